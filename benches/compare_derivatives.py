"""Speed of derivatives beside MuJoCo's C engine, in one run on one core, with how far they are apart.

    pip install mujoco==4.0.0 numpy, and the package in python/
    python benches/compare_derivatives.py models/zoo/humanoid18.xml models/zoo/ant.xml
    python benches/compare_derivatives.py MODEL... --states 64 --forward --precision f64
    python benches/compare_derivatives.py MODEL... --states 1000 --method exact

For every model, ``lanesim.transition`` and ``mujoco.mjd_transitionFD`` run in turn, --repeats times, over states along a motion under
uniform control noise; times are the processor's, per state, the ratio is the median of the ratios of neighbours. MuJoCo solves as the model says, we
solve until nothing is left but rounding. The difference is that to MuJoCo's derivatives when it solves so, too, relative to the largest entry:
its median over the states and the worst, which is where a contact begins or ends within eps.
"""

import argparse
import os
import statistics
import time

import lanesim
import mujoco
import numpy as np

EPS = 1e-6
CONVERGED = dict(tolerance=1e-18, iterations=200, ls_tolerance=1e-9, ls_iterations=100)


def motion(model, nstate, seed):
    """States along a motion, a few steps apart."""
    rng, data = np.random.default_rng(seed), mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    rows = {name: [] for name in ("qpos", "qvel", "act", "ctrl")}
    limited = model.actuator_ctrllimited.astype(bool)
    low, high = np.where(limited[:, None], model.actuator_ctrlrange, [[-1.0, 1.0]]).T
    for step in range(200 + 5 * nstate):
        data.ctrl = rng.uniform(low, high)
        mujoco.mj_step(model, data)
        if step >= 200 and step % 5 == 0:
            for name, values in rows.items():
                values.append(getattr(data, name).copy())
    return {name: np.array(values) for name, values in rows.items()}


def theirs(model, data, rows, centred):
    """MuJoCo's derivatives, and the seconds that they took."""
    n, count = 2 * model.nv + model.na, len(rows["qpos"])
    A, B = np.zeros((count, n, n)), np.zeros((count, n, model.nu))
    seconds = 0.0
    for i in range(count):
        for name, values in rows.items():
            setattr(data, name, values[i])
        mujoco.mj_forward(model, data)
        start = time.process_time()
        mujoco.mjd_transitionFD(model, data, EPS, centred, A[i], B[i] if model.nu else None, None, None)
        seconds += time.process_time() - start
    return A, B, seconds


def compare(path, args):
    reference = mujoco.MjModel.from_xml_path(path)
    # Sensors are not asked for.
    reference.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    data = mujoco.MjData(reference)
    model = lanesim.Model.from_xml_path(path, lenient=True)
    rows = motion(reference, args.states, args.seed)
    given = {name: values for name, values in rows.items() if values.size}
    how = dict(method="exact") if args.method == "exact" else dict(eps=EPS, centred=not args.forward)
    run = lambda: lanesim.transition(model, **given, **how, threads=1, precision=args.precision)
    found, ratios, ours, mujocos = run(), [], [], []
    for _ in range(args.repeats):
        mujocos.append(theirs(reference, data, rows, not args.forward)[2] / args.states)
        start = time.process_time()
        run()
        ours.append((time.process_time() - start) / args.states)
        ratios.append(mujocos[-1] / ours[-1])
    for name, value in CONVERGED.items():
        setattr(reference.opt, name, value)
    A, _, _ = theirs(reference, data, rows, not args.forward)
    error = np.abs(found.A - A).max((1, 2)) / np.abs(A).max((1, 2))
    name = os.path.splitext(os.path.basename(path))[0]
    figures = [statistics.median(ours) * 1e6, statistics.median(mujocos) * 1e6, statistics.median(ratios)]
    print(
        f"| {name} | {2 * reference.nv + reference.na + reference.nu} | {figures[0]:.1f} | {figures[1]:.0f} | {figures[2]:.1f} "
        f"| {np.nanmedian(error):.1e} | {np.nanmax(error):.1e} | {int(np.isnan(error).sum())} |",
        flush=True,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="+", metavar="MODEL")
    parser.add_argument("--states", type=int, default=64, help="states of a call")
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--method", choices=("fd", "exact"), default="fd", help="of ours: differences as MuJoCo's, or exact")
    parser.add_argument("--forward", action="store_true", help="to one side, not centred")
    parser.add_argument("--precision", choices=("f64", "f32"), default="f64")
    parser.add_argument("--core", type=int, help="processor to stay on")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    if args.core is not None and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {args.core})
    print("| model | columns | ours, µs a state | MuJoCo, µs | ratio | difference, median | worst | without |")
    print("|---|---|---|---|---|---|---|---|")
    for path in args.models:
        compare(path, args)


if __name__ == "__main__":
    main()
