"""Compiled kernels: columns through a mesh, labels of a volume, and the nets around them.

All of them stand in one file because numba's cache watches the file of the outermost function
only.
"""

from typing import no_type_check

import numpy as np
from jaxtyping import Float32, Float64, Int8, Int16, Int32, Int64, UInt8

from xden1k.errors import require

__all__ = [
    "assign",
    "cells",
    "cross",
    "near_levels",
    "plateaus",
    "pool",
    "pool_parts",
    "quads",
    "sides",
    "volumes",
    "vote",
    "ways",
]

compiled = require("numba", "build").njit(cache=True, nogil=True)


@compiled
@no_type_check
def cross(
    vertices: Float64[np.ndarray, "v 3"],
    faces: Int64[np.ndarray, "f 3"],
    axis: int,
    offset: float,
    parity: UInt8[np.ndarray, "u v steps"],
    winding: Int16[np.ndarray, "u v steps"],
) -> None:
    """Mark where the columns along an axis cross a surface.

    Parameters
    ----------
    vertices
        In voxels: the centre of voxel i lies at i + 1/2.
    faces
        Vertex indices.
    axis
        Of the columns; u and v are the next two in cyclic order.
    offset
        Of the columns from the centres of the voxels, so that they meet no vertex and no edge.
    parity, winding
        Flipped, and raised or lowered, at the first voxel centre beyond each crossing.
    """
    side, steps = parity.shape[0], parity.shape[2] - 1
    b, c = (axis + 1) % 3, (axis + 2) % 3
    for f in range(len(faces)):
        p, q, r = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        area = (q[b] - p[b]) * (r[c] - p[c]) - (q[c] - p[c]) * (r[b] - p[b])
        if area == 0:
            continue
        shift = 0.5 + offset
        first_u = max(int(np.ceil(min(p[b], q[b], r[b]) - shift)), 0)
        last_u = min(int(np.floor(max(p[b], q[b], r[b]) - shift)), side - 1)
        first_v = max(int(np.ceil(min(p[c], q[c], r[c]) - shift)), 0)
        last_v = min(int(np.floor(max(p[c], q[c], r[c]) - shift)), side - 1)
        for i in range(first_u, last_u + 1):
            u = i + shift
            for j in range(first_v, last_v + 1):
                v = j + shift
                at_p = ((q[b] - u) * (r[c] - v) - (q[c] - v) * (r[b] - u)) / area
                at_q = ((r[b] - u) * (p[c] - v) - (r[c] - v) * (p[b] - u)) / area
                at_r = ((p[b] - u) * (q[c] - v) - (p[c] - v) * (q[b] - u)) / area
                if at_p < 0 or at_q < 0 or at_r < 0:
                    continue
                depth = at_p * p[axis] + at_q * q[axis] + at_r * r[axis]
                step = min(max(int(np.ceil(depth - 0.5)), 0), steps)
                parity[i, j, step] ^= 1
                winding[i, j, step] += -1 if area > 0 else 1


@compiled
@no_type_check
def vote(
    parity: UInt8[np.ndarray, "u v steps"],
    winding: Int16[np.ndarray, "u v steps"],
    votes: Int8[np.ndarray, "u v n"],
) -> None:
    """Add what each column says of its voxels: positive for inside, negative for outside.

    A column that crosses the surface an odd number of times says nothing. One whose crossings
    balance speaks twice as loud where the number of turns agrees with the parity, and not at all
    where it does not: bodies overlap there.
    """
    for i in range(parity.shape[0]):
        for j in range(parity.shape[1]):
            odd, turns = 0, 0
            for k in range(parity.shape[2]):
                odd ^= parity[i, j, k]
                turns += winding[i, j, k]
            if odd:
                continue
            balanced = turns == 0
            inside, turns = 0, 0
            for k in range(votes.shape[2]):
                inside ^= parity[i, j, k]
                turns += winding[i, j, k]
                weight = 1
                if balanced:
                    weight = 2 if (turns != 0) == (inside == 1) else 0
                votes[i, j, k] += weight if inside else -weight


@compiled
@no_type_check
def near_levels(
    volume: Float32[np.ndarray, "x y z"],
    levels: Float64[np.ndarray, "k"],
    tolerance: float,
    near: UInt8[np.ndarray, "x y z"],
) -> None:
    """Write the level, counted from 1, that each voxel has within a share; 0 = none."""
    for i in range(volume.shape[0]):
        for j in range(volume.shape[1]):
            for k in range(volume.shape[2]):
                value = volume[i, j, k]
                if value < levels[0] * (1 - tolerance):
                    continue
                for place in range(len(levels)):
                    if abs(value - levels[place]) <= tolerance * levels[place]:
                        near[i, j, k] = place + 1
                        break


@compiled
@no_type_check
def plateaus(
    volume: Float32[np.ndarray, "x y z"],
    least: float,
    tolerance: float,
    flat: UInt8[np.ndarray, "x y z"],
) -> None:
    """Mark voxels that share their value with their neighbours.

    With five of six: 1. With four, where no neighbour among 26 has more, so that it is no edge of
    something stronger: 2, a sheet.

    Parameters
    ----------
    volume
        Values, with a margin of air.
    least
        Value below which nothing is marked.
    tolerance
        Share of a value within which another is equal.
    flat
        Written.
    """
    for i in range(1, volume.shape[0] - 1):
        for j in range(1, volume.shape[1] - 1):
            for k in range(1, volume.shape[2] - 1):
                value = volume[i, j, k]
                if value < least:
                    continue
                most = value * (1 + tolerance)
                equal, top = 0, True
                for di in range(-1, 2):
                    for dj in range(-1, 2):
                        for dk in range(-1, 2):
                            other = volume[i + di, j + dj, k + dk]
                            top = top and other <= most
                            beside = abs(di) + abs(dj) + abs(dk) == 1
                            equal += beside and abs(other - value) <= tolerance * value
                if equal >= 5:
                    flat[i, j, k] = 1
                elif equal == 4 and top:
                    flat[i, j, k] = 2


@compiled
@no_type_check
def assign(
    volume: Float32[np.ndarray, "x y z"],
    levels: Float64[np.ndarray, "k"],
    near: UInt8[np.ndarray, "x y z"],
    steps: Int64[np.ndarray, "steps 3"],
    floor: float,
    labels: UInt8[np.ndarray, "x y z"],
    share: Float32[np.ndarray, "x y z"],
    guessed: Float64[np.ndarray, "k"],
) -> None:
    """Give each voxel above a floor to a level, and the share of it that is filled.

    A voxel that has a level's value as two of its six neighbours do is that level's. What lies
    between two levels belongs to the nearer one in value; at the air, to the next one that is not
    below it, the nearest in space first. Where none is near, as in a sheet that fills no voxel, to
    the next one that is not below the fullest of the voxels around.

    Parameters
    ----------
    volume
        Values, with a margin of air as wide as the steps.
    levels
        Ascending.
    near
        Of :func:`near_levels`.
    steps
        To the voxels that are looked at, the nearest first; the first 26 are the neighbours.
    floor
        Value up to which a voxel is air.
    labels, share
        Written: the level, counted from 1 (0 = air), and 0 to 1.
    guessed
        Raised: what each level got for want of a voxel of its own near by.
    """
    sides = volume.shape
    for i in range(2, sides[0] - 2):
        for j in range(2, sides[1] - 2):
            for k in range(2, sides[2] - 2):
                value = volume[i, j, k]
                if value <= floor:
                    continue
                own = near[i, j, k]
                if own:
                    like = 0
                    for s in range(6):
                        like += near[i + steps[s, 0], j + steps[s, 1], k + steps[s, 2]] == own
                    if like >= 2:
                        labels[i, j, k] = own
                        share[i, j, k] = 1.0
                        continue
                below, above, air, fullest = 0, 0, False, value
                for s in range(len(steps)):
                    a, b, c = i + steps[s, 0], j + steps[s, 1], k + steps[s, 2]
                    if s < 26:
                        air = air or volume[a, b, c] <= floor
                    found = near[a, b, c]
                    if found == 0:
                        fullest = max(fullest, volume[a, b, c])
                    if found and levels[found - 1] >= value * 0.996:
                        above = found if above == 0 else above
                    elif found:
                        below = found if below == 0 else below
                alone = above == 0
                if alone:
                    most = fullest if air else value
                    above = min(np.searchsorted(levels, most * 0.996) + 1, len(levels))
                if below and not air and value < (levels[below - 1] + levels[above - 1]) / 2:
                    above, alone = below, False
                labels[i, j, k] = above
                share[i, j, k] = min(value / levels[above - 1], 1.0) if air else 1.0
                if alone:
                    guessed[above - 1] += share[i, j, k]


@compiled
@no_type_check
def volumes(
    labels: UInt8[np.ndarray, "x y z"],
    share: Float32[np.ndarray, "x y z"],
    total: Float64[np.ndarray, "labels"],
) -> None:
    """Add up how much of each label's voxels is filled."""
    for i in range(labels.shape[0]):
        for j in range(labels.shape[1]):
            for k in range(labels.shape[2]):
                total[labels[i, j, k]] += share[i, j, k]


@compiled
@no_type_check
def sides(labels: UInt8[np.ndarray, "x y z"], count: Int64[np.ndarray, "labels"]) -> None:
    """Count the sides of each label's voxels behind which another label begins."""
    for i in range(labels.shape[0]):
        for j in range(labels.shape[1]):
            for k in range(labels.shape[2]):
                here = labels[i, j, k]
                for axis in range(3):
                    a, b, c = i + (axis == 0), j + (axis == 1), k + (axis == 2)
                    if a == labels.shape[0] or b == labels.shape[1] or c == labels.shape[2]:
                        continue
                    there = labels[a, b, c]
                    if here != there:
                        count[here] += 1
                        count[there] += 1


@compiled
@no_type_check
def pool(
    values: Float32[np.ndarray, "x y z"],
    pooled: Float32[np.ndarray, "i j k"],
) -> None:
    """Write the means over blocks of 2 x 2 x 2; an odd layer at the end is left out."""
    for i in range(pooled.shape[0]):
        for j in range(pooled.shape[1]):
            for k in range(pooled.shape[2]):
                total = np.float32(0)
                for row in range(4):
                    a, b = 2 * i + (row >> 1), 2 * j + (row & 1)
                    total += values[a, b, 2 * k] + values[a, b, 2 * k + 1]
                pooled[i, j, k] = total / np.float32(8)


@compiled
@no_type_check
def pool_parts(
    labels: UInt8[np.ndarray, "x y z"],
    share: Float32[np.ndarray, "x y z"],
    filled: Float32[np.ndarray, "labels"],
    owner: UInt8[np.ndarray, "i j k"],
    total: Float32[np.ndarray, "i j k"],
) -> None:
    """Write the label that fills most of each block of 2 x 2 x 2, and what all of them fill.

    Parameters
    ----------
    labels, share
        Owner of each voxel, 0 = air, and how much of it is filled; beyond them is air.
    filled
        To work in: zero for each label.
    owner, total
        Zeros, for half as many voxels along each axis, rounded up; written.
    """
    for i in range(owner.shape[0]):
        for j in range(owner.shape[1]):
            for k in range(owner.shape[2]):
                c = 2 * k
                for a in range(2 * i, min(2 * i + 2, labels.shape[0])):
                    for b in range(2 * j, min(2 * j + 2, labels.shape[1])):
                        here, one = labels[a, b, c], share[a, b, c] / np.float32(8)
                        if c + 1 < labels.shape[2]:
                            there, other = labels[a, b, c + 1], share[a, b, c + 1] / np.float32(8)
                            if there == here:
                                one += other
                            else:
                                filled[there] += other
                        filled[here] += one
                most = np.float32(0)
                for part in range(1, len(filled)):
                    if filled[part] > most:
                        owner[i, j, k], most = part, filled[part]
                    total[i, j, k] += filled[part]
                filled[:] = 0


@compiled
@no_type_check
def ways(
    labels: UInt8[np.ndarray, "a b c"],
    share: Float32[np.ndarray, "a b c"],
    lac_per_cm: Float64[np.ndarray, "parts"],
    paths: Float32[np.ndarray, "parts a b"],
    depths: Float32[np.ndarray, "a b"],
) -> None:
    """Add up each column's way through each part, and its attenuation, in voxels.

    Parameters
    ----------
    labels, share
        Owner of each voxel, 0 = air, and how much of it is filled.
    lac_per_cm
        Of each part.
    paths, depths
        Raised: ways in voxels, and ways times coefficients; part k is at k - 1.
    """
    for i in range(labels.shape[0]):
        for j in range(labels.shape[1]):
            for k in range(labels.shape[2]):
                part = labels[i, j, k]
                if part:
                    paths[part - 1, i, j] += share[i, j, k]
                    depths[i, j] += share[i, j, k] * lac_per_cm[part - 1]


@compiled
@no_type_check
def cells(
    labels: UInt8[np.ndarray, "x y z"],
    share: Float32[np.ndarray, "x y z"],
    number: Int32[np.ndarray, "x1 y1 z1"],
    points: Float64[np.ndarray, "n 3"],
    write: bool,
) -> int:
    """Place a vertex in each cell of eight voxels whose labels differ; return how many.

    It is the mean of where the cell's edges pass from one label to another: half-way between two
    parts; against the air, as far from the part's voxel as what is filled of both reaches.

    Parameters
    ----------
    labels, share
        With a margin of air; air voxels may be filled in part.
    number
        Index of the vertex of each cell, -1 = none; written at the first call.
    points
        In voxels, voxel i at i; written if ``write``.
    write
        False to count alone.
    """
    count = 0
    for i in range(number.shape[0]):
        for j in range(number.shape[1]):
            for k in range(number.shape[2]):
                first, mixed = labels[i, j, k], False
                for corner in range(1, 8):
                    di, dj, dk = corner >> 2, (corner >> 1) & 1, corner & 1
                    if labels[i + di, j + dj, k + dk] != first:
                        mixed = True
                        break
                number[i, j, k] = count if mixed else -1
                if not mixed:
                    continue
                if write:
                    place = points[count]
                    place[:] = 0.0
                    passed = 0
                    for corner in range(8):
                        for axis in range(3):
                            bit = 4 >> axis
                            if corner & bit:
                                continue
                            a = (i + (corner >> 2), j + ((corner >> 1) & 1), k + (corner & 1))
                            other = corner | bit
                            b = (i + (other >> 2), j + ((other >> 1) & 1), k + (other & 1))
                            if labels[a] == labels[b]:
                                continue
                            passed += 1
                            at = 0.5
                            if labels[b] == 0:
                                at = min(max(share[a] + share[b] - 0.5, 0.0), 1.0)
                            elif labels[a] == 0:
                                at = 1.0 - min(max(share[a] + share[b] - 0.5, 0.0), 1.0)
                            for d in range(3):
                                place[d] += a[d] + (at if d == axis else 0.0)
                    place /= passed
                count += 1
    return count


@compiled
@no_type_check
def quads(
    labels: UInt8[np.ndarray, "x y z"],
    number: Int32[np.ndarray, "x1 y1 z1"],
    corners: Int64[np.ndarray, "n 4"],
    sides: UInt8[np.ndarray, "n 2"],
    write: bool,
) -> int:
    """List the faces between voxels of unlike labels; return how many.

    Parameters
    ----------
    labels
        With a margin of air.
    number
        Of :func:`cells`.
    corners
        Vertices of each face, counter-clockwise seen from the second voxel; written if ``write``.
    sides
        Labels of the first and the second voxel; written if ``write``.
    write
        False to count alone.
    """
    count = 0
    for axis in range(3):
        b, c = (axis + 1) % 3, (axis + 2) % 3
        for i in range(labels.shape[0] - 1):
            for j in range(labels.shape[1] - 1):
                for k in range(labels.shape[2] - 1):
                    here = labels[i, j, k]
                    there = labels[i + (axis == 0), j + (axis == 1), k + (axis == 2)]
                    if here == there:
                        continue
                    if write:
                        for turn in range(4):
                            shift_b = -1 if turn in (0, 3) else 0
                            shift_c = -1 if turn in (0, 1) else 0
                            x = i + (shift_b if b == 0 else 0) + (shift_c if c == 0 else 0)
                            y = j + (shift_b if b == 1 else 0) + (shift_c if c == 1 else 0)
                            z = k + (shift_b if b == 2 else 0) + (shift_c if c == 2 else 0)
                            corners[count, turn] = number[x, y, z]
                        sides[count, 0] = here
                        sides[count, 1] = there
                    count += 1
    return count
