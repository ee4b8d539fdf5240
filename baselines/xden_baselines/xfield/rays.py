"""What a radiograph says along each ray, and where points meet it."""

from __future__ import annotations

from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

__all__ = [
    "FLOOR",
    "IMAGE_CHANNELS",
    "RAY_CHANNELS",
    "log_attenuation",
    "projected",
    "ray_channels",
    "sampled",
]

FLOOR: Final = 0.003
"""Transmission below which a pixel tells no more: stray light and noise."""
USUAL_MAC_CM2_G: Final = 0.2
"""Fixed normaliser of attenuation to density; no calibration."""
REGULAR: Final = 0.02
"""Attenuation that is added to the denominator of a mean density."""
SHORTEST: Final = 0.03
"""Chords below this share of half the cube's edge tell no mean density."""
DENSEST_G_CM3: Final = 9.0
IMAGE_CHANNELS: Final = 3
"""Of the ray channels, what an encoder of images sees: not the chord."""
RAY_CHANNELS: Final = 4


def log_attenuation(transmission: Float[Tensor, "*pixels"]) -> Float[Tensor, "*pixels"]:
    """Line integral of the attenuation, at most that of :data:`FLOOR`."""
    return -transmission.clamp(min=FLOOR).log()


def ray_channels(
    transmission: Float[Tensor, "batch views rows columns"],
    chord: Float[Tensor, "batch views rows columns"],
    half_cm: Float[Tensor, "batch"],
) -> Float[Tensor, "batch views 4 rows columns"]:
    """Log attenuation / 3, transmission, mean density along the chord / 4, chord / half the cube.

    The mean density takes all matter for 0.2 cm²/g and is 0 where the chord is short.
    """
    attenuation = log_attenuation(transmission)
    length_cm = chord * half_cm[:, None, None, None]
    mean = (attenuation / (USUAL_MAC_CM2_G * length_cm + REGULAR)).clamp(0, DENSEST_G_CM3)
    mean = mean * (chord >= SHORTEST)
    return torch.stack([attenuation / 3, transmission.clamp(0, 1.05), mean / 4, chord], dim=2)


def projected(
    projection: Float[Tensor, "batch views 3 4"], places: Float[Tensor, "batch points 3"]
) -> Float[Tensor, "batch views points 2"]:
    """Column and row of points in each crop, -1 to 1; in bf16 they would be pixels off."""
    with torch.autocast(places.device.type, enabled=False):
        found = places[:, None] @ projection[..., :3].mT + projection[:, :, None, :, 3]
    return found[..., :2] / found[..., 2:]


def sampled(
    images: Float[Tensor, "batch channels rows columns"],
    at: Float[Tensor, "batch points 2"],
) -> Float[Tensor, "batch points channels"]:
    """Values of images between their pixels, at (column, row) from -1 to 1; else the edge's."""
    found = functional.grid_sample(images, at[:, None], padding_mode="border", align_corners=False)
    return found[:, :, 0].transpose(1, 2)
