"""Pictures of part-coloured meshes: rays cast by Embree, Lambert shading, fixed lights.

Embree (Intel's ray tracer, through ``embreex``, the binding trimesh recommends) runs on any CPU
without a display or OpenGL driver, finds the nearest triangle exactly up to float32, and gives
depth and visibility with the picture. What materials look like beyond their colour is drawn by
:mod:`xden_baselines.views.shaded`, on the same rays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from jaxtyping import Float, Float32, Int32, UInt8

from xden1k.errors import DataError, require
from xden1k.values.arrays import Vec3
from xden_baselines.views.cameras import Camera
from xden_baselines.views.pictures import BACKGROUND, Pictures

if TYPE_CHECKING:
    from embreex import mesh_construction, rtcore_scene
else:
    rtcore_scene = require("embreex.rtcore_scene", "baselines")
    mesh_construction = require("embreex.mesh_construction", "baselines")

__all__ = ["Color", "Rendered", "Surface", "render", "shaded"]

Color = tuple[float, float, float]
"""Red, green, blue, 0 to 1, as displayed."""
Origins = Vec3 | Float[np.ndarray, "*n 3"]
AMBIENT = 0.55
LIGHTS = (
    ((0.4, -0.7, 0.6), 0.25),
    ((-0.8, 0.3, 0.5), 0.12),
    ((0.3, 0.6, -0.7), 0.08),
)
"""Directions towards the lights, object frame, and their strengths. With the ambient light they add
up to 1: no surface gets brighter than its own colour."""


class Surface:
    """Triangles that rays can hit.

    Parameters
    ----------
    triangles_cm
        Corners, object frame.

    Raises
    ------
    DataError
        If there is none.
    """

    def __init__(self, triangles_cm: Float[np.ndarray, "faces 3 3"]) -> None:
        if not len(triangles_cm):
            raise DataError("a surface needs triangles, got none")
        self._scene = rtcore_scene.EmbreeScene()
        # the scene does not keep the mesh alive
        self._mesh = mesh_construction.TriangleMesh(self._scene, triangles_cm.astype(np.float32))

    def first_hits(
        self, origin_cm: Origins, rays: Float[np.ndarray, "*n 3"]
    ) -> tuple[Int32[np.ndarray, "*n"], Float32[np.ndarray, "*n"]]:
        """Nearest triangle along rays of unit length from one point, or from one for each.

        Returns
        -------
        faces
            Index of the triangle, -1 where there is none.
        distance_cm
            Along the ray; inf where there is none.
        """
        faces, distance, _ = self.hits(origin_cm, rays)
        return faces, distance

    def hits(
        self, origin_cm: Origins, rays: Float[np.ndarray, "*n 3"]
    ) -> tuple[Int32[np.ndarray, "*n"], Float32[np.ndarray, "*n"], Float32[np.ndarray, "*n 2"]]:
        """Do the same, and say where in its triangle each ray hits.

        Returns
        -------
        faces, distance_cm
            As of :meth:`first_hits`.
        spot
            Weights of the second and the third corner at the hit.
        """
        directions = rays.reshape(-1, 3).astype(np.float32)
        origins = np.broadcast_to(origin_cm, rays.shape).reshape(-1, 3)
        hits = self._scene.run(origins.astype(np.float32), directions, output=True)
        faces = np.asarray(hits["primID"], dtype=np.int32)
        distance = np.where(faces >= 0, hits["tfar"], np.inf).astype(np.float32)
        spot = np.stack([hits["u"], hits["v"]], axis=-1)
        shape = rays.shape[:-1]
        return faces.reshape(shape), distance.reshape(shape), spot.reshape(*shape, 2)


@dataclass(frozen=True, slots=True, eq=False)
class Rendered:
    """Pictures, and beside them what only a method that reads ``PARTS`` may know.

    Parameters
    ----------
    pictures
        For any method that reads ``RGB``.
    parts
        Shape (views, rows, columns): number of the part, from 1; 0 off the object.
    """

    pictures: Pictures
    parts: UInt8[np.ndarray, "views rows columns"]


def render(
    meshes: Sequence[trimesh.Trimesh], colors: Sequence[Color], cameras: Sequence[Camera]
) -> Rendered:
    """Draw parts as cameras outside them see them, one ray through each pixel's centre.

    What lies behind another surface leaves no trace.

    Parameters
    ----------
    meshes
        One for each part, cm, at most 255.
    colors
        One for each part.
    cameras
        All of one picture size, outside the object.

    Raises
    ------
    DataError
        If there is no triangle or no camera.
    """
    triangles = np.concatenate([np.asarray(mesh.triangles) for mesh in meshes])
    part_of_face = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
    surface, normals = Surface(triangles), _normals(triangles)
    albedo = np.array(colors, dtype=np.float64)
    pictures, distances, parts = [], [], []
    for camera in cameras:
        rays = camera.rays()
        faces, distance = surface.first_hits(camera.position_cm, rays)
        hit = faces >= 0
        part = part_of_face[faces[hit]]
        picture = np.full((*camera.shape, 3), BACKGROUND, dtype=np.uint8)
        light = shaded(normals[faces[hit]], rays[hit])
        picture[hit] = np.rint(255 * light[:, None] * albedo[part])
        numbers = np.zeros(camera.shape, dtype=np.uint8)
        numbers[hit] = part + 1
        pictures.append(picture)
        distances.append(distance)
        parts.append(numbers)
    if not pictures:
        raise DataError("rendering needs at least one camera, got none")
    distance_cm = np.stack(distances)
    return Rendered(
        Pictures(np.stack(pictures), np.isfinite(distance_cm), distance_cm, tuple(cameras)),
        np.stack(parts),
    )


def shaded(
    normals: Float[np.ndarray, "hits 3"], rays: Float[np.ndarray, "hits 3"]
) -> Float[np.ndarray, "hits"]:
    """Share of its colour that a surface shows: Lambert's law, ambient light added.

    A surface seen from behind is lit as if it faced the camera.
    """
    away = (normals * rays).sum(axis=1, keepdims=True) > 0
    facing = np.where(away, -normals, normals)
    light = np.full(len(normals), AMBIENT)
    for towards, strength in LIGHTS:
        direction = np.array(towards) / np.linalg.norm(towards)
        light += strength * (facing @ direction).clip(min=0)
    return light


def _normals(triangles: Float[np.ndarray, "faces 3 3"]) -> Float[np.ndarray, "faces 3"]:
    """Return unit normals; 0 for a triangle without area, which no ray hits."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(lengths > 0, lengths, 1))
