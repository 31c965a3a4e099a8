"""Predictive sampling swings a cart-pole up, and plots how.  python swing_up.py [PLOT.png]

At every decision a few hundred noisy copies of the best plan so far are rolled out at once; the best of them is followed
for a few steps.
"""

import pathlib
import sys

import lanesim
import numpy as np

ZOO = pathlib.Path(__file__).resolve().parents[2] / "models" / "zoo"
SAMPLES, HORIZON, REPLAN, KNOTS = 256, 150, 5, 6
SECONDS, NOISE = 6.0, 0.6


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
history = []

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
        state = states[best, REPLAN - 1]
        plan = np.concatenate([plan[REPLAN:], np.repeat(plan[-1:], REPLAN, axis=0)])

path = np.concatenate(history)
error = np.abs(np.angle(np.exp(1j * path[:, 2])))
print(f"pole within 0.3 rad of upright for the last {np.argmax(error[::-1] > 0.3) * model.opt.timestep:.2f} s")
file = sys.argv[1] if len(sys.argv) > 1 else "swing_up.png"
try:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
except ImportError:
    sys.exit("no plot: pip install matplotlib")
figure, axes = plt.subplots(2, sharex=True)
axes[0].plot(path[:, 0], path[:, 1])
axes[0].set_ylabel("cart, m")
axes[1].plot(path[:, 0], np.unwrap(path[:, 2]))
axes[1].set_ylabel("pole, rad")
axes[1].set_xlabel("time, s")
figure.savefig(file)
print(f"plotted in {file}")
