"""Pinhole cameras in the object frame.

Conventions, those of ``transforms.json``: a camera looks along its -z, x to the right, y up
(OpenGL), and its matrix takes camera coordinates to the object frame. Column and row are counted
from the upper left corner of the picture, so that pixel (r, c) has its centre at column c + 0.5,
row r + 0.5. *Depth* is the coordinate along the optical axis, *distance* the length of the ray.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from xden1k.errors import DataError
from xden1k.values.arrays import Points, Vec3

__all__ = ["Camera", "Rig", "look_at"]

OPENCV = np.array([1.0, -1.0, -1.0])
"""From x right, y up, z backward to x right, y down, z forward, and back."""
ROTATION_TOLERANCE = 1e-3
"""A rotation from a file is rounded."""


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A pinhole camera without distortion.

    Parameters
    ----------
    camera_to_world
        Shape (4, 4): OpenGL camera axes to the object frame, cm.
    focal_px
        Focal length across and down, pixels.
    centre_px
        Column and row of the optical axis, pixels from the upper left corner.
    shape
        Rows and columns of its picture.

    Raises
    ------
    DataError
        If the matrix is no rigid motion, a focal length or the shape is not positive, or a number
        is not finite.

    Examples
    --------
    >>> at = look_at(np.array([0.0, -10.0, 0.0]), np.zeros(3))
    >>> camera = Camera(at, focal_px=(100.0, 100.0), centre_px=(32.0, 24.0), shape=(48, 64))
    >>> camera.project(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])).tolist()
    [[42.0, 24.0, 10.0], [32.0, 14.0, 10.0]]
    """

    camera_to_world: Float[np.ndarray, "4 4"]
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    shape: tuple[int, int]

    def __post_init__(self) -> None:
        rotation = self.rotation
        rigid = (
            np.allclose(rotation @ rotation.T, np.eye(3), atol=ROTATION_TOLERANCE)
            and np.linalg.det(rotation) > 0
            and np.isfinite(self.position_cm).all()
            and np.allclose(self.camera_to_world[3], [0, 0, 0, 1])
        )
        if not rigid:
            raise DataError(
                "camera_to_world must be a rotation and a translation, "
                f"got {np.round(self.camera_to_world, 4).tolist()}"
            )
        finite = np.isfinite([*self.focal_px, *self.centre_px]).all()
        if not (finite and min(self.focal_px) > 0 and min(self.shape) > 0):
            raise DataError(
                "focal_px and shape must be positive and finite, centre_px finite, "
                f"got {list(self.focal_px)}, {list(self.shape)} and {list(self.centre_px)}"
            )

    @property
    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """Columns: right, up and backward, in the object frame."""
        return np.asarray(self.camera_to_world[:3, :3])

    @property
    def position_cm(self) -> Vec3:
        """The pinhole, object frame."""
        return np.asarray(self.camera_to_world[:3, 3])

    def project(self, points_cm: Points) -> Float[np.ndarray, "points 3"]:
        """Column and row in pixels and depth in cm of points.

        Column and row are nan where a point is not in front of the camera.
        """
        x, y, depth = ((points_cm - self.position_cm) @ self.rotation * OPENCV).T
        ahead = np.where(depth > 0, depth, np.nan)
        columns = self.focal_px[0] * x / ahead + self.centre_px[0]
        rows = self.focal_px[1] * y / ahead + self.centre_px[1]
        return np.stack([columns, rows, depth], axis=1)

    def rays(self) -> Float[np.ndarray, "rows columns 3"]:
        """Return unit vectors in the object frame through the centres of the pixels."""
        return self.rays_through(*np.ogrid[: self.shape[0], : self.shape[1]])

    def rays_through(
        self, rows: Int[np.ndarray, "*#n"], columns: Int[np.ndarray, "*#n"]
    ) -> Float[np.ndarray, "*n 3"]:
        """Return unit vectors in the object frame through the centres of some pixels."""
        across = (columns + 0.5 - self.centre_px[0]) / self.focal_px[0]
        down = (rows + 0.5 - self.centre_px[1]) / self.focal_px[1]
        right, up, backward = self.rotation.T
        rays = across[..., None] * right - down[..., None] * up - backward
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        return np.asarray(rays)

    def depth_per_distance(self) -> Float[np.ndarray, "rows columns"]:
        """Depth of a point over its distance, for the ray of each pixel: at most 1."""
        return np.asarray(-self.rays() @ self.rotation[:, 2])


def look_at(position_cm: Vec3, target_cm: Vec3) -> Float[np.ndarray, "4 4"]:
    """Pose of a camera that looks at a point, its right hand level with the object's z axis up.

    Raises
    ------
    DataError
        If it would look straight up or down: which way its right hand is, is then open.
    """
    backward = position_cm - target_cm
    right = np.cross([0.0, 0.0, 1.0], backward)
    if not np.linalg.norm(right) > 1e-9 * np.linalg.norm(backward):
        raise DataError(f"a camera at {position_cm.tolist()} would look along z: give it an offset")
    backward, right = backward / np.linalg.norm(backward), right / np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(backward, right), backward, position_cm], axis=1)
    return pose


@dataclass(frozen=True, slots=True)
class Rig:
    """Rings of cameras on a sphere around an object, scaled to it.

    Parameters
    ----------
    elevations_deg
        One ring for each, between -90 and 90.
    per_ring
        Cameras on each ring, evenly spaced; each ring is turned against the one before.
    size_px
        Rows and columns of each picture.
    distance
        Of the cameras from the object's centre, in radii of its bounding sphere.
    fill
        Share of the picture's width that the bounding sphere takes up. The default leaves room
        for a patch of :data:`xden_baselines.features.encoder.PATCH_SHARE` of a picture around any
        point of the object.
    """

    elevations_deg: tuple[float, ...] = (-45.0, 5.0, 50.0)
    per_ring: int = 4
    size_px: int = 256
    distance: float = 3.0
    fill: float = 0.8

    def cameras(self, points_cm: Points) -> tuple[Camera, ...]:
        """Cameras around these points, such as a mesh's vertices."""
        centre = (points_cm.min(axis=0) + points_cm.max(axis=0)) / 2
        radius = float(np.linalg.norm(points_cm - centre, axis=1).max())
        # the sphere's outline is where rays touch it, at an angle of asin(1 / distance)
        focal = self.fill * self.size_px / 2 * np.sqrt(self.distance**2 - 1)
        return tuple(
            Camera(
                look_at(centre + self.distance * radius * direction, centre),
                focal_px=(float(focal),) * 2,
                centre_px=(self.size_px / 2,) * 2,
                shape=(self.size_px,) * 2,
            )
            for direction in self._directions()
        )

    def _directions(self) -> Points:
        rings = len(self.elevations_deg)
        elevation = np.radians(np.repeat(self.elevations_deg, self.per_ring))
        step = np.tile(np.arange(self.per_ring), rings) + np.repeat(
            np.arange(rings) / rings, self.per_ring
        )
        azimuth = 2 * np.pi * step / self.per_ring
        level = np.cos(elevation)
        return np.stack(
            [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=1
        )
