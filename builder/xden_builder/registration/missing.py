"""Poses of an object of which a part may have no mesh, told by differences of neighbouring pixels.

A shadow that no mesh explains leads derivatives astray, on images of any size, and what pixels
differ by has many small troughs. So it is looked around where poses lie, without derivatives, too.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from xden1k.values.arrays import Vec3
from xden_builder.capture import Capture
from xden_builder.registration.body import Body
from xden_builder.registration.exact import COARSE_PX, Judge
from xden_builder.registration.kinds import FINAL_APART, first_of_like
from xden_builder.registration.likeness import Likeness
from xden_builder.registration.middles import room_of
from xden_builder.registration.placement import Found, RigidPlacement
from xden_builder.registration.shadow import Shadow

__all__ = ["told_by_edges"]

AROUND, SOME, CLOSELY = 24, 16, 4
"""Poses that are looked around, that are moved on fine images, and that go on."""
CLOSER: Final = (8, 4)
"""Poses that are looked around on fine images, and those once more."""
REACHES, FINE_REACHES = (0.1, 0.003), (0.05, 0.003)
"""How far and how closely: radians, and as a share of the radius."""


def told_by_edges(
    capture: Capture,
    shadows: Sequence[Shadow],
    body: Body,
    likeness: Likeness,
    poses: Sequence[RigidPlacement],
    fine: Judge,
) -> list[Found]:
    """Find unlike poses beside some, the one first of which neighbouring pixels differ least.

    Parameters
    ----------
    capture, shadows
        What was measured.
    body, likeness
        What is looked for, and how far apart its poses are.
    poses
        Where it may stand, about.
    fine
        Compares fine images, and lets light be lost.
    """
    poses = _within(room_of(shadows, body.radius_cm), body, poses) or list(poses)
    coarse = Judge.of(capture, shadows, body, COARSE_PX, poses[0], incomplete=True)
    starts = [coarse.fixed(each) for each in poses]
    moved = [coarse.edged(each) for each in starts]
    promising = sorted(range(len(poses)), key=lambda number: moved[number].improbability)[:AROUND]
    around = [coarse.edged(coarse.sought(starts[number], REACHES)) for number in promising]
    some = first_of_like(_best_first([*moved, *around]), likeness, body, SOME, FINAL_APART)
    there = _best_first(fine.edged(each) for each in some)
    for count in CLOSER:
        closer = [_looked_around(fine, each) for each in there[:count]]
        there = _best_first([*closer, *there[count:]])
    return first_of_like(there, likeness, body, CLOSELY)


def _within(
    room_cm: tuple[Vec3, Vec3], body: Body, poses: Sequence[RigidPlacement]
) -> list[RigidPlacement]:
    """Leave out poses elsewhere: a search that explains all has gone near a source with some."""
    least, most = room_cm
    middles = [each.apply(body.middle_cm[None])[0] for each in poses]
    return [
        each
        for each, middle in zip(poses, middles, strict=True)
        if ((least <= middle) & (middle <= most)).all()
    ]


def _looked_around(judge: Judge, found: Found) -> Found:
    """Give the better of a pose and of what is found around it."""
    return _best_first([judge.edged(judge.sought(found, FINE_REACHES)), found])[0]


def _best_first(found: Iterable[Found]) -> list[Found]:
    return sorted(found, key=lambda each: each.improbability)
