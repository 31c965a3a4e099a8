"""What happens to worlds."""

from __future__ import annotations

import enum
from typing import NamedTuple

__all__ = ["Status", "StatusEvent"]


class Status(enum.IntFlag):
    """What happened to a world: bits that stay set until it is reset."""

    NonFinitePos = 1 << 0
    """A position from outside was NaN or infinite."""
    NonFiniteVel = 1 << 1
    """A velocity from outside was NaN or infinite."""
    NonFiniteAcc = 1 << 2
    """The smooth acceleration, or a force from outside, was NaN or infinite."""
    HugeValue = 1 << 3
    """A position, a velocity, a force from outside or an acceleration exceeded the largest magnitude, 1e10 (1e7 in f32)."""
    BadCtrl = 1 << 4
    """A control was NaN or infinite: all controls of that step were 0."""
    QuatZero = 1 << 5
    """A quaternion of length zero in the state: it counts as the identity."""
    QuatFar = 1 << 6
    """A quaternion in the state whose length was off by more than 1e-3; its direction counts."""
    SingularInertia = 1 << 7
    """The inertia matrix had a pivot near zero."""
    Guarded = 1 << 8
    """The guard took more than a hundredth of a tree's inner velocities in a step."""
    ContactOverflow = 1 << 9
    """More contacts than the capacity."""
    NotConverged = 1 << 10
    """The solver reached its limit of iterations."""
    CallbackFailed = 1 << 14
    """Code that a step called has failed."""
    Frozen = 1 << 15
    """The world is frozen: its state is the last good one, and it is stepped no more."""


class StatusEvent(NamedTuple):
    """The first time that a bit was set in a world."""

    status: Status
    """The bit."""
    step: int
    """Steps that the batch had taken before the one in which it happened."""
    place: str
    """Where, such as ``joint 3 "knee"``; empty: the world as a whole."""
