"""Small pictures of a view with the silhouette of meshes over it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float, Float32, Float64, UInt8
from scipy.ndimage import binary_dilation

from xden1k.pictures.looks import attenuation, grey_scale
from xden1k.rays import path_lengths
from xden1k.values.arrays import Mask
from xden1k.values.views import ViewGeometry, XRayView
from xden1k.values.windows import pixel_aspect
from xden_builder.pipeline.check.outlines import air_level
from xden_builder.registration.shadow import Shadow
from xden_builder.triage.pictures import Picture, picture

__all__ = ["FOUND", "TOLD", "Sheet", "window_around"]

LINE_PX: Final = 2
MARGIN: Final = 0.15
"""Around shadow and meshes, as a share of half their box."""
SLENDER: Final = 0.4
"""Least shorter side of a window over its longer one."""
DARKENED: Final = 0.04
"""What the object takes from the light where it is drawn as shadow."""
APART_PX: Final = 2
"""Of the radiograph: so near to each other, outlines agree."""
OPACITY: Final = 0.7
"""Of the colours where silhouettes disagree."""

Colour = tuple[int, int, int]
TOLD: Final[Colour] = (232, 121, 249)
"""Of meshes where their files have them."""
FOUND: Final[Colour] = (34, 211, 238)
"""Of meshes where they were found to be."""
SHADOW_ALONE: Final[Colour] = (255, 80, 70)
MESH_ALONE: Final[Colour] = (70, 130, 255)

Box = Float64[np.ndarray, "4"]
"""First column, first row, last column, last row; edges, in pixels of the radiograph."""


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A radiograph, or a window of it, in the pixels of a picture.

    Parameters
    ----------
    geometry
        Of those pixels.
    grey
        Shape (rows, columns, 4): its attenuation, air black.
    shadow
        Shape (rows, columns): where the object's shadow is.
    apart_px
        So near to each other, outlines agree.
    """

    geometry: ViewGeometry
    grey: UInt8[np.ndarray, "rows columns 4"]
    shadow: Mask
    apart_px: int

    @classmethod
    def of(cls, view: XRayView, shadow: Shadow, box_px: Box, longest_px: int) -> Sheet:
        """Cut a box out of a view, such that its longer side has so many pixels."""
        geometry = _cut(view, box_px, longest_px)
        air = air_level(view.transmission, shadow.mask | ~view.valid)
        image = np.where(view.valid, view.transmission / np.float32(air), np.float32(np.nan))
        seen = _resized(attenuation(image), geometry, box_px)
        darkened = _resized(shadow.opacity, geometry, box_px) > DARKENED
        larger = np.linalg.norm(view.geometry.column_step_cm) / np.linalg.norm(
            geometry.column_step_cm
        )
        grey = grey_scale(seen).to_rgba(seen, bytes=True)
        return cls(geometry, grey, darkened, max(round(APART_PX * float(larger)), 1))

    def outlined(
        self, label: str, meshes: Sequence[trimesh.Trimesh], colour: Colour
    ) -> Picture | None:
        """Draw the silhouette of meshes around what they cover; None where it is not in sight."""
        inside = self._silhouette(meshes)
        if not inside.any():
            return None
        colours = self.grey.copy()
        colours[binary_dilation(inside, iterations=LINE_PX) & ~inside, :3] = colour
        return self._picture(label, colours)

    def disagreeing(self, label: str, meshes: Sequence[trimesh.Trimesh]) -> Picture:
        """Draw where shadow or silhouette of meshes lie well outside the other."""
        inside, colours = self._silhouette(meshes), self.grey.copy()
        for where, colour in (
            (self.shadow & ~binary_dilation(inside, iterations=self.apart_px), SHADOW_ALONE),
            (inside & ~binary_dilation(self.shadow, iterations=self.apart_px), MESH_ALONE),
        ):
            mixed = OPACITY * np.array(colour) + (1 - OPACITY) * colours[where, :3]
            colours[where, :3] = mixed.round()
        return self._picture(label, colours)

    def _silhouette(self, meshes: Sequence[trimesh.Trimesh]) -> Mask:
        inside = np.zeros(self.geometry.shape, dtype=np.bool_)
        if in_front(meshes, self.geometry):
            lengths = path_lengths(meshes, range(len(meshes)), self.geometry)
            inside.flat[lengths.pixels] = True
        return inside

    def _picture(self, label: str, colours: UInt8[np.ndarray, "rows columns 4"]) -> Picture:
        return picture(label, colours, 1.0, max(self.geometry.shape))


def window_around(shadow: Shadow, meshes: Sequence[trimesh.Trimesh]) -> Box:
    """Give a box around a shadow and the silhouette of meshes, cut to the radiograph."""
    low, high = shadow.box_px[:2], shadow.box_px[2:]
    if in_front(meshes, shadow.geometry):
        points = shadow.geometry.project(_vertices(meshes))[:, :2]
        low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    half = (high - low) / 2
    reach = (1 + MARGIN) * np.maximum(half, SLENDER * half.max())
    middle, last = (low + high) / 2, np.array(shadow.geometry.shape[::-1]) - 0.5
    return np.concatenate([np.maximum(middle - reach, -0.5), np.minimum(middle + reach, last)])


def in_front(meshes: Sequence[trimesh.Trimesh], geometry: ViewGeometry) -> bool:
    """Say whether meshes lie before the X-ray source, where there is a point it is at."""
    if geometry.source_cm is None:
        return True
    depth = (_vertices(meshes) - geometry.source_cm) @ np.linalg.inv(geometry.matrix)[2]
    return bool(depth.min() > 0)


def _vertices(meshes: Sequence[trimesh.Trimesh]) -> Float64[np.ndarray, "n 3"]:
    return np.concatenate([np.asarray(mesh.vertices) for mesh in meshes])


def _cut(view: XRayView, box_px: Box, longest_px: int) -> ViewGeometry:
    """Place square pixels over a box."""
    size, told = box_px[2:] - box_px[:2], view.geometry
    width, height = (size * (1.0, pixel_aspect(view))).tolist()
    pitch = max(width, height) / longest_px
    shape = max(round(height / pitch), 1), max(round(width / pitch), 1)
    across, down = (size / shape[::-1]).tolist()
    left, top = float(box_px[0]) + across / 2, float(box_px[1]) + down / 2
    return replace(
        told,
        pixel00_cm=told.pixel00_cm + left * told.column_step_cm + top * told.row_step_cm,
        column_step_cm=across * told.column_step_cm,
        row_step_cm=down * told.row_step_cm,
        shape=shape,
    )


def _resized(
    image: Float[np.ndarray, "rows columns"], geometry: ViewGeometry, box_px: Box
) -> Float32[np.ndarray, "_rows _columns"]:
    """Read a box of an image in larger or smaller pixels."""
    from PIL import Image as Pillow

    resized = Pillow.fromarray(np.asarray(image, np.float32)).resize(
        geometry.shape[::-1], Pillow.Resampling.BILINEAR, tuple((box_px + 0.5).tolist())
    )
    return np.asarray(resized)
