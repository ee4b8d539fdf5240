"""Light through glass, liquids and clear plastic."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from xden_baselines.views.shaded.body import AIR, Hits
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
SURE_STEPS = 4
"""As far on either side of an interface it is asked what is there."""


@dataclass(slots=True, eq=False)
class _Beams:
    """Rays on their way through clear parts.

    Parameters
    ----------
    light
        Of all rays that set out, what they have found so far.
    ray
        Which of them are still on their way.
    carried
        Share of the light further on that reaches the camera.
    hits
        The interfaces they are at.
    """

    light: Light
    ray: Int[np.ndarray, "n"]
    carried: Light
    hits: Hits

    def find(self, which: np.ndarray | slice, light: Light) -> None:
        """Add light that some of them find."""
        self.light[self.ray[which]] += self.carried[which] * light

    def keep(self, which: np.ndarray, hits: Hits) -> None:
        """Follow only some of them, which are at these interfaces now."""
        self.ray, self.carried, self.hits = self.ray[which], self.carried[which], hits


def light_from_clear(scene: Scene, hits: Hits) -> Light:
    """Light through clear parts: reflected at the first interface, refracted at all."""
    beams = _Beams(np.zeros((len(hits), 3)), np.arange(len(hits)), np.ones((len(hits), 3)), hits)
    for interface in range(INTERFACES):
        if len(beams.hits):
            behind = _behind(scene, beams)
            _cross(scene, beams, behind, first=interface == 0)
    blur_rad = np.full(len(beams.hits), LOST_BLUR_RAD)
    beams.find(slice(None), scene.studio.radiance(beams.hits.rays, blur_rad))
    return beams.light


def _behind(scene: Scene, beams: _Beams) -> Parts:
    """Which part is behind the interfaces; rays end where what is opaque touches them."""
    hits = beams.hits
    step = SURE_STEPS * scene.body.skip_cm * hits.rays
    behind = scene.around(hits.points_cm + step, hits.rays)
    touched = (behind != AIR) & ~scene.clear[behind]
    touching = replace(hits.take(touched), part=behind[touched])
    beams.find(touched, light_within(scene, touching))
    beams.keep(~touched, hits.take(~touched))
    return np.asarray(behind[~touched])


def _cross(scene: Scene, beams: _Beams, behind: Parts, *, first: bool) -> None:
    """Refract rays at their interfaces, and follow them to what they meet next."""
    hits, skin = beams.hits, skin_at(scene, beams.hits)
    rays, reflectance, medium = _refracted(scene, hits, skin, behind)
    if first:
        mirror = mirror_image(scene, hits, skin, np.ones(len(hits)))
        beams.find(slice(None), reflectance[:, None] * mirror)
        beams.carried = beams.carried * (1 - reflectance[:, None])
    met, following = scene.body.cast(hits.points_cm + scene.body.skip_cm * rays, rays)
    haze_rad = lobe_width_rad(skin.roughness[~met]) / 2
    beams.find(~met, scene.studio.radiance(rays[~met], haze_rad))
    beams.keep(met, following)
    beams.carried = beams.carried * _tint(scene, medium[met], following.distance_cm)
    opaque = ~scene.clear[following.part]
    beams.find(opaque, light_within(scene, following.take(opaque)))
    beams.keep(~opaque, following.take(~opaque))


def _refracted(
    scene: Scene, hits: Hits, skin: Skin, behind: Parts
) -> tuple[Vectors, Float[np.ndarray, "n"], Parts]:
    """Directions behind interfaces, reflectances, and which part the rays are in then."""
    step = SURE_STEPS * scene.body.skip_cm * hits.rays
    before = scene.around(hits.points_cm - step, -hits.rays)
    index = np.array([*(_index(look) for look in scene.looks), 1.0])
    rays, reflectance = refracted(hits.rays, skin.normals, index[before] / index[behind])
    total = dot(rays, skin.normals) > 0
    return rays, reflectance, np.where(total, before, behind)


def _index(look: Look) -> float:
    """Refractive index; that of air for what is opaque, which no ray is in."""
    return look.finish.refractive_index if look.clear else 1.0


def _tint(scene: Scene, medium: Parts, distance_cm: Float[np.ndarray, "n"]) -> Light:
    """Light that is left after a way through clear matter, by Beer and Lambert."""
    tints = np.array([*(_absorbed_per_cm(look) for look in scene.looks), np.zeros(3)])
    return np.asarray(np.exp(-tints[medium] * distance_cm[:, None]))


def _absorbed_per_cm(look: Look) -> Float[np.ndarray, "3"]:
    """Linear absorption of clear matter, for each colour; 0 of what is opaque."""
    return -np.log(look.color.clip(min=1e-3)) / look.finish.tint_cm if look.clear else np.zeros(3)
