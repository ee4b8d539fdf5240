"""Unlike poses that the search hardly tells, each refined on the images as they are.

What tells a racket from the racket turned by half, or a padlock by a pin behind millimetres of
steel, is finer than the pixels of the search. And where the best pose leaves much, another of those
that were found may be the right one, though it leaves more as long as it has not moved. So they are
refined as the rebuild will refine the one it is given, but neither begun again where they were
found nor looked around, which would take twice as long; but for those that then differ hardly where
a part may have no mesh.
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
"""Poses of which pixels differ by at most so many times the least are looked around where a part
may have no mesh: beside its place a right pose may leave as much as a wrong one."""


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
        Whether even the best is not believed: then all are refined. If several differ hardly more
        than the best, these are looked around, but where a view was turned.

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
    if doubted and not capture.turned:
        there = _looked_around(capture, space, there)
    return [
        *sorted(there, key=lambda each: each.improbability),
        *(each for each in found if each not in close),
    ]


def _may_be_right(found: Found, best: Found) -> bool:
    """Whether the search does not tell a pose from the best."""
    return found.loss <= float(polyval(best.loss, MAY_BE_RIGHT))


def _looked_around(capture: Capture, space: Space, found: Sequence[Found]) -> list[Found]:
    """Refine what differs hardly more than the best once more, as the rebuild will.

    One pose alone is left to that, and each that leaves more by it stays as it was.
    """
    most = HARDLY_MORE * min(each.improbability for each in found)
    close = [each for each in found if each.improbability <= most]
    if len(close) < 2:
        return list(found)
    again = (_refined(capture, space, each, doubted=True, begun_again=True) for each in close)
    pairs = zip(close, again, strict=True)
    better = [min(pair, key=lambda each: each.improbability) for pair in pairs]
    return [*better, *(each for each in found if each not in close)]


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
    refined = replace(
        found,
        density_g_cm3=fit.density_g_cm3,
        edges=fit.edges,
        gains=None,
        growth=float(np.log(size.factor)),
    )
    if capture.scale_sought:
        refined = refined.rescaled(size.centre_cm)
    refined = refined.posed(fit.poses, fit.unknowns)
    return refined if doubted else replace(refined, doubt=fit.doubt, left=fit.left)
