"""Runs and times MuJoCo: one job per line of JSON on standard input, one answer per line on standard output."""

import json
import sys
import time

import mujoco
import numpy as np

INTEGRATORS = {
    name[len("mjINT_") :].lower(): value
    for name, value in mujoco.mjtIntegrator.__members__.items()
}
FASTEST = 1e4


def load(job):
    model = mujoco.MjModel.from_xml_string(job["xml"])
    options = dict(job["options"])
    model.opt.timestep = float(options["timestep"])
    model.opt.integrator = INTEGRATORS[options["integrator"].lower()]
    model.opt.solver = getattr(mujoco.mjtSolver, "mjSOL_" + options["solver"].upper())
    if "iterations" in options:
        model.opt.iterations = int(options["iterations"])
        model.opt.tolerance = float(options["tolerance"])
    if "cone" in options:
        model.opt.cone = getattr(mujoco.mjtCone, "mjCONE_" + options["cone"].upper())
    return model


def place(model, data, start, control):
    mujoco.mj_resetData(model, data)
    data.qpos[:] = start["qpos"]
    data.qvel[:] = start["qvel"]
    if len(control):
        data.ctrl[:] = control


def lost(data):
    warned = any(
        data.warning[w].number
        for w in (
            mujoco.mjtWarning.mjWARN_BADQPOS,
            mujoco.mjtWarning.mjWARN_BADQVEL,
            mujoco.mjtWarning.mjWARN_BADQACC,
        )
    )
    fine = np.isfinite(data.qpos).all() and (np.abs(data.qvel) <= FASTEST).all()
    return bool(warned or not fine)


def trajectory(model, data, job, world):
    controls = job["controls"][world] if job["controls"] else None
    place(model, data, job["starts"][world], controls[0] if controls else [])
    states = [data.qpos.tolist() + data.qvel.tolist()]
    for interval in range(job["intervals"]):
        if controls:
            data.ctrl[:] = controls[interval]
        mujoco.mj_step(model, data, job["steps"])
        if (interval + 1) % job["every"]:
            continue
        if lost(data):
            return {"states": states, "lost": True}
        states.append(data.qpos.tolist() + data.qvel.tolist())
    return {"states": states, "lost": False}


def timed(model, data, timing):
    best, runs, begin = np.inf, 0, time.perf_counter()
    while runs < 3 or time.perf_counter() - begin < timing["seconds"]:
        place(model, data, timing["start"], timing["control"])
        start = time.perf_counter()
        mujoco.mj_step(model, data, timing["steps"])
        seconds = time.perf_counter() - start
        runs += 1
        best = min(best, seconds)
        if seconds > 4:
            break
    return None if lost(data) else best / timing["steps"]


def run(job):
    model = load(job)
    data = mujoco.MjData(model)
    worlds = range(len(job["starts"]))
    trajectories = [trajectory(model, data, job, world) for world in worlds]
    alive = not all(t["lost"] for t in trajectories)
    seconds = timed(model, data, job["timing"]) if alive and job["timing"]["steps"] else None
    return {"trajectories": trajectories, "seconds_per_step": seconds}


def main():
    mujoco.set_mju_user_warning(lambda message: None)
    print(json.dumps({"version": mujoco.__version__}), flush=True)
    for line in sys.stdin:
        try:
            answer = run(json.loads(line))
        except Exception as error:  # Whatever it is, the caller reports it.
            answer = {"error": str(error)}
        print(json.dumps(answer), flush=True)


main()
