"""Where an object of known rotation must be, and how large, for its shadows' boxes to be right."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden1k.values.arrays import Vec3
from xden1k.values.views import ViewGeometry
from xden_builder.registration.camera import Rotations, Shifts
from xden_builder.registration.shadow import Shadow

__all__ = [
    "led_to",
    "lone_sight",
    "own_shifts",
    "room_of",
    "scales_to_sizes",
    "shifts_to_middles",
]

ROUNDS: Final = 2
FARTHEST: Final = 0.75
"""Of the way to a source along its longest axis, that an object may be elsewhere."""
WEAKLY: Final = 1e-6
"""Share of the curvature that keeps what no view tells where it is."""


def shifts_to_middles(
    shadows: Sequence[Shadow], rim_cm: Float64[np.ndarray, "n 3"], rotations: Rotations
) -> Shifts:
    """Shift the object so that the boxes around its shadows have the middles that were measured.

    Parameters
    ----------
    shadows
        Of all views; those before which the object was turned say least, and where all else
        leaves it open.
    rim_cm
        Outermost points of the object about its middle.
    rotations
        Shape (b, 3, 3).

    Returns
    -------
    ndarray
        Shape (b, 3), in cm.
    """
    turned = np.einsum("bij,nj->bni", rotations, rim_cm)
    shifts = _between_rays(shadows) - (turned.max(axis=1) + turned.min(axis=1)) / 2
    places = [(each.geometry, each.middle_px) for each in shadows if not each.turned]
    return led_to(places, turned, shifts)


def scales_to_sizes(
    shadows: Sequence[Shadow], rim_cm: Float64[np.ndarray, "n 3"], rotations: Rotations
) -> Float64[np.ndarray, "b"]:
    """Scale the object such that the boxes around its shadows have the sizes that were measured.

    All sides are off by as many pixels where a rotation is off by a few degrees: seen from its end,
    something long has a small box, which tells least.

    Parameters
    ----------
    shadows, rim_cm, rotations
        As of :func:`shifts_to_middles`.

    Returns
    -------
    ndarray
        Shape (b,).
    """
    shifts = shifts_to_middles(shadows, rim_cm, rotations)
    places = np.einsum("bij,nj->bni", rotations, rim_cm) + shifts[:, None]
    measured_by_shown, shown_squared = np.zeros((2, len(rotations)))
    for shadow in shadows:
        shown = shadow.geometry.project(places.reshape(-1, 3))[:, :2].reshape(*places.shape[:2], 2)
        sides = np.ptp(shown, axis=1)
        measured_by_shown += sides @ shadow.size_px
        shown_squared += (sides**2).sum(axis=1)
    return np.asarray(measured_by_shown / shown_squared)


def led_to(
    places_px: Sequence[tuple[ViewGeometry, Float64[np.ndarray, "*_b 2"]]],
    points_cm: Float64[np.ndarray, "b n 3"],
    shifts: Shifts,
) -> Shifts:
    """Shift points until the middles of the boxes around their images come to lie in some places.

    Parameters
    ----------
    places_px
        Columns and rows of these places in each view, for all poses or each.
    points_cm, shifts
        Of some poses, and by which they are shifted to begin with.
    """
    for _ in range(ROUNDS):
        curvature = np.zeros((len(shifts), 3, 3))
        gradient = np.zeros((len(shifts), 3))
        for geometry, wanted_px in places_px:
            middles_px, slopes = _middles_px(geometry, points_cm + shifts[:, None])
            curvature += np.einsum("bki,bkj->bij", slopes, slopes)
            gradient += np.einsum("bki,bk->bi", slopes, wanted_px - middles_px)
        weakly = WEAKLY * np.trace(curvature, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        shifts = shifts + np.linalg.solve(curvature + weakly, gradient[..., None])[..., 0]
    return np.asarray(shifts)


def own_shifts(
    shadow: Shadow, rim_cm: Float64[np.ndarray, "n 3"], rotations: Rotations, shifts: Shifts
) -> Shifts:
    """Say by how much more the object is shifted in a view, across the beam.

    Nothing where it was not turned before that view; parameters as of :func:`shifts_to_middles`.
    """
    more = np.zeros_like(shifts)
    if not shadow.turned:
        return more
    turned = np.einsum("bij,nj->bni", rotations, rim_cm) + shifts[:, None]
    for _ in range(ROUNDS):
        middles_px, slopes = _middles_px(shadow.geometry, turned + more[:, None])
        off_px = shadow.middle_px - middles_px
        more = more + (np.linalg.pinv(slopes) @ off_px[..., None])[..., 0]
    return more


def lone_sight(shadows: Sequence[Shadow]) -> Vec3 | None:
    """Give the beam through the object in the only view that was not turned; None of two or more.

    How far along it the object was is told by the size of its shadows alone: not at all on coarse
    images, and to some millimetres on fine ones.
    """
    still = [each for each in shadows if not each.turned]
    if len(still) > 1:
        return None
    _, way = _ray(still[0].geometry, still[0].middle_px)
    return way


def room_of(shadows: Sequence[Shadow], radius_cm: float) -> tuple[Vec3, Vec3]:
    """Least and most place of the middle of an object that casts a part of the shadows.

    Parameters
    ----------
    shadows
        Of all views, none of which was turned.
    radius_cm
        Of the object.

    Returns
    -------
    tuple
        Shapes (3,), in cm: as far from where the shadows' middles meet as half a shadow is long on
        its panel, and the object beside it; no source is in an object in that box.
    """
    middle = _between_rays(shadows)
    reach_cm = radius_cm
    for shadow in shadows:
        pitch_cm = float(np.linalg.norm(shadow.geometry.column_step_cm))
        reach_cm = max(reach_cm, radius_cm + pitch_cm * float(shadow.size_px.max()) / 2)
    for shadow in shadows:
        if (source := shadow.geometry.source_cm) is not None:
            away_cm = float(np.abs(source - middle).max())
            reach_cm = max(min(reach_cm, FARTHEST * away_cm, away_cm - 1.1 * radius_cm), 0.0)
    return middle - reach_cm, middle + reach_cm


def _between_rays(shadows: Sequence[Shadow]) -> Vec3:
    """Point that is nearest to the rays through the middles of all shadows."""
    curvature, gradient = np.zeros((3, 3)), np.zeros(3)
    for shadow in shadows:
        place, way = _ray(shadow.geometry, shadow.middle_px)
        across = np.eye(3) - np.outer(way, way)
        curvature += across
        gradient += across @ place
    return np.asarray(np.linalg.lstsq(curvature, gradient)[0])


def _ray(geometry: ViewGeometry, place_px: Float64[np.ndarray, "2"]) -> tuple[Vec3, Vec3]:
    """Give a point of the ray through a pixel, and its direction."""
    end = geometry.pixel_centres_cm(place_px[1:], place_px[:1])[0]
    way = geometry.direction if geometry.source_cm is None else end - geometry.source_cm
    assert way is not None
    return end, way / np.linalg.norm(way)


def _middles_px(
    geometry: ViewGeometry, points_cm: Float64[np.ndarray, "b n 3"]
) -> tuple[Float64[np.ndarray, "b 2"], Float64[np.ndarray, "b 2 3"]]:
    """Middles of the boxes around images of points, and how these move with the points."""
    inverse = np.linalg.inv(geometry.matrix)
    if geometry.source_cm is None:
        places = ((points_cm - geometry.pixel00_cm) @ inverse.T)[..., :2]
        middles = (places.max(axis=1) + places.min(axis=1)) / 2
        return middles, np.broadcast_to(inverse[:2], (len(places), 2, 3))
    along = (points_cm - geometry.source_cm) @ inverse.T
    depth = along[..., 2:].clip(min=0.05)
    places = along[..., :2] / depth
    middles = (places.max(axis=1) + places.min(axis=1)) / 2
    slopes = (inverse[:2] - middles[..., None] * inverse[2]) / np.median(depth, axis=1)[..., None]
    return middles, slopes
