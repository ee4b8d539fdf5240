"""The surface of an object, with the colours of its texture."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh
from jaxtyping import Float64

from xden1k.errors import DataError
from xden_builder.capture.damage import decoding

__all__ = ["read_mesh"]

COMPRESSIONS: Final = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")
"""Extensions of glTF that trimesh does not decode."""
GLB_MAGIC: Final = b"glTF"
GLB_HEAD: Final = struct.Struct("<4sIIII")
"""Magic, version, length; length and type of the first chunk, which is the JSON."""
MOST: Final = 255.0

Colors = Float64[np.ndarray, "vertices 3"]


def read_mesh(path: Path) -> tuple[trimesh.Trimesh, Colors | None]:
    """Read all geometries of a file as one mesh, in the file's frame and unit.

    Returns
    -------
    mesh
        Vertices as they stand in the file, which seams of a texture split.
    colors_rgb
        Colour of the texture at each vertex, 0 to 1; None where a geometry has none.

    Raises
    ------
    DataError
        If it is damaged, compressed, holds no face, or a vertex that is not finite.
    """
    _refuse_compressed(path)
    with decoding(path, "a mesh"):
        scene = trimesh.load_scene(path)
        pieces = [piece for piece in scene.dump() if isinstance(piece, trimesh.Trimesh)]
    pieces = [piece for piece in pieces if len(piece.faces)]
    if not pieces:
        raise DataError(f"{path}: expected a mesh with faces, got none")
    mesh = _joined(pieces)
    if not np.isfinite(mesh.vertices).all():
        raise DataError(f"{path}: expected finite vertices, got some that are not")
    with decoding(path, "a mesh with a texture"):
        colors = [_colors(piece) for piece in pieces]
    known = [each for each in colors if each is not None]
    return mesh, np.concatenate(known) if len(known) == len(colors) else None


def _joined(pieces: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    starts = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])
    faces = [piece.faces + start for piece, start in zip(pieces, starts, strict=False)]
    vertices = np.concatenate([piece.vertices for piece in pieces])
    return trimesh.Trimesh(vertices, np.concatenate(faces), process=False)


def _colors(piece: trimesh.Trimesh) -> Colors | None:
    """Look the colour of each vertex up; None for a surface that says nothing of it."""
    visual: Any = piece.visual
    if not visual.defined:
        return None
    visual = visual.to_color() if visual.kind == "texture" else visual
    return np.asarray(visual.vertex_colors[:, :3] / MOST)


def _refuse_compressed(path: Path) -> None:
    used = {"extensionsRequired": []} if path.suffix.lower() != ".glb" else _gltf(path)
    for name in COMPRESSIONS:
        if name in used.get("extensionsRequired", []):
            raise DataError(
                f"{path}: expected a mesh without compression, got {name}: unpack it by "
                "`gltf-transform copy IN.glb OUT.glb`"
            )


def _gltf(path: Path) -> dict[str, Any]:
    """Read the JSON of a binary glTF file."""
    with decoding(path, "a binary glTF mesh"), path.open("rb") as file:
        head = file.read(GLB_HEAD.size)
        if not head.startswith(GLB_MAGIC):
            begin = head[: len(GLB_MAGIC)]
            raise DataError(f"{path}: expected a binary glTF mesh, got one that begins {begin!r}")
        *_, length, _ = GLB_HEAD.unpack(head)
        values: dict[str, Any] = json.loads(file.read(length))
        return values
