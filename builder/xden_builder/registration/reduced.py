"""A capture of fewer pixels and fewer faces, for what need not see every one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import trimesh

from xden1k.values.views import XRayView
from xden_builder.capture import Capture
from xden_builder.capture.saturation import completed
from xden_builder.capture.solids import simplified
from xden_builder.capture.space import Space
from xden_builder.physics.source import Tube
from xden_builder.poly.model.frames import binned, coarse
from xden_builder.registration.shadow import Shadow

__all__ = ["USUAL_KEV", "binning_of", "reduced", "widest_px"]

USUAL_KEV: Final = 60.0
"""Taken where the source is not told."""
TOLERANCES_PX: Final = (0.25, 0.12, 0.06, 0.03)
"""By which surfaces may be off; less where that would make a part much smaller or larger."""


def reduced(
    capture: Capture, space: Space, shadows: Sequence[Shadow], wide_px: int
) -> tuple[Capture, Space, int]:
    """Average images until the longest shadow is about so many pixels wide.

    Returns
    -------
    capture
        Its source is told, its images are complete.
    space
        What is each part's; what is finer than a share of a pixel is left out.
    binning
        Pixels that were averaged along each side.
    """
    binning = binning_of(shadows, wide_px)
    views = [_averaged(capture, view, binning) for view in capture.fitted_views]
    small = replace(
        capture,
        tube=capture.tube or Tube(energy_kev=USUAL_KEV),
        views=(views[0], views[1]),
        further_views=tuple(views[2:]),
        open_field={},
        at_least={},
    )
    return small, _of_fewer_faces(space, wide_px), binning


def binning_of(shadows: Sequence[Shadow], wide_px: int) -> int:
    """How many pixels are averaged along each side until the longest shadow has about so many."""
    return max(round(widest_px(shadows) / wide_px), 1)


def widest_px(shadows: Sequence[Shadow]) -> float:
    """Longest side of the boxes around shadows."""
    return max(float(shadow.size_px.max()) for shadow in shadows)


def _of_fewer_faces(space: Space, wide_px: int) -> Space:
    """Leave out what is finer than a share of a pixel."""
    points = np.concatenate([np.asarray(mesh.vertices) for mesh in space.meshes])
    pixel_cm = float(np.ptp(points, axis=0).max()) / wide_px

    def of_fewer(whole: trimesh.Trimesh) -> trimesh.Trimesh:
        tries = (simplified(whole, pixel_cm * share) for share in TOLERANCES_PX)
        return next((mesh for mesh in tries if len(mesh.faces) < len(whole.faces)), whole)

    return space.moved(of_fewer)


def _averaged(capture: Capture, view: XRayView, binning: int) -> XRayView:
    whole, _ = completed(view, capture.at_least.get(view.name))
    image, known = binned(whole, binning)
    return XRayView(view.name, image, known, coarse(view.geometry, binning))
