"""Objects as they happen to lie before the scanner, and meshes in a frame of their own."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any, Final, Literal

import numpy as np
import trimesh
from jaxtyping import Float, Float64
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from xden1k.errors import DataError
from xden1k.values.arrays import Vec3
from xden1k.values.ply import CM_PER_UNIT
from xden_builder.capture.pose import MeshScale
from xden_builder.phantoms.phantom import Identity, Phantom
from xden_builder.phantoms.scanner import VIEWS, Scanner

__all__ = ["AS_SCANNED", "MeshFrame", "Posing", "draw_mesh_frame", "posed", "true_poses"]

MOST_OFF_CENTRE_CM: Final = 2.0
"""How far along x, y and z an object may be from the middle between tube and panel."""
MOST_SHIFT_CM: Final = 10.0
"""How far along x, y and z a mesh may be from where it would be without its shift."""
MOST_SCALE: Final = 2.0
TRIES: Final = 50
"""Orientations tried for one that the panels hold."""

Matrix = Float64[np.ndarray, "4 4"]


@dataclass(frozen=True, slots=True)
class Posing:
    """Where objects are before the scanner, and in which frame their meshes come.

    Parameters
    ----------
    pose
        ``near``: objects lie as :func:`make_phantom` puts them, and meshes come in the scanner's
        frame. ``unknown``: an object lies on a table or stands in a block of foam, and its meshes
        come in a frame and in units of their own.
    mesh_scale
        What ``objects.csv`` says of it. ``unknown``: that frame has a scale of its own too.

    Raises
    ------
    DataError
        If meshes in the scanner's frame are to have another scale.
    """

    pose: Literal["near", "unknown"] = "near"
    mesh_scale: MeshScale = "known"

    def __post_init__(self) -> None:
        if self.pose == "near" and self.mesh_scale == "unknown":
            raise DataError("mesh_scale unknown needs pose unknown, got near")

    def settings(self) -> dict[str, Any]:
        """Give what differs from :data:`AS_SCANNED`, of JSON's types."""
        return {} if self == AS_SCANNED else {"posing": asdict(self)}


AS_SCANNED: Final = Posing()
"""Meshes in the scanner's frame."""


def posed(phantom: Phantom, scanner: Scanner, posing: Posing) -> Phantom:
    """Put an object where an operator might, inside all images with some air beside it.

    A pose that is ``near`` leaves it as it is. Otherwise half of the objects lie on a table, as
    they come to rest after a fall, and half stand in a block of foam, turned anyhow. What holds a
    liquid stays upright. All are turned about the vertical by any angle, and are a little off the
    middle.

    Raises
    ------
    DataError
        If the panels hold the object in none of the orientations tried.
    """
    if posing.pose == "near":
        return phantom
    rng = phantom.plan.rng("stand")
    for _ in range(TRIES):
        turned = _centred(phantom, _draw_rotation(phantom, rng))
        for setting in (scanner, scanner.large()):
            if setting.holds(turned):
                return _off_centre(turned, setting, rng)
    raise DataError(
        f"{phantom.plan.object_id} reaches beyond the panels in {TRIES} orientations of it"
    )


def _draw_rotation(phantom: Phantom, rng: np.random.Generator) -> Rotation:
    on_table, anyhow = rng.random() < 0.5, _draw_even_rotation(rng)
    spin = Rotation.from_euler("z", rng.uniform(0.0, 360.0), degrees=True)
    if any(part.role == "liquid" for part in phantom.parts):  # it would pour out
        return spin
    return spin * _at_rest(phantom, anyhow) if on_table else anyhow


def _draw_even_rotation(rng: np.random.Generator) -> Rotation:
    """Draw a rotation, evenly from all."""
    return Rotation.from_quat(rng.normal(size=4))


def _at_rest(phantom: Phantom, falling: Rotation) -> Rotation:
    """Turn an object as it comes to rest on a table, if it falls slowly in some orientation.

    It touches down and topples from facet to facet of its convex hull until its centre of mass is
    above the facet it lies on (Goldberg, Mirtich, Zhuang, Craig, Carlisle and Canny 1999, "Part
    pose statistics", doi:10.1109/70.814800).
    """
    hull = ConvexHull(np.concatenate([part.mesh.vertices for part in phantom.parts]))
    centre = phantom.mass_properties.com_cm
    normals = hull.equations[:, :3]
    heights = -(normals @ centre + hull.equations[:, 3])
    down = normals @ falling.inv().apply([0.0, 0.0, -1.0])
    facet = int(np.argmax(down / heights))
    for _ in hull.simplices:
        foot = centre + heights[facet] * normals[facet]
        beside = _barycentric(hull.points[hull.simplices[facet]], foot)
        if beside.min() >= 0:
            break
        facet = int(hull.neighbors[facet, beside.argmin()])
    return Rotation.align_vectors([[0.0, 0.0, -1.0]], [normals[facet]])[0]


def _barycentric(triangle: Float[np.ndarray, "3 3"], point: Vec3) -> Float[np.ndarray, "3"]:
    """Coordinates of a point in the plane of a triangle, negative beyond the opposite edge."""
    first, second = np.linalg.lstsq((triangle[1:] - triangle[0]).T, point - triangle[0])[0]
    return np.array([1.0 - first - second, first, second])


def _centred(phantom: Phantom, rotation: Rotation) -> Phantom:
    """Turn an object, and bring the middle of its bounding box to the origin."""
    points = rotation.apply(np.concatenate([part.mesh.vertices for part in phantom.parts]))
    middle_cm = (points.min(axis=0) + points.max(axis=0)) / 2
    return _moved(phantom, _similarity(rotation, -middle_cm))


def _off_centre(phantom: Phantom, scanner: Scanner, rng: np.random.Generator) -> Phantom:
    """Shift an object, by less where the panels would not hold it."""
    shift_cm = rng.uniform(-MOST_OFF_CENTRE_CM, MOST_OFF_CENTRE_CM, 3)
    for share in (1.0, 0.5, 0.25):
        shifted = _moved(phantom, _similarity(Rotation.identity(), share * shift_cm))
        if scanner.holds(shifted):
            return shifted
    return phantom


def _moved(phantom: Phantom, matrix: Matrix) -> Phantom:
    meshes = [part.mesh.copy().apply_transform(matrix) for part in phantom.parts]
    parts = zip(phantom.parts, meshes, strict=True)
    return replace(phantom, parts=tuple(replace(part, mesh=mesh) for part, mesh in parts))


def _similarity(rotation: Rotation, shift_cm: Vec3, scale: float = 1.0) -> Matrix:
    """Give the map of x to scale * R x + shift as a matrix."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = scale * rotation.as_matrix(), shift_cm
    return matrix


@dataclass(frozen=True, slots=True, eq=False)
class MeshFrame:
    """The frame and the units that the mesh files of an object are in.

    Parameters
    ----------
    matrix
        From the scanner's frame to that of the meshes, in cm: a similarity.
    units
        A key of ``CM_PER_UNIT``.
    """

    matrix: Matrix
    units: str

    def applied(self, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
        """Bring a mesh of the scanner's frame into this one, in cm; the same one if it is this."""
        if (self.matrix == np.eye(4)).all():
            return mesh
        return mesh.copy().apply_transform(self.matrix)

    def in_units(self, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
        """Give a mesh in the units of the files instead of cm; the same one where they are cm."""
        if self.units == "cm":
            return mesh
        return trimesh.Trimesh(mesh.vertices / CM_PER_UNIT[self.units], mesh.faces, process=False)


def draw_mesh_frame(plan: Identity, posing: Posing) -> MeshFrame:
    """Draw the frame an object's meshes come in; a pose that is ``near`` is in the scanner's.

    Any rotation, a shift of up to 10 cm along each axis, any units and, where it is to be unknown,
    a scale from 1/2 to 2, evenly in its logarithm.
    """
    if posing.pose == "near":
        return MeshFrame(np.eye(4), "cm")
    rng = plan.rng("frame")
    rotation = _draw_even_rotation(rng)
    shift_cm = rng.uniform(-MOST_SHIFT_CM, MOST_SHIFT_CM, 3)
    units, scale = str(rng.choice(list(CM_PER_UNIT))), MOST_SCALE ** rng.uniform(-1.0, 1.0)
    own_scale = posing.mesh_scale == "unknown"
    return MeshFrame(_similarity(rotation, shift_cm, scale if own_scale else 1.0), units)


def true_poses(plan: Identity, scanner: Scanner, posing: Posing) -> dict[str, Any]:
    """Give what ``truth.json`` holds of poses that are not told; nothing where they are.

    Each is a quaternion, scalar last, a translation and, of meshes, a scale: a point x is at
    scale * R x + t.

    ``mesh_pose``, where the pose is unknown: from the meshes of the files, in cm, to the object in
    the scanner's frame. It undoes the frame and the error of the handover
    (:meth:`Scanner.mesh_error`: turn, shift and scale). So it is the best there is for the
    annotated meshes; what remains is by how much their surfaces were simplified.

    ``view_poses``, where objects are turned by hand: by view, from the object in the scanner's
    frame to where the view's told geometry sees it.
    """
    poses: dict[str, Any] = {}
    if posing.pose == "unknown":
        handed_over = draw_mesh_frame(plan, posing).matrix @ scanner.mesh_error(plan).matrix
        poses["mesh_pose"] = _as_dict(np.linalg.inv(handed_over))
    turns = {view: scanner.turn(plan, view) for view in VIEWS}
    if scanner.one_tube:
        poses["view_poses"] = {v: _as_dict(turn) for v, turn in turns.items() if turn is not None}
    return poses


def _as_dict(matrix: Matrix) -> dict[str, Any]:
    scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
    return {
        "quaternion_xyzw": Rotation.from_matrix(matrix[:3, :3] / scale).as_quat().tolist(),
        "translation_cm": matrix[:3, 3].tolist(),
        "scale": scale,
    }
