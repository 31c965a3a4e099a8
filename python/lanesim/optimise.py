"""Optimal motions: a model, a start and a cost in; controls, the motion, and gains that follow it out."""

from __future__ import annotations

from typing import Any, NamedTuple, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _lanesim
from .errors import InputError
from .model import Model, check_model
from .progress import Progress, following

__all__ = ["Goal", "Motion", "TASKS", "Term", "optimise"]

TASKS: dict[str, str] = {name: what for name, what, _, _ in _lanesim.tasks()}
"""Names of the tasks that there are, and what they are."""

METHODS = ("ilqg", "gauss-newton")
"""How a motion may be searched."""

_ITERATIONS = {name: iterations for name, _, _, iterations in _lanesim.tasks()}


class Term(NamedTuple):
    """A term of a cost: the difference of a quantity from a goal, at some weight."""

    of: str
    """``"qpos"``, ``"qvel"`` or ``"ctrl"``, of all or as ``"qpos:JOINT"``, ``"qvel:JOINT"``, ``"ctrl:ACTUATOR"``; ``"site:NAME"``, ``"body:NAME"``:
    positions; ``"com:BODY"``: centre of mass of a body and all that it carries; ``"sensor:NAME"``."""
    goal: ArrayLike | None = None
    """What it should be; one number for all; None: zeros, and of positions the reference configuration. Positions differ in the tangent space."""
    running: float = 0.0
    """Weight per second of the motion."""
    terminal: float = 0.0
    """Weight at its end."""
    smooth: float | None = None
    """None: a residual r costs r^2 / 2. Else the width p of sqrt(r^2 + p^2) - p."""


class Goal(NamedTuple):
    """A task's goal, and how far the motion's end is from it."""

    what: str
    """In words."""
    distance: float
    """How far the end is from it."""
    within: float
    """How far it may be."""
    unit: str
    """Unit of both."""

    @property
    def reached(self) -> bool:
        """Whether the end is near enough."""
        return self.distance <= self.within


class Motion(NamedTuple):
    """A motion that was found; n = 2 nv + na: qpos in the tangent space, qvel, act."""

    qpos: NDArray[np.float64]
    """Positions, [steps + 1, nq]."""
    qvel: NDArray[np.float64]
    """Velocities, [steps + 1, nv]."""
    act: NDArray[np.float64]
    """Activations, [steps + 1, na]."""
    ctrl: NDArray[np.float64]
    """Controls, [steps, nu]."""
    gains: NDArray[np.float64]
    """How controls should follow differences of the state, [steps, nu, n]."""
    cost: float
    """Cost of the motion."""
    costs: NDArray[np.float64]
    """Cost after each iteration, the start first."""
    seconds: NDArray[np.float64]
    """Seconds since the start, likewise."""
    regularisation: NDArray[np.float64]
    """Regularisation with which each was computed."""
    steps: NDArray[np.float64]
    """Length of the step that each took; 0: none."""
    end: str
    """Why the search ended: "converged", "iterations used up", "no step made it better"."""
    residual: float
    """Largest force that the positions of "gauss-newton" need and no actuator gives (N, N m)."""
    goals: list[Goal]
    """A task's goals."""


def optimise(
    task: str | Model,
    terms: Sequence[Term] | None = None,
    *,
    seconds: float | None = None,
    qpos: ArrayLike | None = None,
    qvel: ArrayLike | None = None,
    act: ArrayLike | None = None,
    ctrl: ArrayLike | None = None,
    method: str = "ilqg",
    iterations: int | None = None,
    tolerance: float = 1e-6,
    eps: float | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> Motion:
    """Searches the controls of an optimal motion: of a task by its name, or of a model with the terms of a cost.

    >>> motion = lanesim.optimise("cartpole")
    >>> reach = lanesim.optimise(model, [lanesim.Term("site:tip", [0.3, 0, 0.5], terminal=100), lanesim.Term("ctrl", running=0.1)], seconds=1)

    Args:
        task: A task, see `TASKS`, or a model.
        terms: The cost of a model's motion, a sum of terms; tasks have their own.
        seconds: Length of the motion; None: the task's own. A model needs it.
        qpos: Positions at the start, [nq]; None: the reference configuration. This and the next three go with a model.
        qvel: Velocities at the start, [nv]; None: at rest.
        act: Activations at the start, [na]; None: zero.
        ctrl: First controls, [steps, nu], which are clamped to their ranges; None: none.
        method: "ilqg": differential dynamic programming, with bounds of controls; "gauss-newton": over positions, with forces from inverse
            dynamics, of models whose actuators are motors on hinges and slides.
        iterations: Most iterations; None: the task's own, or 200.
        tolerance: The search ends when an iteration can gain no more than this share of the cost.
        eps: How far numbers are moved for derivatives; None: 1e-6.
        threads: Worker threads; None: as many as there are processors.
        progress: True for a bar (needs tqdm), or a function of (iterations done, most of them).

    Raises:
        InputError: Arrays have other shapes or hold numbers that are not finite; the model has no actuators, or the method does not go with them.
        OptionError: The motion has no step, or `eps` or `tolerance` are out of bounds.
        UnknownNameError: There is no such task, quantity, element or method.
    """
    _arrays.choice("method", method, METHODS)
    how = (method, None if iterations is None else _count("iterations", iterations), float(tolerance), eps, threads)
    most = how[1] or (_ITERATIONS.get(task, 200) if isinstance(task, str) else 200)
    start = [None if array is None else _numbers(name, array) for name, array in (("qpos", qpos), ("qvel", qvel), ("act", act), ("ctrl", ctrl))]
    given = [name for name, array in zip(("terms", "qpos", "qvel", "act", "ctrl"), [terms, *start]) if array is not None]
    with following(progress, most) as follow:
        if isinstance(task, str):
            if given:
                raise InputError(f"task {task!r} has its own terms and start; leave out {given[0]}, or give a model")
            found = _lanesim.optimise(task, seconds, None, [], 0, start, how, follow)
        else:
            check_model(task)
            found = _lanesim.optimise(None, None, task._m, _terms(terms), _steps(task, seconds), start, how, follow)
    return Motion(**{**found, "goals": [Goal(*goal) for goal in found["goals"]]})


def _terms(terms: Sequence[Term] | None) -> list[tuple[str, list[float], float, float, float | None]]:
    if terms is None:
        raise InputError("a model needs terms of a cost: give a list of Term")
    rows = []
    for term in terms:
        if not isinstance(term, Term):
            raise InputError(f"a term is a {type(term).__name__}; expected Term")
        goal = [] if term.goal is None else _numbers(f"goal of {term.of}", term.goal)
        rows.append((term.of, goal, float(term.running), float(term.terminal), term.smooth))
    return rows


def _steps(model: Model, seconds: float | None) -> int:
    if seconds is None:
        raise InputError("a model needs the length of its motion: give seconds")
    steps = float(seconds) / model.opt.timestep
    if not 0 <= steps <= 1e6:
        raise InputError(f"seconds is {seconds}; expected 1 to 1000000 steps of {model.opt.timestep} s")
    return round(steps)


def _count(name: str, value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
        raise InputError(f"{name} is {value!r}; expected an integer from 1 on")
    return int(value)


def _numbers(name: str, values: ArrayLike) -> list[float]:
    try:
        array = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} is {values!r}; expected numbers") from None
    return [float(x) for x in array.ravel()]
