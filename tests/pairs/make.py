"""Records MuJoCo's contacts of two free bodies at random poses, for tests/collision.rs.

    pip install mujoco==4.0.0 numpy
    python tests/pairs/make.py

poses.npz holds, per pair of shapes, `<pair>/qpos` [40, 14], `<pair>/ncon` [40], and of each pose's contacts, padded with
zeros to eight, `<pair>/dist` [40, 8], `<pair>/pos` and `<pair>/normal` [40, 8, 3]. Convex pairs without a formula run with one
contact and a tolerance of 1e-9. Poses whose contacts change with a motion of 1e-7 are left out.
"""

import pathlib
import sys

import mujoco
import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "goldens"))
from make import VERSION, save  # noqa: E402

SIZES = {"sphere": "0.2", "capsule": "0.1 0.3", "ellipsoid": "0.15 0.3 0.2", "cylinder": "0.2 0.3", "box": "0.3 0.2 0.25"}
SHAPES = list(SIZES)
MARGIN, POSES, MOST = 0.1, 40, 8


def model(a, b):
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option ccd_tolerance="1e-9" ccd_iterations="200"><flag multiccd="disable"/></option>
      <worldbody>
        <body><freejoint/><geom type="{a}" size="{SIZES[a]}" margin="{MARGIN}"/></body>
        <body><freejoint/><geom type="{b}" size="{SIZES[b]}"/></body>
      </worldbody></mujoco>""")


def contacts(m, qpos):
    d = mujoco.MjData(m)
    d.qpos[:] = qpos
    mujoco.mj_forward(m, d)
    return np.array(d.contact.dist), np.array(d.contact.pos), np.array(d.contact.frame)[:, :3]


def pose(rng):
    q = rng.standard_normal((2, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    at = 10 * rng.uniform(-1, 1, 3)
    return np.r_[at, q[0], at + 0.6 * rng.uniform(-1, 1, 3), q[1]]


def steady(m, qpos, rng):
    dist, pos, normal = contacts(m, qpos)
    if not len(dist):
        return False
    near = qpos.copy()
    mujoco.mj_integratePos(m, near, rng.standard_normal(12), 1e-7)
    other = contacts(m, near)
    return len(other[0]) == len(dist) and np.abs(pos - other[1]).max() < 1e-3 and np.abs(normal - other[2]).max() < 1e-3


def main():
    if mujoco.__version__ != VERSION:
        raise SystemExit(f"MuJoCo {VERSION} is needed, this is {mujoco.__version__}")
    arrays = {}
    for i, a in enumerate(SHAPES):
        for b in SHAPES[i:]:
            m, rng = model(a, b), np.random.default_rng(1)
            poses = []
            while len(poses) < POSES:
                q = pose(rng)
                if steady(m, q, rng):
                    poses.append(q)
            rows = [contacts(m, q) for q in poses]
            pad = lambda x: np.concatenate([x, np.zeros((MOST - len(x), *x.shape[1:]))])  # noqa: E731
            name = f"{a}_{b}"
            arrays[f"{name}/qpos"] = np.array(poses)
            arrays[f"{name}/ncon"] = np.array([len(r[0]) for r in rows])
            for k, field in enumerate(("dist", "pos", "normal")):
                arrays[f"{name}/{field}"] = np.array([pad(r[k]) for r in rows])
    print(save(HERE / "poses.npz", arrays), "bytes")


if __name__ == "__main__":
    main()
