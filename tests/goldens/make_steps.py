"""Records steps of the other integrators, and inverse dynamics, at the states of the goldens.

    pip install mujoco==4.0.0 numpy
    python tests/goldens/make_steps.py            every model that has a golden
    python tests/goldens/make_steps.py ant hinge  only these

One file per model, steps/<model>.npz, with one row for each state of <model>.npz:

    <integrator>/                qpos, qvel and act after one mj_step by RK4, implicitfast, implicit and discrete
    inverse/qacc                 accelerations: those of mj_forward, changed at random by a tenth
    inverse/qfrc_inverse         what mj_inverse makes of them
    inverse/qfrc_inverse_<integrator>   the same with the flag invdiscrete, for Euler, implicitfast, implicit and discrete

Solver settings are those of `make.py`.
"""

import sys

import mujoco
import numpy as np

import make

OUT = make.HERE / "steps"
INTEGRATORS = ("discrete", "RK4", "implicitfast", "implicit")
DISCRETE = ("Euler", "implicitfast", "implicit", "discrete")


def choose(model, integrator):
    model.opt.integrator = getattr(mujoco.mjtIntegrator, "mjINT_" + integrator.upper())


def inverse(model, state, qacc):
    # What actuators gain with velocity depends on whether they are at their bounds, which inverse dynamics does not find by itself.
    data = make.forward(model, state)
    data.qacc[:] = qacc
    mujoco.mj_inverse(model, data)
    return np.array(data.qfrc_inverse)


def record(path):
    model = mujoco.MjModel.from_xml_path(str(path))
    make.converge(model)
    own = model.opt.integrator
    rng = np.random.default_rng(sum(path.stem.encode()) + 1)
    with np.load(make.HERE / (path.stem + ".npz")) as golden:
        given = {k: golden["in/" + k] for k in make.inputs(model) if "in/" + k in golden}
        count = len(golden["out/ncon"])
    arrays = {}

    def add(name, row):
        arrays.setdefault(name, []).append(np.array(row))

    for i in range(count):
        state = {k: v[i] for k, v in given.items()}
        for integrator in INTEGRATORS:
            choose(model, integrator)
            warm = np.array(make.forward(model, state).qacc)
            data = make.start(model, state)
            if model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC:
                data.qacc_warmstart[:] = warm
            mujoco.mj_step(model, data)
            add(integrator + "/qpos", data.qpos)
            add(integrator + "/qvel", data.qvel)
            if model.na:
                add(integrator + "/act", data.act)
        model.opt.integrator = own
        qacc = warm + 0.1 * (1 + np.abs(warm)) * rng.standard_normal(model.nv)
        add("inverse/qacc", qacc)
        add("inverse/qfrc_inverse", inverse(model, state, qacc))
        model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
        for integrator in DISCRETE:
            choose(model, integrator)
            add("inverse/qfrc_inverse_" + integrator, inverse(model, state, qacc))
        model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
    size = make.save(OUT / (path.stem + ".npz"), {k: np.array(v) for k, v in arrays.items()})
    print(f"{path.stem:22s} {count} states, {size / 1e3:.1f} kB", flush=True)


def main():
    if mujoco.__version__ != make.VERSION:
        raise SystemExit(f"MuJoCo {make.VERSION} is needed, this is {mujoco.__version__}")
    wanted = set(sys.argv[1:])
    paths = [p for folder in ("zoo", "unit") for p in sorted((make.MODELS / folder).glob("*.xml"))]
    for path in paths:
        if not wanted or path.stem in wanted:
            record(path)


if __name__ == "__main__":
    main()
