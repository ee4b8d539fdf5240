"""An object in a room, and what its surfaces are like where rays meet them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from xden_baselines.views.shaded.body import AIR, Body, Group, Hits
from xden_baselines.views.shaded.finishes import Look
from xden_baselines.views.shaded.reflection import facing, unit
from xden_baselines.views.shaded.studio import Studio
from xden_baselines.views.shaded.textures import TEXTURES

__all__ = ["Scene", "Skin", "skin_at"]

ROUGHER = 0.3
"""By which share a texture makes a surface rougher or smoother."""


@dataclass(frozen=True, eq=False)
class Scene:
    """An object and the room around it.

    Parameters
    ----------
    body
        Its parts.
    looks
        What they look like.
    studio
        The room.
    """

    body: Body
    looks: Sequence[Look]
    studio: Studio

    @cached_property
    def clear(self) -> Bool[np.ndarray, "parts"]:
        """Which parts can be seen through."""
        return np.array([look.clear for look in self.looks])

    def around(
        self, points_cm: Float[np.ndarray, "n 3"], rays: Float[np.ndarray, "n 3"]
    ) -> Int[np.ndarray, "n"]:
        """Which part is around points, seen by rays in any direction; ``AIR``: none."""
        found = np.full(len(points_cm), AIR)
        for group in self._groups:
            part = group.around(points_cm, rays)
            found = np.where(part == AIR, found, part)
        return found

    @cached_property
    def _groups(self) -> list[Group]:
        """Parts that hold others, each alone, and all the rest: so no two of a group touch."""
        holders = np.array([look.holds_others for look in self.looks])
        alone = np.eye(len(self.looks), dtype=bool)[holders]
        return [self.body.group(parts) for parts in (~holders, *alone) if parts.any()]


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    """The surface at each hit, its grain included.

    Parameters
    ----------
    color
        Base colour, linear red, green and blue.
    metalness, roughness
        From 0 to 1, as glTF 2.0 has them.
    normals
        Unit vectors.
    """

    color: Float[np.ndarray, "n 3"]
    metalness: Float[np.ndarray, "n"]
    roughness: Float[np.ndarray, "n"]
    normals: Float[np.ndarray, "n 3"]


def skin_at(scene: Scene, hits: Hits) -> Skin:
    """Return what the surface is like at each hit."""
    color, normals = np.zeros((len(hits), 3)), hits.normals.copy()
    metalness, roughness = np.zeros(len(hits)), np.zeros(len(hits))
    for part in np.unique(hits.part):
        here, look, frame = hits.part == part, scene.looks[part], scene.body.frames[part]
        finish = look.finish
        places = frame.places(hits.points_cm[here]) / finish.scale_cm + look.offset
        grain = TEXTURES[finish.texture](places, frame.turned(hits.normals[here]))
        color[here] = (look.color * (1 + finish.contrast * grain.tone[:, None])).clip(0, 1)
        metalness[here] = finish.metalness
        roughness[here] = (look.roughness * (1 + ROUGHER * grain.rough)).clip(0.01, 1)
        normals[here] = unit(normals[here] + finish.relief * frame.back(grain.tilt))
    return Skin(color, metalness, roughness, facing(normals, hits.rays))
