"""The truth that segments are compared with: the points of an object, and who owns them.

Needs the extra ``build``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import UInt8

from xden1k.errors import DataError, about, of_dataset
from xden1k.format.records import split_meshes
from xden1k.format.shards import Row
from xden1k.rays import CubeGrid, outer_surface
from xden1k.segmentation import SegmentPoints, material_regions
from xden1k.segmentation.points import draw_points, point_owners, segment_grid
from xden_bench.scoring.protocol import SegmentProtocol
from xden_bench.scoring.reference import Reference, private_refusal

__all__ = ["DrawnObject", "Regions", "SegmentReference"]


@dataclass(frozen=True, slots=True, eq=False)
class Regions:
    """The truth of one object.

    Parameters
    ----------
    materials, parts
        Shape (points,): material region of each point; part that owns it, 0 = void.
    """

    materials: UInt8[np.ndarray, "points"]
    parts: UInt8[np.ndarray, "points"]


@dataclass(frozen=True, slots=True, eq=False)
class DrawnObject:
    """One object and the points where it is asked.

    Parameters
    ----------
    row
        Of the dataset.
    meshes
        Its parts, cm.
    grid
        At whose voxel centres points lie.
    extent_cm
        Longest edge of the bounding box of the outer surface.
    points
        In the outer surface.
    where
        Dataset and object, for messages.
    """

    row: Row
    meshes: Sequence[trimesh.Trimesh]
    grid: CubeGrid
    extent_cm: float
    points: SegmentPoints
    where: str

    @property
    def densities_g_cm3(self) -> list[float]:
        """Density of void and of each part.

        Raises
        ------
        DataError
            If only the attenuation of a part is known.
        """
        names, densities = self.row["part_names"], self.row["part_density_g_cm3"]
        for name, density in zip(names, densities, strict=True):
            if density is None or np.isnan(density):
                raise DataError(
                    f"{self.where}: the part {name} must have a density, for its "
                    "material region; only its attenuation is known"
                )
        return [0.0, *densities]

    def regions(self, gap_g_cm3: float) -> Regions:
        """Find the regions of the points; a gap between densities is larger than this.

        Raises
        ------
        DataError
            If a part has no density.
        """
        owners = point_owners(self.meshes, self.grid, self.points)
        return Regions(material_regions(self.densities_g_cm3, gap_g_cm3)[owners], owners)


@dataclass(frozen=True, eq=False)
class SegmentReference(Reference):
    """One split of a dataset folder as the truth of segments.

    Parameters
    ----------
    folder, split
        As in :class:`xden_bench.scoring.reference.Reference`.
    rules
        Which points are asked for, and what a region is.

    Raises
    ------
    DataError
        If the folder has no such split, or it is ``private``.
    """

    rules: SegmentProtocol

    def __post_init__(self) -> None:
        if refusal := private_refusal(self.split):
            raise DataError(f"{self.folder.root}: {refusal}")
        Reference.__post_init__(self)

    def drawn(self, object_id: str) -> DrawnObject:
        """Draw the points of an object.

        Raises
        ------
        DataError
            If its outer surface is not closed.
        """
        row = self._row(object_id, _COLUMNS)
        grid = segment_grid(np.array(row["grid_origin_cm"]), row["voxel_size_cm"])
        with of_dataset(self.folder.root), about(object_id):
            meshes = split_meshes(row)
            outer = outer_surface(meshes)
            points = draw_points(outer, grid, object_id, self.rules.points_seed)
        where = f"{self.folder.root}: {object_id}"
        return DrawnObject(row, meshes, grid, float(outer.extents.max()), points, where)


_COLUMNS = (
    "object_id",
    "category",
    "source",
    "grid_origin_cm",
    "voxel_size_cm",
    "part_names",
    "part_density_g_cm3",
    "mesh_vertices",
    "mesh_faces",
    "face_part",
)
