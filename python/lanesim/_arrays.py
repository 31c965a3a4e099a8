"""What users give as arrays, numbers and names: every type, shape and layout is checked or converted here."""

from __future__ import annotations

from typing import Any, Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _lanesim
from .errors import InputError, UnknownNameError

LARGEST = 2**63 - 1
"""Largest whole number that the engine can be given."""

Dim = tuple[str, int]

HINT = "; was it made for another model?"


def nstate(model: Any) -> int:
    """Numbers of a row of states."""
    return 1 + int(model.nq + model.nv + model.na + model.nhistory + model.nplastic)


def numbers(name: str, values: ArrayLike) -> NDArray[Any]:
    """An array of float64 or float32 in C order; a copy only if `values` is not one already."""
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise InputError(f"array `{name}` is not an array of numbers: {error}") from None
    if array.dtype not in (np.float64, np.float32) or not array.dtype.isnative:
        if array.dtype.kind not in "fiub":
            raise InputError(f"array `{name}` has type {array.dtype}; expected real numbers")
        array = array.astype(np.float64)
    return np.require(array, requirements=("C", "A"))


def check_range(name: str, array: NDArray[Any], dtype: np.dtype[Any]) -> None:
    """An exception if a finite number is too large for the type of the worlds."""
    if array.dtype.itemsize <= dtype.itemsize or array.size == 0:
        return
    largest, most = max(-array.min(), array.max()), float(np.finfo(dtype).max)
    if most < largest < np.inf:
        raise InputError(f"array `{name}` holds a number of size {largest:.1e}; {dtype} has none above {most:.1e}")


def show(dims: Sequence[Dim]) -> str:
    """A shape such as [nworld=4, nq=7]."""
    return "[" + ", ".join(f"{name}={n}" if name else str(n) for name, n in dims) + "]"


def wrong_shape(name: str, shape: Sequence[int], dims: Sequence[Dim]) -> InputError:
    """The error for an array that does not have the shape `dims`."""
    other = len(shape) == len(dims) and shape[-1:] != tuple(n for _, n in dims[-1:])
    text = f"array `{name}` has shape {list(shape)}; expected {show(dims)}{HINT if other else ''}"
    return InputError(text)


def per_world(name: str, values: ArrayLike, nworld: int, row: Sequence[Dim], label: str = "nworld") -> NDArray[Any]:
    """Numbers of shape [nworld, *row], or *row or [1, *row] for the same in every world."""
    array = numbers(name, values)
    shape = tuple(n for _, n in row)
    if array.shape in ((nworld, *shape), (1, *shape), shape):
        return array
    raise wrong_shape(name, array.shape, [(label, nworld), *row])


def mask_of(mask: ArrayLike | None, nworld: int) -> NDArray[np.bool_] | None:
    """A mask over worlds, [nworld] booleans."""
    if mask is None:
        return None
    array = np.asarray(mask)
    if array.dtype != np.bool_:
        raise InputError(f"array `mask` has type {array.dtype}; expected bool")
    if array.shape != (nworld,):
        raise wrong_shape("mask", array.shape, [("nworld", nworld)])
    return np.require(array, requirements=("C", "A"))


def ids_of(ids: Any, nworld: int) -> NDArray[np.uint64] | None:
    """Numbers of worlds: from an array of them, a mask [nworld] or a slice; None: all."""
    if ids is None:
        return None
    if isinstance(ids, slice):
        return np.arange(nworld, dtype=np.uint64)[ids].copy()
    array = np.asarray(ids)
    if array.dtype == np.bool_:
        if array.shape != (nworld,):
            raise wrong_shape("ids", array.shape, [("nworld", nworld)])
        return np.flatnonzero(array).astype(np.uint64)
    if array.ndim == 0 and array.dtype.kind in "iu":
        raise InputError(f"ids is {ids!r}; expected an array of worlds' numbers, such as [{ids!r}] for one world")
    if array.ndim != 1:
        raise InputError(f"array `ids` has shape {list(array.shape)}; expected one dimension, a world's number each")
    if array.size and array.dtype.kind not in "iu":
        raise InputError(f"array `ids` has type {array.dtype}; expected whole numbers, a mask of bool, or a slice")
    outside = (array < 0) | (array >= nworld)
    if outside.any():
        world = array[outside][0]
        raise InputError(f"there is no world {world} that ids could name: the batch has {nworld}, counted from 0")
    chosen = array.astype(np.uint64)
    ordered = np.sort(chosen)
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    if twice.size:
        raise InputError(f"world {twice[0]} is named twice in ids; each can be named once")
    return chosen


def chosen(mask: Any, ids: Any, nworld: int) -> tuple[NDArray[np.bool_] | None, NDArray[np.uint64] | None]:
    """Worlds by mask or by numbers, not by both."""
    if mask is not None and ids is not None:
        raise InputError("mask and ids both choose worlds; give one of them")
    return mask_of(mask, nworld), ids_of(ids, nworld)


def lead(name: str, values: ArrayLike, ndim: int) -> NDArray[Any]:
    """Numbers with dimensions of length 1 put in front where some are missing."""
    array = numbers(name, values)
    if array.ndim > ndim:
        raise InputError(f"{name} can have at most {ndim} dimensions")
    return array.reshape((1,) * (ndim - array.ndim) + array.shape)


def infer(what: str, axis: int, value: int | None, arrays: list[tuple[str, Any]]) -> int:
    """A dimension on which all arrays agree, unless they have length 1 there."""
    for name, array in arrays:
        if array is None or array.ndim <= axis or array.shape[axis] == 1 and value is not None:
            continue
        n = array.shape[axis]
        if value is not None and value != 1 and n != value:
            raise InputError(f"{what} inferred as {value} but {name} has {n}")
        value = n
    return 1 if value is None else value


def trailing(name: str, array: NDArray[Any] | None, dims: list[Dim]) -> None:
    """The last dimension must be right; the others were inferred."""
    if array is not None and array.shape[-1] != dims[-1][1]:
        raise wrong_shape(name, array.shape, dims)


def strided(control: NDArray[Any] | None) -> tuple[NDArray[Any], int, int] | None:
    """Controls, [nworld or 1, nstep or 1, nu], with their strides from world to world and from step to step."""
    if control is None:
        return None
    nworld, nstep, nu = control.shape
    return (control, 0 if nworld == 1 else nstep * nu, 0 if nstep == 1 else nu)


def names_of(outputs: Sequence[str] | None) -> list[str]:
    """Names of outputs, each once."""
    if isinstance(outputs, str):
        raise InputError(f"outputs is a str; expected a list of names, such as [{outputs!r}]")
    return list(dict.fromkeys(outputs or ()))


def unknown(kind: str, name: Any, known: Iterable[str], place: str = "") -> str:
    """There is no such thing; which one was probably meant, or which there are. `place` has the whole list."""
    if not isinstance(name, str):
        return f"{kind} {name!r} is a {type(name).__name__}; expected a name"
    remedy = _lanesim.or_list(name, list(known)) or (f"{place} lists what there is" if place else "")
    return f"there is no {kind} {name}" + (f"; {remedy}" if remedy else "")


def target(name: str, array: Any, shape: tuple[int, ...], dims: Sequence[Dim], kinds: tuple[Any, ...]) -> NDArray[Any]:
    """An array that results can be written to: of the right shape and type, writable and contiguous."""
    if not isinstance(array, np.ndarray):
        raise InputError(f"array `{name}` is a {type(array).__name__}; expected a NumPy array to write to")
    if array.shape != shape:
        raise wrong_shape(name, array.shape, dims)
    if array.dtype not in kinds:
        names = " or ".join(np.dtype(kind).name for kind in kinds)
        raise InputError(f"array `{name}` has type {array.dtype}; expected {names}")
    if not array.flags.writeable:
        raise InputError(f"array `{name}` is read-only; expected one that can be written to")
    if not array.flags.c_contiguous or not array.flags.aligned:
        raise InputError(f"array `{name}` is not contiguous in C order; results cannot be written to it in place")
    return array


def count(name: str, value: Any, least: int = 0) -> int:
    """A whole number that is at least `least`."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
        raise InputError(f"{name} is {value!r}; expected a whole number")
    if value < least:
        raise InputError(f"{name} is {value}; expected at least {least}")
    if value > LARGEST:
        raise InputError(f"{name} is {value}; expected at most {LARGEST}")
    return int(value)


def choice(name: str, value: Any, valid: Sequence[str]) -> str:
    """One of a few words."""
    if not isinstance(value, str) or value not in valid:
        near = _lanesim.or_list(value, list(valid)) if isinstance(value, str) else ""
        near = f"; {near}" if near.startswith("did") else ""
        raise UnknownNameError(f"{name} is {value!r}; expected one of {', '.join(valid)}{near}")
    return value
