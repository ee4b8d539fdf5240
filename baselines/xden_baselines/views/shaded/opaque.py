"""Light from surfaces that cannot be seen through."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from xden_baselines.views.shaded.body import Hits
from xden_baselines.views.shaded.reflection import (
    dot,
    lobe_width_rad,
    mirrored,
    specular_share,
    unit,
)
from xden_baselines.views.shaded.scene import Scene, Skin, skin_at
from xden_baselines.views.shaded.studio import DIFFUSE_BLUR_RAD

__all__ = ["light_from_opaque", "light_within", "mirror_image"]

Vectors = Float[np.ndarray, "n 3"]
Light = Float[np.ndarray, "n 3"]
Share = Float[np.ndarray, "n"]

SKY_RAYS = 10
"""Directions in which each sample looks for what hides the room from it."""
SKY_BLUR_RAD = 0.3
"""How much of the room around each of them it stands for."""
MIRROR_SHARP, MIRROR_DULL = 0.15, 0.5
"""Roughness up to which a surface shows a clear image of the object, and from which on none."""
INNER_SHADE = 0.6
"""Of the room that reaches what is seen in a mirror or through glass, where no ray looks for it."""
DIELECTRIC = 0.04
"""Reflectance at normal incidence of a refractive index of 1.5."""


def light_from_opaque(scene: Scene, hits: Hits, sample: int) -> Light:
    """Light from the first surfaces that rays meet."""
    skin = skin_at(scene, hits)
    sky = _open_sky(scene, hits, skin.normals, sample)
    return _shaded(scene, hits, skin, sky, mirror_image(scene, hits, skin, sky))


def light_within(scene: Scene, hits: Hits) -> Light:
    """Light from surfaces that are seen in a mirror or through glass."""
    skin, sky = skin_at(scene, hits), np.full(len(hits), INNER_SHADE)
    return _shaded(scene, hits, skin, sky, sky[:, None] * _room(scene, hits, skin))


def mirror_image(scene: Scene, hits: Hits, skin: Skin, sky: Float[np.ndarray, "n"]) -> Light:
    """Return what surfaces mirror: the room, and the object where it is in the way."""
    directions = _mirrors(hits, skin)
    found = scene.studio.radiance(directions, lobe_width_rad(skin.roughness))
    start = hits.points_cm + scene.body.skip_cm * hits.flat
    met, others = scene.body.cast(start, directions)
    dull = ((skin.roughness - MIRROR_SHARP) / (MIRROR_DULL - MIRROR_SHARP)).clip(0, 1)[:, None]
    image = found * sky[:, None]
    image[met] *= dull[met]
    image[met] += (1 - dull[met]) * light_within(scene, others)
    free = found * (1 - dull + dull * sky[:, None])
    return np.asarray(np.where(met[:, None], image, free))


def _shaded(
    scene: Scene, hits: Hits, skin: Skin, sky: Float[np.ndarray, "n"], mirror: Light
) -> Light:
    """Light scattered in the matt part of a surface, and reflected by its glossy part."""
    cosine = -dot(hits.rays, skin.normals)
    metal = skin.metalness[:, None]
    around = scene.studio.radiance(skin.normals, np.full(len(hits), DIFFUSE_BLUR_RAD))
    matt = (1 - metal) * skin.color * around * sky[:, None]
    share = specular_share(
        metal * skin.color + (1 - metal) * DIELECTRIC, skin.roughness, cosine.clip(0, 1)
    )
    return np.asarray(matt + share * mirror)


def _room(scene: Scene, hits: Hits, skin: Skin) -> Light:
    """Return what of the room a surface mirrors."""
    return scene.studio.radiance(_mirrors(hits, skin), lobe_width_rad(skin.roughness))


def _mirrors(hits: Hits, skin: Skin) -> Vectors:
    """Directions in which surfaces mirror, never into their own facet."""
    directions = mirrored(hits.rays, skin.normals)
    below = dot(directions, hits.flat).clip(max=0)
    return unit(directions - 2 * below[:, None] * hits.flat)


def _open_sky(scene: Scene, hits: Hits, normals: Vectors, sample: int) -> Float[np.ndarray, "n"]:
    """Share of the room's light on a matt surface that the object does not hide from it."""
    light, open_light = np.full(len(hits), 1e-9), np.full(len(hits), 1e-9)
    directions = _spread(SKY_RAYS, sample)
    bright = scene.studio.radiance(directions, np.full(len(directions), SKY_BLUR_RAD)).mean(axis=1)
    for direction, weight in zip(directions, bright, strict=True):
        part = weight * (normals @ direction).clip(min=0)
        facing = (part > 0) & (hits.flat @ direction > 0)
        rays = np.broadcast_to(direction, (int(facing.sum()), 3))
        shown = np.zeros(len(hits), dtype=bool)
        shown[facing] = ~scene.body.blocked(hits.points_cm[facing], rays)
        light += part
        open_light += part * shown
    return np.asarray(open_light / light)


def _spread(count: int, turn: int) -> Vectors:
    """Directions spread evenly over the sphere, other ones for each turn: a Fibonacci lattice."""
    step = np.arange(count) + (0.3819660113 * turn + 0.1) % 1
    high = 1 - 2 * step / count
    azimuth = np.pi * (3 - np.sqrt(5)) * step + turn
    level = np.sqrt(1 - high**2)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), high], axis=1)
