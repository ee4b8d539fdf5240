"""Unlike poses that the search hardly tells, each refined on the images as they are.

What tells a racket from the racket turned by half, or a padlock by a pin behind millimetres of
steel, is finer than the pixels of the search. And where the best pose leaves much, another of those
that were found may be the right one, though it leaves more as long as it has not moved. So they are
refined as the rebuild will refine the one it is given, but neither begun again where they were
found nor looked around, which would take twice as long.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.polynomial.polynomial import polyval

from xden_builder.capture import Capture
from xden_builder.capture.space import Space
from xden_builder.poly.pose import find_pose
from xden_builder.poly.scene import set_scene
from xden_builder.poly.settings import PolySettings
from xden_builder.poly.start import first_guess
from xden_builder.registration.placement import Found

__all__ = ["told_closely"]

MAY_BE_RIGHT: Final = (0.01, 1.3, 4.0)
"""A pose whose loss is at most so much, so many times that of the best, and so many times its
square, together: the more even the best leaves, the less of that is a fault of the pose."""
HARDLY_MORE: Final = 1.1
"""Times the least differences of a pose that is looked around, too, where a part may have no mesh:
in one trough beside their place poses differ by as little as in the next."""


def told_closely(
    capture: Capture, space: Space, found: Sequence[Found], *, doubted: bool
) -> list[Found]:
    """Refine every pose that may be right, and put first the one that leaves least.

    Parameters
    ----------
    capture
        Its meshes in any frame.
    space
        What is each part's.
    found
        Unlike poses, the best first.
    doubted
        Whether even the best is not believed: then all are refined.

    Returns
    -------
    list of Found
        The best first, refined, and after them those that were not, as they came. All as they came
        where there is one alone, or the source is not told.
    """
    close = [each for each in found if doubted or _may_be_right(each, found[0])]
    if len(close) < 2 or capture.tube is None:
        return list(found)
    there = [_refined(capture, space, each, doubted=doubted) for each in close]
    if doubted:
        least = min(each.improbability for each in there)
        there = [
            _looked_around(capture, space, each)
            if each.improbability <= HARDLY_MORE * least
            else each
            for each in there
        ]
    return [
        *sorted(there, key=lambda each: each.improbability),
        *(each for each in found if each not in close),
    ]


def _may_be_right(found: Found, best: Found) -> bool:
    """Whether the search does not tell a pose from the best."""
    return found.loss <= float(polyval(best.loss, MAY_BE_RIGHT))


def _looked_around(capture: Capture, space: Space, found: Found) -> Found:
    """Refine a pose once more, as the rebuild will, unless that leaves more."""
    again = _refined(capture, space, found, doubted=True, begun_again=True)
    return min(found, again, key=lambda each: each.improbability)


def _refined(
    capture: Capture, space: Space, found: Found, *, doubted: bool, begun_again: bool = False
) -> Found:
    """Move a pose on the images as they are, and say what it leaves of them."""
    settings = PolySettings()
    there = found.placement
    scene = set_scene(there.of_capture(capture), space.moved(there.moved), settings)
    end = find_pose(first_guess(scene), settings, begun_again=begun_again)
    fit, size = end.fit, end.size
    assert fit is not None
    growth = float(np.log(size.factor))
    if capture.mesh_scale == "unknown":
        there, growth = there.enlarged(size.factor, size.centre_cm), 0.0
    refined = replace(
        found,
        placement=there.followed_by(fit.pose),
        density_g_cm3=fit.density_g_cm3,
        edges=fit.edges,
        gains=None,
        growth=growth,
    )
    return refined if doubted else replace(refined, doubt=fit.doubt, left=fit.left)
