"""Mesh onto volume to a fraction of a voxel: Gauss-Newton on how full the cells are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float32, Float64

from xden_builder.published.orientation import Orientation, box_factors, resampled
from xden_builder.published.shares import SHARE_SIZE, BoxShares

__all__ = ["Fit", "MeshBox", "fit_pair", "mesh_box", "voxel_affine"]

MARGIN: Final = 4
"""Cells around the volume's box that are compared as well."""
MOST_STEPS: Final = 12
SETTLED: Final = 1e-3
"""Cells: a smaller step is the last one."""
DAMPING: Final = 1e-3
FARTHEST: Final = 2.0
"""Cells that one step may go."""


class MeshBox(NamedTuple):
    """Where the box of a mesh lies in a volume, along the volume's axes and in its unit.

    Parameters
    ----------
    sides
        Of the box.
    middle
        Of the box; None where it is not known.
    """

    sides: Float64[np.ndarray, "3"]
    middle: Float64[np.ndarray, "3"] | None


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A mesh placed on a volume's grid.

    Parameters
    ----------
    factors, shift
        Of :func:`xden_builder.published.orientation.resampled`.
    placed, volume
        Shares of the mesh there, and of the volume, with a margin.
    """

    factors: Float64[np.ndarray, "3"]
    shift: Float64[np.ndarray, "3"]
    placed: Float32[np.ndarray, "m m m"]
    volume: Float32[np.ndarray, "m m m"]

    @property
    def iou(self) -> float:
        """Intersection over union of both."""
        both = float(np.minimum(self.placed, self.volume).sum(dtype=np.float64))
        return both / float(np.maximum(self.placed, self.volume).sum(dtype=np.float64))

    @property
    def loss(self) -> float:
        """Sum of squared differences."""
        return float(((self.placed - self.volume) ** 2).sum(dtype=np.float64))


def fit_pair(
    mesh: BoxShares,
    volume: BoxShares,
    way: Orientation,
    mode: str,
    known: MeshBox | None = None,
) -> Fit:
    """Place a mesh in an orientation: the best pair of versions, box onto box, then refined.

    What is known of the box stays as it is.
    """
    factors, shift = box_factors(mesh, volume, way, mode), np.zeros(3)
    free_scales = 3 if mode == "stretched" else 1
    if known is not None:
        factors, free_scales = volume.extent / known.sides, 0
        if known.middle is not None:
            shift = SHARE_SIZE * ((volume.low + volume.high) / 2 - known.middle) / known.sides
    pairs = [(way.oriented(body), other) for body in mesh.versions for other in volume.versions]
    starts = [_placed(body, np.pad(other, MARGIN), factors, shift) for body, other in pairs]
    best = int(np.argmax([start.iou for start in starts]))
    if known is not None and known.middle is not None:
        return starts[best]
    return _refined(pairs[best][0], starts[best], free_scales)


def mesh_box(
    volume: BoxShares, fit: Fit
) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]:
    """Sides and middle of the mesh's box as a fit puts it, in the volume's unit."""
    sides = volume.extent / fit.factors
    return sides, (volume.low + volume.high) / 2 - fit.shift * sides / SHARE_SIZE


def _placed(
    mesh: Float32[np.ndarray, "n n n"],
    target: Float32[np.ndarray, "m m m"],
    factors: Float64[np.ndarray, "3"],
    shift: Float64[np.ndarray, "3"],
) -> Fit:
    return Fit(factors, shift, resampled(mesh, factors, shift, MARGIN), target)


def _refined(mesh: Float32[np.ndarray, "n n n"], fit: Fit, free_scales: int) -> Fit:
    """Step while the loss falls; a step that raises it is halved once."""
    for _ in range(MOST_STEPS):
        scales, shifts = _step(mesh, fit, free_scales)
        for share in (1.0, 0.5):
            better = _placed(
                mesh,
                fit.volume,
                fit.factors * np.exp(share * scales),
                fit.shift + share * shifts,
            )
            if better.loss < fit.loss:
                break
        else:
            return fit
        fit = better
        if max(np.abs(shifts).max(), np.abs(scales).max() * mesh.shape[0] / 2) < SETTLED:
            return fit
    return fit


def _step(
    mesh: Float32[np.ndarray, "n n n"], fit: Fit, free_scales: int
) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]:
    """Change of the three logarithms of the factors, and of the shift in cells."""
    cells = np.arange(fit.volume.shape[0]) - (fit.volume.shape[0] - 1) / 2
    slopes, by_scale = [], []
    for axis in range(3):
        slope = resampled(mesh, fit.factors, fit.shift, MARGIN, slope_along=axis)
        along = (fit.factors[axis] * cells).astype(np.float32)
        slopes.append(slope.ravel())
        by_scale.append((slope * along.reshape([-1 if a == axis else 1 for a in range(3)])).ravel())
    scales = [np.sum(by_scale, axis=0)] if free_scales == 1 else by_scale[:free_scales]
    jacobian = np.stack([*slopes, *scales], axis=1)
    residual = (fit.volume - fit.placed).ravel()
    normal = (jacobian.T @ jacobian).astype(np.float64)
    normal[np.diag_indices_from(normal)] *= 1 + DAMPING
    step = np.linalg.solve(normal, (jacobian.T @ residual).astype(np.float64))
    step *= min(1.0, FARTHEST / max(float(np.abs(step[:3]).max()), 1e-9))
    return (step[3:] if scales else np.zeros(1)) * np.ones(3), step[:3]


def voxel_affine(
    mesh: BoxShares, volume: BoxShares, way: Orientation, fit: Fit
) -> Float64[np.ndarray, "4 4"]:
    """Matrix that takes points of the volume, voxel i being i to i + 1, to points of the mesh."""
    axes = list(way.axes)
    scale = fit.factors * mesh.extent[axes] / volume.extent
    cell = mesh.extent[axes] / SHARE_SIZE
    middle_mesh, middle_volume = ((body.low + body.high) / 2 for body in (mesh, volume))
    linear = way.matrix * scale
    affine = np.eye(4)
    affine[:3, :3] = linear
    affine[:3, 3] = middle_mesh + way.matrix @ (fit.shift * cell) - linear @ middle_volume
    return affine
