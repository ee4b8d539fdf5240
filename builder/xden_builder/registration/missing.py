"""Poses of an object of which a part may have no mesh, told by differences of neighbouring pixels.

A shadow that no mesh explains leads derivatives astray, on images of any size, and what pixels
differ by has many small troughs. So the meshes are laid upon what they resemble in each of many
rotations, and from the best of those, as they are, it is looked around without derivatives.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from xden_builder.capture import Capture
from xden_builder.registration.body import Body
from xden_builder.registration.exact import Judge
from xden_builder.registration.kinds import first_of_like
from xden_builder.registration.likeness import Likeness
from xden_builder.registration.placement import Found
from xden_builder.registration.shadow import Shadow
from xden_builder.registration.shortlist import laid_upon_content

__all__ = ["found_by_edges"]

LAID, AROUND, SOME, CLOSELY = 60, 24, 16, 4
"""Poses that are moved first, that are looked around, that are moved on fine images, and go on."""
COARSE_PX: Final = 80
"""Width of the shadow, in averaged pixels, where it is looked around poses."""
REACH: Final = 0.1
"""How far: radians, and as a share of the radius."""
UNLIKE: Final = 0.02
"""Of the radius: by how much poses differ that are moved on fine images."""


def found_by_edges(
    capture: Capture,
    shadows: Sequence[Shadow],
    clouded: Body,
    body: Body,
    likeness: Likeness,
    before: Sequence[Found],
    fine: Judge,
) -> list[Found]:
    """Find unlike poses, the one first of which neighbouring pixels differ least.

    Parameters
    ----------
    capture, shadows
        What was measured.
    clouded, body, likeness
        What is looked for, by points and as it is, and how far apart its poses are.
    before
        What was found otherwise, which takes part.
    fine
        Compares fine images, and lets light be lost.
    """
    laid = laid_upon_content(shadows, clouded, likeness, LAID).placements()
    poses = [*(each.placement for each in before), *map(body.of_files, laid)]
    coarse = Judge.of(capture, shadows, body, COARSE_PX, poses[0], incomplete=True)
    starts = [coarse.fixed(each) for each in poses]
    moved = [coarse.edged(each) for each in starts]
    promising = sorted(range(len(poses)), key=lambda number: moved[number].improbability)[:AROUND]
    around = [coarse.edged(coarse.sought(starts[number], REACH)) for number in promising]
    some = first_of_like(_best_first([*moved, *around]), likeness, body, SOME, UNLIKE)
    stayed = (fine.fixed(each.placement, each.growth) for each in before)
    there = _best_first(fine.edged(each) for each in (*some, *stayed))
    return first_of_like(there, likeness, body, CLOSELY)


def _best_first(found: Iterable[Found]) -> list[Found]:
    return sorted(found, key=lambda each: each.improbability)
