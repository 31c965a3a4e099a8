"""Clouds by MuJoCo, one state at a time: a job per line of JSON on standard input, an answer per line on standard output."""

import json
import sys
import time

import mujoco
import numpy as np


def load(job):
    model = mujoco.MjModel.from_xml_string(job["xml"])
    model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    for name in ("tolerance", "ls_tolerance", "iterations", "ls_iterations"):
        setattr(model.opt, name, job[name])
    return model


def moved(model, state, points, inverse):
    """The states that the points are: qpos, qvel, and qfrc_applied or qacc, a row each."""
    nv = model.nv
    count = len(points)
    tangent, qvel, drive = np.zeros((3, count, nv))
    qvel += state["qvel"]
    if inverse:
        drive += state["qacc"]
    for row, moves in enumerate(points):
        for kind, dof, distance in moves:
            (tangent, qvel, drive)[kind][row, dof] += distance
    qpos = np.tile(np.array(state["qpos"]), (count, 1))
    for row in np.flatnonzero(tangent.any(axis=1)):
        mujoco.mj_integratePos(model, qpos[row], tangent[row], 1.0)
    return qpos, qvel, drive


def visit(model, data, state, cloud, run):
    """What follows from the points, and the seconds that it took."""
    order, skips, (qpos, qvel, drive) = cloud
    inverse, whole, move = run
    stages = mujoco.mjtStage
    levels = [stages.mjSTAGE_NONE, stages.mjSTAGE_POS, stages.mjSTAGE_VEL]
    target = data.qacc if inverse else data.qfrc_applied
    source = data.qfrc_inverse if inverse else data.qacc
    found = np.empty((len(order), model.nv))
    mujoco.mj_resetData(model, data)
    data.qpos[:], data.qvel[:], data.ctrl[:] = state["qpos"], state["qvel"], state["ctrl"]
    start = time.perf_counter()
    if move:
        mujoco.mj_forward(model, data)
        data.qacc_warmstart[:] = data.qacc
        if inverse:
            data.qacc[:] = state["qacc"]
            mujoco.mj_inverse(model, data)
    warm = data.qacc_warmstart.copy()
    for point, level in zip(order, skips):
        data.qpos[:] = qpos[point]
        data.qvel[:] = qvel[point]
        target[:] = drive[point]
        if not inverse:
            data.qacc_warmstart[:] = warm
        skip = levels[0 if whole else level]
        if not move:
            pass
        elif inverse:
            mujoco.mj_inverseSkip(model, data, skip, 1)
        else:
            mujoco.mj_forwardSkip(model, data, skip, 1)
        found[point] = source
    return found, time.perf_counter() - start


def run(job):
    model = load(job)
    data = mujoco.MjData(model)
    inverse, whole, points = job["inverse"], job["whole"], job["points"]
    level = [min((kind for kind, _, _ in moves), default=2) for moves in points]
    order = sorted(range(len(points)), key=lambda point: -level[point])
    skips = [level[point] for point in order]
    costs, seconds = [], 0.0
    for state in job["states"]:
        cloud = order, skips, moved(model, state, points, inverse)
        _, idle = visit(model, data, state, cloud, (inverse, whole, False))
        found, busy = visit(model, data, state, cloud, (inverse, whole, True))
        # What it takes to move numbers in and out, from Python, is no part of an evaluation.
        seconds += busy - idle
        costs.append((0.5 * (found * found).sum(axis=1)).tolist())
    return {"seconds": seconds, "costs": costs}


def main():
    print(json.dumps({"version": mujoco.__version__}), flush=True)
    for line in sys.stdin:
        try:
            answer = run(json.loads(line))
        except Exception as error:  # Whatever it is, the caller reports it.
            answer = {"error": str(error)}
        print(json.dumps(answer), flush=True)


main()
