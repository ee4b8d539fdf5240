"""Compiled kernels: where rays cross surfaces, and who owns the way between two crossings.

All of them stand in one file because numba's cache watches the file of the outermost function
only. None uses fast math: two triangles that share an edge must compute the same number for it.
"""

from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int16, Int32, Int64, Shaped, UInt8

from xden1k.errors import require

__all__ = [
    "add_depths",
    "count",
    "extent",
    "gather",
    "give_lengths",
    "key_of",
    "mark",
    "mean_transmission",
    "over_pixel",
    "pixel_of",
    "project",
    "scan",
    "walk_fill",
    "walk_labels",
    "walk_lengths",
]

compiled = require("numba", "build").njit(cache=True, nogil=True)

COLUMN, ROW, DEPTH = 0, 1, 2
TINY = 1e-12
"""Rows or columns: what is closer together stands in no ray's way."""
LEAST_DEPTH = 1e-11
"""Rounding usually leaves less of the depths of one ray, where it should leave nothing."""
MOST_INSERTED = 64
"""Crossings sorted by insertion; its time grows with their square."""
Window = tuple[int, int, int, int]


@compiled
@no_type_check
def project(
    vertices: Float64[np.ndarray, "v 3"],
    origin: Float64[np.ndarray, "3"],
    inverse: Float64[np.ndarray, "3 3"],
    cone: bool,
    projected: Float64[np.ndarray, "v 3"],
) -> bool:
    """Write column, row and depth (cone: 1 / depth) of each vertex.

    Equal points give equal numbers wherever they stand in the array, or duplicate vertices would
    open a seam. A point of a cone that is not in front of the source keeps its depth, 0 or less.

    Parameters
    ----------
    vertices
        In cm.
    origin, inverse
        Of the detector's frame.
    cone
        Whether rays leave the origin.
    projected
        Written.

    Returns
    -------
    bool
        Whether all vertices are finite.
    """
    finite = True
    for i in range(len(vertices)):
        x = vertices[i, 0] - origin[0]
        y = vertices[i, 1] - origin[1]
        z = vertices[i, 2] - origin[2]
        finite &= np.isfinite(x) and np.isfinite(y) and np.isfinite(z)
        for axis in range(3):
            place = inverse[axis, 0] * x + inverse[axis, 1] * y + inverse[axis, 2] * z
            projected[i, axis] = place
        if cone and projected[i, DEPTH] > 0:
            projected[i, DEPTH] = 1.0 / projected[i, DEPTH]
            projected[i, COLUMN] *= projected[i, DEPTH]
            projected[i, ROW] *= projected[i, DEPTH]
    return finite


@compiled
@no_type_check
def gather(
    projected: Float64[np.ndarray, "v 3"],
    faces: Int64[np.ndarray, "f 3"],
    rank: int,
    triangles: Float64[np.ndarray, "f 3 3"],
    labels: Int16[np.ndarray, "f"],
) -> int:
    """Write triangles with their vertices ordered by row; each swap turns the label's sign.

    Returns
    -------
    int
        Number of triangles with a depth that is not positive.
    """
    behind = 0
    for i in range(len(faces)):
        first, second, third = faces[i, 0], faces[i, 1], faces[i, 2]
        label = rank
        if projected[second, ROW] < projected[first, ROW]:
            first, second, label = second, first, -label
        if projected[third, ROW] < projected[second, ROW]:
            second, third, label = third, second, -label
        if projected[second, ROW] < projected[first, ROW]:
            first, second, label = second, first, -label
        for axis in range(3):
            triangles[i, 0, axis] = projected[first, axis]
            triangles[i, 1, axis] = projected[second, axis]
            triangles[i, 2, axis] = projected[third, axis]
        labels[i] = label
        nearest = min(projected[first, DEPTH], projected[second, DEPTH], projected[third, DEPTH])
        behind += nearest <= 0
    return behind


@compiled
@no_type_check
def extent(triangles: Float64[np.ndarray, "n 3 3"]) -> tuple[float, float, float, float]:
    """Least and most row, least and most column of vertices that are ordered by row."""
    first_row, last_row = np.inf, -np.inf
    first_column, last_column = np.inf, -np.inf
    for i in range(len(triangles)):
        first_row = min(first_row, triangles[i, 0, ROW])
        last_row = max(last_row, triangles[i, 2, ROW])
        for vertex in range(3):
            first_column = min(first_column, triangles[i, vertex, COLUMN])
            last_column = max(last_column, triangles[i, vertex, COLUMN])
    return first_row, last_row, first_column, last_column


@compiled
@no_type_check
def _along(share: float, start: float, end: float) -> float:
    """Value a share of the way from start to end."""
    return start + share * (end - start)


@compiled
@no_type_check
def _between(low: float, high: float, first: int, end: int) -> tuple[int, int]:
    """First and end of the whole numbers in a half-open interval, cut to a window.

    Both are cut on either side: next to the source a projection leaves the integers.
    """
    return int(min(max(np.ceil(low), first), end)), int(max(min(np.ceil(high), end), first))


@compiled
@no_type_check
def count(
    triangles: Float64[np.ndarray, "n 3 3"],
    window: Window,
    cells: Int32[np.ndarray, "rows columns"],
) -> None:
    """Write the number of crossings of each ray, cut as by :func:`scan`.

    A triangle that meets a row adds one where it begins and takes it away where it ends; the sums
    along the row are the numbers.

    Parameters
    ----------
    triangles, window
        As of :func:`scan`.
    cells
        Of the rays of the window: zero on entry, written.
    """
    first_row, end_row, first_column, end_column = window
    for i in range(len(triangles)):
        upper, middle, lower = triangles[i, 0, ROW], triangles[i, 1, ROW], triangles[i, 2, ROW]
        columns = triangles[i, 0, COLUMN], triangles[i, 1, COLUMN], triangles[i, 2, COLUMN]
        start, stop = _between(upper, lower, first_row, end_row)
        for row in range(start, stop):
            long = _along((row - upper) / (lower - upper), columns[0], columns[2])
            if row < middle:
                short = _along((row - upper) / (middle - upper), columns[0], columns[1])
            else:
                short = _along((row - middle) / (lower - middle), columns[1], columns[2])
            begin, end = _between(min(long, short), max(long, short), first_column, end_column)
            if begin < end:
                cells[row - first_row, begin - first_column] += 1
                if end < end_column:
                    cells[row - first_row, end - first_column] -= 1
    for i in range(cells.shape[0]):
        for j in range(1, cells.shape[1]):
            cells[i, j] += cells[i, j - 1]


@compiled
@no_type_check
def scan(
    triangles: Float64[np.ndarray, "n 3 3"],
    labels: Int16[np.ndarray, "n"],
    inverse_depth: bool,
    window: Window,
    cells: Int32[np.ndarray, "rows columns"],
    depths: Float64[np.ndarray, "crossings"],
    crossed: Int16[np.ndarray, "crossings"],
) -> None:
    """Scan conversion of triangles whose vertices are ordered by row.

    A row is cut by the long edge (first to last vertex) and one short edge, each always followed
    from its upper end. With an edge of a closed mesh shared by two triangles of opposite parity,
    and the sign of a triangle taken from the order in which its two edges are met, the signs along
    each ray sum to zero whatever the rounding. Half-open intervals (``ceil``) give a ray through a
    vertex or an edge to one side.

    Parameters
    ----------
    triangles
        Column, row and depth of each vertex; depth must be affine in column and row.
    labels
        Rank of the part, from 1, negative after an odd number of swaps; the contrary on a detector
        that is mirrored.
    inverse_depth
        Whether the third coordinate is 1 / depth, as perspective asks for.
    window
        First and end row, first and end column.
    cells
        For each ray of the window the end of its list before, and its start after.
    depths, crossed
        Depth of each crossing, and the part's rank: positive on entering, negative on leaving.
    """
    first_row, end_row, first_column, end_column = window
    for i in range(len(triangles)):
        # copied out, since a loop that writes arrays would read them anew for each row
        upper, middle, lower = triangles[i, 0, ROW], triangles[i, 1, ROW], triangles[i, 2, ROW]
        columns = triangles[i, 0, COLUMN], triangles[i, 1, COLUMN], triangles[i, 2, COLUMN]
        thirds = triangles[i, 0, DEPTH], triangles[i, 1, DEPTH], triangles[i, 2, DEPTH]
        start, stop = _between(upper, lower, first_row, end_row)
        for row in range(start, stop):
            label, share = -labels[i], (row - upper) / (lower - upper)
            left = _along(share, columns[0], columns[2])
            left_depth = _along(share, thirds[0], thirds[2])
            if row < middle:
                share = (row - upper) / (middle - upper)
                right = _along(share, columns[0], columns[1])
                right_depth = _along(share, thirds[0], thirds[1])
            else:
                share = (row - middle) / (lower - middle)
                right = _along(share, columns[1], columns[2])
                right_depth = _along(share, thirds[1], thirds[2])
            if right < left:
                left, left_depth, right, right_depth = right, right_depth, left, left_depth
                label = -label
            begin, end = _between(left, right, first_column, end_column)
            for column in range(begin, end):
                slot = cells[row - first_row, column - first_column] - 1
                cells[row - first_row, column - first_column] = slot
                # the share is at most 1, so a grazing sliver cannot leave its own depth range
                depth = _along((column - left) / (right - left), left_depth, right_depth)
                depths[slot] = 1.0 / depth if inverse_depth else depth
                crossed[slot] = label


@compiled
@no_type_check
def _sort_by_depth(
    depths: Float64[np.ndarray, "crossings"],
    crossed: Int16[np.ndarray, "crossings"],
    begin: int,
    end: int,
) -> None:
    """Sort one ray's crossings, equal ones as they came: most lists are short."""
    if end - begin > MOST_INSERTED:
        order = np.argsort(depths[begin:end], kind="mergesort")
        depths[begin:end] = depths[begin:end][order]
        crossed[begin:end] = crossed[begin:end][order]
        return
    for j in range(begin + 1, end):
        depth, label = depths[j], crossed[j]
        above = depths[j - 1]
        while above > depth:
            depths[j], crossed[j] = above, crossed[j - 1]
            j -= 1
            above = depths[j - 1] if j > begin else -np.inf
        depths[j], crossed[j] = depth, label


@compiled
@no_type_check
def _cross(
    windings: Int32[np.ndarray, "parts"], label: int, owner: int, inside: int, uneven: int
) -> tuple[int, int, int]:
    """Step over one surface.

    Returns
    -------
    tuple
        The strongest part now open (or the number of parts), how many are, and how many have been
        left less or more often than entered.
    """
    rank = abs(label) - 1
    before = windings[rank]
    after = before + (1 if label > 0 else -1)
    windings[rank] = after
    uneven += (after != 0) - (before != 0)
    if before == 0 and label > 0:
        return min(owner, rank), inside + 1, uneven
    if before == 1 and label < 0:
        while owner < len(windings) and windings[owner] <= 0:
            owner += 1
        return owner, inside - 1, uneven
    return owner, inside, uneven


@compiled
@no_type_check
def _cm_per_depth(frame: Float64[np.ndarray, "3 3"], row: int, column: int) -> float:
    """Length of a ray's vector, as ``ViewGeometry.cm_per_depth`` gives it for whole arrays."""
    square = 0.0
    for axis in range(3):
        along = column * frame[axis, 0] + row * frame[axis, 1] + frame[axis, 2]
        square += along * along
    return np.sqrt(square)


@compiled
@no_type_check
def over_pixel(row: int, column: int, along: int, across: int) -> tuple[int, int]:
    """Row and column of a ray in pixels, times twice the rays of one; see ``lattice.Lattice``."""
    below = 2 * (along * row + across * column)
    beside = 2 * (along * column - across * row)
    if across == 0:
        return below, beside
    rays = along * along + across * across
    half = (rays + 1) % 2  # of an even number of rays the first stands half a column beside
    return below + rays + across * half, beside + rays + along * half


@compiled
@no_type_check
def key_of(below: int, beside: int, along: int, across: int) -> int:
    """Tell the rays of a pixel apart by where they stand, as of :func:`over_pixel`.

    Below twice their number. On a turned lattice no two of them stand in one row.
    """
    return below if across > 0 else below + beside // along


@compiled
@no_type_check
def pixel_of(row: int, column: int, along: int, across: int) -> tuple[int, int]:
    """Row and column of the pixel in which a ray of a lattice stands."""
    below, beside = over_pixel(row, column, along, across)
    whole = 2 * (along * along + across * across)
    return below // whole, beside // whole


@compiled
@no_type_check
def mark(
    counts: Shaped[np.ndarray, "rows columns"],
    window: Window,
    along: int,
    across: int,
    met: Bool[np.ndarray, "image_rows image_columns"],
) -> None:
    """Mark the pixels of which a ray has a crossing.

    Parameters
    ----------
    counts
        Of the rays of a window: how many each has, or whether it has any.
    window
        First and end row, first and end column.
    along, across
        Of ``lattice.Lattice``.
    met
        By pixel: written.
    """
    whole = 2 * (along * along + across * across)
    for i in range(counts.shape[0]):
        below, beside = over_pixel(i + window[0], window[2], along, across)
        row, column = below // whole, beside // whole
        below, beside = below - row * whole, beside - column * whole
        for j in range(counts.shape[1]):
            if counts[i, j] > 0 and 0 <= row < met.shape[0] and 0 <= column < met.shape[1]:
                met[row, column] = True
            below, beside = below + 2 * across, beside + 2 * along
            if below >= whole:
                below, row = below - whole, row + 1
            if beside >= whole:
                beside, column = beside - whole, column + 1


@compiled
@no_type_check
def walk_lengths(
    pixels: Int64[np.ndarray, "pixels"],
    columns: int,
    along: int,
    across: int,
    places: Int64[np.ndarray, "rays 2"],
    window: Window,
    frame: Float64[np.ndarray, "3 3"],
    order: Int64[np.ndarray, "parts"],
    cells: Int32[np.ndarray, "rows columns"],
    depths: Float64[np.ndarray, "crossings"],
    crossed: Int16[np.ndarray, "crossings"],
    lengths: Float32[np.ndarray, "pixels rays parts"],
    shared: Float64[np.ndarray, "pixels"],
    broken: Bool[np.ndarray, "pixels"],
) -> None:
    """Walk each ray's sorted crossings and give every stretch to the strongest open part.

    Parameters
    ----------
    pixels, columns
        Flat indices of the pixels, and how many stand in a row.
    along, across, places
        Of ``lattice.Lattice``.
    window, cells, depths, crossed
        What :func:`scan` stored; each ray's list is sorted here.
    frame
        Columns: what a step in column, in row, and none at all adds to the ray's vector per depth.
    order
        Indices of the parts, strongest first.
    lengths, shared, broken
        Results, zero on entry: cm for each part, cm covered twice or more (mean over the rays),
        and whether a surface stayed open.
    """
    first_row, end_row, first_column, end_column = window
    width = end_column - first_column
    flat = cells.ravel()
    windings = np.zeros(len(order), dtype=np.int32)
    for i in range(len(pixels)):
        below = pixels[i] // columns
        beside = pixels[i] - below * columns
        top, left = along * below - across * beside, along * beside + across * below
        for ray in range(len(places)):
            row, column = top + places[ray, 0], left + places[ray, 1]
            if not (first_row <= row < end_row and first_column <= column < end_column):
                continue
            cell = (row - first_row) * width + column - first_column
            begin = flat[cell]
            end = flat[cell + 1] if cell + 1 < len(flat) else len(depths)
            if begin == end:
                continue
            _sort_by_depth(depths, crossed, begin, end)
            cm_per_depth = _cm_per_depth(frame, row, column)
            owner, inside, uneven = len(order), 0, 0
            for j in range(begin, end):
                if inside > 0:
                    span = cm_per_depth * (depths[j] - depths[j - 1])
                    lengths[i, ray, order[owner]] += span
                    if inside > 1:
                        shared[i] += span / len(places)
                owner, inside, uneven = _cross(windings, crossed[j], owner, inside, uneven)
            if uneven > 0:
                broken[i] = True
                windings[:] = 0


@compiled
@no_type_check
def add_depths(
    triangles: Float64[np.ndarray, "n 3 3"],
    labels: Int16[np.ndarray, "n"],
    inverse_depth: bool,
    window: Window,
    depths: Float64[np.ndarray, "rows columns"],
) -> None:
    """Add the depths at which rays leave one part, less those at which they enter it.

    That is their way through it, in any order of the crossings. Triangles are cut as by
    :func:`scan`: an edge is followed from its upper end, by numbers that are its own alone, so
    that two triangles beside each other agree about it.

    Parameters
    ----------
    triangles, labels, inverse_depth, window
        As of :func:`scan`, of one part.
    depths
        Of the rays of the window, contiguous: added to.
    """
    first_row, end_row, first_column, end_column = window
    flat, width = depths.reshape(-1), end_column - first_column
    for i in range(len(triangles)):
        upper, middle, lower = triangles[i, 0, ROW], triangles[i, 1, ROW], triangles[i, 2, ROW]
        start, stop = _between(upper, lower, first_row, end_row)
        if start >= stop:
            continue
        turn, _ = _between(middle, middle, start, stop)
        columns = triangles[i, 0, COLUMN], triangles[i, 1, COLUMN], triangles[i, 2, COLUMN]
        thirds = triangles[i, 0, DEPTH], triangles[i, 1, DEPTH], triangles[i, 2, DEPTH]
        sign = 1.0 if labels[i] > 0 else -1.0
        long = _edge(upper, lower, columns[0], columns[2], thirds[0], thirds[2])
        short = _edge(upper, middle, columns[0], columns[1], thirds[0], thirds[1])
        for row in range(start, stop):
            if row == turn:
                short = _edge(middle, lower, columns[1], columns[2], thirds[1], thirds[2])
            left, left_depth = _met(long, row)
            right, right_depth = _met(short, row)
            way = sign
            if right < left:
                left, left_depth, right, right_depth = right, right_depth, left, left_depth
                way = -sign
            begin, end = _between(left, right, first_column, end_column)
            if begin < end:
                rise = (right_depth - left_depth) / max(right - left, TINY)
                depth = left_depth + (begin - left) * rise
                cell = (row - first_row) * width - first_column
                line = flat[cell + begin : cell + end]
                for k in range(len(line)):
                    here = depth + k * rise
                    line[k] += way / here if inverse_depth else way * here


@compiled
@no_type_check
def _edge(
    upper: float, lower: float, start: float, end: float, depth: float, end_depth: float
) -> tuple[float, float, float, float, float]:
    """Row, column and depth of an edge's upper end, and what the latter two change by a row."""
    per_row = 1.0 / max(lower - upper, TINY)
    return upper, start, depth, (end - start) * per_row, (end_depth - depth) * per_row


@compiled
@no_type_check
def _met(edge: tuple[float, float, float, float, float], row: int) -> tuple[float, float]:
    """Column and depth at which a row meets an edge."""
    rows = row - edge[0]
    return edge[1] + rows * edge[3], edge[2] + rows * edge[4]


@compiled
@no_type_check
def give_lengths(
    depths: Float64[np.ndarray, "rows columns"],
    window: Window,
    along: int,
    across: int,
    numbers: Int64[np.ndarray, "keys"],
    frame: Float64[np.ndarray, "3 3"],
    places: Int64[np.ndarray, "image_rows image_columns"],
    lengths: Float32[np.ndarray, "pixels rays"],
) -> None:
    """Write the length of each ray through one part.

    Parameters
    ----------
    depths, window
        What :func:`add_depths` summed.
    along, across, numbers
        Of ``lattice.Lattice``.
    frame
        As of :func:`walk_lengths`.
    places
        Number of each pixel among those that are listed.
    lengths
        Of these in cm: zero on entry, written.
    """
    whole = 2 * (along * along + across * across)
    for i in range(depths.shape[0]):
        below, beside = over_pixel(i + window[0], window[2], along, across)
        row, column = below // whole, beside // whole
        below, beside = below - row * whole, beside - column * whole
        for j in range(depths.shape[1]):
            depth = depths[i, j]
            if depth > LEAST_DEPTH:
                inside = 0 <= row < places.shape[0] and 0 <= column < places.shape[1]
                if inside:
                    ray = numbers[key_of(below, beside, along, across)]
                    cm_per_depth = _cm_per_depth(frame, i + window[0], j + window[2])
                    lengths[places[row, column], ray] = depth * cm_per_depth
            below, beside = below + 2 * across, beside + 2 * along
            if below >= whole:
                below, row = below - whole, row + 1
            if beside >= whole:
                beside, column = beside - whole, column + 1


@compiled
@no_type_check
def mean_transmission(
    lengths: Float32[np.ndarray, "pixels rays parts"], lac_per_cm: Float64[np.ndarray, "parts"]
) -> Float64[np.ndarray, "pixels"]:
    """Mean over each pixel's rays of exp(-sum of LAC * length)."""
    pixels, rays, parts = lengths.shape
    means = np.zeros(pixels)
    for i in range(pixels):
        for ray in range(rays):
            attenuation = 0.0
            for part in range(parts):
                attenuation += lac_per_cm[part] * lengths[i, ray, part]
            means[i] += np.exp(-attenuation) / rays
    return means


@compiled
@no_type_check
def walk_fill(
    window: Window,
    subsamples: int,
    voxel_size: float,
    order: Int64[np.ndarray, "parts"],
    boxes: Int64[np.ndarray, "parts 2 3"],
    cells: Int32[np.ndarray, "rows columns"],
    depths: Float64[np.ndarray, "crossings"],
    crossed: Int16[np.ndarray, "crossings"],
    fill: Float64[np.ndarray, "voxels"],
) -> int:
    """Add to each voxel the height its owner fills of it, summed over the rays along z.

    Rays form a square lattice turned against the voxels (see ``voxels.part_fractions``): the ray
    in row r, column c stands at x = (S c - r) / N, y = (c + S r) / N voxels, N = S² + 1.

    Parameters
    ----------
    window, order, cells, depths, crossed
        As for :func:`walk_lengths`.
    subsamples
        S.
    voxel_size
        What a voxel measures in units of depth.
    boxes
        First and end voxel of each part's crop.
    fill
        The parts' crops, one after the other, in C order; added to.

    Returns
    -------
    int
        Rays that left a part they never entered, or the contrary.
    """
    first_row, end_row, first_column, end_column = window
    rays, per_depth = subsamples * subsamples + 1, 1.0 / voxel_size
    flat = cells.ravel()
    windings = np.zeros(len(order), dtype=np.int32)
    offsets = np.zeros(len(order), dtype=np.int64)
    for part in range(1, len(order)):
        x, y, z = boxes[part - 1, 1] - boxes[part - 1, 0]
        offsets[part] = offsets[part - 1] + x * y * z
    steps = np.zeros(len(fill), dtype=np.int32)
    broken = 0
    cell = -1
    for row in range(first_row, end_row):
        # of a ray's voxel, numerators of (S c - r) / N and (c + S r) / N, halves rounded up
        over_x = subsamples * (first_column - 1) - row + rays // 2
        over_y = first_column - 1 + subsamples * row + rays // 2
        x, y = over_x // rays, over_y // rays
        over_x, over_y = over_x - x * rays, over_y - y * rays
        for _ in range(first_column, end_column):
            cell += 1
            over_x, over_y = over_x + subsamples, over_y + 1
            if over_x >= rays:
                over_x, x = over_x - rays, x + 1
            if over_y >= rays:
                over_y, y = over_y - rays, y + 1
            begin = flat[cell]
            end = flat[cell + 1] if cell + 1 < len(flat) else len(depths)
            if begin == end:
                continue
            _sort_by_depth(depths, crossed, begin, end)
            owner, inside, uneven = len(order), 0, 0
            high = 0.0
            for j in range(begin, end):
                low, high = high, depths[j] * per_depth
                if inside > 0:
                    part = order[owner]
                    _deposit(fill, steps, offsets[part], boxes, part, x, y, low, high)
                owner, inside, uneven = _cross(windings, crossed[j], owner, inside, uneven)
            if uneven > 0:
                broken += 1
                windings[:] = 0
    _fill_up(fill, steps, boxes)
    return broken


@compiled
@no_type_check
def _deposit(
    fill: Float64[np.ndarray, "voxels"],
    steps: Int32[np.ndarray, "voxels"],
    offset: int,
    boxes: Int64[np.ndarray, "parts 2 3"],
    part: int,
    x: int,
    y: int,
    low: float,
    high: float,
) -> None:
    """Add the stretch from low to high (voxel k reaches from k - 1/2 to k + 1/2) to one column.

    Its ends go to ``fill``. Of the voxels between, which it fills, ``steps`` gets the first, and
    less the one behind the last.
    """
    x, y = x - boxes[part, 0, 0], y - boxes[part, 0, 1]
    breadth, depth = boxes[part, 1, 0] - boxes[part, 0, 0], boxes[part, 1, 1] - boxes[part, 0, 1]
    if not (0 <= x < breadth and 0 <= y < depth):
        return
    first, end = boxes[part, 0, 2], boxes[part, 1, 2]
    base = offset + (x * depth + y) * (end - first) - first
    bottom, top = int(np.floor(low + 0.5)), int(np.ceil(high - 0.5))
    if first <= bottom < end:
        fill[base + bottom] += min(high, bottom + 0.5) - low
    if bottom < top and first <= top < end:
        fill[base + top] += high - (top - 0.5)
    start, stop = max(bottom + 1, first), min(top, end)
    if start < stop:
        steps[base + start] += 1
        if stop < end:
            steps[base + stop] -= 1


@compiled
@no_type_check
def _fill_up(
    fill: Float64[np.ndarray, "voxels"],
    steps: Int32[np.ndarray, "voxels"],
    boxes: Int64[np.ndarray, "parts 2 3"],
) -> None:
    """Add the voxels that stretches filled from end to end."""
    voxel = 0
    for part in range(len(boxes)):
        x, y, z = boxes[part, 1] - boxes[part, 0]
        for _ in range(x * y):
            filled = 0
            for _ in range(z):
                filled += steps[voxel]
                fill[voxel] += filled
                voxel += 1


@compiled
@no_type_check
def walk_labels(
    window: Window,
    voxel_size: float,
    order: Int64[np.ndarray, "parts"],
    cells: Int32[np.ndarray, "rows columns"],
    depths: Float64[np.ndarray, "crossings"],
    crossed: Int16[np.ndarray, "crossings"],
    labels: UInt8[np.ndarray, "x y z"],
) -> int:
    """Label each voxel with the owner of its centre, from 1; the rays run along z through centres.

    Parameters and return value as for :func:`walk_fill`; the window lies inside the grid.
    """
    first_row, end_row, first_column, end_column = window
    flat = cells.ravel()
    windings = np.zeros(len(order), dtype=np.int32)
    broken = 0
    cell = -1
    for y in range(first_row, end_row):
        for x in range(first_column, end_column):
            cell += 1
            begin = flat[cell]
            end = flat[cell + 1] if cell + 1 < len(flat) else len(depths)
            _sort_by_depth(depths, crossed, begin, end)
            owner, inside, uneven = len(order), 0, 0
            for j in range(begin, end):
                if inside > 0:
                    start = max(int(np.ceil(depths[j - 1] / voxel_size)), 0)
                    stop = min(int(np.ceil(depths[j] / voxel_size)), labels.shape[2])
                    labels[x, y, start:stop] = order[owner] + 1
                owner, inside, uneven = _cross(windings, crossed[j], owner, inside, uneven)
            if uneven > 0:
                broken += 1
                windings[:] = 0
    return broken
