"""Records rollouts of models whose state is more than positions, velocities and activations, or whose actuators have several controls.

    pip install mujoco==4.0.0 numpy
    python tests/goldens/make_rolls.py

One file per model, rolls/<model>.npz:

    ctrl                  controls, [steps, nu]
    <integrator>/<field>  qpos, qvel, act, history, plastic and sensordata after each step, [steps, ...]
    start/qvel            velocities at the beginning; all else as after a reset to the first keyframe, if there is one
"""

import mujoco
import numpy as np

import make

OUT = make.HERE / "rolls"
NAMES = ("delays", "springyield", "controllers", "dcmotor", "orientation")
INTEGRATORS = ("Euler", "RK4", "implicitfast", "implicit", "discrete")
FIELDS = ("qpos", "qvel", "act", "history", "plastic", "sensordata")
STEPS = 40


def record(name):
    model = mujoco.MjModel.from_xml_path(str(make.MODELS / "unit" / f"{name}.xml"))
    make.converge(model)
    rng = np.random.default_rng(sum(name.encode()))
    lo, hi = make.control_range(model)
    # Held for a few steps each, so that what follows slowly has time to.
    ctrl = np.repeat(rng.uniform(1.2 * lo, 1.2 * hi, (STEPS // 4, model.nu)), 4, axis=0)
    qvel = 2.0 * rng.standard_normal(model.nv)
    arrays = {"ctrl": ctrl, "start/qvel": qvel}
    for integrator in INTEGRATORS:
        model.opt.integrator = getattr(mujoco.mjtIntegrator, "mjINT_" + integrator.upper())
        data = mujoco.MjData(model)
        if model.nkey:
            mujoco.mj_resetDataKeyframe(model, data, 0)
        data.qvel[:] = qvel
        rows = {field: [] for field in FIELDS if getattr(data, field).size}
        for u in ctrl:
            data.ctrl[:] = u
            mujoco.mj_step(model, data)
            # What sensors tell is of the state in which a step begins.
            for field, row in rows.items():
                row.append(np.array(getattr(data, field)))
        arrays.update({f"{integrator}/{field}": np.array(row) for field, row in rows.items()})
    size = make.save(OUT / f"{name}.npz", arrays)
    print(f"{name:14s} {size / 1e3:.1f} kB", flush=True)


if __name__ == "__main__":
    if mujoco.__version__ != make.VERSION:
        raise SystemExit(f"MuJoCo {make.VERSION} is needed, this is {mujoco.__version__}")
    OUT.mkdir(exist_ok=True)
    for model_name in NAMES:
        record(model_name)
