"""Models."""

from __future__ import annotations

import enum
import os
from typing import Any, Iterable, Mapping, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from . import _arrays, _lanesim
from .errors import InputError, UnknownNameError

__all__ = ["Cone", "Integrator", "Key", "Model", "Options", "Report", "Solver"]


class Integrator(enum.IntEnum):
    """Numerical integrators, with MuJoCo's numbers."""

    Euler = 0
    RK4 = 1
    implicit = 2
    implicitfast = 3
    discrete = 4


class Cone(enum.IntEnum):
    """Friction cones, with MuJoCo's numbers."""

    pyramidal = 0
    elliptic = 1


class Solver(enum.IntEnum):
    """Constraint solvers, with MuJoCo's numbers."""

    PGS = 0
    CG = 1
    Newton = 2


_ENUMS: dict[str, type[enum.IntEnum]] = {"integrator": Integrator, "cone": Cone, "solver": Solver}
_OPTIONS = (
    "timestep gravity wind magnetic density viscosity impratio tolerance ls_tolerance noslip_tolerance "
    "ccd_tolerance iterations ls_iterations noslip_iterations ccd_iterations o_margin o_solref o_solimp "
    "o_friction integrator cone solver"
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


class Options:
    """Options of a model, MuJoCo's ``model.opt``: read an attribute, or set it.

    Setting one recompiles the model, so that everything derived from it is right; worlds that exist keep the model
    with which they were made. Several at once: ``opt.set(timestep=0.001, solver="CG", contact=False)``. ``integrator``,
    ``cone`` and ``solver`` are enumerations with MuJoCo's numbers and take names, too. ``timestep`` is in s,
    ``gravity`` in m/s^2 (zero when its flag is off), ``density`` in kg/m^3, ``viscosity`` in kg/(m s).
    """

    __slots__ = ("_model",)

    def __init__(self, model: "Model") -> None:
        object.__setattr__(self, "_model", model)

    def __getattr__(self, name: str) -> Any:
        if name not in _OPTIONS:
            raise AttributeError(f"there is no option {name}; there are {', '.join(_OPTIONS)}")
        value = self._model._m.array(name)
        if value.ndim == 0:
            return _ENUMS[name](int(value)) if name in _ENUMS else value.item()
        value.flags.writeable = False
        return value

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in _OPTIONS:
            raise AttributeError(f"there is no option {name}; there are {', '.join(_OPTIONS)}")
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
        raise TypeError("use Model.from_xml_path, Model.from_xml_string or Model.from_spec")

    @classmethod
    def _of(cls, compiled: Any) -> "Model":
        model = object.__new__(cls)
        model._m = compiled
        model._arrays = {}
        return model

    @classmethod
    def from_xml_path(
        cls,
        path: str | os.PathLike[str],
        *,
        lenient: bool = False,
        options: Mapping[str, Any] | None = None,
    ) -> "Model":
        """Loads an MJCF file. Files that it includes are found relative to it.

        `lenient`: leave out what is not supported, with a line in ``report().losses`` each, instead of rejecting the
        model. `options` replace the file's: names and values of MJCF's ``option``, and of ``flag`` as True or False.
        Raises `ModelError`, which names file, line and element.
        """
        return cls._of(_lanesim.Model.load(os.fsdecode(path), bool(lenient), _overrides(options)))

    @classmethod
    def from_xml_string(
        cls,
        xml: str,
        assets: Mapping[str, str | bytes] | None = None,
        *,
        lenient: bool = False,
        options: Mapping[str, Any] | None = None,
    ) -> "Model":
        """Parses MJCF text; `assets` are the files that it includes, by name. Otherwise like `from_xml_path`."""
        if assets is not None and not isinstance(assets, Mapping):
            raise TypeError(f"assets is a {type(assets).__name__}; expected a dict from file names to contents")
        if not isinstance(xml, str):
            raise TypeError(f"xml is a {type(xml).__name__}; expected str")
        files = {}
        for name, content in (assets or {}).items():
            if isinstance(content, bytes):
                try:
                    content = content.decode("utf-8")
                except UnicodeDecodeError:
                    continue  # Meshes and textures; what needs one says so.
            files[str(name)] = content
        return cls._of(_lanesim.Model.parse(xml, files, bool(lenient), _overrides(options)))

    @classmethod
    def from_spec(
        cls, spec: SupportsToXml, *, lenient: bool = False, options: Mapping[str, Any] | None = None
    ) -> "Model":
        """Compiles a model built in code: a `Spec`, or any object whose method ``to_xml`` gives MJCF text, such as
        ``mujoco.MjSpec``."""
        if not isinstance(spec, SupportsToXml):
            raise TypeError(f"a {type(spec).__name__} has no method to_xml; expected a Spec")
        assets = getattr(spec, "assets", None)
        assets = assets if isinstance(assets, Mapping) else None
        return cls.from_xml_string(spec.to_xml(), assets, lenient=lenient, options=options)

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
        return Report(self._m.notes(), self._m.losses())

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
                raise AttributeError(f"the model has no attribute {name}; array_names lists its arrays")
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
            raise UnknownNameError(
                f"there is no kind of element {kind}; there are body, joint, geom, site, actuator, key"
            ) from None

    def id(self, kind: str, name: str) -> int:
        """Number of the element of that kind and name."""
        known = self.names(kind)
        found = self._m.id(kind, name)
        if found is None:
            some = ", ".join([x for x in known if x][:20])
            raise UnknownNameError(f"there is no {kind} {name}; there are {some or 'none with a name'}")
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
        """Range from which control noise is drawn, [nu, 2]: the control range if limited, else [-1, 1]."""
        return np.array(self._m.control_ranges()).reshape(-1, 2)

    def __repr__(self) -> str:
        sizes = self.sizes()
        shown = ", ".join(f"{name}={sizes[name]}" for name in ("nq", "nv", "nu", "nbody", "ngeom"))
        return f"<lanesim.Model {self.name!r} {shown}>"


def _restore(*document: Any) -> Model:
    return Model._of(_lanesim.Model.restore(*document))
