"""One capture into one density object."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, replace
from itertools import chain
from typing import Any

import numpy as np
import trimesh

from xden1k.errors import DataError
from xden1k.rays import (
    ObjectGrids,
    PathLengths,
    disjoint_regions,
    object_grids,
    ownership_order,
    path_lengths,
)
from xden1k.values.physics import apparent_density_g_cm3
from xden1k.values.plain import plain
from xden1k.values.types import SPLITS, DensityObject, Part, Split
from xden_builder.audit.view import ViewAudit, audit_image, audit_view, noise_floor
from xden_builder.capture import Capture, CapturePart
from xden_builder.fit import LacFit, fit_lac, fit_lac_adam
from xden_builder.fit.density import PartDensity, part_densities
from xden_builder.poly.estimate import estimate
from xden_builder.poly.posterior import MASS_SD_SHARE
from xden_builder.poly.result import PolyFit, judged
from xden_builder.poly.rigid import rigid_sd
from xden_builder.reconstruct.plausible import check_places, check_size, view_flags
from xden_builder.reconstruct.settings import BuildSettings

__all__ = ["default_split", "reconstruct"]

DEFAULT = BuildSettings()
VOLUME_TOLERANCE = 0.03
"""Voxels know the volume of the smallest parts to 1 or 2 %."""
SPLIT_SHARES = (0.7, 0.1, 0.2)
"""Of train, val and test, where a capture names no split."""


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
        Its parts are the annotated ones less what stronger parts own. ``density`` is None where a
        part has no density that can be told; a part that no ray met adds nothing to
        ``apparent_density``.

    Raises
    ------
    DataError
        If stronger parts leave nothing of one, a part reaches behind the source or through the
        detector, or the meshes are in other units than ``objects.csv`` says.
    """
    check_places(capture.parts, capture.views)
    meshes = [part.mesh for part in capture.parts]
    order = ownership_order(meshes, [part.priority for part in capture.parts])
    regions = disjoint_regions(meshes, order)
    _refuse_empty(capture.parts, regions)
    poly = None
    if _model_used(capture, settings) == "poly":
        volumes_cm3 = np.array([float(region.volume) for region in regions])
        poly = judged(estimate(capture, order, volumes_cm3, settings.poly), capture.parts)
        capture = _turned(capture, poly)
    subrays = 1 if settings.model == "paper" else settings.subrays
    lengths = [path_lengths(meshes, order, view.geometry, subrays) for view in capture.views]
    fit = _fit(capture, lengths, settings)
    audits = _audits(capture, lengths, fit, poly)
    check_size(capture.parts, capture.views, audits)
    densities = poly.parts if poly else part_densities(fit, capture.parts, capture.tube)
    grids = object_grids(meshes, order, settings.column_samples)
    parts = [
        _part(*of_part)
        for of_part in zip(
            capture.parts,
            regions,
            fit.lac_per_cm.tolist(),
            densities,
            _unseen_flags(lengths),
            _cut_flags(regions, grids),
            strict=True,
        )
    ]
    known = [part.density_g_cm3 for part in parts]
    return DensityObject(
        object_id=capture.object_id,
        category=capture.category,
        split=capture.split or default_split(capture.object_id),
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
        flags=(*_object_flags(capture), *view_flags(audits)),
        meta=_meta(capture, lengths, fit, audits, settings)
        | _uncertainty(regions, densities, poly, capture.weighed_mass_g)
        | ({} if poly is None else {"poly": plain(poly.report([part.name for part in parts]))}),
    )


def default_split(object_id: str) -> Split:
    """Split of an object whose capture names none: by its id alone, 70 : 10 : 20.

    Examples
    --------
    >>> default_split("tooth"), default_split("tetra")
    ('train', 'test')
    """
    draw = int.from_bytes(hashlib.sha256(object_id.encode()).digest()[:8]) / 2**64
    edges = np.cumsum(SPLIT_SHARES)[:-1]
    return SPLITS[int(np.searchsorted(edges, draw, side="right"))]


def _refuse_empty(parts: Sequence[CapturePart], regions: Sequence[trimesh.Trimesh]) -> None:
    for part, region in zip(parts, regions, strict=True):
        if not len(region.faces):
            raise DataError(
                f"part {part.name}: other parts own all of its space; see priority in parts.csv"
            )


def _fit(capture: Capture, lengths: Sequence[PathLengths], settings: BuildSettings) -> LacFit:
    views = list(zip(lengths, capture.views, strict=True))
    if settings.model == "paper":
        return fit_lac_adam(views)
    return fit_lac(views, dark_sd=capture.noise_sd)


def _turned(capture: Capture, poly: PolyFit) -> Capture:
    """Put the scanner where the refined pose sees it from the meshes."""
    pa, lat = (
        replace(view, geometry=seen.geometry)
        for view, seen in zip(capture.views, poly.solution.seen, strict=True)
    )
    return replace(capture, views=(pa, lat))


def _audits(
    capture: Capture, lengths: Sequence[PathLengths], fit: LacFit, poly: PolyFit | None
) -> tuple[ViewAudit, ...]:
    """How well the fit explains its own images."""
    found = []
    for number, (view, each) in enumerate(zip(capture.views, lengths, strict=True)):
        floor = noise_floor(capture, view.name)
        if poly is None:
            lac, gain = np.nan_to_num(fit.lac_per_cm), float(fit.gain[number])
            found.append(audit_view(view, each, lac, gain=gain, floor=floor))
        else:
            gain = float(poly.solution.nuisances(number)[0])
            model = poly.solution.image(number, each)
            found.append(audit_image(view, each, model, gain=gain, floor=floor))
    return tuple(found)


def _uncertainty(
    regions: Sequence[trimesh.Trimesh],
    densities: Sequence[PartDensity],
    poly: PolyFit | None,
    weighed_mass_g: float | None,
) -> dict[str, Any]:
    """Give standard deviations of the mass properties, if every density is known."""
    known = np.array([density.density_g_cm3 for density in densities])
    if np.isnan(known).any():
        return {}
    sds = np.array([density.sd_g_cm3 for density in densities])
    covariance = np.diag(sds**2) if poly is None else poly.covariance
    weighed_sd_g = None
    if poly is not None and weighed_mass_g is not None:
        weighed_sd_g = MASS_SD_SHARE * weighed_mass_g
    sd = rigid_sd(regions, known, covariance, weighed_sd_g=weighed_sd_g)
    return {
        "uncertainty": {
            "mass_sd_g": sd.mass_g,
            "com_sd_cm": sd.com_cm.tolist(),
            "inertia_sd_g_cm2": [
                float(sd.inertia_g_cm2[axes])
                for axes in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
            ],
        }
    }


def _unseen_flags(lengths: Sequence[PathLengths]) -> list[tuple[str, ...]]:
    """``partly_unseen`` for each part that one of the views does not show."""
    met = [view.lengths_cm.any(axis=(0, 1)) for view in lengths]
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


def _object_flags(capture: Capture) -> tuple[str, ...]:
    return capture.flags if capture.tube else (*capture.flags, "attenuation_only")


def _meta(
    capture: Capture,
    lengths: Sequence[PathLengths],
    fit: LacFit,
    audits: Sequence[ViewAudit],
    settings: BuildSettings,
) -> dict[str, Any]:
    """Fit report and provenance: nothing of the machine or the hour, so that bytes repeat."""
    names = [view.name for view in capture.views]
    meta = {
        "model": _model_used(capture, settings),
        "settings": asdict(settings),
        "tube": None if capture.tube is None else asdict(capture.tube),
        "fit": {
            **fit.report,
            "loss": fit.loss,
            "lac_sd_per_cm": {
                part.name: sd
                for part, sd in zip(capture.parts, fit.lac_sd_per_cm.tolist(), strict=True)
            },
            "gain": dict(zip(names, fit.gain.tolist(), strict=True)),
        },
        "reprojection": {
            audit.name: {
                "transmission_mae": audit.transmission_mae,
                "transmission_corr": audit.transmission_corr,
            }
            for audit in audits
        },
        "overlap_share": {
            name: _overlap_share(view) for name, view in zip(names, lengths, strict=True)
        },
        "priorities": {part.name: part.priority for part in capture.parts},
        "notes": capture.notes,
    }
    cleaned: dict[str, Any] = plain(meta)  # a part that no ray meets has no standard deviation
    return cleaned


def _model_used(capture: Capture, settings: BuildSettings) -> str:
    """``paper``, ``poly``, ``mono`` or, without a known source, ``attenuation``."""
    if settings.model == "paper" or capture.tube is None:
        return settings.model if capture.tube is not None else "attenuation"
    return "mono" if capture.tube.kv is None else "poly"


def _overlap_share(lengths: PathLengths) -> float:
    """Share of the way through the object that two or more annotated parts claim."""
    total = float(lengths.lengths_cm.sum(dtype=np.float64)) / lengths.lengths_cm.shape[1]
    return float(lengths.shared_cm.sum(dtype=np.float64)) / total if total else 0.0
