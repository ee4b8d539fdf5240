"""Published sizes against the boxes of the meshes: their order, and whether they are of them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden1k.errors import DataError
from xden_builder.published.survey import Survey

__all__ = ["size_order"]

ORDERS: Final = tuple((a, b, c) for a, b, c in permutations(range(3)))
MOST_SHIFT: Final = 10
"""Objects by which entries of other objects are looked for."""
FEWEST: Final = 10
"""Objects that must be compared, before entries are said to be another's."""
MOST_APART: Final = 0.05
"""Median standard deviation of the logarithms of size / extent up to which sizes are the meshes'
own: rounding to the millimetre makes far less."""
CLEARLY: Final = 0.2
"""Share of it that is left, where the entries of other objects fit."""


def size_order(surveys: Sequence[Survey]) -> tuple[int, int, int]:
    """Find which published size belongs to each axis of the meshes, by their proportions.

    Raises
    ------
    DataError
        If the sizes are not the meshes', and those of the objects some places on are.
    """
    sizes = np.log([survey.size_cm for survey in surveys])
    extents = np.log([survey.mesh_extent for survey in surveys])
    own, order = _apart(sizes, extents)
    _refuse_shifted(sizes, extents, own)
    return order


def _apart(
    sizes: Float64[np.ndarray, "n 3"], extents: Float64[np.ndarray, "n 3"]
) -> tuple[float, tuple[int, int, int]]:
    """How far sizes are off the meshes' proportions in the median, in the best order."""
    spreads = [(sizes[:, order] - extents).std(axis=1) for order in ORDERS]
    best = int(np.argmin([spread.sum() for spread in spreads]))
    return float(np.median(spreads[best])), ORDERS[best]


def _refuse_shifted(
    sizes: Float64[np.ndarray, "n 3"], extents: Float64[np.ndarray, "n 3"], own: float
) -> None:
    """Say so where the sizes of other objects have the meshes' proportions."""
    if own <= MOST_APART or len(sizes) < FEWEST + MOST_SHIFT:
        return
    steps = [step for step in range(-MOST_SHIFT, MOST_SHIFT + 1) if step]
    others = {step: _apart(*_moved(sizes, extents, step))[0] for step in steps}
    step = min(others, key=lambda one: others[one])
    if others[step] < CLEARLY * own:
        raise DataError(
            f"metadata: expected sizes with the proportions of their meshes, got {own:.0%} apart "
            f"in the median, but {others[step]:.1%} if each object takes the entry of the one "
            f"{abs(step)} places {'after' if step > 0 else 'before'} it: the keys are shifted"
        )


def _moved(
    sizes: Float64[np.ndarray, "n 3"], extents: Float64[np.ndarray, "n 3"], step: int
) -> tuple[Float64[np.ndarray, "m 3"], Float64[np.ndarray, "m 3"]]:
    """Pair each object with the size of the one some places after it."""
    return (sizes[step:], extents[:-step]) if step > 0 else (sizes[:step], extents[-step:])
