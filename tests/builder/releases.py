"""Releases to import: a copy of the tiny twin, and ways to damage one object of it."""

from __future__ import annotations

import gzip
import json
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import trimesh

TWIN = Path(__file__).parents[1] / "data" / "twin-tiny"
VOLUME = "optimized_lac.nii.gz"
TABLE = "part_lac_density.json"


def copied(to: Path) -> Path:
    """Return a copy of the tiny twin, of six objects, ``0`` to ``5``."""
    return Path(shutil.copytree(TWIN, to / "release"))


def edited(file: Path, change: Callable[[Any], Any]) -> None:
    """Change what a JSON file says, in place or by what is returned."""
    values = json.loads(file.read_text())
    file.write_text(json.dumps(change(values) or values))


def metadata(release: Path, change: Callable[[Any], Any]) -> None:
    edited(release / "dataset" / "metadata.json", change)


def table(release: Path, number: int, change: Callable[[Any], Any]) -> None:
    edited(release / "dataset" / str(number) / TABLE, change)


def volume(release: Path, number: int) -> np.ndarray:
    path = release / "dataset" / str(number) / VOLUME
    return np.asarray(nibabel.load(path).dataobj, dtype=np.float32)


def save_volume(release: Path, number: int, values: np.ndarray) -> None:
    image = nibabel.Nifti1Image(values, np.eye(4))
    nibabel.save(image, release / "dataset" / str(number) / VOLUME)


def cut_off(release: Path, number: int) -> None:
    """End a volume in the middle of its voxels."""
    path = release / "dataset" / str(number) / VOLUME
    path.write_bytes(gzip.compress(gzip.decompress(path.read_bytes())[:5000]))


def cut_off_file(release: Path, number: int) -> None:
    """End the compressed file itself."""
    path = release / "dataset" / str(number) / VOLUME
    path.write_bytes(path.read_bytes()[:2000])


def compressed(release: Path, number: int, extension: str) -> None:
    """Say in a mesh that it needs an extension."""
    path = release / "dataset" / str(number) / "mesh.glb"
    content = path.read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    tree = json.loads(content[20 : 20 + length]) | {"extensionsRequired": [extension]}
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack(
        "<4sIIII", b"glTF", 2, len(content) - length + len(text), len(text), 0x4E4F534A
    )
    path.write_bytes(head + text + content[20 + length :])


def without_faces(release: Path, number: int) -> None:
    """Leave an empty scene."""
    scene = trimesh.Scene([trimesh.PointCloud([[0.0, 0, 0], [1, 1, 1]])])
    (release / "dataset" / str(number) / "mesh.glb").write_bytes(scene.export(file_type="glb"))
