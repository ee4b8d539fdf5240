"""Where a body stands: a turn and a shift."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from xden1k.export.si import M_PER_CM
from xden1k.values.arrays import Vec3

__all__ = ["Pose", "turn_between_deg"]

Points = Float[np.ndarray, "*points 3"]
"""One point or many, cm."""


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """A rigid motion from a body's frame into the world's.

    Parameters
    ----------
    rotation
        Shape (3, 3): the body's axes in the world, as columns.
    origin_cm
        Shape (3,): the body's origin in the world.
    """

    rotation: Float[np.ndarray, "3 3"]
    origin_cm: Vec3

    def to_world(self, points_cm: Points) -> Points:
        """Move points of the body into the world.

        Examples
        --------
        >>> up = Pose(np.eye(3), np.array([0.0, 0.0, 2.0]))
        >>> up.to_world(np.zeros((1, 3))).tolist()
        [[0.0, 0.0, 2.0]]
        """
        moved: Points = points_cm @ self.rotation.T + self.origin_cm
        return moved

    def to_body(self, points_cm: Points) -> Points:
        """Move points of the world into the body's frame."""
        moved: Points = (points_cm - self.origin_cm) @ self.rotation
        return moved

    def of(self, inner: Pose) -> Pose:
        """Move a pose that is given in the body's frame into the world.

        Examples
        --------
        >>> up = Pose(np.eye(3), np.array([0.0, 0.0, 2.0]))
        >>> up.of(up).origin_cm.tolist()
        [0.0, 0.0, 4.0]
        """
        return Pose(self.rotation @ inner.rotation, self.to_world(inner.origin_cm))

    def seen_from(self, other: Pose) -> Pose:
        """Return it in the frame of another pose.

        Examples
        --------
        >>> up = Pose(np.eye(3), np.array([0.0, 0.0, 2.0]))
        >>> up.seen_from(up).origin_cm.tolist()
        [0.0, 0.0, 0.0]
        """
        return Pose(other.rotation.T @ self.rotation, other.to_body(self.origin_cm))

    @property
    def qpos(self) -> Float[np.ndarray, "7"]:
        """Position in m and quaternion w, x, y, z: as MuJoCo's free joints have them."""
        x, y, z, w = Rotation.from_matrix(self.rotation).as_quat()
        return np.array([*(M_PER_CM * self.origin_cm), w, x, y, z])

    @classmethod
    def of_qpos(cls, qpos: Float[np.ndarray, "7"]) -> Pose:
        """Return the pose of a free joint.

        Examples
        --------
        >>> Pose.of_qpos(np.array([0.01, 0, 0, 1.0, 0, 0, 0])).origin_cm.tolist()
        [1.0, 0.0, 0.0]
        """
        w, x, y, z = qpos[3:]
        return cls(Rotation.from_quat([x, y, z, w]).as_matrix(), qpos[:3] / M_PER_CM)


def turn_between_deg(a: Float[np.ndarray, "3 3"], b: Float[np.ndarray, "3 3"]) -> float:
    """Angle of the rotation that leads from one to the other.

    Examples
    --------
    >>> round(turn_between_deg(np.eye(3), np.diag([-1.0, -1.0, 1.0])), 6)
    180.0
    """
    return float(np.degrees(Rotation.from_matrix(a.T @ b).magnitude()))
