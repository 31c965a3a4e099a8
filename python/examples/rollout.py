"""A thousand ants under random controls: where do they end up?  python rollout.py [MODEL]"""

import pathlib
import sys

import lanesim
import numpy as np

ZOO = pathlib.Path(__file__).resolve().parents[2] / "models" / "zoo"
model = lanesim.Model.from_xml_path(sys.argv[1] if len(sys.argv) > 1 else ZOO / "ant.xml")

nbatch, nstep = 1000, 250
rng = np.random.default_rng(0)
start = np.concatenate([[0.0], model.qpos0, np.zeros(model.nv)])  # time, qpos, qvel
control = rng.uniform(-1, 1, (nbatch, nstep, model.nu))

state, _ = lanesim.rollout(model, start, control)  # [nbatch, nstep, 1 + nq + nv]

travelled = np.linalg.norm(state[:, -1, 1:3] - state[:, 0, 1:3], axis=1)
print(f"{model.name}: {nbatch} rollouts of {state[0, -1, 0]:.2f} s")
print(f"distance travelled: median {np.median(travelled):.2f} m, best {travelled.max():.2f} m")
