"""What every adapter reads out of a run: densities at points, in the run's own frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from jaxtyping import Bool, Float

from xden1k.errors import DataError
from xden1k.values.arrays import Points

__all__ = [
    "DENSITIES_G_CM3",
    "Cloud",
    "Unit",
    "box_of",
    "density_g_cm3",
    "floaters",
    "middle",
]

Unit = Literal["kg/m3", "g/cm3"]
KG_M3_PER_G_CM3: Final = 1000.0
DENSITIES_G_CM3: Final = (0.001, 25.0)
"""From thinner than any foam to denser than osmium."""
FEW: Final = 1e-3
"""Share of the points beyond each end of an axis that a box leaves out unless told otherwise."""
BEYOND: Final = 0.05
"""Of that box's longest side: how far off a point is a floater, if nothing else tells."""


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Densities at points, as a run left them.

    Parameters
    ----------
    points
        Shape (N, 3), in the frame and unit of length of the run.
    density
        Shape (N,), in ``unit``.
    unit
        Of the densities.
    cell
        Edge of the voxels whose centres the points are; 0 for scattered points.
    box
        Shape (2, 3): what in the run's frame is the object's bounding box; None = that of the
        points with their cells.
    mass_native_g
        The mass by the method's own rule, where the run has it.
    unread
        How many answers or voxels gave no density.
    few
        Share of the points that may float beyond each end of an axis.
    """

    points: Points
    density: Float[np.ndarray, "points"]
    unit: Unit
    cell: float = 0.0
    box: Float[np.ndarray, "2 3"] | None = None
    mass_native_g: float | None = None
    unread: int = 0
    few: float = FEW

    @property
    def bounds(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest corner of what is the object's bounding box, floaters left out."""
        if self.box is not None:
            return self.box
        return box_of(self.points[~floaters(self.points, BEYOND, self.few)], self.cell)


def box_of(points: Points, cell: float = 0.0) -> Float[np.ndarray, "2 3"]:
    """Lowest and highest corner of points, or of the cells whose centres they are."""
    return np.stack([points.min(axis=0) - cell / 2, points.max(axis=0) + cell / 2])


def floaters(points: Points, beyond: float = 0.0, few: float = FEW) -> Bool[np.ndarray, "points"]:
    """Points outside the box of all but a few, which a reconstruction may have left in the air.

    Parameters
    ----------
    points
        Of one object.
    beyond
        How far outside they must lie, of the box's longest side.
    few
        Share of the points beyond each end of an axis that the box leaves out.

    Examples
    --------
    >>> line = np.linspace(0, 1, 2000)[:, None] * np.ones(3)
    >>> floaters(np.concatenate([line, [[0.5, 0.5, 4.0]]]), beyond=0.1).sum()
    np.int64(1)
    """
    low, high = np.quantile(points, (few, 1 - few), axis=0, method="nearest")
    reach = beyond * (high - low).max()
    return np.asarray(((points < low - reach) | (points > high + reach)).any(axis=1))


def middle(density: Float[np.ndarray, "points *range"], where: str) -> Float[np.ndarray, "points"]:
    """Middle of [low, high]; a single value is its own.

    Raises
    ------
    DataError
        If a low end is above its high end.

    Examples
    --------
    >>> middle(np.array([[400.0, 600.0]]), "wood").tolist()
    [500.0]
    """
    if density.ndim == 1:
        return density
    if (turned := density[:, 0] > density[:, 1]).any():
        first = int(turned.argmax())
        raise DataError(
            f"{where}: expected [low, high], {turned.sum()} are the other way round, first at "
            f"{first}: {density[first].tolist()}"
        )
    return np.asarray(density.mean(axis=1))


def density_g_cm3(cloud: Cloud, where: str) -> Float[np.ndarray, "points"]:
    """Return the densities in g/cm³.

    Raises
    ------
    DataError
        If one is nothing that an object is made of, or all look as if given in the other unit.
    """
    values = cloud.density
    low, high = DENSITIES_G_CM3
    largest = float(values.max())
    if cloud.unit == "kg/m3" and largest <= high:
        raise DataError(f"{where}: the largest density is {largest:g} kg/m3: these look like g/cm3")
    if cloud.unit == "g/cm3" and float(np.median(values)) > high:
        raise DataError(
            f"{where}: the median density is {np.median(values):g} g/cm3: these look like kg/m3"
        )
    found = values / KG_M3_PER_G_CM3 if cloud.unit == "kg/m3" else values
    if (outside := (found < low) | (found > high)).any():
        first = int(outside.argmax())
        raise DataError(
            f"{where}: densities must be within {low:g} and {high:g} g/cm3, {outside.sum()} of "
            f"{len(found)} are not, first at {first}: {found[first]:g}"
        )
    return np.asarray(found)
