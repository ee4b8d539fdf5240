"""One axis convention for the whole release, by the vote of its objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float64

from xden1k.errors import DataError
from xden_builder.published.orientation import (
    MODES,
    ORIENTATIONS,
    STRETCH_GAIN,
    Orientation,
    best_way,
)
from xden_builder.published.refine import MeshBox
from xden_builder.published.sizes import size_order
from xden_builder.published.survey import Survey, Three

__all__ = ["Convention", "vote"]

MOST_LOST: Final = 0.15
"""Overlap that one object can hold against an orientation, so that no one decides alone."""
ALIKE: Final = 0.01
"""Overlap within which an object cannot tell two orientations apart."""
LEAST_MARGIN: Final = 0.5
MARGIN_EACH: Final = 0.03
"""What the runner-up must have lost in all, or for each unambiguous object where these are few."""
LEAST_AGREE: Final = 0.6
"""Share of the unambiguous objects whose own best orientation is the convention."""
FEWEST: Final = 10
"""Objects that must say where their meshes lie, before it is taken to hold for all."""
TURNED: Final = 0.6
"""Median overlap of the objects' own best orientations below which none of them is right: 0.95 is
usual, and a turn by 7 degrees leaves 0.4 (simulated)."""
FEWEST_TURNED: Final = 5
"""Objects that must say so."""
MOST_SPREAD: Final = 0.002
"""Median distance from the median, in shares of the volume's longest side, up to which objects lie
alike: half a voxel of 256."""


@dataclass(frozen=True, slots=True)
class Convention:
    """How the files of a release lie to each other.

    Parameters
    ----------
    mode
        ``isotropic`` or ``stretched``.
    place
        Index of the orientation.
    size_order
        Which published size belongs to each axis of the mesh.
    margin
        By how much the runner-up lost; 0 where no object tells any other orientation from it.
    agreeing, unambiguous
        Objects with a best orientation of their own, and those of them that agree.
    sure
        Whether margin and agreement suffice; else each object goes by its own.
    scale
        Sides of every mesh's box in its volume, or where voxels are cubes of the mesh's unit; along
        the volume's axes, in shares of its longest side. None where objects differ.
    middle
        Of every mesh's box, likewise.
    """

    mode: str
    place: int
    size_order: tuple[int, int, int]
    margin: float
    agreeing: int
    unambiguous: int
    sure: bool
    scale: Three | None
    middle: Three | None

    @property
    def orientation(self) -> Orientation:
        """Of the volume's axes in the mesh."""
        return ORIENTATIONS[self.place]

    def to_json(self) -> dict[str, Any]:
        """Return values of JSON's types."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Convention:
        """Read what :meth:`to_json` gave."""
        threes = ("size_order", "scale", "middle")
        known = {name: values[name] and tuple(values[name]) for name in threes}
        return cls(**{**values, **known})

    def box_of(self, extent: Float64[np.ndarray, "3"], longest: int) -> MeshBox | None:
        """Where a mesh lies in its volume, in voxels; None where objects differ.

        Parameters
        ----------
        extent
            Of the mesh, along its own axes.
        longest
            Longest side of the volume.
        """
        if self.scale is None:
            return None
        along = extent[list(self.orientation.axes)] if self.mode == MODES[0] else np.ones(3)
        middle = None if self.middle is None else longest * np.array(self.middle)
        return MeshBox(longest * along * self.scale, middle)


def vote(surveys: Sequence[Survey]) -> Convention:
    """Find the convention that most objects agree with.

    An object whose overlap is the same in several orientations does not tell them apart, and so has
    no say between them.

    Raises
    ------
    DataError
        If there is no object, no orientation fits them, or their sizes are of other objects.
    """
    if not surveys:
        raise DataError("convention: expected at least one object, got none")
    scores = np.array([survey.overlaps for survey in surveys])
    _refuse_turned(scores)
    lost = np.maximum(scores - scores.max(axis=(1, 2), keepdims=True), -MOST_LOST).sum(axis=0)
    gained = float(lost[1].max() - lost[0].max())
    mode = int(gained > STRETCH_GAIN * len(surveys))
    place = int(lost[mode].argmax())
    own = scores[:, mode]
    clear = _unambiguous(own)
    agreeing = int((own[clear].argmax(axis=1) == place).sum())
    rivals = lost[mode][_rivals(own, place)]
    margin = float(lost[mode, place] - rivals.max()) if len(rivals) else 0.0
    needed = min(LEAST_MARGIN, MARGIN_EACH * int(clear.sum()))
    sure = bool(clear.any()) and margin > needed and agreeing >= LEAST_AGREE * int(clear.sum())
    order, scale, middle = size_order(surveys), *_frame(surveys, MODES[mode], place)
    figures = margin, agreeing, int(clear.sum())
    return Convention(MODES[mode], place, order, *figures, sure, scale, middle)


def _refuse_turned(scores: Float64[np.ndarray, "n modes 48"]) -> None:
    """Say so where no quarter turns bring the meshes and volumes of a release together."""
    overlap = float(np.median(scores.max(axis=(1, 2))))
    if len(scores) >= FEWEST_TURNED and overlap < TURNED:
        raise DataError(
            f"convention: expected meshes that quarter turns bring onto their volumes, with a "
            f"median overlap of {TURNED} at least, got {overlap:.2f} in the best of 48 ways: they "
            "are turned by another angle, or not of the same objects"
        )


def _unambiguous(scores: Float64[np.ndarray, "n 48"]) -> Bool[np.ndarray, "n"]:
    """Objects whose best orientation is better than any other."""
    second, first = np.sort(scores, axis=1)[:, -2:].T
    return np.asarray(first - second > ALIKE)


def _rivals(scores: Float64[np.ndarray, "n 48"], place: int) -> Bool[np.ndarray, "48"]:
    """Orientations that some object tells from the winner."""
    apart = np.abs(scores - scores[:, [place]]) > ALIKE
    return np.asarray(apart.any(axis=0))


def _frame(surveys: Sequence[Survey], mode: str, place: int) -> tuple[Three | None, Three | None]:
    """Scale and middle that the objects have in common, by those whose own best is the winner."""
    asked = [each for each in surveys if best_way(np.array(each.overlaps)) == (mode, place)]
    sides = np.array([each.box_sides for each in asked]).reshape(-1, 3)
    if mode == MODES[0]:
        extents = np.array([each.mesh_extent for each in asked]).reshape(-1, 3)
        ratio = sides / extents[:, ORIENTATIONS[place].axes]
        sides = np.exp(np.log(ratio).mean(axis=1, keepdims=True)) * np.ones(3)
    middles = np.array([each.box_middle for each in asked]).reshape(-1, 3)
    return _one_side(_common(sides)), _common(middles)


def _common(values: Float64[np.ndarray, "n 3"]) -> Three | None:
    """Median of what some objects say; None if they are too few, or differ."""
    if len(values) < FEWEST:
        return None
    middle = np.median(values, axis=0)
    spread = np.median(np.abs(values - middle), axis=0)
    x, y, z = middle.tolist()
    return (x, y, z) if (spread <= MOST_SPREAD).all() else None


def _one_side(scale: Three | None) -> Three | None:
    """Take a cube for one: of its sides the flat bottoms of things tell one less well."""
    if scale is None or np.ptp(scale) > MOST_SPREAD:
        return scale
    return (float(np.median(scale)),) * 3
