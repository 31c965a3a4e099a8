"""Models."""

from __future__ import annotations

import enum
import os
import warnings
from typing import Any, Iterable, Mapping, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from . import _arrays, _lanesim, mjmodel
from .errors import InputError, LossWarning, ModelError, UnknownNameError

__all__ = ["Cone", "Integrator", "Key", "Model", "Options", "Report", "Solver"]


class Integrator(enum.IntEnum):
    """Numerical integrators, with MuJoCo's numbers; ``midpoint`` is not in MuJoCo."""

    Euler = 0
    RK4 = 1
    implicit = 2
    implicitfast = 3
    discrete = 4
    midpoint = 5


class Cone(enum.IntEnum):
    """Friction cones, with MuJoCo's numbers."""

    pyramidal = 0
    elliptic = 1


class Solver(enum.IntEnum):
    """Constraint solvers, with MuJoCo's numbers."""

    PGS = 0
    CG = 1
    Newton = 2


KINDS = ("body", "joint", "geom", "site", "equality", "actuator", "key")
"""Kinds of elements that have names."""
_ENUMS: dict[str, type[enum.IntEnum]] = {"integrator": Integrator, "cone": Cone, "solver": Solver}
_OPTIONS = (
    "timestep gravity wind magnetic density viscosity impratio tolerance ls_tolerance noslip_tolerance "
    "ccd_tolerance sleep_tolerance iterations ls_iterations noslip_iterations ccd_iterations o_margin o_solref o_solimp "
    "o_friction integrator guard cone solver"
).split()


class Report(NamedTuple):
    """What one should know about a model that compiled."""

    notes: list[str]
    """What was adjusted, or acts otherwise than it may seem."""
    losses: list[str]
    """What a lenient load left out."""


class Key(NamedTuple):
    """A keyframe."""

    name: str
    """Name, or empty."""
    time: float
    """Time, s."""
    qpos: NDArray[np.float64]
    """Positions, [nq]."""
    qvel: NDArray[np.float64]
    """Velocities, [nv]."""
    act: NDArray[np.float64]
    """Activations, [na]."""
    ctrl: NDArray[np.float64]
    """Controls, [nu]."""
    mpos: NDArray[np.float64]
    """Positions of mocap bodies, [nmocap, 3], m."""
    mquat: NDArray[np.float64]
    """Orientations of mocap bodies, [nmocap, 4], (w, x, y, z)."""


def _is(value: Any, name: str) -> bool:
    """Whether a value is of MuJoCo's class of that name. MuJoCo need not be installed."""
    kind = type(value)
    return kind.__name__ == name and kind.__module__.partition(".")[0] == "mujoco"


def check_model(model: Any) -> None:
    """An exception that says how to come by a lanesim.Model, if this is none."""
    if isinstance(model, Model):
        return
    if _is(model, "MjModel"):
        raise TypeError(
            "model is a mujoco.MjModel; expected a lanesim.Model: lanesim.Model.from_mjmodel(model) makes one of it"
        )
    if _is(model, "MjSpec"):
        raise TypeError(
            "model is a mujoco.MjSpec; expected a lanesim.Model: lanesim.Model.from_spec(model) makes one of it"
        )
    if isinstance(model, (list, tuple)) and model:
        raise TypeError(f"model is a {type(model).__name__}; expected one lanesim.Model, the same for all worlds")
    raise TypeError(f"model is a {type(model).__name__}; expected a lanesim.Model, such as Model.from_xml_path loads")


def output(model: "Model", name: Any) -> tuple[bool, list[int], bool]:
    """An output's (lengths equal in all worlds, shape per world or per entry, integer)."""
    known = dict(_lanesim.OUTPUTS)
    if not isinstance(name, str) or (name not in known and ":" not in name):
        raise UnknownNameError(_arrays.unknown("output", name, known, "lanesim.OUTPUTS"))
    return model._m.output(name)


@runtime_checkable
class SupportsToXml(Protocol):
    """What `Model.from_spec` takes: `lanesim.Spec`, `mujoco.MjSpec` and the like."""

    def to_xml(self) -> str: ...


def _text(value: Any) -> str:
    """An option's value as MJCF writes it."""
    if isinstance(value, enum.Enum):
        return value.name
    if isinstance(value, (bool, np.bool_)):
        return "enable" if value else "disable"
    if isinstance(value, str):
        return value
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    if isinstance(value, (list, tuple, np.ndarray)):
        return " ".join(_text(x) for x in np.asarray(value).tolist())
    raise InputError(f"{value!r} is not the value of an option")


def _overrides(options: Mapping[str, Any] | None) -> list[tuple[str, str]]:
    out = []
    for name, value in (options or {}).items():
        if name in _ENUMS and isinstance(value, (int, np.integer)) and not isinstance(value, bool):
            try:
                value = _ENUMS[name](int(value))
            except ValueError:
                valid = ", ".join(f"{x.name} ({x.value})" for x in _ENUMS[name])
                raise InputError(f"option {name} is {value}; expected one of {valid}") from None
        out.append((str(name), _text(value)))
    return out


def _losses(compiled: _lanesim.Model) -> list[str]:
    """What a lenient load left out; where the text is a single line, which one is not said."""
    losses = compiled.losses()
    file, text, *_ = compiled.document()
    if file is None and "\n" not in text.strip():
        losses = [loss.removeprefix("line 1: ") for loss in losses]
    return losses


class Options:
    """Options of a model, MuJoCo's ``model.opt``: read an attribute, or set it.

    Setting one recompiles the model, so that everything derived from it is right; worlds that exist keep the model
    with which they were made. Several at once: ``opt.set(timestep=0.001, solver="CG", contact=False)``. ``integrator``,
    ``cone`` and ``solver`` are enumerations with MuJoCo's numbers and take names, too. ``timestep`` is in s,
    ``gravity`` in m/s^2 (as written, also while its flag is off), ``density`` in kg/m^3, ``viscosity`` in kg/(m s).
    """

    __slots__ = ("_model",)

    def __init__(self, model: "Model") -> None:
        object.__setattr__(self, "_model", model)

    def __getattr__(self, name: str) -> Any:
        if name not in _OPTIONS:
            raise AttributeError(_arrays.unknown("option", name, self.__dir__()))
        value = self._model._m.array(name)
        if value.ndim == 0:
            if name == "guard":
                return bool(value)
            return _ENUMS[name](int(value)) if name in _ENUMS else value.item()
        value.flags.writeable = False
        return value

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in _OPTIONS:
            raise AttributeError(_arrays.unknown("option", name, _OPTIONS))
        self.set(**{name: value})

    def set(self, **options: Any) -> None:
        """Sets options, and flags as True or False."""
        self._model._m = self._model._m.with_options(_overrides(options))
        self._model._arrays.clear()

    @property
    def flags(self) -> dict[str, bool]:
        """Flags of MJCF's ``option/flag``: True means enabled. A copy; `set` changes them."""
        return dict(self._model._m.flags())

    def __dir__(self) -> list[str]:
        return [*_OPTIONS, "flags", "set"]

    def __repr__(self) -> str:
        return "Options(" + ", ".join(f"{name}={getattr(self, name)!r}" for name in _OPTIONS) + ")"


class Model:
    """A compiled model.

    Attributes under MuJoCo's names: sizes (``nq``, ``nv``, ``nu``, ``na``, ``nbody``, ``njnt``, ``ngeom``, ``nsite``,
    ...) and arrays (``qpos0`` [nq], ``body_mass`` [nbody] in kg, ``jnt_range`` [njnt, 2] in rad or m, ``geom_size``
    [ngeom, 3] in m, ...; read-only). `array_names` lists them. A model can be pickled: it carries its text with it.
    """

    __slots__ = ("_m", "_arrays", "__weakref__")
    _m: _lanesim.Model
    _arrays: dict[str, Any]

    def __init__(self) -> None:
        raise TypeError("use Model.from_xml_path, Model.from_xml_string, Model.from_spec or Model.from_mjmodel")

    @classmethod
    def _of(cls, compiled: Any) -> "Model":
        model = object.__new__(cls)
        model._m = compiled
        model._arrays = {}
        return model

    @classmethod
    def _loaded(cls, compiled: Any, caller: int = 3) -> "Model":
        """The same; the caller that many frames away is warned of what was left out."""
        losses = _losses(compiled)
        if losses:
            more = f", and {len(losses) - 3} more" if len(losses) > 3 else ""
            text = "; ".join(losses[:3])
            what = f"left out of the model: {text}{more} (Model.report().losses lists everything)"
            warnings.warn(what, LossWarning, stacklevel=caller)
        return cls._of(compiled)

    @classmethod
    def from_xml_path(
        cls,
        path: str | os.PathLike[str],
        *,
        lenient: bool = False,
        options: Mapping[str, Any] | None = None,
    ) -> "Model":
        """Loads an MJCF file. Files that it includes are found relative to it.

        `lenient`: leave out what is not supported, with a line in ``report().losses`` each and one `LossWarning`, instead of
        rejecting the model. `options` replace the file's: names and values of MJCF's ``option``, and of ``flag`` as True or False.
        Raises `ModelError`, which names file, line and element.
        """
        return cls._loaded(_lanesim.Model.load(os.fsdecode(path), bool(lenient), _overrides(options)))

    @classmethod
    def from_xml_string(
        cls,
        xml: str,
        assets: Mapping[str, str | bytes] | None = None,
        *,
        lenient: bool = False,
        options: Mapping[str, Any] | None = None,
    ) -> "Model":
        """Parses MJCF text; `assets` are the files that it reads, by name: included ones and those of meshes. Otherwise like `from_xml_path`."""
        if assets is not None and not isinstance(assets, Mapping):
            raise TypeError(f"assets is a {type(assets).__name__}; expected a dict from file names to contents")
        if not isinstance(xml, str):
            raise TypeError(f"xml is a {type(xml).__name__}; expected str")
        return cls._loaded(cls._parse(xml, assets, lenient, options))

    @staticmethod
    def _parse(
        xml: str, assets: Mapping[str, str | bytes] | None, lenient: bool, options: Mapping[str, Any] | None
    ) -> Any:
        files = {}
        for name, content in (assets or {}).items():
            files[str(name)] = content.encode() if isinstance(content, str) else bytes(content)
        return _lanesim.Model.parse(xml, files, bool(lenient), _overrides(options))

    @classmethod
    def from_spec(
        cls, spec: SupportsToXml, *, lenient: bool = False, options: Mapping[str, Any] | None = None
    ) -> "Model":
        """Compiles a model built in code: a `Spec`, a ``mujoco.MjSpec``, or any object whose method ``to_xml`` gives MJCF
        text.

        A ``mujoco.MjSpec`` is compiled by MuJoCo and taken over number by number, as `from_mjmodel` does: its ``to_xml``
        rounds to six digits.
        """
        if _is(spec, "MjModel"):
            raise TypeError("spec is a mujoco.MjModel; Model.from_mjmodel takes it")
        if not isinstance(spec, SupportsToXml):
            raise TypeError(f"a {type(spec).__name__} has no method to_xml; expected a Spec")
        if _is(spec, "MjSpec"):
            try:
                compiled = spec.copy().compile()  # type: ignore[attr-defined]
            except ValueError as error:
                raise ModelError(f"MuJoCo cannot compile the MjSpec: {error}") from None
            return cls._loaded(cls._taken(compiled, lenient, options))
        assets = getattr(spec, "assets", None)
        assets = assets if isinstance(assets, Mapping) else None
        return cls._loaded(cls._parse(spec.to_xml(), assets, lenient, options))

    @classmethod
    def from_mjmodel(cls, model: Any, *, lenient: bool = False, options: Mapping[str, Any] | None = None) -> "Model":
        """Takes over a ``mujoco.MjModel``, number by number, as it is now: changes that were made after loading count.

        Every array that both have is compared. What lanesim has not got, or what no MJCF could have given (masses that were
        changed without ``mj_setConst``, for instance), raises `ModelError` with the reason. `lenient` leaves out what is
        not supported; `options` replace the model's, as in `from_xml_path`. Elements that have no name but that others
        refer to get one, such as ``geom 3``.
        """
        if not _is(model, "MjModel"):
            raise TypeError(f"model is a {type(model).__name__}; expected a mujoco.MjModel")
        return cls._loaded(cls._taken(model, lenient, options))

    @classmethod
    def _taken(cls, exact: Any, lenient: bool, options: Mapping[str, Any] | None) -> Any:
        try:
            compiled = cls._parse(mjmodel.spec_of(exact).to_xml(), None, lenient, None)
        except ModelError as error:  # Lines of a text that nobody has seen help nobody.
            lines = [
                f"MjModel: {d.element}: {d.message}" + (f" ({d.remedy})" if d.remedy else "") for d in error.diagnostics
            ]
            places = [(None, 0, *d[2:]) for d in error.diagnostics]
            raise ModelError("\n".join(lines) or str(error), places) from None
        old = next(mjmodel.stale(exact), None)
        if old is not None:
            raise ModelError(
                f"MjModel: {old}: it was changed after loading; mujoco.mj_setConst(model, data) brings derived constants up "
                "to date"
            )
        wrong = [] if compiled.losses() else list(mjmodel.differences(exact, cls._of(compiled)))
        if wrong:
            more = f" (and {len(wrong) - 1} more)" if len(wrong) > 1 else ""
            raise ModelError(f"MjModel: it holds what MJCF cannot express: {wrong[0]}{more}")
        return compiled.with_options(_overrides(options)) if options else compiled

    def replace(self, **options: Any) -> "Model":
        """The same model with other options, as ``opt.set`` takes them; this one stays as it is."""
        return Model._of(self._m.with_options(_overrides(options)))

    def __reduce__(self) -> tuple[Any, ...]:
        return (_restore, self._m.document())

    def __copy__(self) -> "Model":
        return Model._of(self._m)

    def __deepcopy__(self, memo: dict[int, Any]) -> "Model":
        return Model._of(self._m)

    @property
    def name(self) -> str:
        """Name of the model."""
        return self._m.name

    @property
    def opt(self) -> Options:
        """Options; can be set."""
        return Options(self)

    def report(self) -> Report:
        """What one should know about the model: notes, and what a lenient load left out."""
        return Report(self._m.notes(), _losses(self._m))

    def sizes(self) -> dict[str, int]:
        """Numbers of elements by MuJoCo's names."""
        return dict(self._m.sizes())

    @property
    def array_names(self) -> list[str]:
        """Names of all model arrays."""
        return self._m.array_names()

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        arrays = self._arrays
        if not arrays:
            arrays.update(self._m.sizes())
        if name not in arrays:
            value = self._m.array(name)
            if value is None:
                known = [*dict(self._m.sizes()), *self._m.array_names(), *vars(Model)]
                remedy = _lanesim.or_list(name, [x for x in known if not x.startswith("_")])
                raise AttributeError(f"the model has no attribute {name}; {remedy or 'array_names lists its arrays'}")
            value.flags.writeable = False
            arrays[name] = value
        return arrays[name]

    def __dir__(self) -> Iterable[str]:
        return [*super().__dir__(), *self._m.array_names(), *dict(self._m.sizes())]

    def names(self, kind: str) -> list[str]:
        """Names of all elements of a kind, in order; empty where one has none.

        Kinds are body, joint, geom, site, actuator and key.
        """
        try:
            return self._m.names(kind)
        except KeyError:
            raise UnknownNameError(_arrays.unknown("kind of element", kind, KINDS)) from None

    def id(self, kind: str, name: str) -> int:
        """Number of the element of that kind and name."""
        known = self.names(kind)
        found = self._m.id(kind, name)
        if found is None:
            raise UnknownNameError(_arrays.unknown(kind, name, [x for x in known if x], f'names("{kind}")'))
        return found

    def key(self, key: int | str = 0) -> Key:
        """A keyframe by number or name."""
        i = self._key(key)
        fields = {field: getattr(self, "key_" + field)[i] for field in Key._fields[2:]}
        fields["mpos"] = fields["mpos"].reshape(-1, 3)
        fields["mquat"] = fields["mquat"].reshape(-1, 4)
        return Key(name=self.names("key")[i], time=float(self.key_time[i]), **fields)

    def _key(self, key: int | str) -> int:
        if isinstance(key, str):
            return self.id("key", key)
        if _arrays.count("key", key) >= self.nkey:
            raise UnknownNameError(f"there is no keyframe {key}: the model has {self.nkey}")
        return int(key)

    @property
    def actuator_noiserange(self) -> NDArray[np.float64]:
        """Range from which control noise is drawn, [nu, 2]: the control range if limited, two units from its other end where
        one is infinite; else [-1, 1]."""
        return np.array(self._m.control_ranges()).reshape(-1, 2)

    def __repr__(self) -> str:
        sizes = self.sizes()
        shown = ", ".join(f"{name}={sizes[name]}" for name in ("nq", "nv", "nu", "nbody", "ngeom"))
        return f"<lanesim.Model {self.name!r} {shown}>"


def _restore(*document: Any) -> Model:
    return Model._of(_lanesim.Model.restore(*document))
