"""What makes a mesh a solid: closed, wound outwards, every point inside it exactly once."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import trimesh
from jaxtyping import Bool, Float
from manifold3d import Manifold, Mesh64

from xden1k.errors import DataError
from xden1k.values.arrays import Faces, Vec3
from xden1k.values.closed import edge_faults
from xden_builder.capture.sides import Sides

__all__ = ["bare", "closed_mesh", "repeated", "simplified"]

FLATTEST = 1e-9
"""A smaller volume, as a share of the bounding box, is rounding."""
FARTHEST_CM = 1e9
"""From the origin: beyond it vertices that are to be one cannot be told from others."""
FLAP = 1e-4
"""Of a surface, that may be there twice: a splinter that a cut has left, of no volume."""

MOST_VOLUME_CHANGE = 0.02
"""A part that leaving out faces would change more, such as a foil, keeps its surface."""

FEW_PLACES, PLACES = 3, 7
"""Of a closed piece that are asked whether they lie in another one: where they agree, and at most.
"""
NEAR_CORNER, BENEATH = 1e-3, 1e-6
"""Of a triangle's size: how far from a corner, and beneath it, a place touches no surface."""

Triangles = Float[np.ndarray, "_ 3 3"]


def closed_mesh(
    mesh: trimesh.Trimesh, cm_per_unit: float, where: str
) -> tuple[trimesh.Trimesh, bool]:
    """Bring a mesh to cm, merge its vertices and prove that it bounds a solid.

    Parameters
    ----------
    mesh
        Triangles in any unit.
    cm_per_unit
        Of that unit.
    where
        File and part, for messages.

    Returns
    -------
    mesh
        In cm, closed, consistently wound outwards. Its cavities are closed pieces of their own,
        wound the other way.
    inverted
        Whether it was inside out as a whole, which is set right.

    Raises
    ------
    DataError
        If there are no triangles, a vertex is missing or not finite, the mesh is not closed,
        neighbouring triangles are wound against each other, one is there twice, it has no volume,
        or one of several pieces is wound against its place.
    """
    solid = bare(mesh, cm_per_unit, where)
    _check_closed(np.asarray(solid.faces), where)
    _check_counted_once(solid, where)
    volume = _volume(_triangles(solid))
    if not abs(volume) > FLATTEST * float(np.prod(solid.extents)):
        raise DataError(
            f"{where}: the mesh encloses no volume: a sheet, or a shell and its inside-out copy"
        )
    if volume < 0:
        solid.invert()
    _check_pieces(solid, where)
    return solid, volume < 0


def bare(mesh: trimesh.Trimesh, cm_per_unit: float, where: str) -> trimesh.Trimesh:
    """Return bare triangles in cm, vertices of one place merged, faces of two corners dropped."""
    faces = np.asarray(mesh.faces)
    if faces.size and not 0 <= faces.min() <= faces.max() < len(mesh.vertices):
        raise DataError(f"{where}: a triangle names a vertex that is not there")
    if not np.isfinite(mesh.vertices).all():
        raise DataError(f"{where}: the mesh has vertices that are not finite")
    solid = trimesh.Trimesh(mesh.vertices * cm_per_unit, faces, process=False)
    farthest_cm = float(np.abs(solid.vertices[faces]).max(initial=0))
    if farthest_cm > FARTHEST_CM:
        raise DataError(
            f"{where}: a vertex is {farthest_cm:.3g} cm from the origin: check mesh_units"
        )
    solid.merge_vertices()
    first, second, third = solid.faces.T
    solid.update_faces((first != second) & (second != third) & (third != first))
    solid.remove_unreferenced_vertices()
    if len(solid.faces) == 0:
        raise DataError(f"{where}: the mesh has no triangles")
    return solid


def _check_closed(faces: Faces, where: str) -> None:
    """Refuse open edges, and neighbours wound against each other."""
    faults = edge_faults(faces)
    if faults.open:
        raise DataError(
            f"{where}: the mesh is not closed: {faults.open} open edges; `xden-build mend` closes "
            "holes that are narrow or flat"
        )
    if faults.twisted:
        raise DataError(
            f"{where}: triangles are wound against each other at {faults.twisted} edges: expected "
            "all counter-clockwise seen from outside; `xden-build mend` turns the fewer over"
        )


def _check_counted_once(solid: trimesh.Trimesh, where: str) -> None:
    """Refuse triangles that are there twice, but where they are a flap that bounds nothing."""
    again = repeated(np.asarray(solid.faces))
    if again.any() and solid.area_faces[again].sum() > FLAP * solid.area:
        raise DataError(
            f"{where}: {again.sum()} triangles are there twice, wound alike: what they bound would "
            "count twice; `xden-build mend` leaves one of each"
        )


def repeated(faces: Faces) -> Bool[np.ndarray, "_"]:
    """Say which triangles have the corners of an earlier one, in the same order.

    Examples
    --------
    >>> repeated(np.array([[0, 1, 2], [2, 1, 0], [1, 2, 0]]))
    array([False, False,  True])
    """
    turn = (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3
    corners = np.take_along_axis(faces, turn, axis=1)
    order = np.lexsort(corners.T)  # stable: of alike ones the first stays first
    again = np.zeros(len(faces), dtype=np.bool_)
    again[order[1:]] = (corners[order[1:]] == corners[order[:-1]]).all(axis=1)
    return again


def _check_pieces(solid: trimesh.Trimesh, where: str) -> None:
    """Refuse a mesh of several pieces in which some space would count twice, or negatively.

    A piece outside all others must bound a solid, one inside a solid must bound a cavity.
    """
    pieces = _closed_pieces(solid)
    if len(pieces) == 1:
        return
    low, high = (np.stack(ends) for ends in zip(*map(_bounds, pieces), strict=True))
    for index, piece in enumerate(pieces):
        volume = _volume(piece)
        if abs(volume) <= FLATTEST * float(np.prod(solid.extents)):
            continue  # a sliver bounds nothing
        around = ((low <= high[index]) & (high >= low[index])).all(axis=1)
        others = [pieces[other] for other in np.flatnonzero(around) if other != index]
        inside_out = volume < 0
        if _windings_around(piece, others, inside_out=inside_out) != inside_out:
            place = np.round(piece[0, 0], 3).tolist()
            raise DataError(
                f"{where}: one of the mesh's {len(pieces)} closed pieces, at {place} cm, is wound "
                "wrongly: expected outwards for a solid outside the others, inwards for a cavity"
            )


def _bounds(triangles: Triangles) -> tuple[Vec3, Vec3]:
    return triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))


def _closed_pieces(solid: trimesh.Trimesh) -> list[Triangles]:
    """Return the triangles of each set of faces that hang together."""
    piece = Sides(np.asarray(solid.faces)).piece
    order = np.argsort(piece, kind="stable")
    starts = np.flatnonzero(np.diff(piece[order], prepend=-1, append=-1))
    triangles = _triangles(solid)[order]
    return [triangles[start:stop] for start, stop in pairwise(starts)]


def _triangles(solid: trimesh.Trimesh) -> Triangles:
    return np.asarray(solid.vertices)[solid.faces]


def _volume(triangles: Triangles) -> float:
    return float(_triple_products(triangles - triangles[0, 0]).sum() / 6)


def _triple_products(corners: Triangles) -> Float[np.ndarray, "_"]:
    a, b, c = corners.transpose(1, 0, 2)
    return np.asarray((a * np.cross(b, c)).sum(axis=1))


def _windings_around(piece: Triangles, others: list[Triangles], *, inside_out: bool) -> int:
    """How often the other pieces wind around this one, by most of some places in what it bounds.

    They lie a little beneath some of its larger faces, so that it may touch the others, and at a
    corner of them: large faces of a thin shell may cut through it between their corners. Few are
    asked where they agree.
    """
    a, b, c = piece.transpose(1, 0, 2)
    outwards = np.cross(b - a, c - a) * (-1 if inside_out else 1)
    double_area = np.linalg.norm(outwards, axis=1, keepdims=True)
    larger = np.flatnonzero(double_area[:, 0] >= np.median(double_area[double_area > 0]))
    asked = larger[:: len(larger) // PLACES + 1]
    inwards = -outwards[asked] / np.sqrt(double_area[asked])  # as long as a side, about
    corner, middle = piece[asked, 0], piece[asked].mean(axis=1)
    windings: list[float] = []
    for place in corner + NEAR_CORNER * (middle - corner) + BENEATH * inwards:
        windings.append(sum(_winding_number(each, place) for each in others))
        if len(windings) == FEW_PLACES and np.ptp(windings) < 0.5:
            break
    return round(float(np.median(windings)))


def _winding_number(triangles: Triangles, point: Vec3) -> float:
    """Solid angle of a closed surface over 4 pi: 1 inside, 0 outside, between on it.

    Van Oosterom and Strackee, 1983, doi:10.1109/TBME.1983.325207.
    """
    corners = triangles - point
    if (corners.min(axis=(0, 1)) > 0).any() or (corners.max(axis=(0, 1)) < 0).any():
        return 0.0
    a, b, c = corners.transpose(1, 0, 2)
    la, lb, lc = np.linalg.norm(corners, axis=2).T
    ab, bc, ca = ((u * v).sum(axis=1) for u, v in ((a, b), (b, c), (c, a)))
    angles = np.arctan2(_triple_products(corners), la * lb * lc + ab * lc + bc * la + ca * lb)
    return float(angles.sum() / (2 * np.pi))


def simplified(mesh: trimesh.Trimesh, tolerance_cm: float) -> trimesh.Trimesh:
    """Leave out faces of a closed mesh; one that this would change much stays as it is.

    Parameters
    ----------
    mesh
        Closed.
    tolerance_cm
        How far the surface may leave the true one; 0: nothing is left out.
    """
    if tolerance_cm == 0:
        return mesh
    buffers = Mesh64(
        vert_properties=np.array(mesh.vertices, dtype=np.float64),
        tri_verts=np.array(mesh.faces, dtype=np.uint64),
    )
    whole = Manifold(buffers)
    few = whole.simplify(tolerance_cm)
    if few.is_empty() or abs(few.volume() - whole.volume()) > MOST_VOLUME_CHANGE * whole.volume():
        return mesh
    simple = few.to_mesh64()
    return trimesh.Trimesh(simple.vert_properties[:, :3], simple.tri_verts, process=False)
