"""Which way a volume's axes lie in the mesh: 48 ways, each with one scale or three."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations, product
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float32, Float64

from xden_builder.published.shares import BoxShares, pooled

__all__ = [
    "MODES",
    "ORIENTATIONS",
    "STRETCH_GAIN",
    "Orientation",
    "best_way",
    "box_factors",
    "overlaps",
    "resampled",
]

MODES: Final = ("isotropic", "stretched")
"""Whether the volume's voxels are cubes in the mesh's frame, or its box was stretched."""
STRETCH_GAIN: Final = 0.004
"""Overlap by which three scales must be better than one."""


class Orientation(NamedTuple):
    """A signed permutation.

    Parameters
    ----------
    axes
        The mesh's axis that each axis of the volume is.
    signs
        -1 where it runs the other way.
    """

    axes: tuple[int, int, int]
    signs: tuple[int, int, int]

    @property
    def matrix(self) -> Float64[np.ndarray, "3 3"]:
        """Takes directions of the volume to directions of the mesh."""
        matrix = np.zeros((3, 3))
        matrix[list(self.axes), range(3)] = self.signs
        return matrix

    @property
    def mirrored(self) -> bool:
        """Whether it turns a right hand into a left one."""
        return bool(np.linalg.det(self.matrix) < 0)

    @property
    def text(self) -> str:
        """Mesh axes in the order of the volume's.

        Examples
        --------
        >>> Orientation((0, 2, 1), (1, -1, 1)).text
        '+x -z +y'
        """
        pairs = zip(self.signs, self.axes, strict=True)
        return " ".join(f"{'+' if sign > 0 else '-'}{'xyz'[axis]}" for sign, axis in pairs)

    def oriented(self, shares: Float32[np.ndarray, "x y z"]) -> Float32[np.ndarray, "x y z"]:
        """Turn a mesh's grid so that its axes are the volume's."""
        return _flipped(shares.transpose(self.axes), self.signs)


SIGNS: Final = tuple((i, j, k) for i, j, k in product((1, -1), repeat=3))
ORIENTATIONS: Final = tuple(
    Orientation((a, b, c), signs) for a, b, c in permutations(range(3)) for signs in SIGNS
)
"""All 48, mirrored ones too."""


def overlaps(mesh: BoxShares, volume: BoxShares) -> Float64[np.ndarray, "2 48"]:
    """Intersection over union of mesh and volume, box onto box, in every mode and orientation.

    Cavities may be filled in either: the best of the four pairs counts.
    """
    others = [pooled(other) for other in volume.versions]
    upright = ORIENTATIONS[:: len(SIGNS)]
    found = np.zeros((len(MODES), len(upright), len(SIGNS)))
    for mode, place in np.ndindex(found.shape[:2]):
        way = upright[place]
        factors = box_factors(mesh, volume, way, MODES[mode])
        for body in mesh.versions:
            oriented = way.oriented(pooled(body))
            placed = resampled(oriented, factors, np.zeros(3), 0)
            whole = float(oriented.sum(dtype=np.float64) / factors.prod())
            each = [_best(_flipped(placed, signs), whole, others) for signs in SIGNS]
            found[mode, place] = np.maximum(found[mode, place], each)
    return found.reshape(len(MODES), len(ORIENTATIONS))


def best_way(scores: Float64[np.ndarray, "2 48"]) -> tuple[str, int]:
    """Mode and orientation of the largest overlap.

    Examples
    --------
    >>> scores = np.zeros((2, 48))
    >>> scores[0, 7], scores[1, 9] = 0.9, 0.902
    >>> best_way(scores)
    ('isotropic', 7)
    """
    mode = int(scores[1].max() - scores[0].max() > STRETCH_GAIN)
    return MODES[mode], int(scores[mode].argmax())


def box_factors(
    mesh: BoxShares, volume: BoxShares, way: Orientation, mode: str
) -> Float64[np.ndarray, "3"]:
    """How much longer the volume's box is than the mesh's, along each axis of the volume.

    All 1 where the box was stretched; else by the scale that makes them as large on the whole.
    """
    if mode == "stretched":
        return np.ones(3)
    ratio = volume.extent / mesh.extent[list(way.axes)]
    return np.asarray(ratio / np.exp(np.log(ratio).mean()))


def _flipped(
    shares: Float32[np.ndarray, "x y z"], signs: tuple[int, int, int]
) -> Float32[np.ndarray, "x y z"]:
    """Turn the axes of negative sign round."""
    return shares[tuple(slice(None, None, sign) for sign in signs)]


def _best(
    placed: Float32[np.ndarray, "n n n"],
    whole: float,
    others: Sequence[Float32[np.ndarray, "n n n"]],
) -> float:
    """Intersection over union with the best; what reaches beyond the grid counts as well.

    Parameters
    ----------
    placed
        Mesh on the volume's grid.
    whole
        Cells that it fills, with those beyond the grid.
    others
        Volume, with its cavities and without.
    """
    both = [float(np.minimum(placed, other).sum(dtype=np.float64)) for other in others]
    sizes = [float(other.sum(dtype=np.float64)) for other in others]
    return max(one / (whole + size - one) for one, size in zip(both, sizes, strict=True))


def resampled(
    mesh: Float32[np.ndarray, "n n n"],
    factors: Float64[np.ndarray, "3"],
    shift: Float64[np.ndarray, "3"],
    margin: int,
    slope_along: int | None = None,
) -> Float32[np.ndarray, "m m m"]:
    """Take an oriented mesh to the volume's grid, or its slope along an axis there.

    Parameters
    ----------
    mesh
        Shares on the grid of its own box.
    factors, shift
        Cell i of the volume's box lies ``factors (i - middle) + shift`` cells from the middle of
        the mesh's.
    margin
        Cells by which the result reaches beyond the volume's box.
    slope_along
        Axis; None = the shares themselves.
    """
    size = mesh.shape[0]
    cells = np.arange(-margin, size + margin) - (size - 1) / 2
    for axis in range(3):
        at = factors[axis] * cells + shift[axis] + (size - 1) / 2
        weights = _weights(at, size, slope=axis == slope_along)
        mesh = np.moveaxis(np.tensordot(weights, mesh, (1, axis)), 0, axis)
    return mesh


def _weights(at: Float64[np.ndarray, "m"], size: int, *, slope: bool) -> Float32[np.ndarray, "m n"]:
    """Linear interpolation between cells, zero beyond them, or its slope over one cell."""
    if slope:
        before, beyond = (_weights(at + step, size, slope=False) for step in (-0.5, 0.5))
        return np.asarray(beyond - before)
    away = np.abs(at[:, None] - np.arange(size))
    return (1 - away).clip(0).astype(np.float32)
