"""Records where MuJoCo has the contacts of convex shapes that touch at several points, for tests/collision/manifold.rs.

    pip install mujoco==4.0.0 numpy
    python tests/pairs/make_manifold.py

manifold.npz holds `qpos` [60, 77] and of each pose's contacts, padded with zeros, `pair` [60, 30] (number of the pair, or -1),
`dist` [60, 30], `pos` and `normal` [60, 30, 3]. Left out are poses whose contacts change with a motion of 1e-7, or with the
order of the meshes' vertices, on which the choice among more than four points depends, and that of one of two sides.
"""

import pathlib
import re
import sys

import mujoco
import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "goldens"))
from make import VERSION, save  # noqa: E402

POSES, MOST, PAIRS, APART = 60, 30, 6, 5.0
TEXT = (HERE / "manifold.xml").read_text()


def turned(text, seed):
    """The model with every mesh's vertices in another order."""

    def other(match):
        corners = np.array(match[1].split()).reshape(-1, 3)
        order = np.random.default_rng(seed).permutation(len(corners))
        return f'vertex="{" ".join(corners[order].ravel())}"'

    return re.sub(r'vertex="([^"]*)"', other, text)


def contacts(m, qpos):
    d = mujoco.MjData(m)
    d.qpos[:] = qpos
    mujoco.mj_kinematics(m, d)
    mujoco.mj_comPos(m, d)
    mujoco.mj_collision(m, d)
    number = lambda c: PAIRS - 1 if m.geom(int(c.geom[0])).name == "plane" else int(m.geom(int(c.geom[0])).name[1])  # noqa: E731
    rows = [(number(c), c.dist, *c.pos, *c.frame[:3]) for c in d.contact]
    return np.array(sorted(rows)).reshape(-1, 8)


def same(a, b, tolerance):
    if a.shape != b.shape:
        return False
    off = lambda x: np.abs(b[b[:, 0] == x[0]] - x).max(axis=1).min() if (b[:, 0] == x[0]).any() else 1.0  # noqa: E731
    return all(off(x) < tolerance for x in a)


def quaternion(rng, angle):
    axis = rng.standard_normal(3)
    return np.r_[np.cos(angle / 2), np.sin(angle / 2) * axis / np.linalg.norm(axis)]


def orientation(rng):
    q, r, s = np.zeros(4), np.zeros(4), np.eye(3)[rng.integers(3)]
    quarter = np.pi / 4 * rng.integers(4)
    mujoco.mju_mulQuat(q, np.r_[np.cos(quarter), np.sin(quarter) * s], np.r_[np.cos(x := rng.uniform(0, 3)), 0, 0, np.sin(x)])
    mujoco.mju_mulQuat(r, quaternion(rng, rng.choice([0.05, 0.2, 3.0]) * rng.uniform()), q)
    return r


def pose(m, rng):
    """Of each pair, at random directions, the two a little within each other."""
    qpos = np.zeros((2 * PAIRS - 1, 7))
    qpos[:, 3] = 1
    ways = rng.standard_normal((PAIRS, 3))
    ways[-1] = [0, 0, 1]
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    turns = [orientation(rng) for _ in range(PAIRS)]

    def at(far):
        for k in range(PAIRS):
            base = np.array([APART * k, 0, APART if k < PAIRS - 1 else 0])
            if k < PAIRS - 1:
                qpos[2 * k, :3] = base
            qpos[min(2 * k + 1, 2 * PAIRS - 2), :3] = base + ways[k] * far[k]
            qpos[min(2 * k + 1, 2 * PAIRS - 2), 3:] = turns[k]
        return qpos.ravel().copy()

    low, high = np.zeros(PAIRS), np.full(PAIRS, 4.0)
    for _ in range(25):
        middle = (low + high) / 2
        touch = np.isin(np.arange(PAIRS), contacts(m, at(middle))[:, 0])
        low, high = np.where(touch, middle, low), np.where(touch, high, middle)
    return at(low - rng.uniform(0.002, 0.04, PAIRS))


def record(name, m, found_at, pose, keeps, count, most):
    """Poses whose contacts bear a motion of 1e-7 and that `keeps` accepts; their contacts, padded; the file's size is printed."""
    if mujoco.__version__ != VERSION:
        raise SystemExit(f"MuJoCo {VERSION} is needed, this is {mujoco.__version__}")
    rng = np.random.default_rng(1)
    poses, rows = [], []
    while len(poses) < count:
        qpos = pose(m, rng)
        found, near = found_at(m, qpos), qpos.copy()
        mujoco.mj_integratePos(m, near, rng.standard_normal(m.nv), 1e-7)
        if keeps(qpos, found) and same(found, found_at(m, near), 1e-4):
            poses.append(qpos)
            rows.append(found)
    pad = lambda x, fill: np.concatenate([x, np.full((most - len(x), *x.shape[1:]), fill)])  # noqa: E731
    arrays = {
        "qpos": np.array(poses),
        "pair": np.array([pad(r[:, 0], -1) for r in rows]),
        "dist": np.array([pad(r[:, 1], 0.0) for r in rows]),
        "pos": np.array([pad(r[:, 2:5], 0.0) for r in rows]),
        "normal": np.array([pad(r[:, 5:], 0.0) for r in rows]),
    }
    print(save(HERE / name, arrays), "bytes", np.bincount([len(r) for r in rows]))


def main():
    others = [mujoco.MjModel.from_xml_string(turned(TEXT, seed)) for seed in range(8)]
    keeps = lambda qpos, found: all(same(found, contacts(other, qpos), 1e-5) for other in others)  # noqa: E731
    record("manifold.npz", mujoco.MjModel.from_xml_string(TEXT), contacts, pose, keeps, POSES, MOST)


if __name__ == "__main__":
    main()
