"""Clouds of states: second derivatives of what they cost, and means over noise with their gradients."""

from __future__ import annotations

import math
from typing import Any, Callable, Iterator, Mapping, NamedTuple, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _lanesim
from ._states import States
from .derivatives import SOLVING, _accurate, _number
from .errors import InputError, UnknownNameError
from .model import Model, check_model
from .progress import Progress, following
from .worlds import PARAMETERS, PRECISIONS

__all__ = ["Hessian", "ParameterDerivatives", "Smoothed", "hessian", "parameter_derivatives", "smoothed"]

OF = ("transition", "acceleration", "inverse")
"""What may follow from a state."""
_BYTES = 1 << 26
"""What is found at points at once."""

Part = Mapping[str, NDArray[np.float64]]
Cost = Callable[[Part, Part], ArrayLike]
"""From what follows from points, and from the points, arrays [N, ...] by name, to [N] or [N, m] numbers."""


class Hessian(NamedTuple):
    """Value, gradient and Hessian of a cost, or of m of them. NaN where nothing follows from a state; `status` says why."""

    value: NDArray[np.float64]
    """[...], or [..., m]."""
    gradient: NDArray[np.float64]
    """[..., n], or [..., m, n]."""
    hessian: NDArray[np.float64]
    """[..., n, n], or [..., m, n, n]."""
    columns: NDArray[np.intp]
    """Which columns these are, [n]."""
    sides: NDArray[np.int32]
    """How each column was moved, [..., n]: as in `Transition`."""
    changed: NDArray[np.int32]
    """How many limits and contacts begin or cease to push at most among the points for which a column was moved, [..., n]: where
    there are some, differences go across a kink."""
    status: NDArray[np.int32]
    """Bits of `Status`: what happened to each state and to those beside it, [...]."""


class Smoothed(NamedTuple):
    """The mean of something over normal noise, and its gradient. NaN where nothing follows from some point."""

    mean: NDArray[np.float64]
    """[...], or [..., m]."""
    gradient: NDArray[np.float64]
    """[..., n], or [..., m, n]."""
    columns: NDArray[np.intp]
    """Which columns have noise, [n]."""
    changed: NDArray[np.float64]
    """How many limits and contacts push at a point and not in the state, or the other way round, on average, [...]."""
    status: NDArray[np.int32]
    """Bits of `Status`, [...]."""


def hessian(
    model: Model,
    qpos: ArrayLike,
    qvel: ArrayLike,
    cost: Cost,
    *,
    of: str = "transition",
    qacc: ArrayLike | None = None,
    act: ArrayLike | None = None,
    ctrl: ArrayLike | None = None,
    qfrc_applied: ArrayLike | None = None,
    xfrc_applied: ArrayLike | None = None,
    mocap_pos: ArrayLike | None = None,
    mocap_quat: ArrayLike | None = None,
    eq_active: ArrayLike | None = None,
    columns: Sequence[int] | None = None,
    gauss_newton: bool = False,
    eps: float | None = None,
    centred: bool = True,
    sensors: bool = False,
    solving: str = "accurate",
    threads: int | None = None,
    precision: str = "f64",
    backend: str = "auto",
    progress: Progress = None,
) -> Hessian:
    """Second derivatives of what states cost by what follows from them: of one state, of many, or of whole trajectories.

    >>> found = lanesim.hessian(model, qpos, qvel, lambda after, before: (after["qvel"] ** 2).sum(-1), ctrl=ctrl)
    >>> found.gradient, found.hessian     # [..., n] and [..., n, n]

    Every two columns are moved together, by n (n + 1) / 2 + n + 1 points, or to both sides by n² + n + 1 and one for each control; with
    `gauss_newton` by 1 + n, or 1 + 2 n. Moves of a rotation's columns add as one vector of the tangent space. Columns are numbered: positions
    in the tangent space, nv, velocities, nv, activations, na, controls, nu, and, only if `columns` names them, generalised forces, nv. With
    `of="inverse"`: positions, velocities and accelerations, nv each.

    Args:
        model: The model.
        qpos: Positions, [..., nq], with any leading dimensions.
        qvel: Velocities, [..., nv].
        cost: A function of many points at once: `cost(after, before)`. `after` has what follows from them: of a transition `qpos`,
            `qvel`, `act` and, if they are wanted, `sensordata`, [N, ...]; `qacc`; or `qfrc_inverse`. `before` has the points: `qpos`,
            `qvel`, `act`, `ctrl`, and `qacc` of inverse dynamics. It returns [N] numbers, or [N, m] for m costs.
        of: What follows: "transition", the next state; "acceleration"; "inverse", the force that `qacc` needs.
        qacc: Accelerations, [..., nv], for inverse dynamics, which look at no forces from outside.
        act: As of `transition`, with all other parts of the state.
        ctrl: Controls, [..., nu]. One that is nearer than 2 eps to a limit is moved the other way only.
        qfrc_applied: Generalised forces from outside, [..., nv].
        xfrc_applied: Forces and torques on bodies from outside, [..., nbody, 6].
        mocap_pos: Positions of mocap bodies, [..., nmocap, 3].
        mocap_quat: Orientations of mocap bodies, [..., nmocap, 4].
        eq_active: Which equality constraints are active, [..., neq].
        columns: Those along which derivatives are taken; None: all but those of forces.
        gauss_newton: Whether what `cost` returns are residuals: the cost is half the sum of their squares, and their curvature is left out.
        eps: How far a number is moved; None: 1e-4, or with `gauss_newton` 1e-6; in single precision 2e-2, 5e-3, or 1e-3 to one side.
        centred: Whether it is moved to both sides.
        sensors: Whether `after` has sensors.
        solving: As of `transition`.
        threads: Worker threads; None: as many as there are processors.
        precision: "f64", or "f32", in which second differences have hardly a digit.
        backend: As for `Worlds`; the same bits.
        progress: True for a bar (needs tqdm), or a function of (states done, all of them).

    Raises:
        InputError: As of `transition`; `cost` returned something else than [N] or [N, m] numbers; there is no such column.
        OptionError: `eps` is out of bounds.
        UnknownNameError: There is no such `of`, way of solving, precision or backend.
    """
    others = {
        "qvel": qvel,
        "qacc": qacc,
        "act": act,
        "ctrl": ctrl,
        "qfrc_applied": qfrc_applied,
        "xfrc_applied": xfrc_applied,
        "mocap_pos": mocap_pos,
        "mocap_quat": mocap_quat,
        "eq_active": eq_active,
    }
    visit = _Visit(model, of, qpos, others, (solving, sensors, False), (threads, precision, backend))
    scheme = (None if eps is None else _number("eps", eps), bool(centred), not gauss_newton)
    named = None if columns is None else [_arrays.count("a column", column) for column in columns]
    cloud = _lanesim.Cloud.differences(visit.model._m, of, named, scheme, precision == "f32")
    taken = cloud.columns()
    parts: list[list[NDArray[Any]]] = []
    scalar = True
    for here, values, marks in visit.chunks(cloud, cost, progress):
        scalar = values.ndim == 2
        values = values.reshape(*values.shape[:2], -1)
        count, _, m = values.shape
        gradient = np.empty((count, m, taken.size))
        second = None if gauss_newton else np.empty((count, m, taken.size, taken.size))
        cloud.differentiate(np.ascontiguousarray(values), marks.sides, gradient, second)
        value = values[:, 0]
        if second is None:
            residual, jacobian = value, gradient
            value = 0.5 * np.einsum("sm,sm->s", residual, residual)
            gradient = np.einsum("sm,smi->si", residual, jacobian)
            second = np.einsum("smi,smj->sij", jacobian, jacobian)
        elif scalar:
            value, gradient, second = value[:, 0], gradient[:, 0], second[:, 0]
        changed = _by_column(cloud.moved(), marks.changed)
        parts.append([value, gradient, second, marks.sides[:, taken].astype(np.int32), changed, marks.status])
    value, gradient, second, sides, changed, status = visit.joined(parts)
    return Hessian(value, gradient, second, taken, sides, changed, status)


def smoothed(
    model: Model,
    qpos: ArrayLike,
    qvel: ArrayLike,
    cost: Cost | None = None,
    *,
    of: str = "transition",
    scale: float | ArrayLike,
    pairs: int,
    seed: int = 0,
    qacc: ArrayLike | None = None,
    act: ArrayLike | None = None,
    ctrl: ArrayLike | None = None,
    qfrc_applied: ArrayLike | None = None,
    xfrc_applied: ArrayLike | None = None,
    mocap_pos: ArrayLike | None = None,
    mocap_quat: ArrayLike | None = None,
    eq_active: ArrayLike | None = None,
    sensors: bool = False,
    solving: str = "fixed_work",
    threads: int | None = None,
    precision: str = "f64",
    backend: str = "auto",
    progress: Progress = None,
) -> Smoothed:
    """Means over normal noise around states, and their gradients: randomised smoothing.

    >>> noise = np.repeat([0.0, 0.1], [2 * model.nv + model.na, model.nu])              # on controls only
    >>> found = lanesim.smoothed(model, qpos, qvel, ctrl=ctrl, scale=noise, pairs=200)
    >>> found.mean, found.gradient      # the next state, [..., n], and its derivatives by controls, [..., n, nu]

    Points come in pairs on both sides of a state. All states have the same noise, which the seed decides, so that differences between
    them, or between calls, are not those of the noise. The gradient of a mean over normal noise is the slope of the best linear fit (Stein's
    lemma), and that is what is computed: exact for what is linear, whatever the number of pairs. Controls beyond their range count as
    the range's end, as in every step.

    Args:
        model: The model.
        qpos: Positions, [..., nq], with any leading dimensions.
        qvel: Velocities, [..., nv].
        cost: As of `hessian`; None: the mean of what follows itself, with next positions as differences, nv, from the one that follows
            from the state, in the tangent space; then velocities, activations and sensors; or accelerations, or forces.
        of: As of `hessian`, as are all parts of the state.
        scale: Standard deviation of the noise for all columns, or for each of them, without or with those of forces; see `hessian`. Columns
            with 0 have none, and no derivative.
        pairs: Pairs of points, at least as many as columns with noise; the error falls with its square root.
        seed: Chooses the noise.
        qacc: Accelerations, [..., nv], for inverse dynamics.
        act: Activations, [..., na].
        ctrl: Controls, [..., nu].
        qfrc_applied: Generalised forces from outside, [..., nv].
        xfrc_applied: Forces and torques on bodies from outside, [..., nbody, 6].
        mocap_pos: Positions of mocap bodies, [..., nmocap, 3].
        mocap_quat: Orientations of mocap bodies, [..., nmocap, 4].
        eq_active: Which equality constraints are active, [..., neq].
        sensors: Whether sensors are wanted.
        solving: As of `transition`; noise asks for less than differences.
        threads: Worker threads; None: as many as there are processors.
        precision: "f64" or "f32".
        backend: As for `Worlds`; the same bits.
        progress: True for a bar (needs tqdm), or a function of (states done, all of them).

    Raises:
        InputError: As of `hessian`; scales are no scales; there are fewer pairs than columns with noise.
    """
    others = {
        "qvel": qvel,
        "qacc": qacc,
        "act": act,
        "ctrl": ctrl,
        "qfrc_applied": qfrc_applied,
        "xfrc_applied": xfrc_applied,
        "mocap_pos": mocap_pos,
        "mocap_quat": mocap_quat,
        "eq_active": eq_active,
    }
    visit = _Visit(model, of, qpos, others, (solving, sensors, cost is None), (threads, precision, backend))
    pairs, seed = _arrays.count("pairs", pairs, 1), _arrays.count("seed", seed)
    cloud = _lanesim.Cloud.noise(visit.model._m, of, visit.scales(scale), pairs, seed)
    taken = cloud.columns()
    parts = []
    for _, values, marks in visit.chunks(cloud, cost, progress):
        scalar = values.ndim == 2
        values = np.ascontiguousarray(values.reshape(*values.shape[:2], -1))
        count, _, m = values.shape
        mean, gradient = np.empty((count, m)), np.empty((count, m, taken.size))
        cloud.fit(values, mean, gradient)
        if scalar:
            mean, gradient = mean[:, 0], gradient[:, 0]
        parts.append([mean, gradient, marks.changed.mean(axis=1), marks.status])
    mean, gradient, changed, status = visit.joined(parts)
    return Smoothed(mean, gradient, taken, changed, status)


class ParameterDerivatives(NamedTuple):
    """Derivatives of what follows from states by numbers of the model. NaN where nothing does; `status` says why."""

    slopes: NDArray[np.float64]
    """[..., m, *shape] by all numbers of a parameter of that shape, [..., m, n] by those that `entries` names."""
    sides: NDArray[np.int32]
    """How each number was moved, [*shape] or [n]: 2 to both sides; 1 forward: it is zero and may not be negative; 0 not at all: it
    is the mass or inertia of a body that has none, and its slope is zero."""
    status: NDArray[np.int32]
    """Bits of `Status`, [...]."""


def parameter_derivatives(
    model: Model,
    qpos: ArrayLike,
    qvel: ArrayLike,
    parameter: str,
    *,
    entries: Sequence[int] | None = None,
    of: str = "transition",
    qacc: ArrayLike | None = None,
    act: ArrayLike | None = None,
    ctrl: ArrayLike | None = None,
    qfrc_applied: ArrayLike | None = None,
    xfrc_applied: ArrayLike | None = None,
    mocap_pos: ArrayLike | None = None,
    mocap_quat: ArrayLike | None = None,
    eq_active: ArrayLike | None = None,
    eps: float = 1e-6,
    sensors: bool = False,
    solving: str = "accurate",
    threads: int | None = None,
    backend: str = "auto",
) -> ParameterDerivatives:
    """Derivatives of steps, accelerations or inverse dynamics by numbers of the model: what identification asks for.

    >>> found = lanesim.parameter_derivatives(model, qpos, qvel, "body_mass", of="inverse", qacc=qacc)
    >>> found.slopes        # of qfrc_inverse by the masses, [..., nv, nbody]

    Constants that are derived from a number follow it, as for worlds that are given it (`Worlds.set`); inertia does not follow mass.

    Args:
        model: The model, around whose own numbers derivatives are taken.
        qpos: Positions, [..., nq], with any leading dimensions.
        qvel: Velocities, [..., nv].
        parameter: One of `PARAMETERS`.
        entries: Which of its numbers, counted through its array in C order; None: all.
        of: What follows: "transition", the next state, [2 nv + na] with positions in the tangent space, and sensors if they are wanted;
            "acceleration", [nv]; "inverse", the force that `qacc` needs, [nv].
        qacc: Accelerations, [..., nv], for inverse dynamics.
        act: Activations, [..., na].
        ctrl: Controls, [..., nu].
        qfrc_applied: Generalised forces from outside, [..., nv].
        xfrc_applied: Forces and torques on bodies from outside, [..., nbody, 6].
        mocap_pos: Positions of mocap bodies, [..., nmocap, 3].
        mocap_quat: Orientations of mocap bodies, [..., nmocap, 4].
        eq_active: Which equality constraints are active, [..., neq].
        eps: How far a number is moved, to both sides, as a share of its size; by `eps` itself if it is zero.
        sensors: Whether sensors are wanted.
        solving: As of `transition`.
        threads: Worker threads; None: as many as there are processors.
        backend: As for `Worlds`; the same bits.

    Raises:
        InputError: As of `transition`; the parameter has no such entry, or cannot vary.
        OptionError: `eps` is out of bounds.
        UnknownNameError: There is no such parameter, `of`, way of solving or backend.
    """
    others = {
        "qvel": qvel,
        "qacc": qacc,
        "act": act,
        "ctrl": ctrl,
        "qfrc_applied": qfrc_applied,
        "xfrc_applied": xfrc_applied,
        "mocap_pos": mocap_pos,
        "mocap_quat": mocap_quat,
        "eq_active": eq_active,
    }
    visit = _Visit(model, of, qpos, others, (solving, sensors, True), (threads, "f64", backend))
    if parameter not in PARAMETERS:
        raise UnknownNameError(_arrays.unknown("parameter", parameter, PARAMETERS))
    shape = (3,) if parameter == "gravity" else np.shape(getattr(model, parameter))
    named = list(range(math.prod(shape))) if entries is None else [_arrays.count("an entry", x) for x in entries]
    dims = shape if entries is None else (len(named),)
    m = sum(n for _, n in visit.after)
    qacc_rows = visit.states.rows.get("qacc")
    parts, sides = [], np.full(dims, 2.0)
    for worlds, here in visit.states.worlds(threads, "f64", backend):
        rows = None if qacc_rows is None else qacc_rows[here]
        how = (visit.how[0], visit.how[2])
        slopes, moved, status = worlds._w.by_parameter(of, rows, parameter, named, _number("eps", eps), how)
        sides = moved.reshape(dims)
        parts.append([slopes.reshape(here.stop - here.start, m, *dims), status.astype(np.int32)])
    slopes, status = visit.joined(parts)
    return ParameterDerivatives(slopes, sides.astype(np.int32), status)


class _Marks(NamedTuple):
    """What was found about states beside what follows from their points."""

    changed: NDArray[np.int32]
    sides: NDArray[np.float64]
    status: NDArray[np.int32]


class _Visit:
    """States whose points are visited; `how`: solving, whether sensors are wanted, whether positions are as differences."""

    def __init__(
        self,
        model: Model,
        of: str,
        qpos: ArrayLike,
        others: dict[str, ArrayLike | None],
        how: tuple[str, bool, bool],
        choice: tuple[int | None, str, str],
    ) -> None:
        check_model(model)
        solving, sensors, tangent = how
        _arrays.choice("of", of, OF)
        _arrays.choice("solving", solving, SOLVING)
        _arrays.choice("precision", choice[1], PRECISIONS)
        _check_inputs(of, others)
        accurate = solving == "accurate" and of != "inverse"
        self.states = States(_accurate(model) if accurate else model, ("qpos", qpos, "nq"), others)
        self.model = self.states.model
        self.model._m.check_quaternions(self.states.rows["qpos"], [*self.states.leading, model.nq])
        self.of, self.choice = of, choice
        self.how = (bool(sensors), tangent, solving == "accurate")
        self.after, self.before, self.ncolumn = _lanesim.Cloud.parts(self.model._m, of, bool(sensors), tangent)

    def scales(self, scale: float | ArrayLike) -> list[float]:
        """Of each column, those of forces included."""
        array = _arrays.numbers("scale", scale).astype(np.float64)
        known = self.ncolumn - (0 if self.of == "inverse" else self.model.nv)
        if array.ndim == 0:
            array = np.full(known, array)
        if array.shape not in ((known,), (self.ncolumn,)):
            raise InputError(f"array `scale` has shape {list(array.shape)}; expected one number, [{known}], or [{self.ncolumn}]")
        scales = np.zeros(self.ncolumn)
        scales[: array.size] = array
        return [float(x) for x in scales]

    def chunks(self, cloud: Any, cost: Cost | None, progress: Progress) -> Iterator[tuple[slice, NDArray[Any], _Marks]]:
        """Some states after the other: which they are, [N, npoint] or [N, npoint, m] values, and marks."""
        widths = [sum(n for _, n in parts) for parts in (self.after, self.before)]
        npoint = len(cloud)
        most = max(1, _BYTES // (8 * npoint * max(1, sum(widths))))
        qacc = self.states.rows.get("qacc")
        with following(progress, self.states.count) as follow:
            for worlds, here in self.states.worlds(*self.choice, most=most):
                count = here.stop - here.start
                after, before = (np.empty((count, npoint, width)) for width in widths)
                changed = np.empty((count, npoint), np.int32)
                marks = _Marks(changed, np.empty((count, self.ncolumn)), np.empty(count, np.int32))
                done = here.start
                report = None if follow is None else lambda n, done=done: follow(done + n)
                targets = [after, before if cost is not None else np.empty(0), *marks]
                rows = None if qacc is None else qacc[here]
                worlds._w.points(self.of, rows, cloud, self.how, targets, report)
                yield here, after if cost is None else self._costs(cost, after, before), marks

    def _costs(self, cost: Cost, after: NDArray[np.float64], before: NDArray[np.float64]) -> NDArray[np.float64]:
        """What the user's function makes of points: [N, npoint], or [N, npoint, m]."""
        count, npoint, _ = after.shape
        values = np.asarray(cost(_named(after, self.after), _named(before, self.before)))
        if values.ndim not in (1, 2) or values.shape[0] != count * npoint:
            n = count * npoint
            raise InputError(f"cost returned an array of shape {list(values.shape)}; expected [{n}] or [{n}, m]: a row for each point")
        if values.dtype.kind not in "fiub":
            raise InputError(f"cost returned an array of type {values.dtype}; expected numbers")
        return np.asarray(values, dtype=np.float64).reshape(count, npoint, *values.shape[1:])

    def joined(self, parts: list[list[NDArray[Any]]]) -> list[NDArray[Any]]:
        """The arrays of all states, with their leading dimensions."""
        if not parts:
            raise InputError("there are no states")
        arrays = [np.concatenate(arrays) for arrays in zip(*parts)]
        return [array.reshape((*self.states.leading, *array.shape[1:])) for array in arrays]


def _check_inputs(of: str, others: dict[str, ArrayLike | None]) -> None:
    """An exception for arrays that would be needed, or looked at by nobody."""
    if of == "inverse":
        if others["qacc"] is None:
            raise InputError("there is no array qacc; inverse dynamics need accelerations")
        given = [name for name in ("qfrc_applied", "xfrc_applied") if others[name] is not None]
        if given:
            raise InputError(f"inverse dynamics do not look at {given[0]}; leave it out")
    elif others["qacc"] is not None:
        raise InputError('qacc is for of="inverse"; leave it out')


def _named(rows: NDArray[np.float64], parts: Sequence[tuple[str, int]]) -> Part:
    """Parts of rows [N, npoint, ...] by name, [N npoint, ...]."""
    flat = rows.reshape(-1, rows.shape[-1])
    ends = np.cumsum([n for _, n in parts])
    return {name: flat[:, end - n : end] for (name, n), end in zip(parts, ends)}


def _by_column(moved: NDArray[np.bool_], changed: NDArray[np.int32]) -> NDArray[np.int32]:
    """The most among the points for which a column was moved, [N, n]; `moved`: [npoint, n]."""
    by_column = [changed[:, moved[:, i]].max(axis=1, initial=0) for i in range(moved.shape[1])]
    return np.stack(by_column, axis=1) if by_column else np.empty((changed.shape[0], 0), np.int32)
