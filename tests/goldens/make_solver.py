"""Records the constrained acceleration of small scenes for every cone and contact dimension, to judge the solvers alone.

    pip install mujoco==4.0.0 numpy
    python tests/goldens/make_solver.py              every scene under models/solver
    python tests/goldens/make_solver.py plane_box    only this one

A scene is written with `cone="pyramidal"` and `condim="3"`; its variants replace these two words by the other cone and by 1,
4 and 6. One file per scene, solver/<scene>.npz, with N states:

    in/                     qpos qvel qfrc_applied, [N, ...]
    contact/                ncon, geom, pos: which contacts there are, padded with zeros
    out/qacc_smooth         the acceleration without constraints
    <cone><condim>/         nefc, contact_efc (first row of each contact or -1), and the minimiser: qacc qfrc_constraint efc_force
    noslip_<cone><condim>/  qacc after ten iterations of MuJoCo's no-slip pass (scenes of NOSLIP only)

The minimiser. The problem is strictly convex, so that there is one solution, whatever the solver. MuJoCo's Newton solver
runs to 1e-14 in at most 200 iterations and cold. With elliptic cones it now and then stops at a relative gradient of 1e-8,
because it looks at the improvement of the cost. So its answer is polished: `minimise` takes MuJoCo's M, J, D, reference and
cones, the cost as documented for these cones, and Newton steps with gradients in extended precision, for as long as the
gradient shrinks. The script prints the relative gradients before and after.

A state is a random pose in which things just touch (`place`), with random velocity and force, and steady in the sense of
`make.py`: contacts and solution do not jump when the state moves by 1e-9.
"""

import itertools
import sys

import mujoco
import numpy as np

import make

SCENES = make.MODELS / "solver"
OUT = make.HERE / "solver"
STATES = 4
CONES = ("pyramidal", "elliptic")
DIMENSIONS = (1, 3, 4, 6)
# Not the plane scenes: where five friction rows act on a body of four dofs, MuJoCo gives up on the singular block and sets its
# friction to zero.
NOSLIP = ("dry", "equality", "impratio", "pairs", "priority", "sphere_sphere")
Type = mujoco.mjtConstraint
Extended = np.longdouble


def variant(scene, cone, condim):
    """The scene's model with another cone and dimension, set to converge."""
    text = (SCENES / f"{scene}.xml").read_text()
    text = text.replace('cone="pyramidal"', f'cone="{cone}"').replace('condim="3"', f'condim="{condim}"')
    model = mujoco.MjModel.from_xml_string(text)
    make.converge(model)
    return model


# ---- the minimiser --------------------------------------------------------------------------------------------------------

class Problem:
    """minimise ½(a - a₀)ᵀM(a - a₀) + s(J a - a_ref)"""

    def __init__(self, model, data):
        self.M = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, self.M)
        self.J = make.jacobian(model, data)
        self.smooth, self.reference = np.array(data.qacc_smooth), np.array(data.efc_aref)
        self.D, self.kind, self.loss = np.array(data.efc_D), np.array(data.efc_type), np.array(data.efc_frictionloss)
        self.elliptic = [(c.efc_address, c.dim, c.mu, np.array(c.friction)) for c in data.contact
                         if c.efc_address >= 0 and self.kind[c.efc_address] == Type.mjCNSTR_CONTACT_ELLIPTIC]

    def forces(self, y):
        """f = -∇s(y), and the second derivative of s."""
        f, K = np.zeros_like(y), np.zeros((len(y), len(y)))
        for i, kind in enumerate(self.kind):
            if kind == Type.mjCNSTR_CONTACT_ELLIPTIC:
                continue
            pull = -self.D[i] * y[i]
            if kind == Type.mjCNSTR_FRICTION_DOF:
                f[i] = np.clip(pull, -self.loss[i], self.loss[i])
                K[i, i] = self.D[i] if abs(pull) < self.loss[i] else 0
            elif pull > 0 or kind == Type.mjCNSTR_EQUALITY:
                f[i], K[i, i] = pull, self.D[i]
        for start, dim, mu, friction in self.elliptic:
            rows = slice(start, start + dim)
            f[rows], K[rows, rows] = ellipse(y[rows], self.D[rows], mu, friction)
        return f, K

    def gradient(self, a):
        """Gradient in extended precision, row forces, stiffness of the rows, and the relative size of the gradient."""
        a = a.astype(Extended)
        f, K = self.forces(self.J.astype(Extended) @ a - self.reference)
        inertial, constraint = self.M.astype(Extended) @ (a - self.smooth), self.J.T.astype(Extended) @ f
        g = inertial - constraint
        size = np.linalg.norm(self.M @ self.smooth) + np.linalg.norm(constraint.astype(float)) + 1e-300
        return g, f, K, float(np.linalg.norm(g.astype(float))) / size


def ellipse(y, D, mu, friction):
    """Force and stiffness of an elliptic contact."""
    scale = np.concatenate([[mu], friction[:len(y) - 1]])
    U = scale * y
    N, T = U[0], np.sqrt(U[1:] @ U[1:])
    if N >= mu * T:
        return np.zeros_like(y), np.zeros((len(y), len(y)))
    if mu * N + T <= 0:
        return -D * y, np.diag(D)
    stiffness = D[0] / (mu**2 * (1 + mu**2))
    gap, t = N - mu * T, U[1:] / T
    f = -stiffness * gap * np.concatenate([[1], -mu * t]) * scale
    K = np.empty((len(y), len(y)))
    K[0, 0], K[0, 1:], K[1:, 0] = 1, -mu * t, -mu * t
    K[1:, 1:] = mu * N / T * np.outer(t, t) + (mu**2 - mu * N / T) * np.eye(len(t))
    return f, stiffness * K * np.outer(scale, scale)


def minimise(problem, a):
    """The minimiser near `a`: acceleration, row forces, relative gradients at `a` and there."""
    a = a.astype(Extended)
    g, f, K, before = problem.gradient(a)
    after = before
    for _ in range(50):
        step = np.linalg.solve(problem.M + problem.J.T @ K @ problem.J, -g.astype(float))
        for length in (1, 0.5, 0.25, 0.1, 0.01):
            trial = a + length * step
            *found, size = problem.gradient(trial)
            if size < after:
                break
        else:
            break
        a, (g, f, K), after = trial, found, size
    return a.astype(float), f.astype(float), before, after


# ---- states ---------------------------------------------------------------------------------------------------------------

def place(model, rng):
    """Random orientations and joints; then each tree in turn is lowered, or its sliding joint moved, until it just touches."""
    data = mujoco.MjData(model)
    tilt = rng.choice([0.02, 0.3, 2])
    turning = np.ones(model.nv, bool)
    for j in range(model.njnt):
        kind, v = model.jnt_type[j], model.jnt_dofadr[j]
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            turning[v:v + 3] = False
    change = np.where(turning, tilt, 0.03) * rng.uniform(-1, 1, model.nv)
    mujoco.mj_integratePos(model, data.qpos, change, 1.0)
    for body in np.flatnonzero(model.body_parentid[1:] == 0) + 1:
        if model.body_jntnum[body]:
            touch(model, data, body, rng.choice([2e-4, 2e-3, 8e-3]))
    data.qvel[:] = rng.choice([0.02, 0.3, 1]) * rng.standard_normal(model.nv)
    data.qfrc_applied[:] = rng.choice([0, 3]) * rng.standard_normal(model.nv)
    return data


def touch(model, data, body, depth):
    """Moves a tree along its vertical dof so that its deepest contact with what was placed before has this depth."""
    joint = model.body_jntadr[body]
    kind, q = model.jnt_type[joint], model.jnt_qposadr[joint]
    if kind == mujoco.mjtJoint.mjJNT_HINGE:
        return
    q += 2 if kind == mujoco.mjtJoint.mjJNT_FREE else 0

    def deepest():
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        own, least = model.body_rootid[model.geom_bodyid], 1.0
        for c in data.contact:
            roots = own[c.geom[0]], own[c.geom[1]]
            if body in roots and max(roots) == body and min(roots) != body:
                least = min(least, c.dist)
        return least

    high = data.qpos[q] + 1
    data.qpos[q] = high
    while deepest() > -depth and data.qpos[q] > high - 3:
        data.qpos[q] -= 0.01
    low, high = data.qpos[q], data.qpos[q] + 0.01
    for _ in range(30):
        data.qpos[q] = (low + high) / 2
        low, high = (data.qpos[q], high) if deepest() < -depth else (low, data.qpos[q])


def states(scene, rng):
    """Steady in every variant."""
    models = [variant(scene, cone, dim) for cone, dim in itertools.product(CONES, DIMENSIONS)]
    found = []
    while len(found) < STATES:
        data = place(models[0], rng)
        state = {k: np.array(getattr(data, k)) for k in ("qpos", "qvel", "qfrc_applied")}
        if make.forward(models[0], state).nefc and all(make.steady(model, state) for model in models):
            found.append(state)
    return found


# ---- results --------------------------------------------------------------------------------------------------------------

def record(scene):
    rng = np.random.default_rng(sum(scene.encode()))
    found = states(scene, rng)
    arrays = {"in/" + k: np.array([s[k] for s in found]) for k in found[0]}
    before, after, zones = [], [], []
    for cone, dim in itertools.product(CONES, DIMENSIONS):
        model = variant(scene, cone, dim)
        rows = {k: [] for k in ("nefc", "contact_efc", "qacc", "qfrc_constraint", "efc_force")}
        contacts = {k: [] for k in ("ncon", "geom", "pos")}
        smooth = []
        for state in found:
            data = make.forward(model, state)
            problem = Problem(model, data)
            a, f, *gradients = minimise(problem, np.array(data.qacc))
            before.append(gradients[0])
            after.append(gradients[1])
            zones += [zone(f[c.efc_address:c.efc_address + c.dim], c) for c in data.contact
                      if cone == "elliptic" and dim > 1 and c.efc_address >= 0]
            for k, x in zip(rows, (np.array(data.nefc), np.array(data.contact.efc_address), a, problem.J.T @ f, f)):
                rows[k].append(x)
            for k, x in zip(contacts, (np.array(data.ncon), np.array(data.contact.geom), np.array(data.contact.pos))):
                contacts[k].append(x)
            smooth.append(np.array(data.qacc_smooth))
        arrays.update({f"{cone}{dim}/{k}": make.pad(x) for k, x in rows.items()})
        arrays.update({f"contact/{k}": make.pad(x) for k, x in contacts.items()})
        arrays["out/qacc_smooth"] = np.array(smooth)
        if scene in NOSLIP:
            model.opt.noslip_iterations, model.opt.noslip_tolerance = 10, 0
            arrays[f"noslip_{cone}{dim}/qacc"] = np.array([make.forward(model, s).qacc for s in found])
    size = make.save(OUT / f"{scene}.npz", arrays)
    names, counts = np.unique(zones, return_counts=True)
    print(f"{scene:18s} gradient {max(before):.0e} -> {max(after):.0e}, ncon {list(map(int, arrays['contact/ncon']))}, "
          f"elliptic contacts: {dict(zip(map(str, names), map(int, counts)))}, {size / 1e3:.1f} kB", flush=True)


def zone(f, contact):
    """Where the force of an elliptic contact lies."""
    if f[0] == 0:
        return "open"
    side = np.linalg.norm(f[1:] / contact.friction[:len(f) - 1])
    return "slides" if side > (1 - 1e-9) * f[0] else "sticks"


def main():
    if mujoco.__version__ != make.VERSION:
        raise SystemExit(f"MuJoCo {make.VERSION} is needed, this is {mujoco.__version__}")
    OUT.mkdir(exist_ok=True)
    wanted = set(sys.argv[1:])
    for path in sorted(SCENES.glob("*.xml")):
        if not wanted or path.stem in wanted:
            record(path.stem)


if __name__ == "__main__":
    main()
