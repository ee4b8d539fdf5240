"""Unlike poses that the search hardly tells, each refined on the images as they are.

What tells a racket from the racket turned by half, or a yo-yo, is finer than the pixels of the
search. And where the best pose leaves much, as where a part has no mesh, another of those that were
found may be the right one. So they are refined as the rebuild will refine the one it is given, but
neither begun again where they were found nor looked around, which would take twice as long.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

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
        The best first, those that were not refined last, as they came. All as they came where there
        is one alone, or the source is not told.
    """
    close = [doubted or each.as_good_as(found[0]) for each in found]
    if sum(close) < 2 or capture.tube is None:
        return list(found)
    there = [
        _refined(capture, order, each, doubted=doubted) if is_close else each
        for each, is_close in zip(found, close, strict=True)
    ]
    return sorted(there, key=lambda each: each.improbability)


def _refined(capture: Capture, order: Sequence[int], found: Found, *, doubted: bool) -> Found:
    """Say what a pose leaves once refined; it stays as it was found."""
    settings = PolySettings()
    scene = set_scene(found.placement.of_capture(capture), order, settings)
    fit = find_pose(first_guess(scene), settings, begun_again=False).fit
    assert fit is not None
    return replace(found, doubt=fit.doubt, left=fit.left, edges=fit.edges if doubted else None)
