"""Rollouts: open-loop controls in, trajectories out, with the shapes and the state layout of ``mujoco.rollout``."""

from __future__ import annotations

import os
import threading
from typing import Any, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _lanesim, _reuse
from .errors import InputError, UnsupportedError
from .model import Model
from .progress import Progress
from .worlds import PRECISIONS, Worlds

__all__ = ["Rollout", "rollout"]

STATE_CTRL = 1 << 6
"""MuJoCo's ``mjSTATE_CTRL``, the one `control_spec` that is built."""


class Rollout:
    """Threads, and the worlds of the latest rollout, for use from call to call.

    A call with the same model and number of rollouts as the one before allocates nothing but its results. May be used as
    a context manager; `close` ends the threads.
    """

    def __init__(self, *, nthread: int | None = None, precision: str = "f64") -> None:
        """`nthread`: worker threads; None or 0: as many as there are processors."""
        _arrays.choice("precision", precision, PRECISIONS)
        nthread = None if nthread is None else _arrays.count("nthread", nthread)
        self.nthread = nthread or 0
        self._precision = precision
        self._pool: Any = _lanesim.Pool(nthread or None)
        self._worlds: Worlds | None = None
        self._lock = threading.Lock()

    def __enter__(self) -> "Rollout":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the threads."""
        with self._lock:
            self._pool = None
            self._worlds = None

    def rollout(
        self,
        model: Model,
        initial_state: ArrayLike,
        control: ArrayLike | None = None,
        *,
        control_spec: int = STATE_CTRL,
        skip_checks: bool = False,
        nstep: int | None = None,
        initial_warmstart: ArrayLike | None = None,
        state: NDArray[Any] | None = None,
        sensordata: NDArray[Any] | None = None,
        outputs: Sequence[str] | None = None,
        chunk_size: int | None = None,
        progress: Progress = None,
    ) -> Any:
        """Like `lanesim.rollout`."""
        with self._lock:
            if self._pool is None:
                raise RuntimeError("rollout requested after thread pool shutdown")
            _check_kinds(model, initial_state)
            if control_spec != STATE_CTRL:
                raise UnsupportedError(f"control_spec {control_spec} is not built yet: only mjSTATE_CTRL is")
            if chunk_size is not None:
                _arrays.count("chunk_size", chunk_size, 1)
            plan = _Plan(model, initial_state, control, nstep, initial_warmstart, state, sensordata)
            return self._run(plan, skip_checks, outputs, progress)

    def _run(self, plan: "_Plan", skip_checks: bool, outputs: Sequence[str] | None, progress: Progress) -> Any:
        model, nbatch, nstep = plan.model, plan.nbatch, plan.nstep
        worlds = self._worlds
        if worlds is None or worlds.nworld != nbatch or worlds.model._m is not model._m:
            self._worlds = None  # Let go of the old ones before there are new ones.
            worlds = Worlds(model, nbatch, self._precision, _pool=self._pool)
            self._worlds = worlds
        else:
            worlds.reset()
        dtype = worlds.dtype
        state = plan.state
        if state is None:
            state = _reuse.empty((nbatch, nstep, plan.nstate), dtype)
        sensordata = plan.sensordata
        if sensordata is None:
            sensordata = _reuse.empty((nbatch, nstep, model.nsensordata), dtype)
        arrays, names = [state], ["state"]
        if isinstance(outputs, str):
            raise InputError(f"outputs is a str; expected a list of names, such as [{outputs!r}]")
        recorded: dict[str, NDArray[Any]] = {}
        for name in outputs or ():
            fixed, shape, integer = model._m.output(name)
            if not fixed:
                raise InputError(f"{name} differs in length between worlds and cannot be recorded in a rollout")
            if name not in recorded:
                recorded[name] = _reuse.empty((nbatch, nstep, *shape), np.int32 if integer else dtype)
                names.append(name)
                arrays.append(recorded[name])
        plan.start(worlds, not skip_checks)
        worlds._run(nstep, plan.controls(not skip_checks), names, arrays, progress)
        return (state, sensordata) if outputs is None else (state, sensordata, recorded)


class _Plan:
    """What is given, with its shapes understood."""

    def __init__(
        self,
        model: Model,
        initial_state: ArrayLike,
        control: ArrayLike | None,
        nstep: int | None,
        initial_warmstart: ArrayLike | None,
        state: NDArray[Any] | None,
        sensordata: NDArray[Any] | None,
    ) -> None:
        self.model = model
        self.nstate = 1 + model.nq + model.nv + model.na
        if nstep is not None:
            nstep = _arrays.count("nstep", nstep)
        start = _lead("initial_state", initial_state, 2)
        warm = None if initial_warmstart is None else _lead("initial_warmstart", initial_warmstart, 2)
        ctrl = None if control is None else _lead("control", control, 3)
        given = [("initial_state", start), ("initial_warmstart", warm), ("control", ctrl)]
        results = [("state", state), ("sensordata", sensordata)]
        for name, array in results:
            if array is not None and (not isinstance(array, np.ndarray) or array.ndim != 3):
                raise InputError(f"array `{name}` to write to must be a NumPy array [nbatch, nstep, n{name}]")
        self.nbatch = _arrays.count("nbatch", _infer("nbatch", 0, None, given + results), 1)
        self.nstep = _infer("nstep", 1, nstep, [("control", ctrl), *results])
        batch, step = ("nbatch", self.nbatch), ("nstep", self.nstep)
        _trailing("initial_state", start, [batch, ("nstate", self.nstate)])
        _trailing("initial_warmstart", warm, [batch, ("nv", model.nv)])
        _trailing("control", ctrl, [batch, step, ("nu", model.nu)])
        self.initial_state, self.warmstart, self.control = start, warm, ctrl
        self.state = self._result("state", state, self.nstate)
        self.sensordata = self._result("sensordata", sensordata, model.nsensordata)
        if self.state is not None and ctrl is not None and np.may_share_memory(self.state, ctrl):
            raise InputError("array `state` overlaps `control`, which would change while it is read")

    def _result(self, name: str, array: NDArray[Any] | None, width: int) -> NDArray[Any] | None:
        if array is None:
            return None
        shape = (self.nbatch, self.nstep, width)
        dims = [("nbatch", self.nbatch), ("nstep", self.nstep), ("n" + name, width)]
        return _arrays.target(name, array, shape, dims, (np.float64, np.float32))

    def start(self, worlds: Worlds, checked: bool) -> None:
        """Puts the worlds where they start."""
        model, rows = self.model, self.initial_state
        stride = 0 if rows.shape[0] == 1 and self.nbatch > 1 else self.nstate
        check = ("initial_state", list(rows.shape)) if checked else None
        if checked:
            _arrays.check_range("initial_state", rows, worlds.dtype)
        at = 0
        for name, width in (("time", 1), ("qpos", model.nq), ("qvel", model.nv), ("act", model.na)):
            worlds._w.write(name, rows, (at, stride), None, check)
            at, check = at + width, None
        if self.warmstart is not None:
            self._warm_start(worlds, self.warmstart, checked)

    def _warm_start(self, worlds: Worlds, warmstart: NDArray[Any], checked: bool) -> None:
        """MuJoCo's solver starts from an acceleration, the engine's from what constraints add to `qacc_smooth`; that
        depends on the controls of the first step."""
        if checked:
            _lanesim.check_finite("initial_warmstart", warmstart)
        controls = self.controls(checked)
        if self.nstep and controls is not None:
            values, stride, _ = controls
            worlds._w.write("ctrl", values, (0, stride), None, None)
        with np.errstate(invalid="ignore"):  # A warm start that is not a number is passed over by the solver.
            added = _arrays.numbers("initial_warmstart", warmstart - worlds.get("qacc_smooth"))
        worlds._w.write("qacc_warmstart", added, (0, self.model.nv), None, None)

    def controls(self, checked: bool) -> tuple[NDArray[Any], int, int] | None:
        """Controls with their strides from rollout to rollout and from step to step."""
        ctrl = self.control
        if ctrl is None:
            return None
        if checked:
            _lanesim.check_finite("control", ctrl)
        step = 0 if ctrl.shape[1] == 1 else self.model.nu
        world = 0 if ctrl.shape[0] == 1 else ctrl.shape[1] * self.model.nu
        return (ctrl, world, step)


def _check_kinds(model: Model, initial_state: ArrayLike) -> None:
    """A call meant for ``mujoco.rollout`` should learn what to change."""
    if not isinstance(model, Model):
        kind = type(model).__name__
        raise TypeError(f"model is a {kind}; expected one lanesim.Model, such as Model.from_xml_path loads")
    several = isinstance(initial_state, (list, tuple)) and len(initial_state) > 0
    first = initial_state[0] if several else initial_state  # type: ignore[index]
    if type(first).__name__ == "MjData":
        raise TypeError("initial_state is MjData, which is not needed here: leave it out, and give nthread if you like")


def _lead(name: str, values: ArrayLike, ndim: int) -> NDArray[Any]:
    """Numbers with dimensions of length 1 put in front where some are missing."""
    array = _arrays.numbers(name, values)
    if array.ndim > ndim:
        raise InputError(f"{name} can have at most {ndim} dimensions")
    return array.reshape((1,) * (ndim - array.ndim) + array.shape)


def _infer(what: str, axis: int, value: int | None, arrays: list[tuple[str, Any]]) -> int:
    """A dimension on which all arrays agree, unless they have length 1 there."""
    for name, array in arrays:
        if array is None or array.ndim <= axis or array.shape[axis] == 1 and value is not None:
            continue
        n = array.shape[axis]
        if value is not None and value != 1 and n != value:
            raise InputError(f"{what} inferred as {value} but {name} has {n}")
        value = n
    return 1 if value is None else value


def _trailing(name: str, array: NDArray[Any] | None, dims: list[tuple[str, int]]) -> None:
    """The last dimension must be right; the others were inferred."""
    if array is not None and array.shape[-1] != dims[-1][1]:
        raise _arrays.wrong_shape(name, array.shape, dims)


_persistent: dict[tuple[int, str], Rollout] = {}
_persistent_lock = threading.Lock()


def rollout(
    model: Model,
    initial_state: ArrayLike,
    control: ArrayLike | None = None,
    *,
    control_spec: int = STATE_CTRL,
    skip_checks: bool = False,
    nstep: int | None = None,
    initial_warmstart: ArrayLike | None = None,
    state: NDArray[Any] | None = None,
    sensordata: NDArray[Any] | None = None,
    outputs: Sequence[str] | None = None,
    nthread: int | None = None,
    precision: str = "f64",
    chunk_size: int | None = None,
    persistent_pool: bool = False,
    progress: Progress = None,
) -> Any:
    """Rolls out open-loop trajectories from initial states, with the shapes of ``mujoco.rollout.rollout``.

    ``mujoco.rollout.rollout(model, data, initial_state, control)`` becomes ``lanesim.rollout(model, initial_state,
    control)``; `nthread` takes the place of the list of ``MjData``. Keywords mean the same, except that with
    `skip_checks` results are still made and shapes still checked. There is one model per call.

    Inputs with a dimension of length 1 are repeated along it; missing leading dimensions count as 1. The memory of
    results that nobody refers to any more (up to 256 MiB) is kept for those of later calls, since memory fresh from the
    system costs time; `shutdown_persistent_pool` gives it back.

    Args:
        model: The model.
        initial_state: [nbatch or 1, nstate] in the layout of ``mjSTATE_FULLPHYSICS``: time (s), qpos, qvel, act.
        control: [nbatch or 1, nstep or 1, nu]; None: zero.
        control_spec: ``mjSTATE_CTRL``; nothing else is built yet.
        skip_checks: Do not look for numbers that are not finite. A world that gets one is frozen at its last good state.
        nstep: Number of steps; inferred if None.
        initial_warmstart: [nbatch or 1, nv], where the solver starts: MuJoCo's ``qacc_warmstart``, an acceleration (m/s^2,
            rad/s^2). None: from the acceleration without constraints. (``Worlds.qacc_warmstart`` is kept in
            another form.)
        state: Array to write to, [nbatch, nstep, nstate], float64 or float32.
        sensordata: Array to write to, [nbatch, nstep, nsensordata].
        outputs: Names of further quantities to record at every step (see `lanesim.OUTPUTS`): state quantities after the
            step, derived ones as the step computed them, from the state before it.
        nthread: Worker threads; None or 0: as many as there are processors.
        precision: "f64" or "f32"; arrays that are made here have that type.
        chunk_size: Accepted for ``mujoco.rollout``'s sake; work is shared out by blocks of worlds.
        persistent_pool: Keep threads and worlds for the next call.
        progress: True for a bar (needs tqdm), or a function of (world steps done, all of them).

    Returns:
        state, [nbatch, nstep, nstate], after each step; a world that diverges repeats its last good state.
        sensordata, [nbatch, nstep, nsensordata]: empty, since sensors are not built yet and nsensordata is 0.
        If `outputs` are given, also a dict of arrays [nbatch, nstep, ...].
    """
    arguments: dict[str, Any] = dict(
        control_spec=control_spec,
        skip_checks=skip_checks,
        nstep=nstep,
        initial_warmstart=initial_warmstart,
        state=state,
        sensordata=sensordata,
        outputs=outputs,
        chunk_size=chunk_size,
        progress=progress,
    )
    if not persistent_pool:
        with Rollout(nthread=nthread, precision=precision) as once:
            return once.rollout(model, initial_state, control, **arguments)
    _arrays.choice("precision", precision, PRECISIONS)
    with _persistent_lock:
        key = (0 if nthread is None else _arrays.count("nthread", nthread), precision)
        if key not in _persistent:
            _persistent[key] = Rollout(nthread=nthread, precision=precision)
    return _persistent[key].rollout(model, initial_state, control, **arguments)


def shutdown_persistent_pool() -> None:
    """Ends the threads that ``rollout(..., persistent_pool=True)`` keeps, and gives the memory of results back that was
    kept for later ones."""
    with _persistent_lock:
        for pool in _persistent.values():
            pool.close()
        _persistent.clear()
    _reuse.clear()


def _after_fork() -> None:
    """A forked process has none of the threads that the pools stand for, and nobody to open a lock that was closed."""
    global _persistent_lock
    _persistent_lock = threading.Lock()
    _persistent.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
