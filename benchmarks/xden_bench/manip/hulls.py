"""Convex pieces of a surface for contact, made once and kept by what they are made of."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh
from jaxtyping import Float

from xden1k.errors import require
from xden1k.values.arrays import Points
from xden_bench.manip.arrays import pack_meshes, read_arrays, unpack_meshes, write_arrays
from xden_bench.manip.protocol import HullRules

__all__ = ["contact_error_cm", "content_key", "hulls_of", "volume_error"]

FLAT: Final = 1e-6
"""Of the whole volume: a piece of less is none."""
VERSION: Final = "vhacdx 0.1"
"""Of the code that makes hulls: another is another key."""


def hulls_of(
    surface: trimesh.Trimesh, rules: HullRules, cache: Path
) -> tuple[trimesh.Trimesh, ...]:
    """Cover the inside of a closed surface with convex meshes, by V-HACD.

    Parameters
    ----------
    surface
        cm.
    rules
        How many.
    cache
        Folder in which they are kept, by :func:`content_key`.

    Raises
    ------
    MissingExtraError
        If vhacdx or manifold3d is not installed.
    """
    path = cache / f"{content_key(surface, rules)}.npz"
    if path.is_file():
        return unpack_meshes(read_arrays(path), "hulls")
    made = _decomposed(surface, rules.max_hulls)
    cache.mkdir(parents=True, exist_ok=True)
    write_arrays(path, pack_meshes(made, "hulls"))
    return made


def _decomposed(surface: trimesh.Trimesh, max_hulls: int) -> tuple[trimesh.Trimesh, ...]:
    """Run V-HACD; pieces without volume, of which there are some, can be left out."""
    vhacdx = require("vhacdx", "sim")
    faces = np.asarray(surface.faces, dtype=np.uint32)
    made = vhacdx.compute_vhacd(
        np.asarray(surface.vertices, dtype=np.float64),
        np.column_stack([np.full(len(faces), 3, dtype=np.uint32), faces]).ravel(),
        maxConvexHulls=max_hulls,
        asyncACD=False,
    )
    solids = [_hull(vertices) for vertices, _ in made]
    least_cm3 = FLAT * abs(float(surface.volume))
    meshes = [solid.to_mesh64() for solid in solids if solid.volume() > least_cm3]
    return tuple(
        trimesh.Trimesh(mesh.vert_properties, mesh.tri_verts, process=False) for mesh in meshes
    )


def _hull(vertices_cm: Points) -> Any:
    """Convex hull as a solid of manifold3d, empty where the points are in one plane."""
    return require("manifold3d", "build").Manifold.hull_points(np.asarray(vertices_cm))


def content_key(surface: trimesh.Trimesh, rules: HullRules) -> str:
    """Name of the hulls of a surface: a checksum of its arrays and of all that makes them."""
    digest = hashlib.sha256(repr((VERSION, asdict(rules))).encode())
    digest.update(np.ascontiguousarray(surface.vertices, dtype="<f8").tobytes())
    digest.update(np.ascontiguousarray(surface.faces, dtype="<i8").tobytes())
    return digest.hexdigest()


def volume_error(hulls: Sequence[trimesh.Trimesh], volume_cm3: float) -> float:
    """Relative difference between the union of hulls and a volume.

    Raises
    ------
    MissingExtraError
        If manifold3d, which joins them, is not installed.
    """
    manifold3d = require("manifold3d", "build")
    solids = [_hull(hull.vertices) for hull in hulls]
    union = manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add)
    return abs(float(union.volume()) / volume_cm3 - 1)


def contact_error_cm(
    hulls: Sequence[trimesh.Trimesh], points_cm: Points
) -> Float[np.ndarray, "points"]:
    """Measure how far points of the surface are from that of the union of hulls, cm.

    A point inside some hulls is as deep as in the one that holds it deepest; another is as far
    off as the nearest.
    """
    depths = [_depth_cm(hull, points_cm) for hull in hulls]
    errors: Float[np.ndarray, "points"] = np.abs(np.max(depths, axis=0))
    return errors


def _depth_cm(hull: trimesh.Trimesh, points_cm: Points) -> Float[np.ndarray, "points"]:
    """Least distance to a face's plane: inside a hull its depth, outside less than minus none."""
    planes = np.einsum("ij,ij->i", hull.face_normals, hull.triangles[:, 0])
    depths: Float[np.ndarray, "points"] = np.min(planes - points_cm @ hull.face_normals.T, axis=1)
    return depths
