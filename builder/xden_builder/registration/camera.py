"""A view on few pixels: what a cloud of points looks like in many poses, against the shadow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float, Float32, Float64
from scipy.ndimage import gaussian_filter, map_coordinates

from xden1k.values.views import ViewGeometry
from xden_builder.registration import kernels
from xden_builder.registration.body import Cloud
from xden_builder.registration.shadow import OPAQUE, Shadow

__all__ = ["Camera", "Features", "rendered", "seen"]

BLUR_PX: Final = 1.0
"""Standard deviation of the blur, in the camera's pixels, part of it before light is counted."""
BEFORE, AFTER = 0.6, 0.8
MARGIN_PX: Final = 5
"""Of air around the shadow."""
DEEPEST: Final = 6.0
SOFTENING: Final = 0.02
"""-ln T below which its root grows as itself."""
OUTLINE_DEPTH: Final = 0.06
"""-ln T at which half of the outline's weight is reached."""
USUAL_DEPTH: Final = 0.2
"""-ln T: where less is typical of a shadow, all depths are raised to it in proportion."""
OUTLINE_WEIGHT: Final = 0.7
"""Of the outline, which does not depend on labels, beside the root of -ln T, which does."""

Rotations = Float64[np.ndarray, "b 3 3"]
Shifts = Float64[np.ndarray, "b 3"]
Features = Float32[np.ndarray, "b n"]


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A coarse window of a view around the shadow.

    Parameters
    ----------
    geometry
        Of the window's pixels.
    seen
        Shape (n,): features of the shadow.
    contrast
        By which -ln T is multiplied before features are taken of it; 1 but for faint shadows.
    """

    geometry: ViewGeometry
    seen: Float32[np.ndarray, "n"]
    contrast: float

    @classmethod
    def of(cls, shadow: Shadow, wide_px: int) -> Camera:
        """Look at a shadow with pixels such that its longer side is so many of them."""
        pitch = float(shadow.size_px.max()) / wide_px
        columns, rows = (np.ceil(shadow.size_px / pitch) + 2 * MARGIN_PX).astype(int).tolist()
        start = shadow.middle_px - pitch * (np.array([columns, rows]) - 1) / 2
        told = shadow.geometry
        geometry = replace(
            told,
            pixel00_cm=told.pixel_centres_cm(start[1:], start[:1])[0],
            column_step_cm=pitch * told.column_step_cm,
            row_step_cm=pitch * told.row_step_cm,
            shape=(rows, columns),
        )
        places = np.indices((rows, columns)) * pitch + start[::-1, None, None]
        blurred = gaussian_filter(shadow.opacity, BLUR_PX * pitch)
        opacity = map_coordinates(blurred, places, order=1)
        contrast = max(1.0, USUAL_DEPTH / shadow.typical_depth)
        return cls(geometry, _features(1 - opacity[None], contrast)[0], contrast)

    @property
    def pixel_cm(self) -> float:
        """Side of its pixels on the panel."""
        return float(np.linalg.norm(self.geometry.column_step_cm))

    def render(self, cloud: Cloud, rotations: Rotations, shifts: Shifts) -> Features:
        """Features of a cloud in some poses: a point x stands at R x + shift."""
        images = np.zeros((len(rotations), *self.geometry.shape), dtype=np.float32)
        cone = self.geometry.source_cm is not None
        origin = self.geometry.source_cm if cone else self.geometry.pixel00_cm
        kernels.splat(
            cloud.points_cm.astype(np.float32),
            cloud.weights_cm2.astype(np.float32),
            np.ascontiguousarray(rotations),
            np.ascontiguousarray(shifts),
            np.linalg.inv(self.geometry.matrix),
            origin,
            cone,
            self._pixel_area_cm2,
            images,
        )
        depth = _blurred(images, BEFORE)
        return _features(_blurred(np.exp(-depth), AFTER), self.contrast)

    @property
    def _pixel_area_cm2(self) -> float:
        """Area across the beam of the middle pixel."""
        volume = abs(float(np.linalg.det(self.geometry.matrix)))
        rows, columns = np.array(self.geometry.shape)[:, None] / 2
        return volume / float(self.geometry.cm_per_depth(rows, columns)[0])


def _blurred(
    images: Float32[np.ndarray, "b rows columns"], sd_px: float
) -> Float32[np.ndarray, "b rows columns"]:
    return np.asarray(
        gaussian_filter(images, (0, sd_px, sd_px), mode="nearest", truncate=2.5), np.float32
    )


def _features(transmission: Float[np.ndarray, "b rows columns"], contrast: float) -> Features:
    """Root of -ln T, which content and outline share, and the outline alone."""
    depth = -np.log(transmission.clip(min=OPAQUE)).reshape(len(transmission), -1)
    depth = (contrast * depth).clip(0, DEEPEST)
    root = np.sqrt(depth + SOFTENING) - SOFTENING**0.5
    outline = OUTLINE_WEIGHT * depth**2 / (depth**2 + OUTLINE_DEPTH**2)
    return np.concatenate([root, outline], axis=1, dtype=np.float32)


def seen(cameras: Sequence[Camera]) -> Float32[np.ndarray, "n"]:
    """Features of the shadows in all views."""
    return np.concatenate([camera.seen for camera in cameras])


def rendered(
    cameras: Sequence[Camera], cloud: Cloud, rotations: Rotations, shifts: Sequence[Shifts]
) -> Features:
    """Features of a cloud in some poses, in all views; shifts of each view."""
    return np.concatenate(
        [
            camera.render(cloud, rotations, mine)
            for camera, mine in zip(cameras, shifts, strict=True)
        ],
        axis=1,
    )
