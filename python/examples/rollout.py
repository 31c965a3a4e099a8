"""A thousand ants under random controls: where do they end up?  python rollout.py [MODEL] [--quick]"""

import argparse
import pathlib

import lanesim
import numpy as np

ZOO = pathlib.Path(__file__).resolve().parents[2] / "models" / "zoo"
parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("model", nargs="?", default=str(ZOO / "ant.xml"))
parser.add_argument("--quick", action="store_true", help="a few short rollouts, to see that it runs")
args = parser.parse_args()

model = lanesim.Model.from_xml_path(args.model)
nbatch, nstep = (10, 25) if args.quick else (1000, 250)
rng = np.random.default_rng(0)
start = np.concatenate([[0.0], model.qpos0, np.zeros(model.nv + model.na)])  # time, qpos, qvel, act
control = rng.uniform(-1, 1, (nbatch, nstep, model.nu))

state, _ = lanesim.rollout(model, start, control)  # [nbatch, nstep, 1 + nq + nv + na]

travelled = np.linalg.norm(state[:, -1, 1:3] - state[:, 0, 1:3], axis=1)
print(f"{model.name}: {nbatch} rollouts of {state[0, -1, 0]:.2f} s")
print(f"distance travelled: median {np.median(travelled):.2f} m, best {travelled.max():.2f} m")
