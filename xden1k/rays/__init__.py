"""Rays through part meshes: exact path lengths, who owns what, cuts, and voxels.

Needs the extra ``build``.
"""

from xden1k.rays.disjoint import disjoint_path_lengths
from xden1k.rays.grids import (
    COLUMN_SAMPLES,
    THINNER_THAN_LABELS,
    ObjectGrids,
    column_samples,
    object_grids,
)
from xden1k.rays.lengths import PathLengths, path_lengths
from xden1k.rays.priority import ownership_order
from xden1k.rays.regions import disjoint_regions, half_beyond, outer_surface, sealed
from xden1k.rays.reprojection import reprojected
from xden1k.rays.solids import field_solid, label_solids
from xden1k.rays.voxels import (
    CUBE_MARGIN,
    CubeGrid,
    PartFill,
    density_grid,
    fill_grid,
    object_cube,
    part_fractions,
    voxel_labels,
)

__all__ = [
    "COLUMN_SAMPLES",
    "CUBE_MARGIN",
    "THINNER_THAN_LABELS",
    "CubeGrid",
    "ObjectGrids",
    "PartFill",
    "PathLengths",
    "column_samples",
    "density_grid",
    "disjoint_path_lengths",
    "disjoint_regions",
    "field_solid",
    "fill_grid",
    "half_beyond",
    "label_solids",
    "object_cube",
    "object_grids",
    "outer_surface",
    "ownership_order",
    "part_fractions",
    "path_lengths",
    "reprojected",
    "sealed",
    "voxel_labels",
]
