"""Part meshes as PLY files, as capture folders hold them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np
import trimesh

__all__ = ["CM_PER_UNIT", "write_ply"]

CM_PER_UNIT: Final[Mapping[str, float]] = MappingProxyType(
    {"cm": 1.0, "mm": 0.1, "m": 100.0, "in": 2.54}
)
"""The units a mesh may be in."""


def write_ply(path: Path, mesh: trimesh.Trimesh, units: str = "cm") -> None:
    """Write a mesh in double precision, which trimesh's own writer would round to single.

    Rounding each part by itself makes facets that should coincide cross each other.
    """
    faces = np.empty(len(mesh.faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    header = (
        f"ply\nformat binary_little_endian 1.0\ncomment {units}\n"
        f"element vertex {len(mesh.vertices)}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(header.encode() + mesh.vertices.astype("<f8").tobytes() + faces.tobytes())
