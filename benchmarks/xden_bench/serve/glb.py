"""Part meshes coloured by a value, as binary glTF for the 3D view. Needs the extra ``view``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import trimesh
from jaxtyping import Float, UInt8
from matplotlib.cm import ScalarMappable
from scipy.ndimage import map_coordinates

from xden1k.export.glb import write_nodes
from xden1k.values.arrays import Grid, Vec3
from xden1k.values.types import Part

__all__ = [
    "cut_open",
    "part_values",
    "refined",
    "surface_values",
    "vertex_colours",
    "write_glb",
]

LONGEST_EDGE_VOXELS: Final = 3.0
"""Triangles that show a field are cut until no edge is longer, lest their corners speak for all."""
SHARP: Final = np.radians(30)
"""Facets that meet at a larger angle are shaded as an edge."""

PartQuantity = Literal["density_g_cm3", "density_sd_g_cm3"]


def cut_open(meshes: Sequence[trimesh.Trimesh], y_cm: float) -> list[trimesh.Trimesh]:
    """Take away the half of closed meshes in front of a plane of constant y, and close the cut.

    Parts that lie in front of it wholly come back empty. Needs the extra ``build``.
    """
    from xden1k.rays import half_beyond

    return [half_beyond(mesh, np.array([0.0, 1.0, 0.0]), y_cm) for mesh in meshes]


def part_values(parts: Sequence[Part], quantity: PartQuantity) -> Float[np.ndarray, "parts"]:
    """One value for each part; nan where it is unknown."""
    return np.array([getattr(part, quantity) for part in parts], dtype=np.float64)


def refined(mesh: trimesh.Trimesh, voxel_size_cm: float) -> trimesh.Trimesh:
    """Cut triangles up until none is longer than three voxels."""
    if not len(mesh.faces):
        return mesh
    vertices, faces = trimesh.remesh.subdivide_to_size(  # type: ignore[no-untyped-call]
        mesh.vertices, mesh.faces, LONGEST_EDGE_VOXELS * voxel_size_cm, max_iter=12
    )
    return trimesh.Trimesh(vertices, faces)


def surface_values(
    mesh: trimesh.Trimesh, field: Grid, origin_cm: Vec3, voxel_size_cm: float
) -> Float[np.ndarray, "vertices"]:
    """Values of a voxel field half a voxel below a surface, one for each vertex.

    Parameters
    ----------
    mesh
        cm, outward-wound.
    field
        Shape (x, y, z).
    origin_cm
        Shape (3,): centre of voxel (0, 0, 0).
    voxel_size_cm
        Edge of a voxel.

    Examples
    --------
    >>> box = trimesh.creation.box((2, 2, 2))
    >>> values = surface_values(box, np.full((4, 4, 4), 3.0), np.full(3, -1.5), 1.0)
    >>> values.round(6).tolist()
    [3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0]
    """
    below = mesh.vertices - 0.5 * voxel_size_cm * mesh.vertex_normals
    places = (below - origin_cm) / voxel_size_cm
    values: Float[np.ndarray, "vertices"] = map_coordinates(
        np.asarray(field, dtype=np.float64), places.T, order=1, mode="nearest"
    )
    return values


def vertex_colours(
    values: Float[np.ndarray, "vertices"], scale: ScalarMappable
) -> UInt8[np.ndarray, "vertices 4"]:
    """Colours of a scale as glTF wants them: linear light, where pictures hold sRGB."""
    rgba = scale.to_rgba(np.ma.masked_invalid(values))
    rgb = rgba[:, :3]
    rgba[:, :3] = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.rint(255 * rgba), dtype=np.uint8)


def write_glb(
    path: Path,
    parts: Sequence[Part],
    meshes: Sequence[trimesh.Trimesh],
    colours: Sequence[UInt8[np.ndarray, "_ 4"]],
) -> None:
    """Write one node for each part that has faces, of its name.

    Parameters
    ----------
    path
        The ``.glb``.
    parts
        Named.
    meshes
        Their shapes, cm, object frame.
    colours
        From :func:`vertex_colours`, one array for each mesh.
    """
    shown = {}
    for part, mesh, rgba in zip(parts, meshes, colours, strict=True):
        if len(mesh.faces):
            bare = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False, vertex_colors=rgba)
            shown[part.name] = trimesh.graph.smooth_shade(bare, angle=SHARP)
    write_nodes(path, shown, normals=True, finish=_matt)


def _matt(tree: dict[str, Any]) -> None:
    """Give every surface a material without gloss: glTF's default is a mirror of metal."""
    surface = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
    tree["materials"] = [{"pbrMetallicRoughness": surface, "doubleSided": True}]
    for mesh in tree["meshes"]:
        for primitive in mesh["primitives"]:
            primitive["material"] = 0
