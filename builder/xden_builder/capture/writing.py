"""Files of a capture folder, as simulators write them."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from jaxtyping import UInt16

from xden1k.errors import require
from xden1k.values.arrays import Image

__all__ = ["write_image", "write_json", "write_ply", "write_table"]


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


def write_image(path: Path, image: UInt16[np.ndarray, "rows columns"] | Image) -> None:
    """Write a TIFF: counts, or transmission."""
    require("tifffile", "build").imwrite(path, image, compression="zlib", metadata=None)


def write_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write values of JSON's types, to be read by people too."""
    path.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")


def write_table(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Write a CSV table."""
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([header, *rows])
