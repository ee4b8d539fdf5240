"""Turns about an object's own axes, which outlines hardly tell apart."""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Bool, Float64

from xden_builder.registration.body import Body
from xden_builder.registration.exact import Judge
from xden_builder.registration.kinds import close_to_best, distance_cm, loss_of
from xden_builder.registration.likeness import Likeness
from xden_builder.registration.placement import Found, RigidPlacement
from xden_builder.registration.shortlist import Poses, Search, turned_about

__all__ = ["half_turned", "least_turns"]

SOFT: Final = (2.0, 0.004)
"""A turn about an axis whose cost is at most so many times that of the pose, and so much more, may
be right too: few points on few pixels do not tell."""
SYMMETRIC: Final = 0.004
"""Of the radius: a half turn that moves surfaces less leaves the object where it is."""
HALVES_CLOSE: Final = 8.0
"""A half turn whose loss is more times that of the pose is not given."""
MOST_JUDGED: Final = 72
MOST: Final = 5
"""Turns that are looked at, and that are given."""


def least_turns(
    judge: Judge, found: Found, search: Search, body: Body, every_deg: float
) -> list[Found]:
    """Turn a pose about the principal axes, all around, and give where the loss is least.

    A turn that is a few degrees off leaves much loss, as a turn that is wrong does; so not the
    least losses are given but those that are less than a step before and after.

    Parameters
    ----------
    judge
        Compares turns exactly.
    found
        Is turned.
    search
        Says which turns few points on few pixels leave possible.
    body
        Whose axes they are.
    every_deg
        Between turns.

    Returns
    -------
    list of Found
        The least loss first.
    """
    here = Poses.of([body.placed(found.placement)])
    cost = float(search.judged(here.linear, here.shifts).costs[0])
    angles = np.radians(np.arange(every_deg, 360, every_deg)).tolist()
    rings = [turned_about(here, body, axis, angles) for axis in range(3)]
    costs = np.array([search.judged(ring.linear, ring.shifts).costs for ring in rings])
    times, more = SOFT
    highest = min(times * cost + more, np.sort(costs, axis=None)[:MOST_JUDGED][-1])
    least: list[Found] = []
    for ring, soft in zip(rings, costs <= highest, strict=True):
        numbers = np.flatnonzero(soft)
        turned = [judge.fixed(each) for each in _of_files(ring.picked(numbers), body)]
        losses = np.full(len(angles), np.inf)
        losses[numbers] = [each.loss for each in turned]
        lowest = _lowest(losses, found.loss)[numbers]
        least += [each for each, is_lowest in zip(turned, lowest, strict=True) if is_lowest]
    return sorted(least, key=loss_of)[:MOST]


def _lowest(losses: Float64[np.ndarray, "n"], at_rest: float) -> Bool[np.ndarray, "n"]:
    """Which losses around a circle, on which the pose itself lies too, are below their neighbours.

    Examples
    --------
    >>> _lowest(np.array([2.0, 3.0, 1.0, 4.0]), 1.5).tolist()
    [False, False, True, False]
    """
    around = np.concatenate([[at_rest], losses, [at_rest]])
    return np.asarray((losses <= around[:-2]) & (losses <= around[2:]))


def half_turned(judge: Judge, found: Found, likeness: Likeness, body: Body) -> list[Found]:
    """Turn a settled pose by half about each axis of its box, where that puts it elsewhere.

    A telephone turned by half leaves about what the telephone does. It must be turned about the
    middle of its box: about that of its volume, where the battery is, its outlines would be off.

    Returns
    -------
    list of Found
        Those that may be right too, the least loss first.
    """
    here = Poses.of([body.placed(found.placement)])
    halves = [
        judge.fixed(there)
        for axis in range(3)
        for there in _of_files(turned_about(here, body, axis, [np.pi], boxed=True), body)
        if distance_cm(found.placement, there, likeness, body) > SYMMETRIC * body.radius_cm
    ]
    return [each for each in close_to_best([found, *halves], HALVES_CLOSE) if each is not found]


def _of_files(poses: Poses, body: Body) -> list[RigidPlacement]:
    return [body.of_files(each) for each in poses.placements()]
