"""Compiled kernel: clouds of attenuating points, in many poses, as coarse images of one view."""

from typing import no_type_check

import numpy as np
from jaxtyping import Float32, Float64

from xden1k.errors import require

__all__ = ["splat"]

compiled = require("numba", "build").njit(cache=True, nogil=True, fastmath=True)


@compiled
@no_type_check
def splat(
    points: Float64[np.ndarray, "n 3"],
    weights: Float64[np.ndarray, "n"],
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
    for b in range(len(turns)):
        matrix = to_panel @ turns[b]
        origin = to_panel @ (shifts[b] - source)
        image = images[b]
        growth = abs(np.linalg.det(turns[b]))
        for i in range(len(points)):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            depth = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z + origin[2]
            column = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z + origin[0]
            row = matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z + origin[1]
            value = growth * weights[i] / area
            if cone:
                if depth <= 0.05:
                    continue
                column /= depth
                row /= depth
                value /= depth * depth
            if not (0 <= column < columns - 1 and 0 <= row < rows - 1):
                continue
            c, r = int(column), int(row)
            right, down = np.float32(column - c), np.float32(row - r)
            v = np.float32(value)
            image[r, c] += v * (1 - right) * (1 - down)
            image[r, c + 1] += v * right * (1 - down)
            image[r + 1, c] += v * (1 - right) * down
            image[r + 1, c + 1] += v * right * down
