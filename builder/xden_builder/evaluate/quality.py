"""What knowing the interior is worth: all parts, against the outer surface as one part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from xden1k.rays import object_grids
from xden_builder.audit.view import ViewAudit, audit_image, noise_floor
from xden_builder.capture import Capture
from xden_builder.capture.space import divide
from xden_builder.evaluate.methods import poly
from xden_builder.evaluate.truth import Truth
from xden_builder.poly.judgement import PolyFit
from xden_builder.poly.settings import PolySettings
from xden_builder.reconstruct.withheld import as_whole

__all__ = ["SHOWN", "Quality", "QualityPair", "quality_of"]

SHOWN: Final = ("glue_stick", "pencil", "ballpoint_pen", "razor")
"""Categories of the objects that the paper compares with a CT."""


@dataclass(frozen=True, slots=True)
class Quality:
    """How well a model explains the radiographs, and the true density.

    Parameters
    ----------
    voxel_mae_g_cm3
        Mean absolute error of the density over the object's voxels, weighted by the share inside
        its outer surface.
    views
        Reprojection of ``pa`` and ``lat``, on the object.
    """

    voxel_mae_g_cm3: float
    views: tuple[ViewAudit, ...]


@dataclass(frozen=True, slots=True)
class QualityPair:
    """Both models of one object."""

    category: str
    interior: Quality
    outside: Quality


def quality_of(
    capture: Capture,
    order: Sequence[int],
    truth: Truth,
    fit: PolyFit,
) -> QualityPair:
    """Compare a fit of all parts with one of the outer surface, hollow and of unknown material.

    Parameters
    ----------
    capture, order
        The object, and which part owns space first.
    truth
        Its densities.
    fit
        Of all parts.
    """
    meshes = [part.mesh for part in capture.parts]
    grids = object_grids(meshes, order)
    true_field = grids.density(truth.density_g_cm3.tolist()).density_g_cm3
    weights = grids.envelope.astype(np.float64)
    hull = as_whole(capture)
    (alone,) = poly(hull, divide(hull.parts), [None], PolySettings())
    whole = float(alone.solution.density_g_cm3[0]) * weights

    def mae(field: np.ndarray) -> float:
        return float((np.abs(field - true_field) * weights).sum() / weights.sum())

    own = grids.density(fit.solution.density_g_cm3.tolist()).density_g_cm3
    return QualityPair(
        capture.category,
        Quality(mae(own), _views(capture, fit)),
        Quality(mae(whole), _views(capture, alone)),
    )


def _views(capture: Capture, fit: PolyFit) -> tuple[ViewAudit, ...]:
    found = []
    for number, seen in enumerate(fit.solution.seen):
        gain = float(fit.solution.nuisances(number)[0])
        floor = noise_floor(capture, seen.view.name)
        model = fit.solution.image(number, seen.lengths)
        saturated = fit.solution.scene.saturated[number]
        found.append(
            audit_image(seen.view, seen.lengths, model, gain=gain, floor=floor, saturated=saturated)
        )
    return tuple(found)
