"""Records MuJoCo's contacts of pairs of shapes that are aligned or parallel, for tests/collision/aligned.rs.

    pip install mujoco==4.0.0 numpy
    python tests/pairs/make_aligned.py

Where shapes are aligned, several sets of points are as good as each other, and which of them MuJoCo takes hangs on rounding:
on how the scene as a whole is turned, and on which way round a shape is that looks the same both ways. (Of a rod that lies
across a box, it takes one end or both.) So every pose is tried in all 24 quarter turns of the scene, with the first shape
turned in itself, and all distinct points are recorded. Poses whose deepest distance, or the normal there, hang on the turn
are left out, and so are those that have a distance near the margin, where single precision may decide otherwise.

aligned.npz holds, per pair of shapes, `<pair>/size` [2, 3], `<pair>/pose` [n, 7], position and quaternion of the second in
the first's axes, `<pair>/ncon` [n], and of each pose's contacts, in the first's axes and padded with zeros to eight,
`<pair>/dist` [n, 8], `<pair>/pos` and `<pair>/normal` [n, 8, 3]. The iterative pairs run with one contact and a tolerance of
1e-9; where on a flat side it lies is MuJoCo's choice alone.
"""

import itertools
import pathlib
import sys

import mujoco
import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "goldens"))
from make import VERSION, save  # noqa: E402

# Sizes of the shapes as the first of a pair and as the second.
FIRST = {
    "plane": (3, 3, 1), "sphere": (0.2,), "capsule": (0.1, 0.3), "ellipsoid": (0.15, 0.3, 0.2), "cylinder": (0.2, 0.3),
    "box": (0.3, 0.2, 0.25),
}
SECOND = {
    "sphere": (0.15,), "capsule": (0.08, 0.2), "ellipsoid": (0.2, 0.1, 0.2), "cylinder": (0.25, 0.2), "box": (0.2, 0.25, 0.15),
}
MARGIN, POSES, MOST = 0.02, 30, 8
GAPS = (-0.01, -0.01, -0.003, 0.01)


def extent(shape, size):
    """Half widths along the shape's own axes."""
    a, b, c = (*size, 0, 0)[:3]
    return np.array({
        "plane": (0, 0, 0), "sphere": (a, a, a), "capsule": (a, a, a + b), "cylinder": (a, a, b), "ellipsoid": (a, b, c),
        "box": (a, b, c),
    }[shape])


def quarter_turns():
    turns = []
    for q in itertools.product((0, 1, -1), repeat=4):
        q = np.array(q, float)
        if q @ q in (1, 2, 4) and not any(abs(q @ p) > 0.99 * np.sqrt(q @ q) for p in turns):
            turns.append(q / np.sqrt(q @ q))
    return turns


def product(p, q):
    out = np.empty(4)
    mujoco.mju_mulQuat(out, p, q)
    return out


def rotation(q):
    out = np.empty(9)
    mujoco.mju_quat2Mat(out, q)
    return out.reshape(3, 3)


def numbers(x):
    return " ".join(repr(float(y)) for y in x)


def iterative(a, b):
    return "ellipsoid" in (a, b) or "cylinder" in (a, b) if a not in ("plane", "sphere") else (a, b) == ("sphere", "ellipsoid")


def models(a, b):
    """The pair in every quarter turn of the scene, the first shape the right way round and turned by half turns in itself."""
    geom = lambda shape, size, rest: f'<geom type="{shape}" size="{numbers(size)}" {rest}/>'  # noqa: E731
    text = lambda q: f"""<mujoco>
      <option ccd_tolerance="1e-9" ccd_iterations="200"><flag multiccd="disable"/></option>
      <worldbody>
        {geom(a, FIRST[a], f'margin="{MARGIN}" quat="{numbers(q)}"')}
        <body><freejoint/>{geom(b, SECOND[b], '')}</body>
      </worldbody></mujoco>"""  # noqa: E731
    halves = np.eye(4)[:1] if a == "plane" else np.eye(4)
    return [(q, mujoco.MjModel.from_xml_string(text(product(q, half)))) for q in quarter_turns() for half in halves]


def contacts(q, m, pose):
    """Contacts in the first shape's axes."""
    d = mujoco.MjData(m)
    turn = rotation(q)
    d.qpos[:] = np.r_[turn @ pose[:3], product(q, pose[3:])]
    mujoco.mj_fwdPosition(m, d)
    return [np.r_[c.dist, turn.T @ c.pos, turn.T @ c.frame[:3]] for c in d.contact]


def distinct(found):
    kept = []
    for c in found:
        if not any(np.abs(c - other).max() < 1e-5 for other in kept):
            kept.append(c)
    return kept


def recorded(pair, pose, one):
    """The distinct contacts, or `one` of them; none where MuJoCo does not agree with itself."""
    sets = [contacts(q, m, pose) for q, m in pair]
    if any(not found or any(abs(c[0] - MARGIN) < 2e-3 for c in found) for found in sets):
        return None
    deepest = np.array([min(found, key=lambda c: c[0]) for found in sets])
    off = np.abs(deepest - deepest[0])
    if off[:, 0].max() > 1e-9 or off[:, 4:].max() > 1e-6:
        return None
    return [deepest[0]] if one else distinct([c for found in sets for c in found])


def aligned(a, b, rng):
    """A pose with axes in quarter turns, or half of one about an axis, sometimes off by next to nothing; side by side along one
    axis, with edges, ends or centres level along the others."""
    turn = quarter_turns()[rng.integers(24)]
    axis = np.eye(3)[rng.integers(3)]
    angle = rng.choice([0, 0, 0, np.pi / 4, 1e-8, 1e-6])
    turn = product(np.r_[np.cos(angle / 2), np.sin(angle / 2) * axis], turn)
    first, second = extent(a, FIRST[a]), np.abs(rotation(turn)) @ extent(b, SECOND[b])
    if b == "sphere":
        second = extent(b, SECOND[b])
    touching = 2 if a == "plane" else rng.integers(3)
    at = np.zeros(3)
    for k in range(3):
        beside = [0, 0.03, first[k] - second[k], 0.5 * (first[k] + second[k]), -first[k]]
        at[k] = rng.choice([-1, 1]) * rng.choice(beside)
    sign = 1 if a == "plane" else rng.choice([-1, 1])
    at[touching] = sign * (first[touching] + second[touching] + rng.choice(GAPS))
    return np.r_[at, turn]


def main():
    if mujoco.__version__ != VERSION:
        raise SystemExit(f"MuJoCo {VERSION} is needed, this is {mujoco.__version__}")
    arrays = {}
    for a, b in itertools.product(FIRST, SECOND):
        if list(FIRST).index(a) > list(FIRST).index(b):
            continue
        pair, rng, poses, rows = models(a, b), np.random.default_rng(1), [], []
        for _ in range(20 * POSES):
            pose = aligned(a, b, rng)
            found = recorded(pair, pose, iterative(a, b))
            if found is not None:
                poses.append(pose)
                rows.append(found)
            if len(poses) == POSES:
                break
        full = lambda size: np.r_[size, np.zeros(3)][:3]  # noqa: E731
        name = f"{a}_{b}"
        padded = np.array([np.r_[row, np.zeros((MOST - len(row), 7))] for row in rows])
        arrays[f"{name}/size"] = np.array([full(FIRST[a]), full(SECOND[b])])
        arrays[f"{name}/pose"] = np.array(poses)
        arrays[f"{name}/ncon"] = np.array([len(row) for row in rows])
        arrays[f"{name}/dist"], arrays[f"{name}/pos"], arrays[f"{name}/normal"] = padded[..., 0], padded[..., 1:4], padded[..., 4:]
        print(name, len(poses))
    print(save(HERE / "aligned.npz", arrays), "bytes")


if __name__ == "__main__":
    main()
