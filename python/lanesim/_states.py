"""Arrays of many states, such as those of whole trajectories: checked together, then worked on some worlds at a time."""

from __future__ import annotations

import math
import os
import threading
from typing import Any, Iterator, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _lanesim
from .errors import InputError
from .model import Model
from .worlds import Worlds

__all__ = ["States"]

_MOST = 1 << 14
"""Worlds that are worked on at once."""
_kept = threading.local()
"""The worlds that a thread used last, and what they were made for."""


class States:
    """Rows of numbers, one per state; the array `lead` says how many states there are and which dimensions they have."""

    def __init__(self, model: Model, lead: tuple[str, ArrayLike, str], others: Mapping[str, ArrayLike | None]) -> None:
        name, values, size = lead
        array = _arrays.numbers(name, values)
        width = getattr(model, size)
        if array.ndim == 0 or array.shape[-1] != width:
            raise InputError(f"array `{name}` has shape {list(array.shape)}; expected [..., {size}={width}]")
        _lanesim.check_finite(name, array)
        self.model = model
        self.leading = array.shape[:-1]
        self.count = math.prod(self.leading)
        self.rows: dict[str, NDArray[Any]] = {name: array.reshape(self.count, width)}
        for other, others_values in others.items():
            if others_values is not None:
                self._add(other, others_values, name)

    def _add(self, name: str, values: ArrayLike, lead: str) -> None:
        array = _arrays.numbers(name, values)
        own = self._dims(name)
        dims = [*(("", n) for n in self.leading), *own]
        if array.shape != tuple(n for _, n in dims):
            raise InputError(
                f"array `{name}` has shape {list(array.shape)}; expected {_arrays.show(dims)}: {lead} has as many rows"
            )
        _lanesim.check_finite(name, array)
        self.rows[name] = array.reshape(self.count, *(n for _, n in own))

    def _dims(self, name: str) -> list[_arrays.Dim]:
        """A state's own dimensions of a field, or of an array with a number per dof."""
        for field, _, dims in _lanesim.FIELDS:
            if field == name:
                return [("", int(dim)) if dim.isdigit() else (dim, getattr(self.model, dim)) for dim in dims]
        return [("nv", self.model.nv)]

    def worlds(
        self, threads: int | None, precision: str, backend: str, most: int = _MOST
    ) -> Iterator[tuple[Worlds, slice]]:
        """Worlds in these states, so many at most at once, and which states they are. Rows that are no part of a state are left out."""
        fields = [name for name, _, _ in _lanesim.FIELDS if name in self.rows and self.rows[name].size]
        for first in range(0, self.count, most):
            here = slice(first, min(first + most, self.count))
            worlds = _take(self.model, here.stop - first, (threads, precision, backend))
            for name in fields:
                worlds.set(name, self.rows[name][here])
            yield worlds, here
            # Parameters stay through resets.
            _kept.worlds = None if worlds._w.varying() else worlds


def _take(model: Model, nworld: int, choice: tuple[int | None, str, str]) -> Worlds:
    """Worlds as they start: those that this thread used last, if they will do."""
    made = (os.getpid(), model._m, nworld, choice)
    worlds: Worlds | None = getattr(_kept, "worlds", None)
    last = getattr(_kept, "made", None)
    _kept.worlds, _kept.made = None, made
    if worlds is not None and last is not None and last[1] is model._m and (last[0], *last[2:]) == (made[0], *made[2:]):
        worlds.reset()
        return worlds
    threads, precision, backend = choice
    return Worlds(model, nworld, precision, threads, backend=backend)
