"""Pictures by physically based shading: windows to reflect, roughness, metals, glass and grain.

Rays find surfaces by Embree, as in the flat renderer, whose masks, distances and cameras these
pictures share to the bit. Light comes from a :class:`Studio`, which is known in closed form at any
blur: a rough surface reflects a blurred room ("split sum", Karis 2013). Rays to a few directions
tell how much of the room the object hides from itself, one ray more what it sees of itself in its
own mirror, and rays refracted at each interface what is seen through glass and liquids. Nothing is
drawn at random, so there is no noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh
from jaxtyping import Bool, Float, UInt8

from xden_baselines.views.cameras import Camera
from xden_baselines.views.pictures import Pictures
from xden_baselines.views.rendering import Rendered, render
from xden_baselines.views.shaded.body import Body, Hits
from xden_baselines.views.shaded.clear import light_from_clear
from xden_baselines.views.shaded.finishes import Look
from xden_baselines.views.shaded.opaque import light_from_opaque
from xden_baselines.views.shaded.scene import Scene
from xden_baselines.views.shaded.studio import Studio

__all__ = ["VERSION", "render_shaded"]

Light = Float[np.ndarray, "n 3"]

VERSION = "1"
"""Of all that decides what these pictures look like; a change that moves a pixel is a new one."""
SAMPLES_PX = ((0.0, 0.0), (-0.35, -0.1), (0.1, 0.35), (0.3, -0.25))
"""Rays through each pixel, from its centre."""
EXPOSURE = 1.25
WHITEST = 4.0
"""Light, after exposure, that is shown as white."""


def render_shaded(
    meshes: Sequence[trimesh.Trimesh],
    looks: Sequence[Look],
    cameras: Sequence[Camera],
    studio: Studio,
) -> Rendered:
    """Draw parts as cameras outside them see them.

    Parameters
    ----------
    meshes
        One for each part, closed, cm, at most 255.
    looks
        One for each part.
    cameras
        All of one picture size, outside the object.
    studio
        The room they stand in.

    Raises
    ------
    DataError
        If there is no triangle or no camera.
    """
    drawn = render(meshes, [(0.0, 0.0, 0.0)] * len(meshes), cameras)
    scene = Scene(Body(meshes), looks, studio)
    colors = drawn.pictures.colors.copy()
    for view, camera in enumerate(cameras):
        mask = drawn.pictures.masks[view]
        colors[view][mask] = _displayed(_seen(scene, camera, mask))
    pictures = drawn.pictures
    return Rendered(
        Pictures(colors, pictures.masks, pictures.distance_cm, pictures.cameras), drawn.parts
    )


def _seen(scene: Scene, camera: Camera, mask: Bool[np.ndarray, "rows columns"]) -> Light:
    """Mean light of the samples of each pixel that meet the object; the first always does."""
    pixels = np.nonzero(mask)
    total, count = np.zeros((len(pixels[0]), 3)), np.zeros(len(pixels[0]))
    for number, (right, down) in enumerate(SAMPLES_PX):
        centre = (camera.centre_px[0] - right, camera.centre_px[1] - down)
        rays = replace(camera, centre_px=centre).rays_through(*pixels)
        hit, hits = scene.body.cast(camera.position_cm, rays)
        total[hit] += _light(scene, hits, number)
        count[hit] += 1
    return np.asarray(total / count[:, None])


def _light(scene: Scene, hits: Hits, sample: int) -> Light:
    """Light from the first surfaces that rays meet."""
    clear = scene.clear[hits.part]
    found = np.zeros((len(hits), 3))
    found[~clear] = light_from_opaque(scene, hits.take(~clear), sample)
    found[clear] = light_from_clear(scene, hits.take(clear))
    return found


def _displayed(light: Light) -> UInt8[np.ndarray, "n 3"]:
    """Bytes that show light: exposure, a soft shoulder for highlights, and sRGB's curve."""
    bright = EXPOSURE * light
    film = (bright * (1 + bright / WHITEST**2) / (1 + bright)).clip(0, 1)
    steep = 1.055 * film ** (1 / 2.4) - 0.055
    shown = np.where(film <= 0.0031308, 12.92 * film, steep)
    return np.asarray(np.rint(255 * shown).astype(np.uint8))
