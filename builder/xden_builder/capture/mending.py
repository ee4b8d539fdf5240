"""Meshes as scanners and editors leave them, made solids where there is one way to do it.

A surface from photographs ends where nothing was seen, and an editor leaves triangles twice, loose
or turned over. What bounds no solid is set right in this order: vertices of nearly one place are
one, triangles that are there twice or hang on an edge go, neighbours are wound alike, and what is
still open is closed by triangles between the vertices that are there. A wide hole is closed only if
it is flat, as where an object stood: how else it went on nobody can know.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import manifold3d
import numpy as np
import trimesh
from jaxtyping import Bool, Float64, Int64
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from scipy.spatial.distance import pdist

from xden1k.errors import DataError
from xden1k.values.arrays import Faces
from xden1k.values.closed import edge_faults
from xden_builder.capture.solids import bare, closed_mesh

__all__ = ["Mended", "mended"]

NEARLY_ONE: Final = (1e-6, 1e-5, 1e-4)
"""Distances of vertices that may be one, as shares of the mesh's largest extent."""
LOOSE: Final = 0.001
"""Share of the area, below which an open piece is a scrap."""
NARROW: Final = 0.02
"""Width of a hole that is closed whatever its shape, as a share of the mesh's largest extent."""
FLAT: Final = 0.02
"""How far the rim of a wide hole may leave a plane to either side, as a share of its width."""
TRIANGLE: Final = 3
"""Corners of a hole that can be closed in one way alone."""

Rim = Int64[np.ndarray, "n"]
"""Vertices around a hole, in the order in which triangles that close it run along it."""


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
        If it has a wide hole that is not flat, no volume, or pieces within one another of which
        nobody can say what is outside; also if it has no triangles, or damaged ones.
    """
    try:
        return Mended(closed_mesh(mesh, cm_per_unit, where)[0], ())
    except DataError:
        solid = bare(mesh, cm_per_unit, where)
    deeds: list[str] = []
    for repair in (_joined, _without_doubles, _without_fins, _without_scraps, _wound_alike):
        if sum(edge_faults(np.asarray(solid.faces))) == 0:
            break
        solid, deed = repair(solid)
        deeds += [deed] if deed else []
    solid, widths_cm, wide = _closed(solid, where)
    if widths_cm:
        count = len(widths_cm)
        deeds.append(f"{count} hole{'s' * (count > 1)} closed, up to {max(widths_cm):.2g} cm wide")
    return Mended(closed_mesh(solid, 1.0, where)[0], tuple(deeds), wide)


def _joined(solid: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str]:
    """Make one of vertices that lie nearly in one place, no farther than leaves least open."""
    least, best, deed = edge_faults(np.asarray(solid.faces)).open, solid, ""
    for share in NEARLY_ONE:
        distance_cm = share * float(solid.extents.max())
        merged = _merged_within(solid, distance_cm)
        if (left := edge_faults(np.asarray(merged.faces)).open) < least:
            least, best = left, merged
            deed = f"vertices within {10 * distance_cm:.1g} mm joined"
    return best, deed


def _merged_within(solid: trimesh.Trimesh, distance_cm: float) -> trimesh.Trimesh:
    count = len(solid.vertices)
    pairs = KDTree(solid.vertices).query_pairs(distance_cm, output_type="ndarray")
    links = coo_array((np.ones(len(pairs), np.bool_), tuple(pairs.T)), shape=(count, count))
    group = connected_components(links, directed=False)[1]
    _, first = np.unique(group, return_index=True)
    return bare(trimesh.Trimesh(solid.vertices[first], group[solid.faces], process=False), 1.0, "")


def _without_doubles(solid: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str]:
    """Leave one of triangles that have the same corners."""
    _, first = np.unique(np.sort(solid.faces, axis=1), axis=0, return_index=True)
    kept = np.zeros(len(solid.faces), dtype=np.bool_)
    kept[first] = True
    return _keep(solid, kept, "repeated")


def _without_fins(solid: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str]:
    """Leave out triangles that end in nothing and hang on an edge that others share already."""
    kept = np.ones(len(solid.faces), dtype=np.bool_)
    while True:
        index = np.flatnonzero(kept)
        edge, count = _edges(np.asarray(solid.faces)[index])
        meeting = count[edge].reshape(-1, 3)
        fins = (meeting == 1).any(axis=1) & (meeting > 2).any(axis=1)
        if not fins.any():
            return _keep(solid, kept, "overhanging")
        kept[index[fins]] = False


def _without_scraps(solid: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str]:
    """Leave out open pieces that are hardly any of the surface."""
    faces = np.asarray(solid.faces)
    edge, count = _edges(faces)
    number = np.repeat(np.arange(len(faces)), 3)
    size = len(faces) + len(count)
    links = coo_array(
        (np.ones(len(edge), np.bool_), (number, len(faces) + edge)), shape=(size, size)
    )
    piece = connected_components(links, directed=False)[1][: len(faces)]
    area = np.bincount(piece, weights=solid.area_faces)
    opened = np.bincount(piece, weights=(count[edge] == 1).reshape(-1, 3).any(axis=1)) > 0
    return _keep(solid, ~(opened & (area < LOOSE * area.sum()))[piece], "loose")


def _keep(
    solid: trimesh.Trimesh, kept: Bool[np.ndarray, "f"], what: str
) -> tuple[trimesh.Trimesh, str]:
    """Leave out triangles, unless nothing would be left."""
    gone = int((~kept).sum())
    if gone == 0 or not kept.any():
        return solid, ""
    fewer = trimesh.Trimesh(solid.vertices, solid.faces[kept], process=False)
    return fewer, f"{gone} {what} triangle{'s' * (gone > 1)} left out"


def _edges(faces: Faces) -> tuple[Int64[np.ndarray, "e"], Int64[np.ndarray, "u"]]:
    """Give the edge of each side of each triangle, and how many triangles meet in each edge."""
    sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64), axis=1)
    keys = sides[:, 0] * (int(sides.max()) + 1) + sides[:, 1]
    _, edge, count = np.unique(keys, return_inverse=True, return_counts=True)
    return edge, count


def _wound_alike(solid: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str]:
    """Turn triangles over that are wound against their neighbours: of each piece the fewer."""
    alike = solid.copy()
    trimesh.repair.fix_winding(alike)  # type: ignore[no-untyped-call]
    turned = np.asarray(alike.faces[:, 0] != solid.faces[:, 0])
    for piece in trimesh.graph.connected_components(
        solid.face_adjacency, nodes=np.arange(len(solid.faces)), min_len=1
    ):
        area = solid.area_faces[piece]
        if area[turned[piece]].sum() > area.sum() / 2:
            turned[piece] = ~turned[piece]
    if not turned.any():
        return solid, ""
    faces = np.where(turned[:, None], solid.faces[:, ::-1], solid.faces)
    count = int(turned.sum())
    deed = f"{count} triangle{'s' * (count > 1)} turned over"
    return trimesh.Trimesh(solid.vertices, faces, process=False), deed


def _closed(solid: trimesh.Trimesh, where: str) -> tuple[trimesh.Trimesh, list[float], bool]:
    """Close every hole that may be; give their widths in cm too, and whether one is wide."""
    points, faces = np.asarray(solid.vertices), np.asarray(solid.faces)
    widths_cm, lids, wide = [], [faces], False
    for rim in _rims(faces):
        around = points[rim]
        width_cm = float(pdist(around[:: max(len(around) // 200, 1)]).max())
        if len(rim) > TRIANGLE and width_cm > NARROW * float(solid.extents.max()):
            wide = True
            if not np.ptp(around @ _normal(around)) <= 2 * FLAT * width_cm:
                raise DataError(
                    f"{where}: a hole {width_cm:.2g} cm wide that is not flat: close it in a mesh "
                    "editor, where it is seen how the surface goes on"
                )
        widths_cm.append(width_cm)
        lids.append(rim[_lid(around)])
    return trimesh.Trimesh(points, np.concatenate(lids), process=False), widths_cm, wide


def _rims(faces: Faces) -> Iterator[Rim]:
    """Yield the rims of all holes; one that meets itself in a vertex is several.

    Sides that no neighbour runs along the other way, turned round: as many of them come to each
    vertex as leave it, so that they are closed ways.
    """
    sides = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    ahead, count = np.unique(sides, axis=0, return_counts=True)
    back = dict(zip(map(tuple, ahead[:, ::-1].tolist()), count.tolist(), strict=True))
    leaving: dict[int, list[int]] = {}
    for (first, second), there in zip(ahead.tolist(), count.tolist(), strict=True):
        single = there - back.get((first, second), 0)
        leaving.setdefault(second, []).extend([first] * max(single, 0))
    for start in leaving:
        while leaving[start]:
            yield from _simple(leaving, start)


def _simple(leaving: dict[int, list[int]], start: int) -> Iterator[Rim]:
    """Walk on from a vertex until back there; yield each closed way on the way."""
    way, place = [start], {start: 0}
    while leaving[way[-1]]:
        there = leaving[way[-1]].pop()
        if there in place:
            rim = way[place[there] :]
            del way[place[there] + 1 :]
            for left in rim[1:]:
                del place[left]
            yield np.array(rim)
        else:
            place[there] = len(way)
            way.append(there)


def _normal(around: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "3"]:
    """Give the normal of the plane next to some points."""
    return np.asarray(_axes(around)[2])


def _axes(around: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "3 3"]:
    """Give the directions in which points spread, the farthest first."""
    return np.asarray(np.linalg.svd(around - around.mean(axis=0), full_matrices=False)[2])


def _lid(around: Float64[np.ndarray, "n 3"]) -> Int64[np.ndarray, "_m 3"]:
    """Triangles between the points around a hole, in the plane next to them."""
    flat = (around - around.mean(axis=0)) @ _axes(around)[:2].T
    after = np.roll(flat, -1, axis=0)
    if (flat[:, 0] * after[:, 1] - flat[:, 1] * after[:, 0]).sum() < 0:
        flat[:, 1] *= -1  # seen from the other side: the rim keeps its direction
    return np.asarray(manifold3d.triangulate([flat], allow_convex=True), dtype=np.int64)
