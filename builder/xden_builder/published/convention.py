"""One axis convention for the whole release, by the vote of its objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import permutations
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float64

from xden1k.errors import DataError
from xden_builder.published.orientation import MODES, ORIENTATIONS, Orientation
from xden_builder.published.survey import Survey

__all__ = ["Convention", "vote"]

MOST_LOST: Final = 0.15
"""Overlap that one object can hold against an orientation, so that no one decides alone."""
STRETCH_GAIN: Final = 0.004
"""Overlap an object by which three scales must be better than one."""
ALIKE: Final = 0.01
"""Overlap within which an object cannot tell two orientations apart."""
LEAST_MARGIN: Final = 0.5
MARGIN_EACH: Final = 0.03
"""What the runner-up must have lost in all, or for each unambiguous object where these are few."""
LEAST_AGREE: Final = 0.6
"""Share of the unambiguous objects whose own best orientation is the convention."""
SIZE_ORDERS: Final = tuple((a, b, c) for a, b, c in permutations(range(3)))


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
        By how much the runner-up lost.
    agreeing, unambiguous
        Objects with a best orientation of their own, and those of them that agree.
    sure
        Whether margin and agreement suffice; else each object goes by its own.
    """

    mode: str
    place: int
    size_order: tuple[int, int, int]
    margin: float
    agreeing: int
    unambiguous: int
    sure: bool

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
        return cls(**{**values, "size_order": tuple(values["size_order"])})


def vote(surveys: Sequence[Survey]) -> Convention:
    """Find the convention that most objects agree with.

    An object whose overlap is the same in several orientations does not tell them apart, and so has
    no say between them.

    Raises
    ------
    DataError
        If there is no object.
    """
    if not surveys:
        raise DataError("convention: expected at least one object, got none")
    scores = np.array([survey.overlaps for survey in surveys])
    lost = np.maximum(scores - scores.max(axis=(1, 2), keepdims=True), -MOST_LOST).sum(axis=0)
    gained = float(lost[1].max() - lost[0].max())
    mode = int(gained > STRETCH_GAIN * len(surveys))
    place = int(lost[mode].argmax())
    own = scores[:, mode]
    clear = _unambiguous(own)
    agreeing = int((own[clear].argmax(axis=1) == place).sum())
    margin = float(lost[mode, place] - lost[mode][_rivals(own, place)].max(initial=-np.inf))
    needed = min(LEAST_MARGIN, MARGIN_EACH * int(clear.sum()))
    sure = bool(clear.any()) and margin > needed and agreeing >= LEAST_AGREE * int(clear.sum())
    return Convention(
        MODES[mode], place, _size_order(surveys), margin, agreeing, int(clear.sum()), sure
    )


def _unambiguous(scores: Float64[np.ndarray, "n 48"]) -> Bool[np.ndarray, "n"]:
    """Objects whose best orientation is better than any other."""
    second, first = np.sort(scores, axis=1)[:, -2:].T
    return np.asarray(first - second > ALIKE)


def _rivals(scores: Float64[np.ndarray, "n 48"], place: int) -> Bool[np.ndarray, "48"]:
    """Orientations that some object tells from the winner."""
    apart = np.abs(scores - scores[:, [place]]) > ALIKE
    return np.asarray(apart.any(axis=0))


def _size_order(surveys: Sequence[Survey]) -> tuple[int, int, int]:
    """Order of the published sizes that fits the meshes' proportions best."""
    sizes = np.log([survey.size_cm for survey in surveys])
    extents = np.log([survey.mesh_extent for survey in surveys])
    spreads = [(sizes[:, order] - extents).std(axis=1).sum() for order in SIZE_ORDERS]
    first, second, third = SIZE_ORDERS[int(np.argmin(spreads))]
    return first, second, third
