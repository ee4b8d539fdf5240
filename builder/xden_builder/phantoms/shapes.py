"""A small vocabulary of solids: lathed, extruded, joined and cut with manifold3d.

Lengths are centimetres. Solids are built along the z axis unless their name says otherwise.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import ceil, pi, sqrt

import numpy as np
import trimesh
from jaxtyping import Float, Int
from manifold3d import CrossSection, JoinType, Manifold, Mesh64

__all__ = [
    "along_x",
    "along_y",
    "around",
    "box",
    "capsule",
    "cut_above",
    "cylinder",
    "disc",
    "from_mesh",
    "inset",
    "lathe",
    "outline",
    "polygon",
    "regular_polygon",
    "rounded_box",
    "rounded_rectangle",
    "segments",
    "slab",
    "sphere",
    "thread",
    "to_mesh",
    "tube",
    "union",
    "upright",
    "upright_across",
    "without_splinters",
]

CHORD_TOLERANCE_CM = 0.004
"""A circle's polygon strays from it by at most this much: a tenth of a detector pixel."""

CRUMB_CM3 = 1e-5
"""Bodies and cavities smaller than this are no part of an object: a hundredth of a cubic
millimetre."""

SPLINTER_SHARE = 1e-4
"""Of a solid's largest body: smaller bodies and cavities are splinters that a long cut has left."""

OUTLINE_TOLERANCE_CM = 0.002
"""Corners of rounded outlines that matter less are left out."""

Profile = Sequence[tuple[float, float]]


def segments(radius_cm: float) -> int:
    """Corners of the polygon that stands for a circle: a multiple of 4, at least 12.

    Examples
    --------
    >>> segments(0.1), segments(4.0)
    (12, 72)
    """
    return max(12, 4 * ceil(pi / sqrt(2 * CHORD_TOLERANCE_CM / radius_cm) / 4))


# --- outlines in the plane ------------------------------------------------------------------------


def polygon(points: Profile, fillet_cm: float = 0.0) -> CrossSection:
    """Outline through points, in either sense, its corners rounded."""
    corners = np.array(points, dtype=np.float64)
    x, y = corners.T
    if x @ np.roll(y, -1) < y @ np.roll(x, -1):
        corners = corners[::-1]
    return _filleted(CrossSection([corners]), fillet_cm)


def outline(profile: Profile, fillet_cm: float = 0.0) -> CrossSection:
    """Outline to be lathed, through (radius, z) points, its corners rounded.

    It is mirrored at the axis first: fillets and insets then leave the axis alone.
    """
    half = polygon(profile)
    return _filleted(half + half.mirror((1.0, 0.0)), fillet_cm)


def disc(radius_cm: float, centre: tuple[float, float] = (0.0, 0.0)) -> CrossSection:
    """Circle."""
    return CrossSection.circle(radius_cm, segments(radius_cm)).translate(centre)


def regular_polygon(sides: int, across_flats_cm: float) -> CrossSection:
    """Hexagon and its like, a flat facing +y when the number of sides is even."""
    radius = across_flats_cm / 2 / np.cos(pi / sides)
    angles = 2 * pi * (np.arange(sides) + 0.5) / sides + pi / 2
    return CrossSection([radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)])


def rounded_rectangle(width_cm: float, depth_cm: float, corner_cm: float) -> CrossSection:
    """Rectangle centred on the origin with rounded corners."""
    inner = CrossSection.square((width_cm - 2 * corner_cm, depth_cm - 2 * corner_cm), center=True)
    return _offset(inner, corner_cm)


def inset(section: CrossSection, wall_cm: float) -> CrossSection:
    """Outline of the cavity behind a wall of even thickness."""
    return _offset(section, -wall_cm)


def _offset(section: CrossSection, delta_cm: float) -> CrossSection:
    corners = segments(abs(delta_cm)) if delta_cm else 12
    return section.offset(delta_cm, JoinType.Round, 2.0, corners).simplify(OUTLINE_TOLERANCE_CM)


def _filleted(section: CrossSection, radius_cm: float) -> CrossSection:
    if radius_cm <= 0.0:
        return section
    opened = _offset(_offset(section, -radius_cm), radius_cm)
    return _offset(_offset(opened, radius_cm), -radius_cm)


# --- solids ---------------------------------------------------------------------------------------


def lathe(section: CrossSection) -> Manifold:
    """Outline turned about the z axis; its second coordinate becomes z."""
    _, _, radius, _ = section.bounds()
    return Manifold.revolve(section, segments(radius))


def cylinder(
    radius_cm: float, z0_cm: float, z1_cm: float, top_radius_cm: float | None = None
) -> Manifold:
    """Cylinder, or a cone with ``top_radius_cm``, between two heights."""
    top = radius_cm if top_radius_cm is None else top_radius_cm
    solid = Manifold.cylinder(z1_cm - z0_cm, radius_cm, top, segments(max(radius_cm, top)))
    return solid.translate((0.0, 0.0, z0_cm))


def tube(outer_cm: float, inner_cm: float, z0_cm: float, z1_cm: float) -> Manifold:
    """Cylinder with a bore, or a washer."""
    ring = disc(outer_cm) - CrossSection.circle(inner_cm, segments(outer_cm))
    return Manifold.extrude(ring, z1_cm - z0_cm).translate((0.0, 0.0, z0_cm))


def sphere(radius_cm: float, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Manifold:
    """Ball."""
    return Manifold.sphere(radius_cm, segments(radius_cm)).translate(centre)


def box(
    size_cm: tuple[float, float, float], centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Manifold:
    """Box with sharp edges."""
    return Manifold.cube(size_cm, center=True).translate(centre)


def rounded_box(
    size_cm: tuple[float, float, float],
    radius_cm: float,
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Manifold:
    """Box with all edges rounded."""
    corner = Manifold.sphere(radius_cm, segments(radius_cm))
    half = np.array(size_cm) / 2 - radius_cm
    corners = [corner.translate(tuple(half * sign)) for sign in _SIGNS]
    return Manifold.batch_hull(corners).translate(centre)


_SIGNS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


def slab(section: CrossSection, z0_cm: float, z1_cm: float, edge_cm: float = 0.0) -> Manifold:
    """Extruded outline; with ``edge_cm`` its rims are rounded (convex outlines only)."""
    if edge_cm <= 0.0:
        return Manifold.extrude(section, z1_cm - z0_cm).translate((0.0, 0.0, z0_cm))
    layers = []
    for angle in np.linspace(0.0, pi / 2, 4):
        drop, back = edge_cm * (1 - np.cos(angle)), edge_cm * (1 - np.sin(angle))
        layer = _offset(section, -back) if back > 1e-6 else section
        layers.append(slab(layer, z0_cm + drop, z1_cm - drop))
    return Manifold.batch_hull(layers)


def capsule(radius_cm: float, z0_cm: float, z1_cm: float) -> Manifold:
    """Rod with hemispherical ends between two heights."""
    ends = [sphere(radius_cm, (0.0, 0.0, z)) for z in (z0_cm + radius_cm, z1_cm - radius_cm)]
    return Manifold.batch_hull(ends)


def thread(
    major_cm: float, minor_cm: float, pitch_cm: float, z0_cm: float, z1_cm: float
) -> Manifold:
    """Rod with a one-start V thread: crest radius, root radius, pitch."""
    corners, turns = 16, (z1_cm - z0_cm) / pitch_cm  # coarse: a thread has very many facets
    angles = 2 * pi * np.arange(corners) / corners
    crest = 1 - np.abs(angles / pi - 1)
    radii = minor_cm + (major_cm - minor_cm) * crest
    section = CrossSection([radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)])
    rod = Manifold.extrude(section, z1_cm - z0_cm, ceil(8 * turns), -360.0 * turns)
    return rod.translate((0.0, 0.0, z0_cm))


# --- together -------------------------------------------------------------------------------------


def union(solids: Iterable[Manifold]) -> Manifold:
    """All of them as one solid."""
    return sum(solids, Manifold())


def around(solid: Manifold, count: int) -> Manifold:
    """Join copies of a solid, evenly turned about the z axis."""
    return union(solid.rotate((0.0, 0.0, 360.0 * i / count)) for i in range(count))


def cut_above(solid: Manifold, z_cm: float) -> Manifold:
    """Leave what is below a height, as of a liquid poured into a cavity."""
    return solid.trim_by_plane((0.0, 0.0, -1.0), -z_cm)


def along_x(solid: Manifold) -> Manifold:
    """Lay a solid down: its z axis becomes x, its x axis -z."""
    return solid.rotate((0.0, 90.0, 0.0))


def along_y(solid: Manifold) -> Manifold:
    """Tip a solid over: its z axis becomes y, its y axis -z."""
    return solid.rotate((-90.0, 0.0, 0.0))


def upright(section: CrossSection, thickness_cm: float) -> Manifold:
    """Plate with an outline in (x, z), as thick to either side of y = 0."""
    plate = Manifold.extrude(section, thickness_cm).translate((0.0, 0.0, -thickness_cm / 2))
    return plate.rotate((90.0, 0.0, 0.0))


def upright_across(section: CrossSection, thickness_cm: float) -> Manifold:
    """Plate with an outline in (y, z), as thick to either side of x = 0."""
    plate = Manifold.extrude(section, thickness_cm).translate((0.0, 0.0, -thickness_cm / 2))
    return plate.rotate((90.0, 0.0, 90.0))


def from_mesh(mesh: trimesh.Trimesh) -> Manifold:
    """Solid of a closed triangle mesh; the inverse of :func:`to_mesh`."""
    return Manifold(
        Mesh64(np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.uint64))
    )


def to_mesh(solid: Manifold) -> trimesh.Trimesh:
    """Triangle mesh of a solid.

    Loose crumbs, which cuts leave where two curved surfaces nearly coincide, are left out.
    """
    mesh = solid.to_mesh64()
    vertices = np.ascontiguousarray(mesh.vert_properties[:, :3])
    faces = mesh.tri_verts.astype(np.int64)
    return _of_faces(vertices, faces[_body_cm3(vertices, faces) > CRUMB_CM3])


def without_splinters(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Leave out bodies and cavities below a ten-thousandth of the largest, as who meshes does.

    The same mesh where there is none. A solid keeps them, so that objects of published datasets
    stay what they are.
    """
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    body_cm3 = _body_cm3(vertices, faces)
    kept = body_cm3 > SPLINTER_SHARE * body_cm3.max()
    return mesh if kept.all() else _of_faces(vertices, faces[kept])


def _body_cm3(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, "f"]:
    """Volume of the body, or cavity, that each face belongs to."""
    body = _connected(faces, len(vertices))[faces[:, 0]]
    return np.asarray(np.abs(np.bincount(body, np.linalg.det(vertices[faces]) / 6))[body])


def _of_faces(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> trimesh.Trimesh:
    whole = trimesh.Trimesh(vertices, faces, process=False)
    whole.remove_unreferenced_vertices()
    return whole


def _connected(faces: np.ndarray, vertices: int) -> np.ndarray:
    """Give the number of the connected body each vertex belongs to."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    start, end = faces.ravel(), np.roll(faces, 1, axis=1).ravel()
    edges = coo_array((np.ones(len(start), dtype=np.int8), (start, end)), (vertices, vertices))
    return np.asarray(connected_components(edges, directed=False)[1])
