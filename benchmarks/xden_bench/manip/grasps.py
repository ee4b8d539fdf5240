"""Grasps of two parallel pads, and the one nearest to a centre of mass.

Tool frame: z approach, y closing, x = y × z, origin midway between the pads.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Integer

from xden1k.values.arrays import Points, Vec3
from xden_bench.manip.pose import Pose

__all__ = ["Grasps", "nearest"]


@dataclass(frozen=True, slots=True, eq=False)
class Grasps:
    """Candidates, in the frame of whoever made them.

    Parameters
    ----------
    score
        Shape (n,): higher is better, as far as shape alone says.
    width_cm
        Shape (n,): between the contacts.
    rotation
        Shape (n, 3, 3): the tool's axes, as columns.
    centre_cm
        Shape (n, 3): the tool's origin.
    """

    score: Float[np.ndarray, "n"]
    width_cm: Float[np.ndarray, "n"]
    rotation: Float[np.ndarray, "n 3 3"]
    centre_cm: Float[np.ndarray, "n 3"]

    def __len__(self) -> int:
        return len(self.score)

    def __getitem__(self, chosen: Bool[np.ndarray, "n"] | Integer[np.ndarray, "m"]) -> Grasps:
        """Return some of them."""
        return Grasps(*(values[chosen] for values in self.arrays.values()))

    @property
    def arrays(self) -> Mapping[str, np.ndarray]:
        """Every array by name, in the order of the constructor."""
        return {name: getattr(self, name) for name in self.__slots__}

    @property
    def approach(self) -> Float[np.ndarray, "n 3"]:
        """Shape (n, 3): direction towards the object."""
        return self.rotation[:, :, 2]

    @property
    def closing(self) -> Float[np.ndarray, "n 3"]:
        """Shape (n, 3): direction in which the pads close."""
        return self.rotation[:, :, 1]

    @property
    def tips_cm(self) -> Float[np.ndarray, "2 n 3"]:
        """Shape (2, n, 3): where the pads touch."""
        half = self.closing * self.width_cm[:, None] / 2
        return np.stack([self.centre_cm - half, self.centre_cm + half])

    def moved(self, pose: Pose) -> Grasps:
        """Return them in the frame into which a pose leads."""
        return Grasps(
            self.score,
            self.width_cm,
            pose.rotation @ self.rotation,
            pose.to_world(self.centre_cm),
        )

    def pose(self, index: int) -> Pose:
        """Return the tool's pose of one of them."""
        return Pose(self.rotation[index], self.centre_cm[index])


def nearest(grasps: Grasps, com_cm: Vec3) -> int:
    """Index of the grasp whose contacts are nearest to a centre of mass, on average.

    The paper's rule. Of equal ones the higher score is taken, then the first.
    """
    distances: Points = grasps.tips_cm - com_cm
    mean = np.linalg.norm(distances, axis=-1).mean(axis=0)
    return int(np.lexsort((-grasps.score, mean))[0])
