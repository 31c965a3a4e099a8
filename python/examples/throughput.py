"""Steps per second of lanesim.rollout and of mujoco.rollout, same model, same start, same controls.

python throughput.py [MODEL] [--nbatch 4096] [--nstep 100] [--threads 1]     needs mujoco: pip install './python[examples]'
"""

import argparse
import pathlib
import time

import lanesim
import numpy as np

ZOO = pathlib.Path(__file__).resolve().parents[2] / "models" / "zoo"
parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("model", nargs="?", default=str(ZOO / "humanoid18.xml"))
parser.add_argument("--nbatch", type=int, default=4096)
parser.add_argument("--nstep", type=int, default=100)
parser.add_argument("--threads", type=int, default=1)
args = parser.parse_args()

model = lanesim.Model.from_xml_path(args.model)
rng = np.random.default_rng(0)
low, high = model.actuator_noiserange.T
control = rng.uniform(low, high, (args.nbatch, args.nstep, model.nu))
start = np.concatenate([[0.0], model.qpos0, np.zeros(model.nv + model.na)])
start = np.tile(start, (args.nbatch, 1))
start[:, 1 + model.nq : 1 + model.nq + model.nv] = 0.01 * rng.standard_normal((args.nbatch, model.nv))
steps = args.nbatch * args.nstep


def best(run, repeats: int = 3) -> tuple[float, np.ndarray]:
    """Steps per second of the fastest of a few runs, and the final states."""
    rates = []
    for _ in range(repeats):
        before = time.perf_counter()
        state = run()
        rates.append(steps / (time.perf_counter() - before))
    return max(rates), state[:, -1]


def report(name: str, rate: float, final: np.ndarray, reference: np.ndarray) -> None:
    error = np.median(np.abs(final - reference).max(axis=1))
    print(f"{name:14} {rate:12,.0f} steps/s   median difference of final states {error:.1e}")


try:
    import mujoco
    from mujoco import rollout as mujoco_rollout
except ImportError:
    raise SystemExit("this compares with MuJoCo: pip install mujoco") from None

exact = mujoco.MjModel.from_xml_path(args.model)
datas = [mujoco.MjData(exact) for _ in range(args.threads)]
their_rate, theirs = best(lambda: mujoco_rollout.rollout(exact, datas, start, control, persistent_pool=True)[0], 1)
print(f"{model.name}: {args.nbatch} rollouts x {args.nstep} steps, {args.threads} threads")
report("mujoco.rollout", their_rate, theirs, theirs)
for precision in ("f64", "f32"):
    with lanesim.Rollout(threads=args.threads, precision=precision) as pool:
        rate, final = best(lambda: pool.rollout(model, start, control)[0])
    report(f"lanesim {precision}", rate, final, theirs)
    print(f"{'':14} {rate / their_rate:12.1f} x mujoco.rollout")
mujoco_rollout.shutdown_persistent_pool()
