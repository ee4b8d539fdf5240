"""Unlike poses that the search hardly tells, each refined on the images as they are.

What tells a racket from the racket turned by half, or a yo-yo, is finer than the pixels of the
search. And where the best pose leaves much, as where a part has no mesh, another of those that were
found may be the right one. So they are refined as the pose is that is built with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from xden_builder.capture import Capture
from xden_builder.poly.pose import find_pose
from xden_builder.poly.scene import set_scene
from xden_builder.poly.settings import PolySettings
from xden_builder.poly.start import first_guess
from xden_builder.registration.placement import Found

__all__ = ["told_closely"]


def told_closely(
    capture: Capture, order: Sequence[int], found: Sequence[Found], *, doubted: bool
) -> list[Found]:
    """Refine every pose that is as good as the best, and put first the one that leaves least.

    Parameters
    ----------
    capture
        Its meshes in any frame.
    order
        Which part owns space first.
    found
        Unlike poses, the best first.
    doubted
        Whether even the best is not believed: then all are refined.

    Returns
    -------
    list of Found
        The best first. As they came where there is one alone, or the source is not told.
    """
    close = [each for each in found if doubted or each.as_good_as(found[0])]
    if len(close) < 2 or capture.tube is None:
        return list(found)
    judged = {id(each): _refined(capture, order, each) for each in close}
    there = [judged.get(id(each), each) for each in found]
    return sorted(there, key=_improbability)


def _refined(capture: Capture, order: Sequence[int], found: Found) -> Found:
    """Say what a pose leaves once refined; it stays as it was found."""
    settings = PolySettings()
    scene = set_scene(found.placement.of_capture(capture), order, settings)
    fit = find_pose(first_guess(scene), settings).fit
    assert fit is not None
    return replace(found, doubt=fit.doubt)


def _improbability(found: Found) -> float:
    """Give what refined poses are sorted by; those that were not come last, as they came.

    Neither doubt nor loss has a known scale. So they are compared by their shares, which multiply,
    and the finer images count twice.
    """
    return np.inf if found.doubt is None else found.doubt**2 * found.loss
