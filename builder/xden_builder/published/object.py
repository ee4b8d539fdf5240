"""One published object into one density object."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import trimesh
from jaxtyping import Float64
from scipy.spatial import cKDTree

from xden1k.rays import THINNER_THAN_LABELS, ObjectGrids, object_grids
from xden1k.values.physics import apparent_density_g_cm3
from xden1k.values.types import DensityObject, Part, Split
from xden_builder.published.copies import copies
from xden_builder.published.density import PartEstimate, estimate
from xden_builder.published.fill import fill_mesh
from xden_builder.published.given import PublishedObject
from xden_builder.published.labels import LabelVolume, label_volume
from xden_builder.published.register import UPRIGHT, Registration, register
from xden_builder.published.release_fit import ReleaseFit, part_rays
from xden_builder.published.shares import volume_shares
from xden_builder.published.solids import part_solids, thickness_voxels
from xden_builder.published.survey import PartSeen, parts_seen

__all__ = ["correlation", "import_object", "mass_sd_g"]

THIN: Final = 1.5
"""Voxels: the volume of a part that is thinner is uncertain by a tenth and more."""
MOST_GUESSED: Final = 0.2
"""Share of a part's volume that may be guessed."""
IN_COMMON: Final = 0.1
"""Correlation of the errors of an object's parts, which lie in the same radiographs: 0.06 to 0.17
in simulated releases."""
COLOUR_SAMPLES: Final = 4000
"""Vertices of the mesh whose colour is looked at."""
GREY: Final = (0.7, 0.7, 0.7)

Colour = tuple[float, float, float]


def import_object(given: PublishedObject, fit: ReleaseFit, split: Split) -> DensityObject:
    """Register an object, mesh its parts, and give them densities.

    Parameters
    ----------
    given
        As published.
    fit
        Of :func:`xden_builder.published.release_fit.fit_release`, over the whole release.
    split
        That it belongs to.

    Returns
    -------
    DensityObject
        Without radiographs. ``apparent_density`` is the published figure, ``density`` ours.

    Raises
    ------
    DataError
        If mesh or volume show nothing, are not of one object, or no part is left.
    """
    volume = label_volume(given.lac_per_cm, given.table_lac_per_cm)
    bodies = fill_mesh(given.mesh), volume_shares(volume)
    placed = register(*bodies, given.size_cm, fit.convention, volume.longest)
    solids = part_solids(volume, placed.affine)
    seen = parts_seen(volume, given.category)
    alike = copies(seen)
    estimates = _estimates(seen, alike, placed, fit)
    shown = [place for place, solid in enumerate(solids.parts) if solid is not None]
    meshes = [solid for solid in solids.parts if solid is not None]
    grids = object_grids(meshes, range(len(meshes)), outer=solids.outer)
    colours = _colours(given, placed, meshes)
    thin = thickness_voxels(volume) < THIN
    guessed = volume.guessed_voxels > MOST_GUESSED * volume.filled_voxels
    parts = tuple(
        _part(
            volume,
            place,
            mesh,
            estimates[place],
            colour,
            _shape_flags(thin=bool(thin[place] or too_thin), guessed=bool(guessed[place])),
        )
        for place, mesh, colour, too_thin in zip(
            shown, meshes, colours, grids.thin(meshes), strict=True
        )
    )
    lost = [*volume.lost, *(volume.names[k] for k in range(len(estimates)) if k not in shown)]
    return DensityObject(
        object_id=given.object_id,
        category=given.category,
        split=split,
        source="published",
        views=(),
        parts=parts,
        labels=grids.labels,
        occupancy=grids.occupancy,
        envelope=grids.envelope,
        density=grids.density([part.density_g_cm3 for part in parts]),
        apparent_density=grids.density([part.apparent_density_g_cm3 for part in parts]),
        origin_cm=grids.field.origin_cm,
        voxel_size_cm=grids.field.voxel_size_cm,
        flags=_object_flags(volume, placed, grids, lost),
        meta={
            **_meta(given, placed, fit, lost, estimates),
            "uncertainty": {
                "mass_sd_g": mass_sd_g(parts, correlation(alike)[np.ix_(shown, shown)])
            },
        },
    )


def _estimates(
    parts: Sequence[PartSeen],
    alike: Sequence[Sequence[int]],
    placed: Registration,
    fit: ReleaseFit,
) -> list[PartEstimate]:
    """Weigh the materials of every part."""
    sides, beams = np.linalg.norm(placed.affine[:3, :3], axis=0), fit.beam.likely
    seen = [(part.lac_per_cm, part_rays(part, sides, fit.beam.beam.axes)) for part in parts]
    return [
        estimate(
            lac_per_cm, part.name, rays, beams, [seen[place] for place in others], part.category
        )
        for part, (lac_per_cm, rays), others in zip(parts, seen, alike, strict=True)
    ]


def _part(
    volume: LabelVolume,
    place: int,
    mesh: trimesh.Trimesh,
    found: PartEstimate,
    colour: Colour,
    shape_flags: tuple[str, ...],
) -> Part:
    lac = float(volume.lac_per_cm[place])
    return Part(
        name=volume.names[place],
        mesh=mesh,
        material=found.material,
        lac_per_cm=lac,
        apparent_density_g_cm3=apparent_density_g_cm3(lac),
        density_g_cm3=found.density_g_cm3,
        density_sd_g_cm3=found.sd_g_cm3,
        density_source=found.source,
        flags=(*found.flags, *shape_flags),
        color_rgb=colour,
    )


def _shape_flags(*, thin: bool, guessed: bool) -> tuple[str, ...]:
    raised = {"thin": thin, "voxels_guessed": guessed}
    return tuple(flag for flag, is_raised in raised.items() if is_raised)


def _colours(
    given: PublishedObject, placed: Registration, meshes: list[trimesh.Trimesh]
) -> list[Colour]:
    """Mean texture of the vertices nearest to each part; grey for what lies inside."""
    if given.colors_rgb is None:
        return [GREY] * len(meshes)
    every = max(1, len(given.mesh.vertices) // COLOUR_SAMPLES)
    points = placed.meta["cm_per_unit"] * np.asarray(given.mesh.vertices)[::every] @ UPRIGHT.T
    tree = cKDTree(np.concatenate([mesh.vertices for mesh in meshes]))
    owner = np.repeat(np.arange(len(meshes)), [len(mesh.vertices) for mesh in meshes])
    nearest = owner[tree.query(points)[1]]
    colours = given.colors_rgb[::every]
    return [
        _mean_colour(colours[nearest == part]) if (nearest == part).any() else GREY
        for part in range(len(meshes))
    ]


def _mean_colour(colours: np.ndarray) -> Colour:
    red, green, blue = colours.mean(axis=0).clip(0, 1).round(4).tolist()
    return red, green, blue


def _object_flags(
    volume: LabelVolume, placed: Registration, grids: ObjectGrids, lost: list[str]
) -> tuple[str, ...]:
    raised = {
        "lost_parts": bool(lost),
        THINNER_THAN_LABELS: not grids.labels.any(),
        "no_radiographs": True,
    }
    return (
        *placed.flags,
        *volume.flags,
        *(flag for flag, is_raised in raised.items() if is_raised),
    )


def correlation(alike: Sequence[Sequence[int]]) -> Float64[np.ndarray, "k k"]:
    """Correlation of the errors of parts: copies are of one material, and err together.

    Examples
    --------
    >>> correlation([[1], [0], []]).tolist()
    [[1.0, 1.0, 0.1], [1.0, 1.0, 0.1], [0.1, 0.1, 1.0]]
    """
    values = np.full((len(alike), len(alike)), IN_COMMON)
    np.fill_diagonal(values, 1.0)
    for place, others in enumerate(alike):
        values[place, list(others)] = 1.0
    return values


def mass_sd_g(parts: Sequence[Part], correlated: Float64[np.ndarray, "k k"]) -> float:
    """Return the standard deviation of the mass of parts whose errors correlate."""
    each = np.array([part.mesh.volume * part.density_sd_g_cm3 for part in parts])
    return math.sqrt(float(each @ correlated @ each))


def _meta(
    given: PublishedObject,
    placed: Registration,
    fit: ReleaseFit,
    lost: list[str],
    estimates: list[PartEstimate],
) -> dict[str, Any]:
    return {
        "published": dict(given.meta),
        "registration": placed.meta,
        "fit": fit.to_json(),
        "lost_parts": lost,
        "likeliest_materials": [dict(found.likeliest) for found in estimates],
    }
