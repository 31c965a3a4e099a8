"""The same arrays from lanesim and from MuJoCo, field by field, on every model that both can load."""

from __future__ import annotations

import pathlib

import corpus
import lanesim
import mujoco
import numpy as np
import pytest

MODEL_ARRAYS = (
    "qpos0 body_parentid body_mass body_inertia body_ipos body_pos body_invweight0 jnt_type jnt_pos jnt_limited "
    "dof_armature dof_damping dof_invweight0 geom_type geom_bodyid geom_size site_bodyid actuator_acc0 "
    "actuator_gear actuator_ctrlrange key_qpos"
).split()
STATES = 4

# Largest error, relative to the field's size in all states; fields after a contact or a limit found by iteration, and
# those after the solver, are as good as these are.
SMOOTH = 1e-9
SOLVED = 1e-6
# Where a geom's frame is nearly its body's inertial frame MuJoCo takes one for the other.
SAME_FRAME = 1e-6
# A contact this near to its margin may be there or not.
EDGE = 1e-9


def field_error(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Largest difference, relative to the largest number."""
    if ours.shape != theirs.shape:
        return np.inf
    if ours.size == 0:
        return 0.0
    return float(np.abs(ours - theirs).max() / max(np.abs(theirs).max(), 1e-3))


def reference(model: mujoco.MjModel, data: mujoco.MjData) -> dict[str, np.ndarray]:
    """MuJoCo's results for a state."""
    fresh = mujoco.MjData(model)
    for name in ("qpos", "qvel", "act", "ctrl"):
        getattr(fresh, name)[:] = getattr(data, name)
    mujoco.mj_forward(model, fresh)
    names = "xpos xmat xipos subtree_com geom_xpos geom_xmat site_xpos cdof actuator_length actuator_velocity "
    names += "qfrc_bias qfrc_passive actuator_force qfrc_actuator qacc_smooth qfrc_constraint qacc"
    out = {name: np.array(getattr(fresh, name)) for name in names.split()}
    out["qM"] = np.zeros((model.nv, model.nv))
    if model.nv:
        mujoco.mj_fullM(model, fresh, out["qM"])
    out["contact_dist"] = np.sort(fresh.contact.dist)
    out["edge"] = np.abs(fresh.contact.dist - fresh.contact.includemargin).min(initial=np.inf)
    return out


def moved(model: mujoco.MjModel, data: mujoco.MjData) -> dict[str, np.ndarray]:
    """MuJoCo's results for a state that is a rounding away from another: what nobody can tell better."""
    near = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for name in ("qpos", "qvel", "act", "ctrl"):
        own = getattr(data, name)
        getattr(near, name)[:] = own * (1.0 + 1e-15 * rng.standard_normal(own.shape))
    return reference(model, near)


def iterates(model: lanesim.Model) -> bool:
    """Whether some shape can touch whose contacts with others than planes come from iterative routines, as good as their tolerance."""
    colliding = model.geom_type[(model.geom_contype | model.geom_conaffinity) != 0]
    return bool(np.isin(colliding, (4, 5, 7)).any())


def meshes_collide(model: lanesim.Model) -> bool:
    """Whether some mesh can touch: which of many points stand for a flat contact is a choice, and not MuJoCo's."""
    return 7 in model.geom_type[(model.geom_contype | model.geom_conaffinity) != 0]


def convex(model: lanesim.Model) -> bool:
    """Whether there are shapes whose contacts come from iterative routines."""
    return bool(np.isin(model.geom_type, (4, 5, 6, 7)).any())


def mismatches(exact: mujoco.MjModel, model: lanesim.Model) -> list[str]:
    """What differs, in words."""
    out = []
    for name in ("nq", "nv", "nu", "nbody", "njnt", "ngeom", "nsite", "nkey"):
        if getattr(model, name) != getattr(exact, name):
            out.append(f"{name}: {getattr(model, name)} against {getattr(exact, name)}")
    for name in MODEL_ARRAYS if not out else ():
        error = field_error(getattr(model, name).reshape(-1), np.array(getattr(exact, name)).reshape(-1))
        if error > 1e-9:
            out.append(f"{name}: {error:.1e}")
    limited = exact.jnt_limited.astype(bool)  # A range that is not in force is left in the units of the file.
    if not out and field_error(model.jnt_range[limited], exact.jnt_range[limited]) > 1e-9:
        out.append("jnt_range")
    if out:
        return out
    given = list(corpus.states(exact, STATES))
    worlds = lanesim.Worlds(model, STATES, threads=1)
    for name in ("qpos", "qvel", "act", "ctrl"):
        worlds.set(name, np.array([getattr(data, name) for data in given]))
    theirs = [reference(exact, data) for data in given]
    names = [name for name in theirs[0] if name not in ("contact_dist", "edge")]
    ours = worlds.get([*names, "contact_dist", "contact_margin", "ncon"])
    for i, wanted in enumerate(theirs):
        gaps = np.abs(ours["contact_dist"][i] - ours["contact_margin"][i])[: ours["ncon"][i]]
        if min(wanted["edge"], gaps.min(initial=np.inf)) < EDGE:
            continue
        found = np.sort(ours["contact_dist"][i][: ours["ncon"][i]])
        judged = names
        if meshes_collide(model) and (len(found) or len(wanted["contact_dist"])):
            judged = [name for name in names if name not in ("qfrc_constraint", "qacc")]
            wanted["contact_dist"] = found
        if len(found) != len(wanted["contact_dist"]):
            out.append(f"state {i}: {len(found)} contacts against {len(wanted['contact_dist'])}")
            continue
        loose = 1e3 if convex(model) and len(found) else 1.0
        for name in judged:
            solved = name in ("qfrc_constraint", "qacc")
            error = field_error(ours[name][i], wanted[name].reshape(ours[name][i].shape))
            smooth = SAME_FRAME if name == "geom_xmat" else SMOOTH
            limit = SOLVED * loose if solved else smooth
            # Paths of tendons may hang on the last digit: as far as MuJoCo's own numbers move, ours may be off.
            if error > limit and error > 10.0 * field_error(moved(exact, given[i])[name], wanted[name]):
                out.append(f"state {i}: {name}: {error:.1e}")
        if field_error(found, wanted["contact_dist"]) > SMOOTH * loose:
            out.append(f"state {i}: contact_dist: {field_error(found, wanted['contact_dist']):.1e}")
    return out


def compare(paths: list[pathlib.Path]) -> tuple[int, list[str], list[str]]:
    """Number of models that were compared, what differs, and which were passed over and why."""
    compared, wrong, passed_over = 0, [], []
    for path in paths:
        exact = corpus.load_mujoco(path)
        if exact is None:
            passed_over.append(f"{path.name}: not a model of its own")
            continue
        try:
            model = lanesim.Model.from_xml_path(path, options=corpus.OPTIONS)
        except lanesim.ModelError as error:
            if corpus.unsupported(error):
                passed_over.append(f"{path.name}: {error.diagnostics[0].message}")
            else:
                wrong.append(f"{path.name}: {error}")
            continue
        corpus.settle(exact)
        compared += 1
        wrong += [f"{path.name}: {text}" for text in mismatches(exact, model)]
    return compared, wrong, passed_over


def report(compared: int, wrong: list[str], passed_over: list[str]) -> str:
    """The outcome, for whoever reads a failure."""
    return "\n".join([f"{compared} compared", *wrong, f"{len(passed_over)} passed over:", *passed_over])


def test_models_of_this_repository() -> None:
    compared, wrong, passed_over = compare(corpus.ours())
    assert not wrong, report(compared, wrong, passed_over)
    assert compared >= 70, report(compared, wrong, passed_over)


@pytest.mark.parametrize("package, least", [("dm_control", 10), ("gymnasium", 8)])
def test_installed_models(package: str, least: int) -> None:
    compared, wrong, passed_over = compare(corpus.installed(package))
    assert not wrong, report(compared, wrong, passed_over)
    assert compared >= least, report(compared, wrong, passed_over)
