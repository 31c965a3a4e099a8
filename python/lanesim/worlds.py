"""Many worlds of one model."""

from __future__ import annotations

import copy
from typing import Any, Mapping, Sequence, Union, overload

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from . import _arrays, _lanesim, _reuse
from .errors import InputError, UnknownNameError, UnsupportedError
from .model import Model, check_model, output
from .progress import Progress, following
from .status import Status, StatusEvent

__all__ = ["PARAMETERS", "Worlds"]

PARAMETERS: dict[str, str] = dict(_lanesim.PARAMETERS)
"""Names and meanings of the model's arrays that can differ from world to world."""


PRECISIONS = ("f64", "f32")
BACKENDS = ("auto", "native", "wide", "scalar")
Ids = Union[ArrayLike, slice, None]
"""Which worlds: an array of their numbers, a mask [nworld] of bool, or a slice; None: all."""
_FORCES = ("qfrc_applied", "xfrc_applied")
_COUNTS = {
    "dof": "nv",
    "jnt": "njnt",
    "qpos": "nq",
    "actuator": "nactuator",
    "actuator_ctrlrange": "nu",
    "geom": "ngeom",
    "body": "nbody",
    "tendon": "ntendon",
}
_FIELDS = {name: (meaning, dims) for name, meaning, dims in _lanesim.FIELDS}
_KEPT = tuple(name for name in _FIELDS if name not in _FORCES)
# Those that a saved state has only if the model does.
_OPTIONAL = ("history", "plastic", "eq_active", "mocap_pos", "mocap_quat", "tree_rest", "tree_guard")


def _field(name: str, more: str = "") -> Any:
    meaning, dims = _FIELDS[name]

    def get(self: "Worlds") -> NDArray[Any]:
        array = self.get(name)
        array.flags.writeable = False
        return array

    def set_(self: "Worlds", values: ArrayLike) -> None:
        self.set(name, values)

    return property(get, set_, doc=f"{meaning} [{', '.join(['nworld', *dims])}] {more}".rstrip())


class Worlds:
    """`nworld` worlds of `model`, in the reference configuration and at rest.

    A world's results are the same bits whatever its place, its neighbours, the number of worlds and of threads.

    The state's fields (`qpos`, `qvel`, ...) are arrays with one row per world. Reading one copies it out of the engine;
    the copy is read-only, so that ``worlds.qpos[0] = 1`` cannot pass unnoticed without effect. Assign whole arrays
    (``worlds.qpos = q``; a single row goes to every world), or use `set` with a mask. Numbers are float64, or float32 if
    `precision` is "f32".

    `step`, `rollout`, `get`, `set`, `set_state`, `reset` and `forward` take `ids`: an array of worlds' numbers, each at most
    once, in any order, a mask of bool, [nworld], or a slice. Arrays then have a row for each of these worlds, in that order.
    What is done costs what so many worlds take, and the others keep their bits.

    precision: "f64", or "f32" for twice the worlds per vector register.
    threads: threads that may work at once, the caller's among them; None: as many as there are processors. Jobs too small
        to be worth it wake none.
    on_diverge: what happens to worlds whose state would become NaN, infinite or huge. "freeze": they keep their last good
        state, and `status` says so. "reset": they start anew from the reference configuration and go on; `status` keeps
        what happened. "raise": they are frozen, and `step` raises `DivergedError` once all others are done.
    backend: "auto", "native" (machine code made for the model), "wide" (SIMD lanes) or "scalar" (one world at a time);
        the same bits. "auto" is "native" where the machine allows it, else "wide".
    max_contacts: most contacts of a world.
    pin: tie threads to processors, for a machine that does nothing else: one for every processor that the process may use.
    max_memory: most bytes for worlds and threads; None: three quarters of what the system has to give. More is refused with
        `WorldMemoryError`.

    Worlds can be copied and pickled: what `save_state` saves goes along. They cannot be used in a forked process.
    Several batches may be used from several Python threads at once; the interpreter is free while one is stepped.
    """

    __slots__ = ("_model", "_nworld", "_precision", "_forced", "_choice", "_w", "__weakref__")

    def __init__(
        self,
        model: Model,
        nworld: int,
        precision: str = "f64",
        threads: int | None = None,
        on_diverge: str = "freeze",
        *,
        backend: str = "auto",
        max_contacts: int = 1 << 14,
        pin: bool = False,
        max_memory: int | None = None,
        _pool: Any = None,
    ) -> None:
        check_model(model)
        nworld = _arrays.count("nworld", nworld, 1)
        _arrays.choice("precision", precision, PRECISIONS)
        _arrays.choice("on_diverge", on_diverge, ("freeze", "reset", "raise"))
        _arrays.choice("backend", backend, BACKENDS)
        threads = None if threads is None else _arrays.count("threads", threads, 1)
        max_contacts = _arrays.count("max_contacts", max_contacts, 0)
        max_memory = None if max_memory is None else _arrays.count("max_memory", max_memory, 1)
        self._model = copy.copy(model)  # Options set later concern worlds made later.
        self._nworld = nworld
        self._precision = precision
        self._forced = False
        self._choice: dict[str, Any] = dict(
            precision=precision,
            backend=backend,
            threads=threads,
            pin=bool(pin),
            max_memory=max_memory,
            on_diverge=on_diverge,
            max_contacts=max_contacts,
        )
        self._w = _lanesim.Worlds(model._m, nworld, self._choice, _pool)

    def __reduce__(self) -> tuple[Any, ...]:
        return (_restore, (self._model, self._nworld, self._choice, self.save_state()))

    # ---- what it is ----------------------------------------------------------------------------------------------

    @property
    def model(self) -> Model:
        """The model."""
        return self._model

    @property
    def nworld(self) -> int:
        """Number of worlds."""
        return self._nworld

    @property
    def precision(self) -> str:
        """ "f64" or "f32"."""
        return self._precision

    @property
    def dtype(self) -> np.dtype:
        """Type of the arrays: float64 or float32."""
        return np.dtype(np.float32 if self._precision == "f32" else np.float64)

    @property
    def threads(self) -> int:
        """Number of threads that step, of which the caller's is one."""
        return self._w.engine()[0]

    @property
    def nbytes(self) -> int:
        """Bytes kept by the engine for all worlds, parameters that differ between them included; forces from outside come on
        top once they are set."""
        return self._w.engine()[3] * self._nworld

    def __len__(self) -> int:
        return self._nworld

    def __repr__(self) -> str:
        return f"<lanesim.Worlds {self._nworld} x {self._model.name!r} {self._precision}, {self.threads} threads>"

    # ---- state ---------------------------------------------------------------------------------------------------

    time = _field("time")
    qpos = _field("qpos")
    qvel = _field("qvel")
    act = _field("act")
    history = _field("history", "A reset puts it as it is at time 0.")
    plastic = _field("plastic")
    ctrl = _field("ctrl")
    qacc_warmstart = _field(
        "qacc_warmstart",
        "MuJoCo's array of that name holds ``qacc``; to start from one, set states and controls, then subtract ``get('qacc_smooth')``.",
    )
    eq_active = _field("eq_active", "A reset restores the model's.")
    qfrc_applied = _field("qfrc_applied")
    xfrc_applied = _field("xfrc_applied")
    mocap_pos = _field("mocap_pos", "A step leaves them; a reset puts them where the keyframe or the model has them.")
    mocap_quat = _field("mocap_quat", "Of any positive length. A reset does as with `mocap_pos`.")
    tree_rest = _field("tree_rest", "Set to 0, a tree is awake; positions that are set wake all trees of their worlds.")
    tree_guard = _field("tree_guard", "Positions or velocities that are set close the books of their worlds.")

    @property
    def status(self) -> NDArray[np.uint32]:
        """What happened to each world, [nworld] bits of `Status`."""
        bits = self._w.statuses()
        bits.flags.writeable = False
        return bits

    @property
    def lost(self) -> int:
        """Number of frozen worlds."""
        return int(np.count_nonzero(self.status & Status.Frozen))

    def status_detail(self, world: int) -> list[StatusEvent]:
        """For every bit of a world's status, when and where it was first set."""
        if not 0 <= world < self._nworld:
            raise InputError(f"there is no world {world}: the batch has {self._nworld}, counted from 0")
        return [StatusEvent(Status(bit), step, place) for bit, step, place in self._w.status_detail(world)]

    def set(self, name: str, values: ArrayLike, mask: ArrayLike | None = None, *, ids: Ids = None) -> None:
        """Sets a field of every world, of those where `mask` ([nworld], bool) is true, or of those that `ids` names; or a
        parameter of the model.

        Fields are the properties ``time``, ``qpos``, ... and ``state`` (see `set_state`). `values` has the field's shape
        [nworld, ...], with `ids` [len(ids), ...], or that of one row, which every world gets. Integers and other
        floats are converted; numbers that are not finite, other types and other shapes raise `InputError`.

        A parameter is an array of the model that can differ from world to world, such as ``gravity`` or ``geom_friction``:
        `PARAMETERS` lists them. A world with numbers of its own has the bits of a model that was compiled with them. Once
        one is set, all worlds have a row of their own, at first the model's; resets leave it as it is. What derived
        constants would make inconsistent, or a flag without effect, raises `InputError` with the reason.

        >>> worlds.set("gravity", [0.0, 0.0, -1.62], mask=moon)
        >>> worlds.set("qvel", 0.1 * rng.standard_normal((3, model.nv)), ids=[4, 0, 17])
        >>> worlds.set("geom_friction", model.geom_friction * rng.uniform(0.5, 1.5, (worlds.nworld, 1, 1)))
        """
        where, numbers = _arrays.chosen(mask, ids, self._nworld)
        row = self._row(name)
        count = self._nworld if numbers is None else len(numbers)
        array = _arrays.per_world(name, values, count, row, "nworld" if numbers is None else "ids")
        _arrays.check_range(name, array, self.dtype)
        if name == "eq_active" and not np.isin(array, (0, 1)).all():
            raise InputError(f"eq_active has the entry {array[~np.isin(array, (0, 1))][0]}; expected 0 or 1")
        width = int(np.prod([n for _, n in row]))
        single = array.ndim == len(row) or (array.shape[0] == 1 and count > 1)
        stride = 0 if single else width
        if name in PARAMETERS:
            _lanesim.check_finite(name, array)
            if numbers is not None:
                rows = np.zeros((self._nworld, *(n for _, n in row)), dtype=array.dtype)
                where = np.zeros(self._nworld, dtype=bool)
                rows[numbers], where[numbers] = array, True
                array, stride = rows, width
            self._w.write_parameter(name, array, (0, stride), where)
            return
        self._w.write(name, array, (0, stride), where, numbers, (name, list(array.shape)))
        self._forced |= name in _FORCES

    def set_state(self, rows: ArrayLike, mask: ArrayLike | None = None, *, ids: Ids = None) -> None:
        """Sets whole states: rows of time, qpos, qvel, act, history and plastic, as ``get("state")`` gives them and as `lanesim.rollout`
        takes and returns them, [nworld or len(ids), nstate], or one for every world.

        Controls, warm start, forces from outside and status stay as they are; `reset` clears them. The warm start only
        decides where the solver starts.

        >>> state = worlds.get("state", ids=best)
        >>> worlds.set_state(state, ids=worst)
        """
        self.set("state", rows, mask, ids=ids)

    def _row(self, name: str) -> list[tuple[str, int]]:
        """A field's dimensions after the first."""
        m = self._model
        rows: dict[str, list[tuple[str, int]]] = {field: m._m.field(field) for field in _FIELDS}
        rows["state"] = [("nstate", _arrays.nstate(m))]
        if isinstance(name, str) and name in PARAMETERS:
            shape = getattr(m, name).shape
            return list(zip([_COUNTS.get(name, _COUNTS.get(name.split("_")[0], "")), ""], shape))
        if isinstance(name, str) and m._m.array(name) is not None:
            self._w.parameter(name)  # Which says why it cannot.
        if not isinstance(name, str) or name not in rows:
            if isinstance(name, str) and name.split(":")[0] in {known.split(":")[0] for known, _ in _lanesim.OUTPUTS}:
                raise UnknownNameError(f'"{name}" is computed, not set; what can be set is {", ".join(rows)}')
            raise UnknownNameError(_arrays.unknown("field", name, [*rows, *PARAMETERS], "help(Worlds.set)"))
        return rows[name]

    @property
    def varying(self) -> tuple[str, ...]:
        """Names of the parameters that differ between worlds, in the order in which they began to."""
        return tuple(self._w.varying())

    def _parameter(self, name: str, out: NDArray[Any] | None, ids: NDArray[Any] | None) -> NDArray[Any]:
        row = self._row(name)
        rows: NDArray[Any] = self._w.parameter(name).reshape(self._nworld, *(n for _, n in row))
        if ids is not None:
            rows = rows[ids]
        if out is None:
            return rows
        dims = [("nworld", len(rows)), *row]
        np.copyto(_arrays.target(name, out, rows.shape, dims, (np.float64, np.float32)), rows, casting="same_kind")
        return out

    @overload
    def get(self, name: str, out: NDArray[Any] | None = None, *, ids: Ids = None) -> NDArray[Any]: ...
    @overload
    def get(self, name: list[str] | tuple[str, ...], *, ids: Ids = None) -> dict[str, NDArray[Any]]: ...
    def get(self, name: str | list[str] | tuple[str, ...], out: NDArray[Any] | None = None, *, ids: Ids = None) -> Any:
        """A field of every world or of those that `ids` names, or several fields at once as a dict; `lanesim.OUTPUTS`
        describes them. The Jacobian of a point, [nworld, 6, nv] as by ``mj_jacSite``, is ``jac_site:NAME``, and so on.

        State fields are copied; derived ones (``xpos``, ``qM``, ``qacc``, ``contact_dist``, ...) are computed for the
        present state, as `forward` does. Shapes are MuJoCo's with a leading [nworld], or [len(ids)]. Where worlds differ in
        length (contacts, constraint rows) arrays are padded with zeros to the longest, and ``ncon`` and ``nefc`` count.
        Parameters (see `set`) are the numbers that were set, in float64.

        `out`: an array of that shape, float64 or float32 (int32 for integers), to write to instead of a new one.
        """
        numbers = _arrays.ids_of(ids, self._nworld)
        if isinstance(name, (list, tuple)):
            if out is not None:
                raise InputError("out goes with a single name")
            names = _arrays.names_of(name)
            return dict(zip(names, self._read(names, [None] * len(names), numbers)))
        return self._read([name], [out], numbers)[0]

    def _read(
        self, names: list[str], outs: list[NDArray[Any] | None], ids: NDArray[Any] | None = None
    ) -> list[NDArray[Any]]:
        derived = [(name, out) for name, out in zip(names, outs) if name not in PARAMETERS]
        arrays = iter(self._compute([name for name, _ in derived], [out for _, out in derived], ids) if derived else ())
        return [
            self._parameter(name, out, ids) if name in PARAMETERS else next(arrays) for name, out in zip(names, outs)
        ]

    def _kind(self, name: str, integer: bool) -> DTypeLike:
        """The type of an output. Whole states are double: time and positions have more digits than single precision."""
        return np.int32 if integer else np.float64 if name == "state" else self.dtype

    def _compute(
        self, names: list[str], outs: list[NDArray[Any] | None], ids: NDArray[Any] | None
    ) -> list[NDArray[Any]]:
        nworld = self._nworld if ids is None else len(ids)
        arrays: list[Any] = []
        shapes = []
        for name, out in zip(names, outs):
            fixed, shape, integer = output(self._model, name)
            shapes.append(shape)
            whole = (nworld, *shape)
            if not fixed:
                if out is not None:
                    raise InputError(f"{name} differs in length between worlds: out cannot be given")
                arrays.append(None)
            elif out is None:
                arrays.append(np.empty(whole, dtype=self._kind(name, integer)))
            else:
                kinds = (np.int32,) if integer else (np.float64, np.float32)
                dims = [("nworld" if ids is None else "ids", nworld), *(("", n) for n in shape)]
                arrays.append(_arrays.target(name, out, whole, dims, kinds))
        padded = self._w.read(names, arrays, ids)
        for i, entry in enumerate(padded):
            if entry is not None:
                longest, flat = entry
                width = int(np.prod(shapes[i]))
                arrays[i] = flat.reshape(nworld, longest // width if width else 0, *shapes[i])
        return arrays

    # ---- time ----------------------------------------------------------------------------------------------------

    def step(
        self, nstep: int = 1, ctrl: ArrayLike | None = None, *, ids: Ids = None, progress: Progress = None
    ) -> None:
        """Advances every world, or those that `ids` names, by `nstep` steps with the present controls, or with `ctrl`
        ([nworld or len(ids), nu] or [nu]), which become the present ones.

        Ctrl-C stops a long run: every world has then made some whole number of steps, not all the same number.
        `progress`: True for a bar (needs tqdm), or a function that is called with (world steps done, all of them).
        """
        nstep = _arrays.count("nstep", nstep)
        numbers = _arrays.ids_of(ids, self._nworld)
        if ctrl is not None:
            self.set("ctrl", ctrl, ids=ids)
        self._run(nstep, None, [], [], progress, numbers)

    def rollout(
        self,
        control: ArrayLike | None = None,
        *,
        outputs: Sequence[str] | None = None,
        nstep: int | None = None,
        ids: Ids = None,
        out: Mapping[str, NDArray[Any]] | None = None,
        progress: Progress = None,
    ) -> dict[str, NDArray[Any]]:
        """Steps from the present states on under given controls, and records every step; parameters that were set are in
        force.

        Args:
            control: [nworld, nstep, nu]; [nstep, nu] for the same in every world; dimensions of length 1 are repeated.
                None: every world keeps its present controls. The last ones given become the present ones.
            outputs: What to record (see `lanesim.OUTPUTS`), None for ``["state"]``: state quantities after each step, derived ones as the step
                computed them, from the state before it.
            nstep: Number of steps; inferred from `control` if None, and 1 without.
            ids: Which worlds; None: all. With `ids`, nworld stands for their number here.
            out: Arrays to write to, by output: [nworld, nstep, ...], float64 or float32 (int32 for integers).
            progress: True for a bar (needs tqdm), or a function of (world steps done, all of them).

        Returns:
            A dict: for each output an array [nworld, nstep, ...].

        >>> rows = worlds.rollout(rng.uniform(-1, 1, (50, model.nu)), outputs=["qpos", "subtree_com"])
        >>> rows["qpos"].shape
        (1024, 50, 15)
        """
        numbers = _arrays.ids_of(ids, self._nworld)
        nworld = self._nworld if numbers is None else len(numbers)
        nstep = None if nstep is None else _arrays.count("nstep", nstep)
        ctrl = None if control is None else _arrays.lead("control", control, 3)
        nstep = _arrays.infer("nstep", 1, nstep, [("control", ctrl)])
        if ctrl is not None:
            dims = [("nworld" if numbers is None else "ids", nworld), ("nstep", nstep), ("nu", self._model.nu)]
            if ctrl.shape[0] not in (1, nworld) or ctrl.shape[2] != self._model.nu:
                raise _arrays.wrong_shape("control", np.asarray(control).shape, dims)
            _arrays.check_range("control", ctrl, self.dtype)
            _lanesim.check_finite("control", ctrl)
        recorded = self._recorded(
            _arrays.names_of(["state"] if outputs is None else outputs), (nworld, nstep), out or {}
        )
        for name, array in recorded.items():
            if ctrl is not None and np.may_share_memory(array, ctrl):
                raise InputError(f"out array `{name}` overlaps `control`, which would change while it is read")
        self._run(nstep, _arrays.strided(ctrl), list(recorded), list(recorded.values()), progress, numbers)
        return recorded

    def _recorded(
        self, names: list[str], lead: tuple[int, int], out: Mapping[str, NDArray[Any]]
    ) -> dict[str, NDArray[Any]]:
        """Arrays [*lead, ...] to record outputs in: those given, and new ones."""
        if not isinstance(out, Mapping):
            raise InputError(f"out is a {type(out).__name__}; expected a dict from outputs' names to arrays")
        for name in out:
            if name not in names:
                raise InputError(f'out has an array for "{name}", which is not among the outputs')
        recorded: dict[str, NDArray[Any]] = {}
        for name in names:
            fixed, shape, integer = output(self._model, name)
            if not fixed:
                raise InputError(f"{name} differs in length between worlds and cannot be recorded in a rollout")
            whole = (*lead, *shape)
            if name in out:
                dims = [("nworld", lead[0]), ("nstep", lead[1]), *(("", n) for n in shape)]
                kinds = (np.int32,) if integer else (np.float64, np.float32)
                recorded[name] = _arrays.target(name, out[name], whole, dims, kinds)
            else:
                recorded[name] = _reuse.empty(whole, self._kind(name, integer))
        given = list(out.values())
        for i, array in enumerate(given):
            if any(np.may_share_memory(array, other) for other in given[i + 1 :]):
                raise InputError("two arrays of out overlap; each needs memory of its own")
        return recorded

    def _run(
        self,
        nstep: int,
        controls: Any,
        names: list[str],
        targets: list[Any],
        progress: Progress,
        ids: NDArray[Any] | None = None,
    ) -> None:
        nworld = self._nworld if ids is None else len(ids)
        with following(progress, nworld * nstep) as callback:
            self._w.run(nstep, controls, names, targets, callback, ids)

    def forward(self, *, ids: Ids = None) -> None:
        """Computes everything up to the acceleration for the present states, and with it `status`.

        Nothing is stored; `get` computes what it returns.
        """
        self._w.read([], [], _arrays.ids_of(ids, self._nworld))

    def inverse(self, qacc: ArrayLike, out: NDArray[Any] | None = None) -> NDArray[Any]:
        """Inverse dynamics of the present states: for each world the generalised force (N, N m) that must come from actuators
        and from outside so that it has the acceleration `qacc`, [nworld, nv] or one row for all (m/s^2, rad/s^2).

        MuJoCo's ``qfrc_inverse``, [nworld, nv], written to `out` if that is given. Where the model's flag ``invdiscrete`` is set,
        `qacc` is what qvel gains over a step, divided by the time step: `Model.replace` sets flags. Frozen worlds, and those
        whose state cannot be stepped, have NaN. States stay as they are.

        Raises:
            InputError: An array has another shape, or a number that is not finite.
            OptionError: ``invdiscrete`` with the integrator RK4, which evaluates several states in a step.
        """
        nworld, nv = self._nworld, self._model.nv
        rows = _arrays.per_world("qacc", qacc, nworld, [("nv", nv)])
        _arrays.check_range("qacc", rows, self.dtype)
        if out is None:
            out = np.empty((nworld, nv), self.dtype)
        else:
            dims = [("nworld", nworld), ("nv", nv)]
            out = _arrays.target("out", out, (nworld, nv), dims, (np.float64, np.float32))
        self._w.inverse(rows, (0, 0 if rows.size == nv else nv), out, list(rows.shape))
        return out

    def reset(self, mask: ArrayLike | None = None, key: int | str | None = None, *, ids: Ids = None) -> None:
        """Puts every world, those where `mask` ([nworld], bool) is true, or those that `ids` names, into a keyframe (number
        or name) or into the reference configuration, and clears forces from outside, warm start and status."""
        index = None if key is None else self._model._key(key)
        where, numbers = _arrays.chosen(mask, ids, self._nworld)
        self._w.reset(where, numbers, index)

    def _kept(self) -> tuple[str, ...]:
        """Fields of a saved state."""
        return tuple(name for name in _KEPT if name not in _OPTIONAL or self._model._m.field(name)[0][1])

    def save_state(self) -> dict[str, NDArray[Any]]:
        """All that is kept of the worlds, bit by bit: a dict of arrays, fit for ``np.savez`` and for `load_state`."""
        names = [*self._kept(), *(_FORCES if self._forced else ()), *self.varying]
        # In double precision, which holds all digits of time and positions.
        outs = [np.empty((self._nworld, *(n for _, n in self._row(name)))) for name in names]
        return {**dict(zip(names, self._read(names, outs))), "status": self._w.statuses()}

    def load_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Restores what `save_state` returned: stepping goes on with the same bits."""
        missing = [name for name in (*self._kept(), "status") if name not in state]
        if missing:
            raise InputError(f"the state has no array `{missing[0]}`")
        arrays = {}
        # Parameters in the order in which they were saved: some can only follow others.
        parameters = [name for name in state if name in PARAMETERS]
        for name in (*self._kept(), *(f for f in _FORCES if f in state), *parameters):
            arrays[name] = _arrays.numbers(name, state[name])
            dims = [("nworld", self._nworld), *self._row(name)]
            if arrays[name].shape != tuple(n for _, n in dims):
                raise _arrays.wrong_shape(name, arrays[name].shape, dims)
        status = np.asarray(state["status"])
        if status.dtype.kind not in "ui":
            raise InputError(f"array `status` has type {status.dtype}; expected uint32")
        status = np.ascontiguousarray(status, dtype=np.uint32)
        if status.shape != (self._nworld,):
            raise _arrays.wrong_shape("status", status.shape, [("nworld", self._nworld)])
        if self._forced:
            zero = np.zeros(1, dtype=self.dtype)
            for name in _FORCES:
                width = int(np.prod([n for _, n in self._row(name)]))
                arrays.setdefault(name, np.broadcast_to(zero, (width,)).copy())
        for name in self.varying:
            arrays.setdefault(name, np.ascontiguousarray(self._model._m.array(name), dtype=np.float64))
        for name, array in arrays.items():
            if name in PARAMETERS:
                self.set(name, array)
                continue
            width = int(np.prod([n for _, n in self._row(name)]))
            stride = width if array.ndim == 1 + len(self._row(name)) else 0
            self._w.write(name, array, (0, stride), None, None, None)
            self._forced |= name in _FORCES
        self._w.set_statuses(status)

    def state_hash(self) -> int:
        """64-bit hash of positions and velocities in the order of worlds: equal for equal bits."""
        return self._w.state_hash()


def _restore(model: Model, nworld: int, choice: dict[str, Any], state: dict[str, NDArray[Any]]) -> Worlds:
    worlds = Worlds(model, nworld, **choice)
    worlds.load_state(state)
    return worlds
