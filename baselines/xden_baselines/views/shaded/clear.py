"""Light through glass, liquids and clear plastic."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from xden_baselines.views.shaded.body import Hits
from xden_baselines.views.shaded.finishes import Look
from xden_baselines.views.shaded.opaque import light_within, mirror_image
from xden_baselines.views.shaded.reflection import dot, lobe_width_rad, refracted
from xden_baselines.views.shaded.scene import Scene, Skin, skin_at

__all__ = ["light_from_clear"]

Vectors = Float[np.ndarray, "n 3"]
Light = Float[np.ndarray, "n 3"]
Parts = Int[np.ndarray, "n"]

INTERFACES = 8
"""That a ray is followed through."""
LOST_BLUR_RAD = 0.3
"""Of the room that is taken for what lies behind the last of them."""
AIR = -1


def light_from_clear(scene: Scene, hits: Hits) -> Light:
    """Light through clear parts: reflected at the first interface, refracted at all."""
    found, carried = np.zeros((len(hits), 3)), np.ones((len(hits), 3))
    alive = np.arange(len(hits))
    for interface in range(INTERFACES):
        if not len(hits):
            break
        skin = skin_at(scene, hits)
        rays, reflectance, medium = _through(scene, hits, skin)
        if interface == 0:
            mirror = mirror_image(scene, hits, skin, np.ones(len(hits)))
            found[alive] += reflectance[:, None] * mirror
            carried *= 1 - reflectance[:, None]
        met, following = scene.body.cast(hits.points_cm + scene.body.skip_cm * rays, rays)
        haze = lobe_width_rad(skin.roughness[~met]) / 2
        found[alive[~met]] += carried[~met] * scene.studio.radiance(rays[~met], haze)
        following = _touching(scene, hits.take(met), following)
        alive, carried = alive[met], carried[met] * _tint(scene, medium[met], following.distance_cm)
        opaque = ~scene.clear[following.part]
        found[alive[opaque]] += carried[opaque] * light_within(scene, following.take(opaque))
        alive, carried, hits = alive[~opaque], carried[~opaque], following.take(~opaque)
    found[alive] += carried * scene.studio.radiance(hits.rays, np.full(len(hits), LOST_BLUR_RAD))
    return found


def _touching(scene: Scene, hits: Hits, following: Hits) -> Hits:
    """Give what is hit behind an interface: that itself, where what is opaque touches it.

    A ray that leaves an opaque part was in it from the start.
    """
    touching = ~scene.clear[following.part] & ~following.entering
    return replace(
        following,
        points_cm=np.where(touching[:, None], hits.points_cm, following.points_cm),
        distance_cm=np.where(touching, 0.0, following.distance_cm),
        flat=np.where(touching[:, None], hits.flat, following.flat),
        normals=np.where(touching[:, None], hits.normals, following.normals),
    )


def _through(scene: Scene, hits: Hits, skin: Skin) -> tuple[Vectors, Float[np.ndarray, "n"], Parts]:
    """Directions behind an interface, its reflectance, and which part is there, or ``AIR``."""
    step = 4 * scene.body.skip_cm * hits.rays
    before = _medium(scene, hits.points_cm - step, -hits.rays)
    behind = _medium(scene, hits.points_cm + step, hits.rays)
    index = np.array([*(look.finish.refractive_index for look in scene.looks), 1.0])
    rays, reflectance = refracted(hits.rays, skin.normals, index[before] / index[behind])
    total = dot(rays, skin.normals) > 0
    return rays, reflectance, np.where(total, before, behind)


def _medium(scene: Scene, points_cm: Vectors, rays: Vectors) -> Parts:
    """Which clear part is around points; ``AIR`` where there is none."""
    found = np.full(len(points_cm), AIR)
    for part in np.flatnonzero(scene.clear):
        found[scene.body.inside(int(part), points_cm, rays)] = part
    return found


def _tint(scene: Scene, medium: Parts, distance_cm: Float[np.ndarray, "n"]) -> Light:
    """Light that is left after a way through clear matter, by Beer and Lambert."""
    tints = np.array([*(_absorbed_per_cm(look) for look in scene.looks), np.zeros(3)])
    return np.asarray(np.exp(-tints[medium] * distance_cm[:, None]))


def _absorbed_per_cm(look: Look) -> Float[np.ndarray, "3"]:
    """Linear absorption of clear matter, for each colour; 0 of what is opaque."""
    return -np.log(look.color.clip(min=1e-3)) / look.finish.tint_cm if look.clear else np.zeros(3)
