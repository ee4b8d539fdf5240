"""The mesh of an object: what can be seen of it, with the flaws of generated and scanned meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Bool, Int64
from scipy.spatial import cKDTree

from xden1k.rays import outer_surface
from xden_builder.phantoms.phantom import Phantom
from xden_builder.phantoms.shapes import from_mesh, to_mesh
from xden_builder.published.twin.conventions import Conventions
from xden_builder.published.twin.defects import Defects
from xden_builder.published.twin.pose import LONGEST, UPRIGHT, Pose
from xden_builder.published.twin.texture import Atlas, textured

__all__ = ["Surface", "flawed", "scene", "visible_surface"]

BOTTOM_HEIGHT: Final = 0.03
"""Faces that look down and lie within this share of the height are the bottom."""
STEEP: Final = 0.7
"""Least cosine between a bottom face's normal and straight down."""
PATCH: Final = 0.25
"""Radius of a flipped patch, as a share of the longest extent."""
DEEP: Final = 0.02
"""Faces farther from the outer surface, as a share of the longest extent, are inner ones."""
LEFT_OVER: Final = 0.3
"""Radius of the inner faces that are left in, as a share of the longest extent."""

FaceMask = Bool[np.ndarray, "faces"]


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Triangles in the coordinates of the mesh file, and which part shows at each.

    Parameters
    ----------
    mesh
        Vertices shared between faces.
    part
        Index of a part, for each face.
    """

    mesh: trimesh.Trimesh
    part: Int64[np.ndarray, "faces"]

    def kept(self, mask: FaceMask) -> Surface:
        """Return some of the faces."""
        mesh = self.mesh.copy()
        mesh.update_faces(mask)
        mesh.remove_unreferenced_vertices()
        return Surface(mesh, self.part[mask])


def visible_surface(
    phantom: Phantom, pose: Pose, conventions: Conventions
) -> tuple[Surface, Surface]:
    """Return the outer surface of a phantom, and what lies inside of it.

    Parameters
    ----------
    phantom
        The object.
    pose
        Its place in the mesh file.
    conventions
        How fine the triangles are.
    """
    parts = [_refined(part.mesh, pose, conventions) for part in phantom.parts]
    outer = _refined(outer_surface([part.mesh for part in phantom.parts]), pose, conventions)
    of_part = cKDTree(np.concatenate([part.triangles_center for part in parts]))
    owner = np.repeat(np.arange(len(parts)), [len(part.faces) for part in parts])
    every = Surface(_concatenated(parts), owner)
    depth, _ = cKDTree(outer.triangles_center).query(every.mesh.triangles_center)
    _, nearest = of_part.query(outer.triangles_center)
    return Surface(outer, owner[nearest]), every.kept(depth > DEEP * LONGEST)


def _refined(mesh: trimesh.Trimesh, pose: Pose, conventions: Conventions) -> trimesh.Trimesh:
    solid = from_mesh(mesh.copy().apply_transform(pose.mesh))
    if conventions.tolerance:
        solid = solid.simplify(conventions.tolerance * LONGEST)
    return to_mesh(solid.refine_to_length(conventions.facet * LONGEST))


def flawed(outer: Surface, inner: Surface, defects: Defects, rng: np.random.Generator) -> Surface:
    """Do to a surface what was drawn for it."""
    mesh = outer.mesh
    seen = rng.random(len(mesh.faces)) >= defects.dropped_share
    if defects.open_bottom:
        seen &= ~_bottom(mesh)
    whole = outer.kept(seen)
    if defects.inner_faces and len(inner.mesh.faces):
        whole = _joined(whole, inner.kept(_patch(inner.mesh, LEFT_OVER, rng)))
    if defects.flipped:
        turned = _patch(whole.mesh, PATCH, rng)
        whole.mesh.faces[turned] = whole.mesh.faces[turned][:, ::-1]
    return whole


def _bottom(mesh: trimesh.Trimesh) -> FaceMask:
    down = mesh.face_normals @ -UPRIGHT[:, 2]
    height = mesh.triangles_center @ UPRIGHT[:, 2]
    low, high = mesh.bounds @ UPRIGHT[:, 2]
    return np.asarray((down > STEEP) & (height < low + BOTTOM_HEIGHT * (high - low)))


def _patch(mesh: trimesh.Trimesh, radius: float, rng: np.random.Generator) -> FaceMask:
    """Choose the faces around one of them."""
    centres = mesh.triangles_center
    middle = centres[rng.integers(len(centres))]
    return np.asarray(np.linalg.norm(centres - middle, axis=1) < radius * LONGEST)


def _joined(one: Surface, other: Surface) -> Surface:
    parts = np.concatenate([one.part, other.part])
    return Surface(_concatenated([one.mesh, other.mesh]), parts)


def _concatenated(meshes: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    return trimesh.Trimesh(vertices, np.concatenate(faces), process=False)


def scene(
    surface: Surface, phantom: Phantom, defects: Defects, chart_px: int, rng: np.random.Generator
) -> trimesh.Scene:
    """Dress a surface: one geometry, or one for each material."""
    atlas = Atlas([part.color_rgb for part in phantom.parts], chart_px)
    image, made = atlas.image(rng), trimesh.Scene()
    for number, mask in enumerate(_divided(surface, phantom, defects)):
        piece = surface.kept(mask)
        shown = textured(piece.mesh, piece.part, atlas, image)
        made.add_geometry(shown, geom_name=f"geometry_{number}")
    return made


def _divided(surface: Surface, phantom: Phantom, defects: Defects) -> list[FaceMask]:
    names = np.array([part.material for part in phantom.parts])[surface.part]
    if not defects.by_material:
        return [np.ones(len(names), dtype=np.bool_)]
    return [names == name for name in np.unique(names)]
