"""Derivatives of steps, of accelerations and of inverse dynamics: states in, linear models out."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _reuse
from ._states import States
from .errors import InputError, OptionError
from .model import Model, check_model
from .progress import Progress, following
from .worlds import PRECISIONS

__all__ = ["Acceleration", "Inverse", "Transition", "acceleration_derivatives", "inverse_derivatives", "transition"]

METHODS = ("fd", "exact")
SOLVING = ("accurate", "fixed_work")
"""How the constraints of states may be solved."""


class Transition(NamedTuple):
    """Derivatives of the states that follow from given ones, as MuJoCo's ``mjd_transitionFD`` has them.

    States are told by differences of ``qpos`` in the tangent space, [nv], then ``qvel``, then ``act``: n = 2 nv + na numbers. NaN
    where a state has none; `status` says why.
    """

    A: NDArray[Any]
    """Of the next state by the state, [..., n, n]."""
    B: NDArray[Any]
    """Of the next state by controls, [..., n, nu]."""
    C: NDArray[Any] | None
    """Of sensors by the state, [..., nsensordata, n]; None unless they were asked for."""
    D: NDArray[Any] | None
    """Of sensors by controls, [..., nsensordata, nu]; None unless they were asked for."""
    sides: NDArray[np.int32]
    """How each column of `A`, then of `B`, was perturbed, [..., n + nu]: 2 to both sides, 1 forward, -1 backward, as controls
    at a limit are, 0 not at all: a control's range leaves no room, and its column is zero; or derivatives are exact."""
    changed: NDArray[np.int32]
    """How many limits and contacts push beside the state that do not push in it, or the other way round, by columns likewise: where
    there are some, the difference goes across a kink. Of exact derivatives, how many rows are within a millionth of where they begin or
    cease to act, or to slide."""
    status: NDArray[np.int32]
    """Bits of `Status`: what happened to each state and to those beside it, [...]."""


class Acceleration(NamedTuple):
    """Derivatives of the acceleration, ``qacc``. `sides`, `changed` and `status` are as in `Transition`."""

    A: NDArray[Any]
    """By the state, [..., nv, n]: n = 2 nv + na."""
    B: NDArray[Any]
    """By controls, [..., nv, nu]."""
    sides: NDArray[np.int32]
    """How each column of `A`, then of `B`, was perturbed, [..., n + nu]."""
    changed: NDArray[np.int32]
    """How many limits and contacts begin or cease to push, by columns likewise."""
    status: NDArray[np.int32]
    """Bits of `Status`, [...]."""


class Inverse(NamedTuple):
    """Derivatives of the force that an acceleration needs, ``qfrc_inverse``. Columns are those of `dq`, then of `dv`, then of `da`."""

    dq: NDArray[Any]
    """By positions in the tangent space, [..., nv, nv]: a row for each force."""
    dv: NDArray[Any]
    """By velocities, [..., nv, nv]."""
    da: NDArray[Any]
    """By accelerations, [..., nv, nv]."""
    sides: NDArray[np.int32]
    """How each column was perturbed, [..., 3 nv]."""
    changed: NDArray[np.int32]
    """How many limits and contacts begin or cease to push, by columns likewise."""
    status: NDArray[np.int32]
    """Bits of `Status`, [...]."""


def transition(
    model: Model,
    qpos: ArrayLike,
    qvel: ArrayLike,
    *,
    act: ArrayLike | None = None,
    ctrl: ArrayLike | None = None,
    qfrc_applied: ArrayLike | None = None,
    xfrc_applied: ArrayLike | None = None,
    mocap_pos: ArrayLike | None = None,
    mocap_quat: ArrayLike | None = None,
    eq_active: ArrayLike | None = None,
    method: str = "fd",
    eps: float | None = None,
    centred: bool = True,
    sensors: bool = False,
    solving: str = "accurate",
    threads: int | None = None,
    precision: str = "f64",
    backend: str = "auto",
    progress: Progress = None,
) -> Transition:
    """Derivatives of steps by state and controls: of one state, of many, or of whole trajectories.

    >>> model = lanesim.Model.from_xml_path("models/zoo/arm.xml")
    >>> A, B, *_ = lanesim.transition(model, qpos, qvel, ctrl=ctrl)     # [nstep, n, n], [nstep, n, nu]

    By differences the same as ``mujoco.mjd_transitionFD`` with the same `eps`, for all integrators. A column's numbers do not depend on
    what else is asked for. Exact derivatives are those of ever smaller differences, and cost far less; not all that a model can have has
    them, and then an error says what. Where rows begin or cease to act there are two, and theirs are those of the rows that act.

    Args:
        model: The model.
        qpos: Positions, [..., nq], with any leading dimensions: none, [N], [nworld, nstep].
        qvel: Velocities, [..., nv].
        act: Activations, [..., na]; None: zero.
        ctrl: Controls, [..., nu]; None: zero.
        qfrc_applied: Generalised forces from outside, [..., nv].
        xfrc_applied: Forces and torques on bodies from outside, [..., nbody, 6].
        mocap_pos: Positions of mocap bodies, [..., nmocap, 3]; None: as the model has them.
        mocap_quat: Orientations of mocap bodies, [..., nmocap, 4]; None: as the model has them.
        eq_active: Which equality constraints are active, [..., neq], 1 or 0; None: as the model has it.
        method: "fd": by differences. "exact": exact but for rounding, in double precision; `eps` and `centred` count for nothing, and
            `sides` is 0.
        eps: How far a number is moved; None: 1e-6, or in single precision 1e-3 (5e-3 if centred).
        centred: Whether it is moved to both sides.
        sensors: Whether derivatives of sensors are wanted.
        solving: "accurate": constraints are solved by Newton's method until nothing is left but rounding, and what does not get there
            is NaN. "fixed_work": as steps solve them, with the model's solver, tolerance and iterations.
        threads: Worker threads; None: as many as there are processors.
        precision: "f64", or "f32", in which derivatives have two or three digits; the results have that type.
        backend: As for `Worlds`; the same bits.
        progress: True for a bar (needs tqdm), or a function of (states done, all of them).

    Raises:
        InputError: Arrays have other shapes, hold numbers that are not finite, or quaternions of length zero.
        OptionError: `eps` is out of bounds, or is given where derivatives are exact.
        UnknownNameError: There is no such way of solving, precision or backend.
    """
    others = {
        "qvel": qvel,
        "act": act,
        "ctrl": ctrl,
        "qfrc_applied": qfrc_applied,
        "xfrc_applied": xfrc_applied,
        "mocap_pos": mocap_pos,
        "mocap_quat": mocap_quat,
        "eq_active": eq_active,
    }
    how = (method, eps, centred, sensors, solving, progress)
    A, B, C, D, *marks = _run("transition", model, qpos, others, how, (threads, precision, backend))
    return Transition(A, B, C if sensors else None, D if sensors else None, *marks)


def acceleration_derivatives(
    model: Model,
    qpos: ArrayLike,
    qvel: ArrayLike,
    *,
    act: ArrayLike | None = None,
    ctrl: ArrayLike | None = None,
    qfrc_applied: ArrayLike | None = None,
    xfrc_applied: ArrayLike | None = None,
    mocap_pos: ArrayLike | None = None,
    mocap_quat: ArrayLike | None = None,
    eq_active: ArrayLike | None = None,
    method: str = "fd",
    eps: float | None = None,
    centred: bool = True,
    solving: str = "accurate",
    threads: int | None = None,
    precision: str = "f64",
    backend: str = "auto",
    progress: Progress = None,
) -> Acceleration:
    """Derivatives of the acceleration ``qacc`` by state and controls. Arguments and errors as of `transition`.

    With the integrator ``discrete``, the acceleration is that over a step.
    """
    others = {
        "qvel": qvel,
        "act": act,
        "ctrl": ctrl,
        "qfrc_applied": qfrc_applied,
        "xfrc_applied": xfrc_applied,
        "mocap_pos": mocap_pos,
        "mocap_quat": mocap_quat,
        "eq_active": eq_active,
    }
    how = (method, eps, centred, False, solving, progress)
    return Acceleration(*_run("acceleration", model, qpos, others, how, (threads, precision, backend)))


def inverse_derivatives(
    model: Model,
    qpos: ArrayLike,
    qvel: ArrayLike,
    qacc: ArrayLike,
    *,
    act: ArrayLike | None = None,
    ctrl: ArrayLike | None = None,
    mocap_pos: ArrayLike | None = None,
    mocap_quat: ArrayLike | None = None,
    eq_active: ArrayLike | None = None,
    discrete: bool | None = None,
    method: str = "fd",
    eps: float | None = None,
    centred: bool = True,
    threads: int | None = None,
    precision: str = "f64",
    backend: str = "auto",
    progress: Progress = None,
) -> Inverse:
    """Derivatives of inverse dynamics by positions, velocities and accelerations, as MuJoCo's ``mjd_inverseFD``, but not transposed.

    >>> dq, dv, da, *_ = lanesim.inverse_derivatives(model, qpos, qvel, qacc)     # [..., nv, nv] each

    Args:
        model: The model.
        qpos: Positions, [..., nq], with any leading dimensions.
        qvel: Velocities, [..., nv].
        qacc: Accelerations, [..., nv].
        act: Activations, [..., na]; None: zero.
        ctrl: Controls, [..., nu]; None: zero; see `inverse`.
        mocap_pos: Positions of mocap bodies, [..., nmocap, 3]; None: as the model has them.
        mocap_quat: Orientations of mocap bodies, [..., nmocap, 4]; None: as the model has them.
        eq_active: Which equality constraints are active, [..., neq], 1 or 0; None: as the model has it.
        discrete: As of `inverse`.
        method: "fd": by differences. "exact": exact but for rounding, in double precision; `eps` and `centred` count for nothing, and
            `sides` is 0.
        eps: How far a number is moved; None: 1e-6, or in single precision 1e-3 (5e-3 if centred).
        centred: Whether it is moved to both sides.
        threads: Worker threads; None: as many as there are processors.
        precision: "f64" or "f32"; the results have that type.
        backend: As for `Worlds`; the same bits.
        progress: True for a bar (needs tqdm), or a function of (states done, all of them).

    Raises:
        InputError: Arrays have other shapes, hold numbers that are not finite, or quaternions of length zero.
        OptionError: `eps` is out of bounds, or is given where derivatives are exact; `discrete` with the integrator RK4.
    """
    check_model(model)
    if discrete is not None and bool(discrete) != model.opt.flags["invdiscrete"]:
        model = model.replace(invdiscrete=bool(discrete))
    others = {
        "qvel": qvel,
        "qacc": qacc,
        "act": act,
        "ctrl": ctrl,
        "mocap_pos": mocap_pos,
        "mocap_quat": mocap_quat,
        "eq_active": eq_active,
    }
    how = (method, eps, centred, False, "fixed_work", progress)
    return Inverse(*_run("inverse", model, qpos, others, how, (threads, precision, backend)))


def _run(
    of: str,
    model: Model,
    qpos: ArrayLike,
    others: dict[str, ArrayLike | None],
    how: tuple[str, float | None, bool, bool, str, Progress],
    choice: tuple[int | None, str, str],
) -> list[NDArray[Any]]:
    """The arrays of derivatives; `how`: method, eps, centred, sensors, solving and progress; `choice`: threads, precision and backend."""
    method, eps, centred, sensors, solving, progress = how
    check_model(model)
    exact = _arrays.choice("method", method, METHODS) == "exact"
    if exact and eps is not None:
        raise OptionError(f"eps is {eps!r}, and derivatives are exact; leave it out, or take them by differences: method='fd'")
    _arrays.choice("solving", solving, SOLVING)
    _arrays.choice("precision", choice[1], PRECISIONS)
    accurate = solving == "accurate"
    states = States(_accurate(model) if accurate else model, ("qpos", qpos, "nq"), others)
    leading, count, compiled = states.leading, states.count, states.model._m
    compiled.check_quaternions(states.rows["qpos"], [*leading, model.nq])
    dtype = np.float32 if choice[1] == "f32" else np.float64
    described = compiled.derivatives(of, bool(sensors))
    arrays = [_reuse.empty((count, *dims), np.int32 if integers else dtype) for _, dims, integers in described]
    scheme = (exact, None if eps is None else _number("eps", eps), bool(centred), bool(sensors))
    qacc = states.rows.get("qacc")
    with following(progress, count) as follow:
        for worlds, here in states.worlds(*choice):
            done = here.start
            report = None if follow is None else lambda n, done=done: follow(done + n)
            rows = None if qacc is None else qacc[here]
            worlds._w.derivatives(of, rows, scheme, accurate, [array[here] for array in arrays], report)
    return [array.reshape((*leading, *array.shape[1:])) for array in arrays]


_latest: list[tuple[Any, Model]] = []
"""Models, as compiled, and the same with accurate options: those asked for last."""
_MOST = 8


def _accurate(model: Model) -> Model:
    """The model with options by which constraints are solved accurately."""
    for known, made in _latest.copy():
        if known is model._m:
            return made
    made = Model._of(model._m.accurate())
    _latest.insert(0, (model._m, made))
    del _latest[_MOST:]
    return made


def _number(name: str, value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise InputError(f"{name} is {value!r}; expected a number") from None
