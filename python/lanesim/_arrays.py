"""What users give as arrays: every type, shape and layout is checked or converted here."""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InputError, UnknownNameError

LARGEST = 2**63 - 1
"""Largest whole number that the engine can be given."""

Dim = tuple[str, int]

HINT = "; was it made for another model?"


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


def per_world(name: str, values: ArrayLike, nworld: int, row: Sequence[Dim]) -> NDArray[Any]:
    """Numbers of shape [nworld, *row], or *row or [1, *row] for the same in every world."""
    array = numbers(name, values)
    shape = tuple(n for _, n in row)
    if array.shape in ((nworld, *shape), (1, *shape), shape):
        return array
    raise wrong_shape(name, array.shape, [("nworld", nworld), *row])


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
        raise UnknownNameError(f"{name} is {value!r}; expected one of {', '.join(valid)}")
    return value
