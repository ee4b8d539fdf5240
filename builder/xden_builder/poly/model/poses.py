"""Where the object stands in each view: one pose that views share, and one of each turned view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden1k.values.arrays import Vec3
from xden1k.values.views import ViewGeometry
from xden_builder.poly.model.frames import Pose, nearer, posed

__all__ = ["RIGID", "TURNED_SHIFT_SD_CM", "Poses"]

RIGID: Final = 6
SHARED_SD: Final = (0.03, 0.03, 0.03, 0.3, 0.3, 0.3)
"""How far meshes and images are expected to disagree: 1.7 degrees and 3 mm about each axis."""
TURNED_SHIFT_SD_CM: Final = 2.0
TURNED_SD: Final = (0.09, 0.09, 0.09, *[TURNED_SHIFT_SD_CM] * 3)
"""The same where the object was turned by hand: 5 degrees and 2 cm."""
ROW_SHIFT_SD_CM: Final = 0.05
"""How far the rows of two panels are expected to disagree."""


@dataclass(frozen=True, slots=True)
class Poses:
    """The unknowns that say where each view sees the object, in one vector.

    First six that the views which are not turned share: rotation vector and shift. Then what each
    view has of its own: a turned one its rotation vector and shift, the others the row shift of
    their panel, but for the first, which the others are compared with. Last, where it is sought,
    the logarithm of the object's size over that of its meshes.

    Parameters
    ----------
    turned
        By view: whether the object was turned by hand before it.
    origin
        At rest.
    size_sd
        Standard deviation of the logarithm of the size before the images; 0 where meshes have
        their size, which is not sought then.

    Examples
    --------
    >>> [Poses(turned, Pose()).count for turned in ((False, False), (False, True))]
    [7, 12]
    >>> Poses((False, False), Pose(), size_sd=0.01).size_places
    [7]
    """

    turned: tuple[bool, ...]
    origin: Pose
    size_sd: float = 0.0

    @property
    def sized(self) -> bool:
        """Whether the size is sought."""
        return self.size_sd > 0

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return len(self.prior_sd)

    @property
    def prior_sd(self) -> Float64[np.ndarray, "p"]:
        """Standard deviations before the images, in radians, cm and as a share; means are zero."""
        own = [sd for own in self._own_sds() for sd in own]
        return np.array([*SHARED_SD, *own, *[self.size_sd] * self.sized])

    @property
    def size_places(self) -> list[int]:
        """Place of the size in the vector; none where it is not sought."""
        return [self.count - 1] * self.sized

    def _own_sds(self) -> list[tuple[float, ...]]:
        """Give the standard deviations of what each view has of its own."""
        return [
            TURNED_SD if turned else (ROW_SHIFT_SD_CM,) * (number > 0)
            for number, turned in enumerate(self.turned)
        ]

    def places(self, number: int) -> list[int]:
        """Places of a view's unknowns in the vector: rotation, shift and, if any, row shift."""
        counts = [len(own) for own in self._own_sds()]
        start = RIGID + sum(counts[:number])
        own = range(start, start + counts[number])
        return [*own] if self.turned[number] else [*range(RIGID), *own]

    def of(self, number: int, vector: Float64[np.ndarray, "p"]) -> Pose:
        """Pose of the object in a view; its row shift is that of the view's panel."""
        mine = vector[self.places(number)]
        return self.origin.moved(np.append(mine, np.zeros(RIGID + 1 - len(mine))))

    def shifts(self, number: int) -> list[int]:
        """Places of a view's shift in the vector."""
        return self.places(number)[RIGID // 2 : RIGID]

    def sight(self, number: int, told: ViewGeometry, vector: Float64[np.ndarray, "p"]) -> Vec3:
        """Way from where the object's middle stands to the source; of a parallel beam, its line."""
        if told.source_cm is None:
            assert told.direction is not None
            return told.direction
        pose = self.of(number, vector)
        return np.asarray(told.source_cm - np.array(pose.centre_cm) - np.array(pose.shift_cm))

    def geometry(
        self, number: int, told: ViewGeometry, vector: Float64[np.ndarray, "p"]
    ) -> ViewGeometry:
        """Move a view's scanner so that meshes at rest look as the object does, in pose and size.

        Ways through them are those of the meshes.
        """
        there = self.placed(number, told, vector)
        if not self.sized:
            return there
        return nearer(there, float(np.exp(vector[-1])), np.array(self.origin.centre_cm))

    def placed(
        self, number: int, told: ViewGeometry, vector: Float64[np.ndarray, "p"]
    ) -> ViewGeometry:
        """Move a view's scanner so that meshes of the object's size look as it does in its pose."""
        return posed(told, self.of(number, vector), shifted_rows=True)
