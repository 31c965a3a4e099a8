"""Predictive sampling swings a cart-pole up, and plots how.  python swing_up.py [PLOT.png] [--quick]

At every decision a few hundred noisy copies of the best plan so far are rolled out at once; the best of them is followed
for a few steps. The plot needs matplotlib: pip install './python[examples]'.
"""

import argparse
import pathlib

import lanesim
import numpy as np

ZOO = pathlib.Path(__file__).resolve().parents[2] / "models" / "zoo"
SAMPLES, HORIZON, REPLAN, KNOTS = 256, 150, 5, 6
NOISE = 0.6
parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("plot", nargs="?", default="swing_up.png", help="where the plot goes")
parser.add_argument("--quick", action="store_true", help="the first moments only, to see that it runs")
args = parser.parse_args()
SECONDS = 0.3 if args.quick else 6.0


def cost(state: np.ndarray, control: np.ndarray, model: lanesim.Model) -> np.ndarray:
    """Of each rollout: the pole should point up (angle 0), the cart stay near the middle, and both come to rest."""
    x, angle = state[..., 1], state[..., 2]
    speed = state[..., 1 + model.nq :]
    up = 1.0 - np.cos(angle)
    rest = np.exp(-4.0 * up) * np.square(speed).sum(axis=2)
    return (up + 0.05 * x**2 + 0.002 * rest + 0.001 * np.square(control).sum(axis=2)).mean(axis=1)


model = lanesim.Model.from_xml_path(ZOO / "cartpole.xml")
low, high = model.actuator_ctrlrange.T
rng = np.random.default_rng(0)
hanging = model.key("hanging")
state = np.concatenate([[0.0], hanging.qpos, hanging.qvel])
plan = np.zeros((HORIZON, model.nu))
grid = np.linspace(0, KNOTS - 1, HORIZON)
history, controls = [], []

with lanesim.Rollout() as pool:
    while state[0] < SECONDS:
        knots = rng.normal(0.0, NOISE, (SAMPLES, KNOTS, model.nu)) * (high - low) / 2
        knots[0] = 0.0  # The plan itself takes part.
        left = grid.astype(int).clip(max=KNOTS - 2)
        weight = (grid - left)[:, None]
        noise = (1 - weight) * knots[:, left] + weight * knots[:, left + 1]
        control = np.clip(plan + noise, low, high)
        states, _ = pool.rollout(model, state, control)
        best = cost(states, control, model).argmin()
        plan = control[best]
        history.append(states[best, :REPLAN])
        controls.append(plan[:REPLAN])
        state = states[best, REPLAN - 1]
        plan = np.concatenate([plan[REPLAN:], np.repeat(plan[-1:], REPLAN, axis=0)])

path, applied = np.concatenate(history), np.concatenate(controls)
error = np.abs(np.angle(np.exp(1j * path[:, 2])))
held = len(error) if (error <= 0.3).all() else np.argmax(error[::-1] > 0.3)
print(f"pole within 0.3 rad of upright for the last {held * model.opt.timestep:.2f} s")
try:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
except ImportError:
    raise SystemExit("no plot: pip install matplotlib") from None

time, pole = path[:, 0], np.unwrap(path[:, 2])
upright = 2 * np.pi * np.round(pole[-1] / (2 * np.pi))  # The upright nearest to the end, after as many turns.
figure, axes = plt.subplots(3, sharex=True, figsize=(8, 7), layout="constrained")
figure.suptitle(f"Cart-pole swung up by predictive sampling: {SAMPLES} plans of {HORIZON * model.opt.timestep:.2f} s")
gear = model.actuator_gear[0, 0]  # N per unit of control
rail = model.jnt_range[0] if model.jnt_limited[0] else None
panels = [
    (axes[0], path[:, 1], "cart position, m", 0.0, "target", rail, "end of the rail"),
    (axes[1], pole, "pole angle, rad", upright, "target: upright", None, ""),
    (
        axes[2],
        gear * applied[:, 0],
        "force on the cart, N",
        None,
        "",
        (gear * low[0], gear * high[0]),
        "actuator limit",
    ),
]
for axis, values, label, target, target_label, limits, limit_label in panels:
    axis.plot(time, values, linewidth=1.2)
    axis.set_ylabel(label)
    axis.grid(alpha=0.3)
    if target is not None:
        axis.axhline(target, color="tab:green", linestyle="--", label=target_label)
    for i, limit in enumerate(limits if limits is not None else ()):
        axis.axhline(limit, color="tab:red", linestyle=":", label=limit_label if i == 0 else None)
    if target is not None or limits is not None:
        axis.legend(loc="lower right", fontsize="small")
axes[2].set_xlabel("time, s")
axes[0].set_xlim(0.0, time[-1])
figure.savefig(args.plot, dpi=120)
print(f"plotted in {args.plot}")
