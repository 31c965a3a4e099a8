"""Rollouts: open-loop controls in, trajectories out, with the shapes and the state layout of ``mujoco.rollout``."""

from __future__ import annotations

import os
import threading
from typing import Any, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _lanesim, _reuse
from .errors import InputError, LanesimError, UnsupportedError
from .model import Model, check_model
from .progress import Progress
from .worlds import BACKENDS, PRECISIONS, Worlds

__all__ = ["Rollout", "rollout"]

STATE_CTRL = 1 << 6
"""MuJoCo's ``mjSTATE_CTRL``, the one `control_spec` that is built."""
_ARGUMENTS = (
    "model initial_state control control_spec skip_checks nstep initial_warmstart state sensordata outputs threads "
    "precision backend chunk_size persistent_pool progress"
).split()


class Rollout:
    """Threads, and the worlds of the latest rollout, for use from call to call.

    A call with the same model and number of rollouts as the one before allocates nothing but its results. May be used as
    a context manager; `close` ends the threads.
    """

    def __init__(
        self,
        *,
        threads: int | None = None,
        precision: str = "f64",
        backend: str = "auto",
        nthread: int | None = None,
    ) -> None:
        """`threads`: threads, the caller's among them; None: as many as there are processors. `precision` and `backend` as for `Worlds`.
        `nthread`: MuJoCo's name for `threads`; 0 counts as None."""
        _arrays.choice("precision", precision, PRECISIONS)
        _arrays.choice("backend", backend, BACKENDS)
        self.threads = _threads(threads, nthread)
        self._choice: dict[str, Any] = dict(precision=precision, backend=backend)
        self._pool: Any = _lanesim.Pool(self.threads or None)
        self._worlds: Worlds | None = None
        self._lock = threading.Lock()
        self._home = os.getpid()

    @property
    def nthread(self) -> int:
        """MuJoCo's name for `threads`."""
        return self.threads

    def __enter__(self) -> "Rollout":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the threads."""
        if self._home != os.getpid():  # They belong to another process, and the lock may be closed for ever.
            return
        with self._lock:
            self._pool = None
            self._worlds = None

    def rollout(
        self,
        model: Model,
        initial_state: ArrayLike,
        control: ArrayLike | None = None,
        *rest: Any,
        control_spec: int = STATE_CTRL,
        skip_checks: bool = False,
        nstep: int | None = None,
        initial_warmstart: ArrayLike | None = None,
        state: NDArray[Any] | None = None,
        sensordata: NDArray[Any] | None = None,
        outputs: Sequence[str] | None = None,
        chunk_size: int | None = None,
        progress: Progress = None,
        **unknown: Any,
    ) -> Any:
        """Like `lanesim.rollout`."""
        check_call(model, initial_state, control, rest, unknown)
        if self._home != os.getpid():  # The lock may be closed for ever.
            raise LanesimError("made before this process was forked, which has none of its threads: make a new Rollout")
        with self._lock:
            if self._pool is None:
                raise RuntimeError("rollout requested after thread pool shutdown")
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
            worlds = Worlds(model, nbatch, **self._choice, _pool=self._pool)
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
        recorded = worlds._recorded(_arrays.names_of(outputs), (nbatch, nstep), {})
        names, arrays = ["state", *recorded], [state, *recorded.values()]
        if model.nsensordata:
            names.append("sensordata")
            arrays.append(sensordata)
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
        self.nstate = _arrays.nstate(model)
        if nstep is not None:
            nstep = _arrays.count("nstep", nstep)
        start = _arrays.lead("initial_state", initial_state, 2)
        warm = None if initial_warmstart is None else _arrays.lead("initial_warmstart", initial_warmstart, 2)
        ctrl = None if control is None else _arrays.lead("control", control, 3)
        given = [("initial_state", start), ("initial_warmstart", warm), ("control", ctrl)]
        results = [("state", state), ("sensordata", sensordata)]
        for name, array in results:
            if array is not None and (not isinstance(array, np.ndarray) or array.ndim != 3):
                raise InputError(f"array `{name}` to write to must be a NumPy array [nbatch, nstep, n{name}]")
        self.nbatch = _arrays.count("nbatch", _arrays.infer("nbatch", 0, None, given + results), 1)
        self.nstep = _arrays.infer("nstep", 1, nstep, [("control", ctrl), *results])
        batch, step = ("nbatch", self.nbatch), ("nstep", self.nstep)
        _arrays.trailing("initial_state", start, [batch, ("nstate", self.nstate)])
        _arrays.trailing("initial_warmstart", warm, [batch, ("nv", model.nv)])
        _arrays.trailing("control", ctrl, [batch, step, ("nu", model.nu)])
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
        rows = self.initial_state
        stride = 0 if rows.shape[0] == 1 and self.nbatch > 1 else self.nstate
        check = ("initial_state", list(rows.shape)) if checked else None
        if checked:
            _arrays.check_range("initial_state", rows, worlds.dtype)
        worlds._w.write("state", rows, (0, stride), None, None, check)
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
            worlds._w.write("ctrl", values, (0, stride), None, None, None)
        with np.errstate(invalid="ignore"):  # A warm start that is not a number is passed over by the solver.
            added = _arrays.numbers("initial_warmstart", warmstart - worlds.get("qacc_smooth"))
        worlds._w.write("qacc_warmstart", added, (0, self.model.nv), None, None, None)

    def controls(self, checked: bool) -> tuple[NDArray[Any], int, int] | None:
        """Controls with their strides from rollout to rollout and from step to step."""
        if checked and self.control is not None:
            _lanesim.check_finite("control", self.control)
        return _arrays.strided(self.control)


def _holds_data(value: Any) -> bool:
    """Whether this is MjData, or a list of them."""
    first = value[0] if isinstance(value, (list, tuple)) and value else value
    return type(first).__name__ == "MjData"


def check_call(model: Any, initial_state: Any, control: Any, rest: tuple[Any, ...], unknown: dict[str, Any]) -> None:
    """A call meant for ``mujoco.rollout`` should learn what to change; other arguments too many are named."""
    what = "MjData" if not isinstance(initial_state, (list, tuple)) else "a list of MjData"
    if _holds_data(initial_state) or "data" in unknown:
        where = f"the second argument, {what}" if _holds_data(initial_state) else "the argument data"
        raise TypeError(
            f"leave out {where}: lanesim needs none. mujoco.rollout.rollout(model, data, initial_state, control) becomes "
            "lanesim.rollout(model, initial_state, control); threads=N takes the place of a list of N"
        )
    if isinstance(model, (list, tuple)) and model:
        raise TypeError("model is a list; lanesim.rollout takes one model per call: give the models one by one")
    check_model(model)
    if _holds_data(control):
        raise TypeError("control is MjData, which is not needed here: leave it out, and give the controls in its place")
    if rest:
        raise TypeError(
            f"rollout takes model, initial_state and control by position, and was given {3 + len(rest)} arguments; name "
            "the others, such as nstep=100"
        )
    for name in unknown:
        remedy = _lanesim.or_list(name, list(_ARGUMENTS))
        raise TypeError(f'rollout has no argument "{name}"' + (f"; {remedy}" if remedy.startswith("did") else ""))


def _threads(threads: int | None, nthread: int | None) -> int:
    """Number of threads, by lanesim's name or by MuJoCo's; 0: as many as there are processors."""
    if threads is not None and nthread is not None:
        raise InputError("threads and nthread are the same; give one of them")
    if threads is not None:
        return _arrays.count("threads", threads, 1)
    return 0 if nthread is None else _arrays.count("nthread", nthread)


_persistent: dict[tuple[int, str, str], Rollout] = {}
_persistent_lock = threading.Lock()


def rollout(
    model: Model,
    initial_state: ArrayLike,
    control: ArrayLike | None = None,
    *rest: Any,
    control_spec: int = STATE_CTRL,
    skip_checks: bool = False,
    nstep: int | None = None,
    initial_warmstart: ArrayLike | None = None,
    state: NDArray[Any] | None = None,
    sensordata: NDArray[Any] | None = None,
    outputs: Sequence[str] | None = None,
    threads: int | None = None,
    precision: str = "f64",
    backend: str = "auto",
    chunk_size: int | None = None,
    persistent_pool: bool = False,
    progress: Progress = None,
    nthread: int | None = None,
    **unknown: Any,
) -> Any:
    """Rolls out open-loop trajectories from initial states, with the shapes of ``mujoco.rollout.rollout``.

    ``mujoco.rollout.rollout(model, data, initial_state, control)`` becomes ``lanesim.rollout(model, initial_state,
    control)``; `threads` takes the place of the list of ``MjData``. Keywords mean the same, except that with
    `skip_checks` results are still made and shapes still checked. There is one model per call.

    Inputs with a dimension of length 1 are repeated along it; missing leading dimensions count as 1. The memory of
    results that nobody refers to any more (up to 256 MiB) is kept for those of later calls, since memory fresh from the
    system costs time; `shutdown_persistent_pool` gives it back.

    Args:
        model: The model.
        initial_state: [nbatch or 1, nstate] in the layout of ``mjSTATE_FULLPHYSICS``: time (s), qpos, qvel, act,
            history, plastic.
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
        threads: Threads, the caller's among them; None: as many as there are processors.
        precision: "f64" or "f32"; arrays that are made here have that type.
        backend: "auto", "native", "wide" or "scalar", as for `Worlds`; the same bits.
        chunk_size: Accepted for ``mujoco.rollout``'s sake; work is shared out by blocks of worlds.
        persistent_pool: Keep threads and worlds for the next call.
        progress: True for a bar (needs tqdm), or a function of (world steps done, all of them).
        nthread: MuJoCo's name for `threads`; 0 counts as None.

    Returns:
        state, [nbatch, nstep, nstate], after each step; a world that diverges repeats its last good state.
        sensordata, [nbatch, nstep, nsensordata]: what sensors measure at the state from which each step starts.
        If `outputs` are given, also a dict of arrays [nbatch, nstep, ...].
    """
    check_call(model, initial_state, control, rest, unknown)
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
    count = _threads(threads, nthread)
    choice: dict[str, Any] = dict(nthread=count, precision=precision, backend=backend)
    if not persistent_pool:
        with Rollout(**choice) as once:
            return once.rollout(model, initial_state, control, **arguments)
    _arrays.choice("precision", precision, PRECISIONS)
    _arrays.choice("backend", backend, BACKENDS)
    with _persistent_lock:
        key = (count, precision, backend)
        if key not in _persistent:
            _persistent[key] = Rollout(**choice)
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
