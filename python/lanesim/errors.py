"""What can go wrong. Every text is the one that the command line prints."""

from __future__ import annotations

from typing import Any, NamedTuple, Sequence

__all__ = [
    "Diagnostic",
    "DivergedError",
    "InputError",
    "LanesimError",
    "LossWarning",
    "ModelError",
    "OptionError",
    "UnknownNameError",
    "UnsupportedError",
    "WorldMemoryError",
]


class Diagnostic(NamedTuple):
    """One problem of a model."""

    file: str | None
    """File, if the model came from one."""
    line: int
    """Line, counted from 1; 0: unknown."""
    element: str
    """Element and name, such as ``geom "floor"``; empty: the file as a whole."""
    message: str
    """What is wrong."""
    remedy: str
    """What to do about it; may be empty."""


class LanesimError(Exception):
    """Any error of lanesim."""


class LossWarning(UserWarning):
    """A lenient load left something out; ``report().losses`` lists it."""


class ModelError(LanesimError, ValueError):
    """A model was rejected."""

    diagnostics: list[Diagnostic]
    """Every problem that was found."""

    def __init__(self, text: str, diagnostics: Sequence[tuple[str | None, int, str, str, str]] = ()) -> None:
        super().__init__(text)
        self.diagnostics = [Diagnostic(*d) for d in diagnostics]

    def __reduce__(self) -> tuple[Any, ...]:
        return (type(self), (str(self), [tuple(d) for d in self.diagnostics]))


class UnsupportedError(LanesimError, NotImplementedError):
    """The model compiles, but what was asked needs something that is not built yet."""


class InputError(LanesimError, ValueError):
    """An array has the wrong shape, type or contents."""


class OptionError(LanesimError, ValueError):
    """An option is out of range."""


class UnknownNameError(LanesimError, ValueError):
    """There is no element, output, field or key of that name."""


class DivergedError(LanesimError, ArithmeticError):
    """A world diverged, and ``on_diverge`` is "raise"."""


class WorldMemoryError(LanesimError, MemoryError):
    """The system does not grant the memory that so many worlds or outputs would take."""
