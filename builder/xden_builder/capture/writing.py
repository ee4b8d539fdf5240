"""Files of a capture folder, as simulators, and what puts meshes right, write them."""

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
from xden1k.values.ply import CM_PER_UNIT, write_ply

__all__ = ["write_image", "write_json", "write_parts", "write_table"]


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


def write_parts(folder: Path, meshes: Mapping[str, trimesh.Trimesh], units: str) -> None:
    """Write ``parts/NAME.ply`` of meshes in cm, in the units of ``objects.csv``."""
    (folder / "parts").mkdir(parents=True)
    scale = np.diag([1 / CM_PER_UNIT[units]] * 3 + [1.0])
    for name, mesh in meshes.items():
        write_ply(folder / "parts" / f"{name}.ply", mesh.copy().apply_transform(scale), units)
