"""Meshes as flat arrays, and arrays as an ``.npz`` that is the same bytes each time."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import trimesh

__all__ = ["pack_meshes", "read_arrays", "unpack_meshes", "write_arrays"]


def pack_meshes(meshes: Sequence[trimesh.Trimesh], name: str) -> dict[str, np.ndarray]:
    """Join meshes into arrays: vertices, faces, and how many of each a mesh has."""
    counts = [[len(mesh.vertices), len(mesh.faces)] for mesh in meshes]
    return {
        f"{name}_vertices_cm": np.concatenate([np.asarray(mesh.vertices) for mesh in meshes]),
        f"{name}_faces": np.concatenate([np.asarray(mesh.faces) for mesh in meshes]),
        f"{name}_counts": np.array(counts),
    }


def unpack_meshes(arrays: Mapping[str, np.ndarray], name: str) -> tuple[trimesh.Trimesh, ...]:
    """Return the meshes that :func:`pack_meshes` joined.

    Examples
    --------
    >>> boxes = [trimesh.creation.box((1, 1, edge)) for edge in (1, 2)]
    >>> [float(mesh.volume) for mesh in unpack_meshes(pack_meshes(boxes, "box"), "box")]
    [1.0, 2.0]
    """
    ends = np.cumsum(arrays[f"{name}_counts"], axis=0)[:-1]
    vertices = np.split(arrays[f"{name}_vertices_cm"], ends[:, 0])
    faces = np.split(arrays[f"{name}_faces"], ends[:, 1])
    return tuple(
        trimesh.Trimesh(*pair, process=False) for pair in zip(vertices, faces, strict=True)
    )


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays whole or not at all, and equal ones as equal bytes."""
    new = path.with_name(f".{path.name}.{os.getpid()}.new")
    with new.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)
    new.replace(path)


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """Read them."""
    with np.load(path, allow_pickle=False) as archive:
        return dict(archive)
