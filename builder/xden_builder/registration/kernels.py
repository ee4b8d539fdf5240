"""Compiled kernel: clouds of attenuating points, in many poses, as coarse images of one view."""

from typing import Final, no_type_check

import numpy as np
from jaxtyping import Float32, Float64

from xden1k.errors import require

__all__ = ["splat"]

NEAREST: Final = np.float32(0.05)
"""Depth below which a point is beside the source, in distances of the panel."""

compiled = require("numba", "build").njit(cache=True, nogil=True, fastmath=True)


@compiled
@no_type_check
def splat(
    points: Float32[np.ndarray, "n 3"],
    weights: Float32[np.ndarray, "n"],
    turns: Float64[np.ndarray, "b 3 3"],
    shifts: Float64[np.ndarray, "b 3"],
    to_panel: Float64[np.ndarray, "3 3"],
    source: Float64[np.ndarray, "3"],
    cone: bool,
    area: float,
    images: Float32[np.ndarray, "b rows columns"],
) -> None:
    """Add what each point takes from the light to the four pixels around its shadow.

    Parameters
    ----------
    points, weights
        In the object's own frame, cm, and attenuation times volume, cm².
    turns, shifts
        A point x stands at turn x + shift; a turn that stretches makes volumes grow with it.
    to_panel, source
        Inverse of ``ViewGeometry.matrix``; its source or, for a parallel beam, pixel (0, 0).
    cone, area
        Whether the beam is one; cm² across the beam that a pixel stands for on the panel.
    images
        What is added to: -ln T.
    """
    rows, columns = images.shape[1], images.shape[2]
    one, zero = np.float32(1), np.float32(0)
    last_column, last_row = np.float32(columns - 1), np.float32(rows - 1)
    count = len(points)
    along_columns, along_rows, taken = np.empty((3, count), dtype=np.float32)
    xs, ys, zs = points[:, 0].copy(), points[:, 1].copy(), points[:, 2].copy()
    for b in range(len(turns)):
        m = (to_panel @ turns[b]).astype(np.float32)
        o = (to_panel @ (shifts[b] - source)).astype(np.float32)
        growth = np.float32(abs(np.linalg.det(turns[b])) / area)
        for i in range(count):  # without branches, so that several points go at once
            x, y, z = xs[i], ys[i], zs[i]
            depth = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + o[2]
            nearness = one / max(depth, NEAREST) if cone else one
            along_columns[i] = (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + o[0]) * nearness
            along_rows[i] = (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + o[1]) * nearness
            seen = depth > NEAREST or not cone
            taken[i] = growth * weights[i] * nearness * nearness if seen else zero
        image = images[b]
        for i in range(count):
            column, row = along_columns[i], along_rows[i]
            if not (zero <= column < last_column and zero <= row < last_row):
                continue
            c, r = np.uint32(column), np.uint32(row)
            right, down = column - np.float32(c), row - np.float32(r)
            below = taken[i] * down
            above = taken[i] - below
            image[r, c] += above * (one - right)
            image[r, c + 1] += above * right
            image[r + 1, c] += below * (one - right)
            image[r + 1, c + 1] += below * right
