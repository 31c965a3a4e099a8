"""Following long runs."""

from __future__ import annotations

import contextlib
from typing import Callable, Iterator, Union

__all__ = ["Progress"]

Progress = Union[bool, Callable[[int, int], object], None]
"""True for a bar (needs tqdm), or a function of (world steps done, all of them); an exception in it stops the run."""


@contextlib.contextmanager
def following(progress: Progress, total: int) -> Iterator[Callable[[int], object] | None]:
    """A function of the world steps done, or None, to be called now and then."""
    if progress is None or progress is False:
        yield None
        return
    if progress is not True:
        if not callable(progress):
            raise TypeError(f"progress is a {type(progress).__name__}; expected True or a function")
        follow = progress
        yield lambda done: follow(done, total)
        follow(total, total)
        return
    try:
        from tqdm.auto import tqdm  # type: ignore[import-untyped, unused-ignore]
    except ImportError:
        raise ImportError("progress=True needs tqdm: pip install tqdm, or give a function instead") from None
    with tqdm(total=total, unit="step", unit_scale=True) as bar:
        yield lambda done: bar.update(done - bar.n)
        bar.update(total - bar.n)
