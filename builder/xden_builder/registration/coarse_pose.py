"""A pose that a person told coarsely: where a search begins, and what it may come back with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from xden_builder.capture.pose import CoarsePose, PoseTold
from xden_builder.registration.body import Body
from xden_builder.registration.kinds import FINAL_APART
from xden_builder.registration.placement import Found, RigidPlacement

__all__ = ["around_told", "told_one", "told_placement", "told_rotations"]

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


def told_placement(pose: CoarsePose, scale: float) -> RigidPlacement:
    """Give the pose that a person told, of meshes of a scale."""
    return RigidPlacement(pose.rotation.as_matrix(), np.array(pose.translation_cm), scale)


def told_one(pose: PoseTold, found: Sequence[Found], body: Body) -> int | None:
    """Index of the pose that a person told exactly, since it had been found before.

    None where none lies within a fiftieth of the radius (root mean square over vertices): who does
    not copy a pose tells none as well as that.
    """
    if not isinstance(pose, CoarsePose):
        return None
    points = np.concatenate([np.asarray(mesh.vertices) for mesh in body.space.meshes])
    off_cm = []
    for each in found:
        told = told_placement(pose, each.placement.scale)
        beside = told.apply(points) - each.placement.apply(points)
        off_cm.append(float(np.sqrt(np.square(beside).sum(axis=1).mean())))
    nearest = int(np.argmin(off_cm))
    reach_cm = FINAL_APART * body.radius_cm * found[nearest].placement.scale
    return nearest if off_cm[nearest] < reach_cm else None
