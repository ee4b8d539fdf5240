"""Path lengths in torch, on the CPU or a CUDA GPU: the algorithm of :mod:`xden1k.rays` in arrays.

The default stays :func:`xden1k.rays.path_lengths`, compiled by numba: without a GPU it is 5 to 15
times as fast (``xden-build speed``). Here each step runs over all triangles, spans (a triangle cut
by a row) or crossings at once, in float64 and in the same order of operations, so that both find
the same crossings. On a GPU sums come in any order, which changes the last bits.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
import trimesh
from jaxtyping import Bool, Float64, Int64

from xden1k.errors import DataError
from xden1k.rays import PathLengths
from xden1k.rays.priority import check_order
from xden1k.rays.surfaces import Surfaces
from xden1k.values.views import ViewGeometry

__all__ = ["path_lengths"]

CROSSINGS_AT_ONCE = 1 << 22
"""Of a band of rows; each takes about 200 bytes."""
COLUMN, ROW, DEPTH = 0, 1, 2

Integers = Int64[torch.Tensor, "n"]
Floats = Float64[torch.Tensor, "n"]
Points = Float64[torch.Tensor, "n 3"]
Triangles = Float64[torch.Tensor, "triangles 3 3"]
"""Column, row and depth (cone: 1 / depth) of each vertex, vertices ordered by row."""
Labels = Int64[torch.Tensor, "triangles"]
"""Rank of a triangle's part, 1 = strongest; the sign holds the winding."""
_Band = tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]
"""Pixels, lengths, shared and broken of some rows, as in :class:`PathLengths`."""


def path_lengths(
    meshes: Sequence[trimesh.Trimesh],
    order: Sequence[int],
    geometry: ViewGeometry,
    subrays: int = 1,
    device: str | torch.device = "cpu",
) -> PathLengths:
    """Path lengths of one view, as :func:`xden1k.rays.path_lengths` gives them.

    Parameters
    ----------
    meshes, order, geometry, subrays
        As there.
    device
        Where to compute: a CPU or a CUDA device, since others lack float64. The result comes back
        as arrays in main memory.

    Raises
    ------
    DataError
        For the same reasons as there, or if there is no such device.

    Examples
    --------
    >>> view = ViewGeometry.from_dict(
    ...     {"beam": "parallel", "direction": [0, 1, 0], "pixel00_cm": [-0.75, 0, 0.75],
    ...      "column_step_cm": [0.5, 0, 0], "row_step_cm": [0, 0, -0.5], "shape": [4, 4]})
    >>> lengths = path_lengths([trimesh.creation.box((1, 3, 1))], [0], view)
    >>> lengths.pixels.tolist(), lengths.lengths_cm.ravel().tolist()
    ([5, 6, 9, 10], [3.0, 3.0, 3.0, 3.0])
    """
    if subrays < 1:
        raise DataError(f"subrays must be at least 1, got {subrays}")
    detector = _Detector(geometry, subrays, _checked(device))
    triangles, labels = _seen(meshes, order, detector)
    spans = _cut_by_rows(triangles, labels, detector)
    ranked = detector.tensor(np.array(order, dtype=np.int64))
    bands = [
        _walk(_cut_by_columns(band, detector), ranked, detector) for band in _bands(spans, detector)
    ]
    pixels, lengths, shared, broken = (
        torch.cat(each).cpu().numpy() for each in zip(*bands, strict=True)
    )
    return PathLengths(pixels, lengths, shared, broken, geometry.shape)


@dataclass(frozen=True, slots=True, eq=False)
class _Detector:
    """A view, the rays along each side of its pixels, and where to compute."""

    geometry: ViewGeometry
    subrays: int
    device: torch.device

    @property
    def fine(self) -> ViewGeometry:
        """The detector of single rays."""
        return self.geometry.refined(self.subrays)

    def tensor(self, values: np.ndarray) -> torch.Tensor:
        return torch.tensor(values, device=self.device)

    def number(self, row: Integers, column: Integers) -> Integers:
        """Give rays their numbers: pixel by pixel, as the result lists them."""
        side = self.subrays
        pixel = row // side * self.geometry.shape[1] + column // side
        return pixel * side**2 + row % side * side + column % side

    def cm_per_depth(self, ray: Integers) -> Floats:
        """Length in cm of one unit of depth, by the number of the ray."""
        if self.geometry.source_cm is None:
            return torch.ones_like(ray, dtype=torch.float64)
        pixel, within = ray // self.subrays**2, ray % self.subrays**2
        row = pixel // self.geometry.shape[1] * self.subrays + within // self.subrays
        column = pixel % self.geometry.shape[1] * self.subrays + within % self.subrays
        steps = self.tensor(self.fine.matrix.T)
        ways = column[:, None] * steps[0] + row[:, None] * steps[1] + steps[2]
        return (ways**2).sum(dim=1).sqrt()


@dataclass(frozen=True, slots=True, eq=False)
class _Spans:
    """Triangles cut by rows of rays."""

    row: Int64[torch.Tensor, "spans"]
    label: Int64[torch.Tensor, "spans"]
    left: Float64[torch.Tensor, "spans 3"]
    """Column, row and depth (cone: 1 / depth) of either end."""
    right: Float64[torch.Tensor, "spans 3"]
    begin: Int64[torch.Tensor, "spans"]
    """First column of a ray, and how many."""
    count: Int64[torch.Tensor, "spans"]

    def chosen(self, which: Bool[torch.Tensor, "spans"]) -> _Spans:
        return _Spans(*(getattr(self, name)[which] for name in self.__slots__))


@dataclass(frozen=True, slots=True, eq=False)
class _Crossings:
    """Where rays cross surfaces, sorted by ray and depth."""

    ray: Int64[torch.Tensor, "crossings"]
    depth: Float64[torch.Tensor, "crossings"]
    label: Int64[torch.Tensor, "crossings"]
    """Rank of the part, positive on entering, negative on leaving."""


def _checked(device: str | torch.device) -> torch.device:
    device = torch.device(device)
    if device.type == "cuda" and (device.index or 0) >= torch.cuda.device_count():
        raise DataError(f"device {device}: torch finds {torch.cuda.device_count()} CUDA GPUs")
    if device.type not in ("cpu", "cuda"):
        raise DataError(f"device must be a CPU or a CUDA GPU, got {device}")
    return device


def _seen(
    meshes: Sequence[trimesh.Trimesh], order: Sequence[int], detector: _Detector
) -> tuple[Triangles, Labels]:
    """Project all meshes at once, strongest owner first."""
    check_order(order, len(meshes))
    ranked = [meshes[part] for part in order]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in ranked)])
    vertices = np.concatenate([np.zeros((0, 3)), *(mesh.vertices for mesh in ranked)])
    faces = [mesh.faces + start for mesh, start in zip(ranked, starts, strict=False)]
    corners = detector.tensor(np.concatenate([np.zeros((0, 3), dtype=np.int64), *faces]))
    points = _project(detector.tensor(vertices), detector)
    ahead = detector.geometry.source_cm is None or bool((points[:, DEPTH] > 0).all())
    if not (ahead and points.isfinite().all()):
        Surfaces.seen(meshes, order, detector.fine)  # raises where a triangle has such a vertex
    ranks = np.repeat(np.arange(1, len(ranked) + 1), [len(mesh.faces) for mesh in ranked])
    labels = detector.tensor(-ranks if detector.geometry.mirrored else ranks)
    return _ordered_by_row(points[corners], labels)


def _project(vertices: Points, detector: _Detector) -> Points:
    """Column, row and depth (cone: 1 / depth)."""
    fine = detector.fine
    origin = fine.pixel00_cm if fine.source_cm is None else fine.source_cm
    x, y, z = (vertices - detector.tensor(origin)).T
    # term by term: a matrix product may round equal points differently, and open a seam
    inverse = np.linalg.inv(fine.matrix).tolist()
    column, row, depth = (m[0] * x + m[1] * y + m[2] * z for m in inverse)
    if fine.source_cm is not None:
        depth = 1.0 / depth
        column, row = column * depth, row * depth
    return torch.stack([column, row, depth], dim=1)


def _ordered_by_row(triangles: Triangles, labels: Labels) -> tuple[Triangles, Labels]:
    """Order each triangle's vertices by row; each swap turns its label's sign."""
    corners = list(triangles.unbind(dim=1))
    for upper, lower in ((0, 1), (1, 2), (0, 1)):
        first, second = corners[upper], corners[lower]
        swap = second[:, ROW] < first[:, ROW]
        corners[upper] = torch.where(swap[:, None], second, first)
        corners[lower] = torch.where(swap[:, None], first, second)
        labels = torch.where(swap, -labels, labels)
    return torch.stack(corners, dim=1), labels


def _cut_by_rows(triangles: Triangles, labels: Labels, detector: _Detector) -> _Spans:
    """Cut triangles by rows: along a row one reaches from its long edge to a short one."""
    rows, columns = detector.fine.shape
    start = _first_not_before(triangles[:, 0, ROW], rows)
    of, place = _ragged(_first_not_before(triangles[:, 2, ROW], rows) - start)
    row = start[of] + place
    top, middle, bottom = triangles[of].unbind(dim=1)
    early = (row < middle[:, ROW])[:, None]
    long = _edge_at_row(top, bottom, row)
    short = _edge_at_row(torch.where(early, top, middle), torch.where(early, middle, bottom), row)
    swap = short[:, COLUMN] < long[:, COLUMN]
    left, right = (torch.where(swap[:, None], *two) for two in ((short, long), (long, short)))
    begin = _first_not_before(left[:, COLUMN], columns)
    count = _first_not_before(right[:, COLUMN], columns) - begin
    return _Spans(row, torch.where(swap, labels[of], -labels[of]), left, right, begin, count)


def _first_not_before(position: Floats, size: int) -> Integers:
    """First ray of ``size`` that is not before a position, or ``size``."""
    return position.ceil().clamp(0, size).long()


def _ragged(
    counts: Integers,
) -> tuple[Int64[torch.Tensor, "total"], Int64[torch.Tensor, "total"]]:
    """List each index as often as its count says, and which of its copies each is."""
    of = torch.repeat_interleave(counts)
    return of, torch.arange(len(of), device=of.device) - (counts.cumsum(0) - counts)[of]


def _edge_at_row(upper: Points, lower: Points, row: Integers) -> Points:
    """Where a row crosses an edge, always computed from its upper end."""
    share = (row - upper[:, ROW]) / (lower[:, ROW] - upper[:, ROW])
    return upper + share[:, None] * (lower - upper)


def _bands(spans: _Spans, detector: _Detector) -> Iterator[_Spans]:
    """Cut spans into bands of whole pixel rows of about ``CROSSINGS_AT_ONCE`` each."""
    pixel_row = spans.row // detector.subrays
    crossings = torch.zeros(detector.geometry.shape[0], dtype=torch.int64, device=detector.device)
    band = crossings.index_add_(0, pixel_row, spans.count).cumsum(0) // CROSSINGS_AT_ONCE
    for number in range(int(band[-1]) + 1):
        yield spans.chosen(band[pixel_row] == number)


def _cut_by_columns(spans: _Spans, detector: _Detector) -> _Crossings:
    """Cut spans by columns, and sort the crossings by ray and depth."""
    of, place = _ragged(spans.count)
    column = spans.begin[of] + place
    left, right = spans.left[of], spans.right[of]
    # the share is at most 1, so a grazing sliver cannot leave its own depth range
    share = (column - left[:, COLUMN]) / (right[:, COLUMN] - left[:, COLUMN])
    depth = left[:, DEPTH] + share * (right[:, DEPTH] - left[:, DEPTH])
    if detector.geometry.beam == "cone":
        depth = 1.0 / depth
    ray = detector.number(spans.row[of], column)
    by_depth = depth.argsort()
    sort = by_depth[ray[by_depth].argsort(stable=True)]
    return _Crossings(ray[sort], depth[sort], spans.label[of][sort])


def _walk(crossings: _Crossings, order: Int64[torch.Tensor, "parts"], detector: _Detector) -> _Band:
    """Give the way between two crossings of a ray to the strongest part open there."""
    each, parts = detector.subrays**2, len(order)
    unique = torch.unique_consecutive
    rays, of, counts = unique(crossings.ray, return_inverse=True, return_counts=True)
    pixels, pixel = unique(rays // each, return_inverse=True)
    owner, inside, torn = _owners(crossings, of, counts, parts)
    (stretch,) = ((inside[:-1] > 0) & (of[1:] == of[:-1])).nonzero(as_tuple=True)
    ray = of[stretch]
    depths = crossings.depth[stretch + 1] - crossings.depth[stretch]
    way = depths * detector.cm_per_depth(rays)[ray]
    slot = (pixel[ray] * each + rays[ray] % each) * parts + order[owner[stretch]]
    lengths = way.new_zeros(len(pixels) * each * parts).index_add_(0, slot, way)
    crowded = inside[stretch] > 1
    shared = way.new_zeros(len(pixels)).index_add_(0, pixel[ray[crowded]], way[crowded] / each)
    broken = torch.zeros_like(pixels, dtype=torch.bool)
    broken[pixel[torn]] = True
    lengths = lengths.view(len(pixels), each, parts)
    return pixels, lengths.float(), shared.float(), broken


def _owners(
    crossings: _Crossings,
    of: Int64[torch.Tensor, "crossings"],
    counts: Int64[torch.Tensor, "rays"],
    parts: int,
) -> tuple[
    Int64[torch.Tensor, "crossings"], Int64[torch.Tensor, "crossings"], Bool[torch.Tensor, "rays"]
]:
    """Find who owns the way after each crossing, how many are open, and which rays stay open.

    A part's counter is a sum over all crossings before, less its value where the ray begins.
    """
    last = counts.cumsum(0) - 1
    first = last - counts + 1
    rank, step = crossings.label.abs(), crossings.label.sign()
    owner, inside = torch.zeros_like(of), torch.zeros_like(of)
    torn = torch.zeros_like(counts, dtype=torch.bool)
    for part in range(parts):
        mine = torch.where(rank == part + 1, step, 0)
        winding = mine.cumsum(0)
        winding -= (winding - mine)[first][of]
        torn |= winding[last] != 0
        inward = winding > 0
        owner.masked_fill_(inward & (inside == 0), part)
        inside += inward
    return owner, inside, torn
