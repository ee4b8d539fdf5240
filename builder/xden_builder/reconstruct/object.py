"""One capture into one density object: registration, space, fits, checks, parts and voxels."""

from __future__ import annotations

from typing import Final

import numpy as np

from xden1k.values.types import DensityObject
from xden1k.values.views import XRayView
from xden_builder.capture import Capture
from xden_builder.capture.space import divide
from xden_builder.reconstruct.assembly import assemble
from xden_builder.reconstruct.explained import explain
from xden_builder.reconstruct.plausible import (
    check_exposure,
    check_places,
    check_size,
)
from xden_builder.reconstruct.settings import BuildSettings
from xden_builder.reconstruct.withheld import as_told
from xden_builder.registration.capture import registered

__all__ = ["reconstruct"]

DEFAULT: Final = BuildSettings()
AIR: Final = 0.9
"""Quantile of the transmission that is open field, if anything is."""


def reconstruct(capture: Capture, settings: BuildSettings = DEFAULT) -> DensityObject:
    """Rebuild one object: path lengths, fit, density, voxels.

    Parameters
    ----------
    capture
        What came off the scanner and the annotation desk.
    settings
        How to rebuild.

    Returns
    -------
    DensityObject
        In the scanner's frame. Its parts are the annotated ones less what stronger parts own.
        ``density`` is None where a part has no density that can be told; a part that no ray met
        adds nothing to ``apparent_density``.

    Raises
    ------
    DataError
        If stronger parts leave nothing of one, two parts are the same mesh, a part reaches behind
        the source or through the detector, most of the object is saturated, the meshes are in
        other units than ``objects.csv`` says, or their pose is unknown and cannot be looked for.
    """
    there = registered(as_told(capture, settings))
    capture = there.capture
    check_places(capture.parts, capture.fitted_views)
    space = divide(capture.parts)
    explained = explain(there, space, settings)
    check_exposure(zip(capture.fitted_views, explained.lengths, strict=True))
    views = explained.capture.fitted_views
    gains = (audit.gain for audit in explained.audits)
    check_size(capture.parts, views, list(map(_air, views, gains)))
    return assemble(explained, settings)


def _air(view: XRayView, gain: float) -> float:
    """Transmission beside the object, by the fit or, if that found none there, by the image."""
    return max(gain, float(np.quantile(view.transmission[view.valid], AIR)))
