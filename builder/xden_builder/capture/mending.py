"""Meshes as scanners and editors leave them, made solids where there is one way to do it.

A surface from photographs ends where nothing was seen, and an editor leaves triangles twice, loose
or turned over. What bounds no solid is set right in this order: vertices of nearly one place are
one, scraps go, and triangles that are there twice or hang on an edge, neighbours are wound alike,
and what is still open is closed by triangles between the vertices that are there. A wide hole is
closed only if it is flat, as where an object stood: how else it went on nobody can know.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Bool
from scipy.spatial import KDTree

from xden1k.errors import DataError
from xden1k.values.closed import edge_faults
from xden_builder.capture.holes import Hole, find_holes, uneven_lip
from xden_builder.capture.sides import Sides, groups
from xden_builder.capture.solids import bare, closed_mesh, repeated

__all__ = ["Mended", "mended"]

NEARLY_ONE: Final = (1e-6, 1e-5, 1e-4)
"""Distances of vertices that may be one, as shares of the mesh's largest extent."""
COPIES: Final = 32
"""Of a vertex, that are looked for around it: more triangles than usually meet in one."""
LOOSE: Final = 0.001
"""Share of the area, below which open pieces together are scraps."""
RAGGED: Final = 0.25
"""Open sides of a scrap at least, for each of its triangles: others are nearly solids."""
SHEET, SHEETS = 1e-6, 0.1
"""Thickness of an open piece that bounds nothing, as a share of the mesh's largest extent, and of
the surface that such pieces together are at most."""
NARROW: Final = 0.02**2
"""Area of a hole that is closed whatever its shape, as a share of that of the piece it is in."""


@dataclass(frozen=True, slots=True, eq=False)
class Mended:
    """A mesh that bounds a solid.

    Parameters
    ----------
    mesh
        In cm, as of :func:`xden_builder.capture.solids.closed_mesh`.
    deeds
        What was done to it, in words; nothing for a solid.
    wide
        Whether a wide hole was closed: somebody should look whether it ended there.
    """

    mesh: trimesh.Trimesh
    deeds: tuple[str, ...]
    wide: bool = False


def mended(mesh: trimesh.Trimesh, cm_per_unit: float, where: str) -> Mended:
    """Make a mesh a solid.

    Parameters
    ----------
    mesh
        Triangles in any unit.
    cm_per_unit
        Of that unit.
    where
        File and part, for messages.

    Raises
    ------
    DataError
        If it has a wide hole that is not flat, two walls that do not end in one plane, no volume,
        or pieces within one another of which nobody can say what is outside; also if it has no
        triangles, or damaged ones.
    """
    solid = bare(mesh, cm_per_unit, where)
    deeds: list[str] = []
    holes: list[Hole] = []
    if not _is_closed(solid):
        for repair in (_joined, _without_scraps, _without_repeated, _without_fins, _wound_alike):
            solid, deed = repair(solid)
            deeds += [deed] if deed else []
        solid, holes = _closed(solid, where)
    if holes:
        widest_cm = max(hole.width_cm for hole in holes)
        deeds.append(f"{_number(len(holes), 'hole')} closed, up to {widest_cm:.2g} cm wide")
    whole, inverted = closed_mesh(solid, 1.0, where)
    deeds += ["inside out, turned over"] if inverted else []
    return Mended(whole, tuple(deeds), any(hole.share > NARROW for hole in holes))


def _is_closed(solid: trimesh.Trimesh) -> bool:
    faces = np.asarray(solid.faces)
    return sum(edge_faults(faces)) == 0 and not repeated(faces).any()


def _without_scraps(solid: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str]:
    """Leave out ragged pieces that together are hardly any of the surface, and flat ones."""
    sides = Sides(np.asarray(solid.faces))
    area = np.bincount(sides.piece, weights=solid.area_faces)
    ends = np.bincount(sides.piece, weights=(sides.meeting == 1).sum(axis=1))
    ragged = ends >= RAGGED * np.bincount(sides.piece)
    smallest = np.argsort(np.where(ragged, area, np.inf), kind="stable")
    gone = np.zeros(len(area), dtype=np.bool_)
    gone[smallest[np.cumsum(area[smallest]) < LOOSE * area.sum()]] = True
    gone &= ragged
    sheets = (ends > 0) & (np.bincount(sides.piece) > 1) & _flat_pieces(solid, sides)
    if area[sheets].sum() < SHEETS * area.sum():
        gone |= sheets
    return _keep(solid, ~gone[sides.piece], "loose")


def _flat_pieces(solid: trimesh.Trimesh, sides: Sides) -> Bool[np.ndarray, "pieces"]:
    """Say which pieces are sheets: they bound nothing however they are closed."""
    order = np.argsort(sides.piece, kind="stable")
    starts = np.flatnonzero(np.diff(sides.piece[order], prepend=-1))
    first = np.asarray(solid.face_normals)[order[starts]][sides.piece]
    heights = np.einsum("fci,fi->fc", np.asarray(solid.triangles), first)
    low = np.minimum.reduceat(heights.min(axis=1)[order], starts)
    high = np.maximum.reduceat(heights.max(axis=1)[order], starts)
    return np.asarray(high - low < SHEET * float(solid.extents.max()))


def _joined(solid: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str]:
    """Make one of vertices that lie nearly in one place, no farther than leaves least open."""
    least, best, deed = edge_faults(np.asarray(solid.faces)).open, solid, ""
    for share in NEARLY_ONE:
        distance_cm = share * float(solid.extents.max())
        merged = _merged_within(solid, distance_cm)
        if merged is None:
            continue
        if (left := edge_faults(np.asarray(merged.faces)).open) < least:
            least, best = left, merged
            deed = f"vertices within {10 * distance_cm:.1g} mm joined"
    return best, deed


def _merged_within(solid: trimesh.Trimesh, distance_cm: float) -> trimesh.Trimesh | None:
    """Join vertices on open edges, slivers between them gone; None if some lie in a row."""
    sides, points = Sides(np.asarray(solid.faces)), np.asarray(solid.vertices)
    ends = np.unique(sides.ends[sides.meeting.ravel() % 2 == 1])
    if len(ends) < 2:
        return None
    reach = KDTree(points[ends]).query(
        points[ends], min(COPIES, len(ends)), distance_upper_bound=distance_cm
    )[1]
    number = np.broadcast_to(np.arange(len(ends))[:, None], reach.shape)
    links = np.stack([number[reach < len(ends)], reach[reach < len(ends)]], axis=1)
    group = groups(ends[links], len(points))
    low, high = np.full((2, group.max() + 1, 3), [[[np.inf]], [[-np.inf]]])
    np.minimum.at(low, group, points)
    np.maximum.at(high, group, points)
    if np.linalg.norm(high - low, axis=1).max() > 2 * distance_cm:
        return None
    _, first = np.unique(group, return_index=True)
    faces = group[solid.faces]
    slivers = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    return trimesh.Trimesh(points[first], faces[~slivers], process=False)


def _without_repeated(solid: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str]:
    """Leave one of triangles that have the same corners in the same order."""
    return _keep(solid, ~repeated(np.asarray(solid.faces)), "repeated")


def _without_fins(solid: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str]:
    """Leave out triangles that end in nothing and hang on an edge that others share already."""
    kept = np.ones(len(solid.faces), dtype=np.bool_)
    while kept.any():
        index = np.flatnonzero(kept)
        meeting = Sides(np.asarray(solid.faces)[index]).meeting
        fins = (meeting == 1).any(axis=1) & (meeting > 2).any(axis=1)
        if not fins.any():
            break
        kept[index[fins]] = False
    return _keep(solid, kept, "overhanging")


def _keep(
    solid: trimesh.Trimesh, kept: Bool[np.ndarray, "f"], what: str
) -> tuple[trimesh.Trimesh, str]:
    """Leave out triangles, unless nothing would be left."""
    gone = int((~kept).sum())
    if gone == 0 or not kept.any():
        return solid, ""
    share = float(solid.area_faces[~kept].sum() / solid.area)
    fewer = trimesh.Trimesh(solid.vertices, solid.faces[kept], process=False)
    told = f"{_number(gone, f'{what} triangle')} left out"
    return fewer, told if share < LOOSE else f"{told}, {share:.1%} of the surface"


def _wound_alike(solid: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str]:
    """Turn triangles over that are wound against their neighbours: of each piece the fewer.

    Each triangle is there as it is and turned over; those that go with one another hang together.
    """
    faces = np.asarray(solid.faces)
    (one, other), against = (pairs := Sides(faces).pairs)[0].T, pairs[1]
    count = len(faces)
    there = np.where(against, other + count, other), np.where(against, other, other + count)
    links = np.stack([np.concatenate([one, one + count]), np.concatenate(there)], axis=1)
    side, piece = groups(links, 2 * count)[:count], groups(pairs[0], count)
    _, first = np.unique(piece, return_index=True)
    turned = side != side[first][piece]
    area = [np.bincount(piece, weights=solid.area_faces * each) for each in (turned, ~turned)]
    turned ^= (area[0] > area[1])[piece]
    if not turned.any():
        return solid, ""
    alike = np.where(turned[:, None], faces[:, ::-1], faces)
    deed = f"{_number(int(turned.sum()), 'triangle')} turned over"
    return trimesh.Trimesh(solid.vertices, alike, process=False), deed


def _closed(solid: trimesh.Trimesh, where: str) -> tuple[trimesh.Trimesh, list[Hole]]:
    """Close every hole that may be."""
    if Sides(np.asarray(solid.faces)).pairs[1].any():
        raise DataError(f"{where}: the surface has one side alone, as a Möbius strip: no solid")
    holes = find_holes(solid)
    wide = [hole for hole in holes if hole.share > NARROW]
    if uneven := [hole for hole in wide if not hole.flat]:
        raise DataError(
            f"{where}: {_number(len(uneven), 'hole')} up to "
            f"{max(hole.width_cm for hole in uneven):.2g} cm wide, not flat: close what is wide in "
            "a mesh editor, where it is seen how the surface goes on"
        )
    if lip := uneven_lip(wide):
        raise DataError(
            f"{where}: holes {lip[0].width_cm:.2g} and {lip[1].width_cm:.2g} cm wide of two walls, "
            "one within the other and not in one plane: close the gap between them in a mesh editor"
        )
    faces = np.concatenate([solid.faces, *(hole.lid for hole in holes)])
    return trimesh.Trimesh(solid.vertices, faces, process=False), holes


def _number(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
