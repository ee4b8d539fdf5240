"""A pose that a person told coarsely: where a search begins, and what it may come back with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from xden_builder.capture.pose import CoarsePose, PoseTold
from xden_builder.registration.placement import Found

__all__ = ["around_told", "told_rotations"]

NEAR_RAD, NEAR_COUNT = np.radians(30.0), 300
"""How far from a told rotation the search begins, and at how many."""
FAR_RAD: Final = np.radians(50.0)
"""What has gone farther is another pose than the one that was told."""


def told_rotations(pose: PoseTold) -> Rotation | None:
    """Rotations around the one a person told; None where all there are must be tried."""
    if not isinstance(pose, CoarsePose):
        return None
    ways = np.random.default_rng(0).normal(size=(NEAR_COUNT, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    reach = NEAR_RAD * np.cbrt((np.arange(NEAR_COUNT) + 0.5) / NEAR_COUNT)
    return Rotation.from_rotvec(reach[:, None] * ways) * pose.rotation


def around_told(pose: PoseTold, found: Sequence[Found]) -> list[Found]:
    """Leave out poses far from the rotation that a person told, if there is any near it.

    Turns about a body's axes lead to all that look alike. Of an object that is symmetric any pose
    may stand for those like it: where none is near, all are kept.
    """
    if not isinstance(pose, CoarsePose) or not found:
        return [*found]
    rotations = Rotation.from_matrix([each.placement.rotation for each in found])
    off_rad = (rotations * pose.rotation.inv()).magnitude().tolist()
    near = [each for each, off in zip(found, off_rad, strict=True) if off <= FAR_RAD]
    return near or [*found]
