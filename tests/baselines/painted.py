"""Coloured objects for methods that read pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import trimesh

from tests.phantoms import Box, box_object
from xden1k.values.types import DensityObject
from xden_baselines.views.cameras import Camera, look_at
from xden_baselines.views.pictures import Pictures
from xden_baselines.views.rendering import render

GREY, BROWN, RED = (0.7, 0.7, 0.72), (0.6, 0.4, 0.2), (0.8, 0.1, 0.1)


def painted(
    object_id: str,
    boxes: Sequence[Box],
    colors: Mapping[str, tuple[float, float, float]],
    **rest: object,
) -> DensityObject:
    """Object of boxes whose parts have the colours of their names."""
    obj = box_object(object_id, boxes, **rest)
    parts = tuple(replace(part, color_rgb=colors[part.name]) for part in obj.parts)
    return replace(obj, parts=parts)


def camera_at(position: Sequence[float], target: Sequence[float] = (0, 0, 0)) -> Camera:
    """Camera of 96 by 128 pixels, focal length 100 pixels."""
    pose = look_at(np.array(position, dtype=float), np.array(target, dtype=float))
    return Camera(pose, focal_px=(100.0, 100.0), centre_px=(64.0, 48.0), shape=(96, 128))


def sphere_pictures(cameras: Sequence[Camera], radius: float = 1.0) -> Pictures:
    """Pictures of a red sphere at the origin."""
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=radius)
    return render([sphere], [RED], cameras).pictures
