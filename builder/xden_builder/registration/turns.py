"""Turns about an object's own axes, which outlines hardly tell apart."""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Bool, Float64

from xden_builder.registration.body import Body
from xden_builder.registration.exact import Judge
from xden_builder.registration.kinds import apart, close_to_best, loss_of
from xden_builder.registration.likeness import Likeness
from xden_builder.registration.placement import Found, RigidPlacement
from xden_builder.registration.shortlist import Poses, Search, turned_about

__all__ = ["half_turned", "least_turns", "same_share", "slightly_turned"]

SOFT: Final = (2.0, 0.004)
"""A turn about an axis whose cost is at most so many times that of the pose, and so much more, may
be right too: few points on few pixels do not tell."""
SAME, SAME_CM = 0.002, 0.02
"""Of the radius, and at least in cm: turns that put surfaces nearer to each other are one."""
HALVES_CLOSE: Final = 8.0
"""A half turn whose loss is more times that of the pose is not given."""
SLIGHT_DEG: Final = (-8, -6, -4, -2, 2, 4, 6, 8)
"""Over to the next trough of what is seen from its edge."""
MOST_SLIGHT: Final = 2
MOST_JUDGED: Final = 72
MOST: Final = 5
"""Turns that are looked at, and that are given."""
WIDE: Final = 0.5
"""Of the radius: about an axis from which the object reaches farther, coarse images tell turns."""


def least_turns(
    judge: Judge,
    found: Found,
    search: Search,
    likeness: Likeness,
    body: Body,
    every_deg: float,
    first: Judge | None = None,
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
    likeness, body
        Whose axes they are, and which turns about them leave it where it is.
    every_deg
        Between turns.
    first
        Compares turns on coarser images where these tell them apart, so that few are compared
        exactly: where a turn moves the rim by about one of their pixels.

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
    for axis, (ring, soft) in enumerate(zip(rings, costs <= highest, strict=True)):
        if not soft.any():
            continue
        if first is None or _reach_share(body, axis) < WIDE:
            least += _least_of_ring(judge, found, ring, soft, likeness, body)
        else:
            there = first.fixed(found.placement)
            lowest = _least_of_ring(first, there, ring, soft, likeness, body)
            least += [judge.fixed(each.placement) for each in lowest]
    return sorted(least, key=loss_of)[:MOST]


def _least_of_ring(
    judge: Judge,
    found: Found,
    ring: Poses,
    soft: Bool[np.ndarray, "n"],
    likeness: Likeness,
    body: Body,
) -> list[Found]:
    """Judge turns about one axis; one alone of those that are the same object at the same place."""
    same = _same_turns(found, ring, likeness, body)
    judged: dict[int, Found] = {0: found}
    losses = np.full(len(ring) + 1, np.inf)
    losses[0] = found.loss
    there = _of_files(ring, body)
    for number in (np.flatnonzero(soft) + 1).tolist():
        like = next((k for k in judged if same[number - k]), number)
        if like == number:
            judged[number] = judge.fixed(there[number - 1])
        losses[number] = judged[like].loss
    lowest = _lowest(losses)
    return [each for number, each in judged.items() if number and lowest[number]]


def _reach_share(body: Body, axis: int) -> float:
    """How far the object reaches from one of the axes that it is turned about, of its radius."""
    middle, axes = body.spin
    across = np.cross(body.rim_cm - middle, axes[axis])
    return float(np.linalg.norm(across, axis=1).max()) / body.radius_cm


def _same_turns(found: Found, ring: Poses, likeness: Likeness, body: Body) -> Bool[np.ndarray, "m"]:
    """Say of no turn, and of each around a ring, whether it leaves the object where it is."""
    here, least_cm = body.placed(found.placement), same_share(body) * body.radius_cm
    apart_there = [likeness.apart(here, turn, least_cm) for turn in ring.placements()]
    return ~np.array([False, *apart_there])


def _lowest(losses: Float64[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
    """Which losses around a circle are below their neighbours.

    Examples
    --------
    >>> _lowest(np.array([1.5, 2.0, 3.0, 1.0, 4.0])).tolist()
    [True, False, False, True, False]
    """
    return np.asarray((losses <= np.roll(losses, 1)) & (losses <= np.roll(losses, -1)))


def same_share(body: Body) -> float:
    """Share of the radius by which turns differ at least."""
    return max(SAME, SAME_CM / body.radius_cm)


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
        if apart(found.placement, there, likeness, body, same_share(body))
    ]
    return [each for each in close_to_best([found, *halves], HALVES_CLOSE) if each is not found]


def slightly_turned(judge: Judge, found: Found, body: Body) -> list[Found]:
    """Turn a pose by a few degrees about each principal axis; the two of least loss first."""
    here, angles = Poses.of([body.placed(found.placement)]), np.radians(SLIGHT_DEG).tolist()
    turns = [
        judge.fixed(there)
        for axis in range(3)
        for there in _of_files(turned_about(here, body, axis, angles), body)
    ]
    return sorted(turns, key=loss_of)[:MOST_SLIGHT]


def _of_files(poses: Poses, body: Body) -> list[RigidPlacement]:
    return [body.of_files(each) for each in poses.placements()]
