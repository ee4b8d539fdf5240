"""The density object itself: parts, voxels, flags, report."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import Final

import numpy as np
import trimesh

from xden1k.rays import THINNER_THAN_LABELS, ObjectGrids, PathLengths, object_grids
from xden1k.values.physics import apparent_density_g_cm3
from xden1k.values.types import DensityObject, Part, Split
from xden_builder.capture import CapturePart
from xden_builder.fit.density import PartDensity
from xden_builder.reconstruct.densities import densities_of
from xden_builder.reconstruct.explained import Explained
from xden_builder.reconstruct.plausible import view_flags
from xden_builder.reconstruct.report import report
from xden_builder.reconstruct.settings import BuildSettings

__all__ = ["assemble"]

UNSTATED: Final[Split] = "train"
"""Split of an object that nobody gave one; a rebuild of a folder draws them."""
VOLUME_TOLERANCE: Final = 0.03
"""Voxels know the volume of the smallest parts to 1 or 2 %."""


def assemble(explained: Explained, settings: BuildSettings) -> DensityObject:
    """Put parts, voxels and the report together.

    Raises
    ------
    DataError
        If the photon energy of a monochromatic source lies outside the tables.
    """
    capture, space, densities = explained.capture, explained.space, densities_of(explained)
    grids = object_grids(space.meshes, space.order, settings.column_samples)
    parts = [
        _part(*of_part)
        for of_part in zip(
            capture.parts,
            space.regions,
            explained.fit.lac_per_cm.tolist(),
            densities.parts,
            _unseen_flags(explained.lengths),
            _cut_flags(space.regions, grids),
            _thin_flags(space.regions, grids),
            strict=True,
        )
    ]
    known = [part.density_g_cm3 for part in parts]
    return DensityObject(
        object_id=capture.object_id,
        category=capture.category,
        split=capture.split or UNSTATED,
        source=capture.source,
        views=capture.views,
        parts=tuple(parts),
        labels=grids.labels,
        occupancy=grids.occupancy,
        envelope=grids.envelope,
        density=None if np.isnan(known).any() else grids.density(known),
        apparent_density=grids.density(
            np.nan_to_num([part.apparent_density_g_cm3 for part in parts]).tolist()
        ),
        origin_cm=grids.field.origin_cm,
        voxel_size_cm=grids.field.voxel_size_cm,
        weighed_mass_g=capture.weighed_mass_g,
        flags=(
            *_object_flags(explained),
            *view_flags(explained.audits),
            *(() if grids.labels.any() else (THINNER_THAN_LABELS,)),
        ),
        meta=report(explained, densities, settings),
    )


def _part(
    part: CapturePart,
    region: trimesh.Trimesh,
    lac_per_cm: float,
    density: PartDensity,
    *more_flags: tuple[str, ...],
) -> Part:
    return Part(
        name=part.name,
        mesh=region,
        material=part.material,
        lac_per_cm=lac_per_cm,
        apparent_density_g_cm3=apparent_density_g_cm3(lac_per_cm),
        density_g_cm3=density.density_g_cm3,
        density_sd_g_cm3=density.sd_g_cm3,
        density_source=density.source,
        flags=(*density.flags, *chain(*more_flags)),
    )


def _unseen_flags(lengths: Sequence[PathLengths]) -> list[tuple[str, ...]]:
    """``partly_unseen`` for each part that one of the views does not show."""
    met = [view.lengths_cm.max(axis=(0, 1), initial=0.0) > 0 for view in lengths]
    some, every = np.any(met, axis=0), np.all(met, axis=0)
    return [("partly_unseen",) if flag else () for flag in (some & ~every).tolist()]


def _cut_flags(regions: Sequence[trimesh.Trimesh], grids: ObjectGrids) -> list[tuple[str, ...]]:
    """``volume_unsure`` for each part whose mesh and voxels disagree about its volume.

    The mesh comes from booleans, the voxels from the walk over the annotated meshes: two ways to
    the same space.
    """
    voxel = grids.field.voxel_size_cm**3
    in_voxels = [float(fill.share.sum(dtype=np.float64)) * voxel for fill in grids.fills]
    return [
        () if abs(sampled / float(region.volume) - 1) < VOLUME_TOLERANCE else ("volume_unsure",)
        for region, sampled in zip(regions, in_voxels, strict=True)
    ]


def _thin_flags(regions: Sequence[trimesh.Trimesh], grids: ObjectGrids) -> list[tuple[str, ...]]:
    """``thinner_than_labels`` for each part that the label grid shows badly."""
    return [(THINNER_THAN_LABELS,) if thin else () for thin in grids.thin(regions)]


def _object_flags(explained: Explained) -> tuple[str, ...]:
    """Of the capture, of its pose, of its source, of the scale, and of the meshes' size."""
    capture, poly = explained.capture, explained.poly
    raised = {
        "attenuation_only": capture.tube is None,
        "weighed_disagrees": poly and poly.weighing and poly.weighing.disagrees,
        "pose_uncertain": poly
        and poly.pose
        and poly.pose.how_sure(explained.space.meshes).uncertain,
        "views_disagree": poly
        and poly.pose
        and poly.pose.apart is not None
        and poly.pose.apart.contradicts,
        "size_at_bound": explained.size and explained.size.at_bound(capture.mesh_scale),
    }
    views = () if poly is None else tuple(f"{view}:at_bound" for view in poly.views_at_bound)
    pose = () if explained.registration is None else explained.registration.flags
    said = (flag for flag, is_raised in raised.items() if is_raised)
    return (*capture.flags, *pose, *said, *views)
