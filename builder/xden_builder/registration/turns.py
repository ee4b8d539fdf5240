"""Turns about an object's own axes, which outlines hardly tell apart."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Final

import numpy as np
from jaxtyping import Bool, Float64

from xden_builder.registration.body import Body
from xden_builder.registration.exact import Judge
from xden_builder.registration.kinds import loss_of
from xden_builder.registration.likeness import Likeness
from xden_builder.registration.placement import Found, RigidPlacement
from xden_builder.registration.shortlist import Poses, Search, turned_about

__all__ = [
    "box_turned",
    "least_turns",
    "lowest_beside",
    "same_share",
    "slightly_turned",
    "symmetric_box_turns",
    "symmetric_turns",
]

SOFT: Final = (2.0, 0.004)
"""A turn about an axis whose cost is at most so many times that of the pose, and so much more, may
be right too: few points on few pixels do not tell."""
SAME, SAME_CM = 0.002, 0.02
"""Of the radius, and at least in cm: turns that put surfaces nearer to each other are one."""
BOXED_CLOSE: Final = (8.0, 0.02)
"""A turn of the box is given whose loss is at most so many times that of the pose, and so much
more."""
MOST_BOXED: Final = 4
SYMMETRY_DEG: Final = 15
"""Between turns that may leave the object where it is."""
SYMMETRIC: Final = 0.03
"""Of the radius: a turn that moves surfaces less leaves the object where it is."""
SLIGHT_DEG: Final = np.array([-8.0, -6.0, -4.0, -2.0, 2.0, 4.0, 6.0, 8.0])
"""Over to the next trough of what is seen from its edge."""
MOST_SLIGHT: Final = 2
MOST_JUDGED: Final = 72
MOST: Final = 5
"""Turns that are looked at, and that are given."""
STEPS_PX: Final = np.array([0.25, 0.5, 1, 1.5, 2.5, 4, 6, 9])
"""By which the rim is moved beside a settled pose, or by less where that would turn it so far:"""
LONGEST_DEG: Final = 3.0
WALL: Final = 3.0
"""Where the loss is more times that of the pose, a line that leads away is not followed on."""

Judged = Callable[[RigidPlacement], Found]
"""Judges a pose."""


def least_turns(
    judged: Judged,
    found: Found,
    search: Search,
    likeness: Likeness,
    body: Body,
    every_deg: float,
) -> list[Found]:
    """Turn a pose about the principal axes, all around, and give where the loss is least.

    A turn that is a few degrees off leaves much loss, as a turn that is wrong does; so not the
    least losses are given but those that are less than a step before and after.

    Parameters
    ----------
    judged
        Judges a pose.
    found
        Is turned, judged likewise.
    search
        Says which turns few points on few pixels leave possible.
    likeness, body
        Whose axes they are, and which turns about them leave it where it is.
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
        least += _least_of_ring(judged, found, ring, soft, likeness, body)
    return sorted(least, key=loss_of)[:MOST]


def _least_of_ring(
    judged: Judged,
    found: Found,
    ring: Poses,
    soft: Bool[np.ndarray, "n"],
    likeness: Likeness,
    body: Body,
) -> list[Found]:
    """Judge turns about one axis; one alone of those that are the same object at the same place."""
    same = _same_turns(found, ring, likeness, body)
    known: dict[int, Found] = {0: found}
    losses = np.full(len(ring) + 1, np.inf)
    losses[0] = found.loss
    there = _of_files(ring, body)
    for number in (np.flatnonzero(soft) + 1).tolist():
        like = next((k for k in known if same[number - k]), number)
        if like == number:
            known[number] = judged(there[number - 1])
        losses[number] = known[like].loss
    lowest = _lowest(losses)
    return [each for number, each in known.items() if number and lowest[number]]


def _same_turns(found: Found, ring: Poses, likeness: Likeness, body: Body) -> Bool[np.ndarray, "m"]:
    """Say of no turn, and of each around a ring, whether it leaves the object where it is."""
    here, least_cm = body.placed(found.placement), same_share(body) * body.radius_cm
    apart_there = [likeness.apart(here, turn, least_cm) for turn in ring.placements()]
    return ~np.array([False, *apart_there])


def symmetric_turns(
    placement: RigidPlacement, likeness: Likeness, body: Body
) -> list[RigidPlacement]:
    """Turn a pose about the principal axes, by multiples of 15 degrees that leave the object there.

    All 69 of a ball, 23 of a bottle, 3 of a box.
    """
    here = Poses.of([body.placed(placement)])
    angles = np.radians(np.arange(SYMMETRY_DEG, 360, SYMMETRY_DEG)).tolist()
    turns = [
        turn for axis in range(3) for turn in turned_about(here, body, axis, angles).placements()
    ]
    return _left_there(placement, turns, likeness, body)


def symmetric_box_turns(
    placement: RigidPlacement, likeness: Likeness, body: Body
) -> list[RigidPlacement]:
    """Turn it likewise about the axes of the box around it.

    In a square section two principal axes lie anyhow.
    """
    return _left_there(placement, _about_box(body.placed(placement), body), likeness, body)


def _left_there(
    placement: RigidPlacement, turns: Sequence[RigidPlacement], likeness: Likeness, body: Body
) -> list[RigidPlacement]:
    """Which turns of the body's own frame leave the object where it is; of the files' frame."""
    own, least_cm = body.placed(placement), SYMMETRIC * body.radius_cm
    return [body.of_files(each) for each in turns if not likeness.apart(own, each, least_cm)]


def lowest_beside(
    judged: Judged, found: Found, axis: int, pixel_cm: float, body: Body
) -> list[Found]:
    """Turn a pose about a principal axis to either side, and give what is least on the way.

    Parameters
    ----------
    judged
        Judges a pose.
    found
        Is turned, judged likewise.
    axis
        Number of the axis.
    pixel_cm
        By which the first turns move the rim, about.
    body
        Whose axes they are.
    """
    step_deg = min(np.degrees(pixel_cm / _reach_cm(body, axis)), LONGEST_DEG)
    before, after = (
        list(_until_wall(judged, found, _turned(found, body, axis, steps * step_deg)))
        for steps in (-STEPS_PX, STEPS_PX)
    )
    line = [*before[::-1], found, *after]
    losses = np.array([each.loss for each in line])
    inner = (losses[1:-1] <= losses[:-2]) & (losses[1:-1] <= losses[2:])
    return [line[k + 1] for k in np.flatnonzero(inner).tolist() if line[k + 1] is not found]


def _until_wall(judged: Judged, found: Found, line: Sequence[RigidPlacement]) -> Iterator[Found]:
    """Judge poses that lead away from one until they leave much more than it."""
    for placement in line:
        here = judged(placement)
        yield here
        if here.loss > WALL * found.loss:
            return


def _turned(
    found: Found, body: Body, axis: int, angles_deg: Float64[np.ndarray, "n"]
) -> list[RigidPlacement]:
    here = Poses.of([body.placed(found.placement)])
    return _of_files(turned_about(here, body, axis, np.radians(angles_deg).tolist()), body)


def _reach_cm(body: Body, axis: int) -> float:
    """How far the object reaches from one of the axes that it is turned about."""
    middle, axes = body.spin
    across = np.cross(body.rim_cm - middle, axes[axis])
    return float(np.linalg.norm(across, axis=1).max())


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


def box_turned(judged: Judged, found: Found, likeness: Likeness, body: Body) -> list[Found]:
    """Turn a settled pose such that the box around it stays, where that puts it elsewhere.

    A telephone turned by half leaves about what the telephone does, a puzzle cube turned by a
    quarter about what it does. They must be turned about the middle of the box: about that of the
    volume, where the battery is, outlines would be off.

    Returns
    -------
    list of Found
        Those that may be right too, the least loss first.
    """
    own = body.placed(found.placement)
    others = [
        judged(body.of_files(each))
        for each in _about_box(own, body)
        if likeness.apart(own, each, same_share(body) * body.radius_cm)
    ]
    times, more = BOXED_CLOSE
    close = [each for each in others if each.loss <= times * found.loss + more]
    return sorted(close, key=loss_of)[:MOST_BOXED]


def _about_box(own: RigidPlacement, body: Body) -> list[RigidPlacement]:
    """Turn a pose such that the box around it stays."""
    middle, turns = body.box_turns
    return [
        RigidPlacement(
            own.rotation @ turn,
            own.translation_cm + own.scale * own.rotation @ (middle - turn @ middle),
            own.scale,
        )
        for turn in turns
    ]


def slightly_turned(judge: Judge, found: Found, body: Body) -> list[Found]:
    """Turn a pose by a few degrees about each principal axis; the two of least loss first."""
    turns = [
        judge.elsewhere(found, there)
        for axis in range(3)
        for there in _turned(found, body, axis, SLIGHT_DEG)
    ]
    return sorted(turns, key=loss_of)[:MOST_SLIGHT]


def _of_files(poses: Poses, body: Body) -> list[RigidPlacement]:
    return [body.of_files(each) for each in poses.placements()]
