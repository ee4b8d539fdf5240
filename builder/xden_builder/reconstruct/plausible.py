"""Whether a capture hangs together: parts where the images show them, and as large."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from jaxtyping import Bool

from xden1k.errors import DataError
from xden1k.rays import PathLengths
from xden1k.values.arrays import Points
from xden1k.values.views import XRayView
from xden_builder.audit.view import ViewAudit
from xden_builder.capture import CapturePart

__all__ = [
    "SHADOW_DEPTH",
    "check_exposure",
    "check_places",
    "check_size",
    "view_flags",
]

MOST_INVALID_SHARE = 0.5
"""An object with a larger share of saturated and dead pixels is refused."""
SHADOW_DEPTH = 0.05
"""Transmission below the open field by which a pixel counts as shadow."""
SAME_SIZE = 0.2
"""Sizes that differ by less than this share may be the same."""
WHOLE = 0.98
"""Share of an image's side, of a shadow that reaches from edge to edge: it is air that was
misjudged, or an object that both edges cut, and tells no size."""
UNIT_RATIOS = {"100": 100.0, "10": 10.0, "25.4": 25.4, "2.54": 2.54, "39.4": 39.37}


def check_places(parts: Sequence[CapturePart], views: Sequence[XRayView]) -> None:
    """Refuse parts that reach behind the X-ray source or through the detector.

    Raises
    ------
    DataError
        Naming the part and the view.
    """
    for view in views:
        geometry = view.geometry
        if geometry.source_cm is None:
            continue
        inverse = np.linalg.inv(geometry.matrix)[2]  # depth: 0 at the source, 1 on the detector
        for part in parts:
            depth = (np.asarray(part.mesh.vertices) - geometry.source_cm) @ inverse
            if depth.min() <= 0 or depth.max() > 1:
                place = "behind the source" if depth.min() <= 0 else "through the detector"
                raise DataError(
                    f"part {part.name} reaches {place} of view {view.name}; check mesh_units and "
                    "the view's geometry"
                )


def check_exposure(views: Iterable[tuple[XRayView, PathLengths]]) -> None:
    """Refuse an object most of which is saturated: its densities are known from above alone.

    Parameters
    ----------
    views
        Each with what its rays pass through.

    Raises
    ------
    DataError
        Naming the view and the share.
    """
    for view, lengths in views:
        dead = ~view.valid.flat[lengths.pixels]
        share = float(dead.mean()) if dead.size else 0.0
        if share > MOST_INVALID_SHARE:
            told = np.ceil(1000 * share) / 1000  # never the limit itself
            raise DataError(
                f"view {view.name}: {told:.1%} of the object's pixels are saturated, dead or "
                f"masked, expected at most {MOST_INVALID_SHARE:.0%}: expose it less, and mask in "
                f"ignore_{view.name}.png what is not of the object alone"
            )


def view_flags(audits: Sequence[ViewAudit]) -> tuple[str, ...]:
    """Say which views show something else than the parts: ``VIEW:does_not_fit`` and its like."""
    return tuple(f"{audit.name}:{flag}" for audit in audits for flag in _one_views_flags(audit))


def _one_views_flags(audit: ViewAudit) -> Iterator[str]:
    raised = {
        "not_seen": not audit.object_pixels,
        "does_not_fit": audit.object_pixels and not audit.good,
        "unexplained_content": audit.unexplained.content,
        "unexplained_shadow": audit.unexplained.shadow,
        "blurred": audit.blur.harms,
        "uneven_air": audit.uneven_air,
    }
    return (flag for flag, is_raised in raised.items() if is_raised)


def check_size(
    parts: Sequence[CapturePart], views: Sequence[XRayView], air: Sequence[float]
) -> None:
    """Refuse meshes in the wrong units: both shadows are larger or smaller by a unit's factor.

    A shadow that reaches from edge to edge tells no size.

    Parameters
    ----------
    parts, views
        Of a capture.
    air
        Transmission beside the object, of each view.

    Raises
    ------
    DataError
        Naming both sizes in pixels and the factor.
    """
    points = [np.asarray(part.mesh.vertices) for part in parts]
    sizes = []
    for view, level in zip(views, air, strict=True):
        shadow = view.valid & (view.transmission < level - SHADOW_DEPTH)
        if not shadow.any():
            return
        drawn = _drawn_px(points, view)
        if not drawn:
            return
        seen = _longest_side(shadow)
        if seen >= WHOLE * max(shadow.shape):
            return
        sizes.append((seen, drawn))
    for name, factor in UNIT_RATIOS.items():
        for power, words in ((1, f"{name} times"), (-1, f"1/{name} of")):
            if all(abs(seen / (drawn * factor**power) - 1) < SAME_SIZE for seen, drawn in sizes):
                seen, drawn = sizes[0]
                raise DataError(
                    f"the shadow in {views[0].name} is {seen} pixels long, {words} the "
                    f"{drawn:.1f} that the meshes give: check mesh_units in objects.csv, and "
                    "whether parts are missing"
                )


def _drawn_px(points_cm: Sequence[Points], view: XRayView) -> float:
    """How long the parts are on a panel, those left out that lie wholly beyond it; 0 for none."""
    end = np.array(view.geometry.shape)[::-1] - 0.5
    places = [view.geometry.project(each)[:, :2] for each in points_cm]
    seen = [
        each
        for each in places
        if (each.max(axis=0) > -0.5).all() and (each.min(axis=0) < end).all()
    ]
    return float(np.ptp(np.concatenate(seen), axis=0).max()) if seen else 0.0


def _longest_side(mask: Bool[np.ndarray, "rows columns"]) -> int:
    """Longest side of what a mask shows, a few stray pixels left out."""
    sides = []
    for axis in (0, 1):
        places = np.repeat(np.arange(mask.shape[axis]), mask.sum(axis=1 - axis))
        low, high = np.percentile(places, (0.5, 99.5))
        sides.append(int(high - low) + 1)
    return max(sides)
