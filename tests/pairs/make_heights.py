"""Records where MuJoCo has the contacts of shapes on a height field, for tests/collision/heights.rs.

    pip install mujoco==4.0.0 numpy
    python tests/pairs/make_heights.py

heights.npz holds `qpos` [20, 42] and of each pose's contacts, padded with zeros, `pair` [20, 120] (number of the body, or -1), `dist`
[20, 120], `pos` and `normal` [20, 120, 3]. Left out are poses whose contacts change with a motion of 1e-7, and those where MuJoCo's
search does not find the shortest way of the box out of a prism, by separating axes.
"""

import itertools

import mujoco
import numpy as np
from make_manifold import HERE, quaternion, record

POSES, MOST, BODIES = 20, 120, 6


def contacts(m, qpos):
    d = mujoco.MjData(m)
    d.qpos[:] = qpos
    mujoco.mj_kinematics(m, d)
    mujoco.mj_comPos(m, d)
    mujoco.mj_collision(m, d)
    rows = [(m.geom_bodyid[c.geom[1]] - 1, c.dist, *c.pos, *c.frame[:3]) for c in d.contact]
    return np.array(sorted(rows)).reshape(-1, 8)


def box_distances(m, qpos, body=4):
    """Distances of the box from the prisms that it is in: the least depth along normals of faces and products of edges."""
    d = mujoco.MjData(m)
    d.qpos[:] = qpos
    mujoco.mj_kinematics(m, d)
    turn, half = d.geom_xmat[body + 1].reshape(3, 3), m.geom_size[body + 1]
    box = np.array(list(itertools.product((-1, 1), repeat=3))) * half @ turn.T + d.geom_xpos[body + 1]
    rows, columns = int(m.hfield_nrow[0]), int(m.hfield_ncol[0])
    sx, sy, top, base = m.hfield_size[0]
    heights = m.hfield_data.reshape(rows, columns) * top
    point = lambda r, c: np.array([sx * (2 * c / (columns - 1) - 1), sy * (2 * r / (rows - 1) - 1), heights[r, c]])  # noqa: E731
    found = []
    for r, c in itertools.product(range(rows - 1), range(columns - 1)):
        for middle in ((1, 0), (0, 1)):
            above = np.array([point(r, c), point(r + middle[0], c + middle[1]), point(r + 1, c + 1)])
            below = np.c_[above[:, :2], np.full(3, -base)]
            prism = np.r_[above, below] @ d.geom_xmat[0].reshape(3, 3).T + d.geom_xpos[0]
            if np.linalg.norm((prism[:3].mean(axis=0) - box.mean(axis=0))[:2]) > 1.0:
                continue
            edges = [prism[1] - prism[0], prism[2] - prism[0], prism[2] - prism[1], prism[3] - prism[0]]
            axes = [*turn.T, *(np.cross(a, b) for a, b in itertools.combinations(edges, 2))]
            axes += [np.cross(a, b) for a in edges for b in turn.T]
            axes = np.array([a / np.linalg.norm(a) for a in axes if np.linalg.norm(a) > 1e-9])
            axes = np.r_[axes, -axes]
            found.append(((box @ axes.T).min(axis=0) - (prism @ axes.T).max(axis=0)).max())
    return sorted(x for x in found if x <= 0)


def pose(m, rng):
    """The bodies along x, each a little in the ground."""
    qpos = np.zeros((BODIES, 7))
    qpos[:, 0] = 2.0 * np.arange(BODIES) - 5.0 + rng.uniform(-0.3, 0.3, BODIES)
    qpos[:, 1] = rng.uniform(-1.5, 1.5, BODIES)
    qpos[:, 3:] = [quaternion(rng, rng.uniform(0, 3)) for _ in range(BODIES)]

    def at(height):
        qpos[:, 2] = height
        return qpos.ravel().copy()

    low, high = np.zeros(BODIES), np.full(BODIES, 3.0)
    for _ in range(25):
        middle = (low + high) / 2
        touch = np.isin(np.arange(BODIES), contacts(m, at(middle))[:, 0])
        low, high = np.where(touch, middle, low), np.where(touch, high, middle)
    return at(low - rng.uniform(0.002, 0.08, BODIES))


def main():
    m = mujoco.MjModel.from_xml_string((HERE / "heights.xml").read_text())

    def keeps(qpos, found):
        box, shortest = sorted(found[found[:, 0] == 4, 1]), box_distances(m, qpos)
        return len(box) == len(shortest) and np.allclose(box, shortest, rtol=0, atol=1e-7)

    record("heights.npz", m, contacts, pose, keeps, POSES, MOST)


if __name__ == "__main__":
    main()
