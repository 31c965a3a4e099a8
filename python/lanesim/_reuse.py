"""Memory of results that nobody refers to any more, kept for the results of the next call.

The system hands out memory page by page, zeroed, as it is first written to: for the trajectories of some thousand
worlds that takes up to a quarter of the time of the rollout itself. A loop that lets go of its results pays it twice,
not every time.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from .errors import WorldMemoryError

__all__ = ["clear", "empty"]

SMALLEST = 1 << 20
"""Bytes from which on memory is kept; what is smaller does not go back to the system each time anyway."""
MOST = 1 << 28
"""Most bytes that are kept."""

# Newest last. A list, and no lock around it: memory comes back from `__del__`, which may run at any moment, in the thread
# that holds the lock, too. Each operation is one call that other threads cannot divide.
_kept: list[NDArray[np.uint8]] = []


class _Loan:
    """What a result array is a view of; when the last view is gone, the memory comes back."""

    def __init__(self, memory: NDArray[np.uint8]) -> None:
        self._memory = memory
        self.__array_interface__ = memory.__array_interface__

    def __del__(self, kept: list[NDArray[np.uint8]] = _kept) -> None:
        kept.append(self._memory)
        while sum(memory.nbytes for memory in kept.copy()) > MOST:
            _pop(0)


def _pop(i: int) -> NDArray[np.uint8] | None:
    """Takes one out, unless another thread was quicker."""
    try:
        return _kept.pop(i)
    except IndexError:
        return None


def _take(nbytes: int) -> NDArray[np.uint8]:
    """Memory of just that size: a kept one or new."""
    for _ in range(len(_kept)):
        memory = _pop(0)
        if memory is None:
            break
        if memory.nbytes == nbytes:
            return memory
        _kept.append(memory)
    return np.empty(nbytes, dtype=np.uint8)


def empty(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Like ``np.empty``."""
    kind = np.dtype(dtype)
    nbytes = kind.itemsize
    for n in shape:
        nbytes *= n
    if not SMALLEST <= nbytes <= MOST:
        try:
            return np.empty(shape, dtype=kind)
        except (MemoryError, ValueError):
            text = f"the results would take {nbytes} bytes of memory, which the system does not give; ask for fewer"
            raise WorldMemoryError(text) from None
    return np.asarray(_Loan(_take(nbytes))).view(kind).reshape(shape)


def clear() -> None:
    """Gives the memory back to the system."""
    _kept.clear()
