"""The least value of a convex parabola in a box."""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Bool, Float64

__all__ = ["box_minimum"]

LITTLE_SLOPE: Final = 1e-12
"""Relative to the steepest; with unknowns scaled to unit curvature less is rounding."""
TURNS: Final = 10
"""Changes of the set of resting unknowns, for each unknown; each change lowers the value."""

Unknowns = Float64[np.ndarray, "u"]
Matrix = Float64[np.ndarray, "u u"]


def box_minimum(curvature: Matrix, slope: Unknowns, low: Unknowns, high: Unknowns) -> Unknowns:
    """Find the least ``2 slope·s + s·curvature·s`` with ``low <= s <= high``, by active sets.

    Unknowns that reach a bound rest there while the others are solved for again; one that would
    leave its bound is set free (Stark and Parker, 1995, "Bounded-variable least squares"). The
    value falls from 0 with every change, so that the result never promises a rise.

    Parameters
    ----------
    curvature
        Positive definite, with a unit diagonal or nearly so.
    slope
        Half the gradient at 0.
    low, high
        ``low <= 0 <= high``.
    """
    step = np.zeros(len(slope))
    tolerance = LITTLE_SLOPE * np.abs(slope).max(initial=0.0)
    free = _inward_pull(step, slope, low, high) > 0
    for _ in range(TURNS * len(slope)):
        blocked = _advance(step, free, curvature, slope, low, high)
        free &= ~blocked
        if blocked.any():
            continue
        pull = np.where(free, 0.0, _inward_pull(step, slope + curvature @ step, low, high))
        if pull.max(initial=0.0) <= tolerance:
            break
        free[pull.argmax()] = True
    return step


def _inward_pull(step: Unknowns, slope: Unknowns, low: Unknowns, high: Unknowns) -> Unknowns:
    """How steeply the value falls along each unknown where its bounds leave room."""
    return np.maximum(np.where(step < high, -slope, 0.0), np.where(step > low, slope, 0.0))


def _advance(
    step: Unknowns,
    free: Bool[np.ndarray, "u"],
    curvature: Matrix,
    slope: Unknowns,
    low: Unknowns,
    high: Unknowns,
) -> Bool[np.ndarray, "u"]:
    """Move towards the least value among the free unknowns; return those that block the way."""
    way = np.zeros(len(step))
    rest = slope + curvature @ step
    way[free] = -np.linalg.solve(curvature[np.ix_(free, free)], rest[free])
    room = np.full(len(step), np.inf)
    with np.errstate(over="ignore"):  # a way next to none leaves room without end
        np.divide(np.where(way > 0, high, low) - step, way, out=room, where=way != 0)
    share = float(np.clip(room.min(initial=np.inf), 0.0, 1.0))
    blocked = room <= share if share < 1 else np.zeros(len(step), dtype=bool)
    step += share * way
    step[blocked] = np.where(way > 0, high, low)[blocked]
    return np.asarray(blocked)
