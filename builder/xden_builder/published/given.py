"""What a folder of the release gives of one object, before anything is made of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float32, Float64

from xden1k.errors import DataError

__all__ = ["PublishedObject"]

DIMENSIONS = 3


@dataclass(frozen=True, slots=True, eq=False)
class PublishedObject:
    """One object as published.

    Parameters
    ----------
    object_id
        Name that it gets in the dataset, such as ``xden1k-0004``.
    category
        Lower snake case.
    mesh
        Surface in the mesh file's own frame and unit, y up; as a rule not closed.
    colors_rgb
        Shape (vertices, 3), 0 to 1: colour of the texture at each vertex; None without one.
    lac_per_cm
        Shape (x, y, z): attenuation coefficient of each voxel, 1/cm; any size.
    table_lac_per_cm
        Attenuation coefficient of each part, 1/cm, in the table's order; empty without a table.
    size_cm
        Shape (3,): sides of the bounding box, in the release's own order.
    meta
        Where it comes from: identity, checksums, commit; of JSON's types.

    Raises
    ------
    DataError
        If the volume is not three-dimensional, the mesh is empty or a size is not positive.
    """

    object_id: str
    category: str
    mesh: trimesh.Trimesh
    colors_rgb: Float64[np.ndarray, "vertices 3"] | None
    lac_per_cm: Float32[np.ndarray, "x y z"]
    table_lac_per_cm: Mapping[str, float]
    size_cm: Float64[np.ndarray, "3"]
    meta: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.lac_per_cm.ndim != DIMENSIONS:
            raise DataError(
                f"{self.object_id}: volume: expected 3 dimensions, got {self.lac_per_cm.ndim}"
            )
        if not len(self.mesh.faces):
            raise DataError(f"{self.object_id}: mesh: expected faces, got none")
        if not (self.size_cm > 0).all():
            raise DataError(f"{self.object_id}: size must be positive, got {self.size_cm.tolist()}")
