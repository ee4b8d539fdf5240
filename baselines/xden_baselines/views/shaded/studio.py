"""A room to stand in: what light comes from where, and how it looks in a dull mirror.

Floor, walls and ceiling with windows, lamps and dark doors. Everything is a soft-edged patch on
the sphere of directions, so that the room blurred by a rough surface has a closed form: the edges
get softer. No picture is stored, nothing is sampled, and there is no noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

__all__ = ["DIFFUSE_BLUR_RAD", "Panel", "Studio", "studio_of"]

Directions = Float[np.ndarray, "n 3"]
Radiance = Float[np.ndarray, "n 3"]

DIFFUSE_BLUR_RAD = 0.75
"""Standard deviation of a Gaussian about as wide as the cosine lobe of a matt surface."""
SHARPEST_RAD = 0.004
"""Of edges in a perfect mirror: about a pixel."""


@dataclass(frozen=True, slots=True)
class Panel:
    """A rectangle of the room that is brighter or darker than what is around it.

    Parameters
    ----------
    azimuth_deg, elevation_deg
        Of its centre.
    width_deg, height_deg
        Its size.
    radiance
        What it adds to the room behind it: red, green, blue; negative for what is dark.
    """

    azimuth_deg: float
    elevation_deg: float
    width_deg: float
    height_deg: float
    radiance: tuple[float, float, float]

    def share(
        self, directions: Directions, blur_rad: Float[np.ndarray, "n"]
    ) -> Float[np.ndarray, "n"]:
        """Share of a blurred spot around each direction that the panel takes up."""
        outward, across, up = self._axes()
        right = np.arctan2(directions @ across, directions @ outward)
        above = np.arcsin((directions @ up).clip(-1, 1))
        half_width, half_height = np.radians([self.width_deg / 2, self.height_deg / 2])
        across_share = _within(right, half_width, blur_rad)
        return np.asarray(across_share * _within(above, half_height, blur_rad))

    def _axes(self) -> Float[np.ndarray, "3 3"]:
        azimuth, elevation = np.radians([self.azimuth_deg, self.elevation_deg])
        level, high = np.cos(elevation), np.sin(elevation)
        east, north = np.cos(azimuth), np.sin(azimuth)
        return np.array(
            [
                (level * east, level * north, high),
                (-north, east, 0.0),
                (-high * east, -high * north, level),
            ]
        )


_PANELS = (
    *(Panel(azimuth, 28.0, 21.0, 44.0, (5.2, 5.6, 6.2)) for azimuth in (-24.0, 0.0, 24.0)),
    Panel(128.0, 42.0, 58.0, 24.0, (4.6, 4.4, 4.1)),
    Panel(215.0, 24.0, 12.0, 62.0, (3.4, 3.4, 3.6)),
    Panel(0.0, 88.0, 50.0, 16.0, (2.4, 2.4, 2.4)),
    Panel(70.0, 12.0, 26.0, 40.0, (-0.58, -0.59, -0.61)),
    Panel(265.0, 10.0, 34.0, 34.0, (-0.5, -0.5, -0.51)),
    Panel(170.0, -32.0, 60.0, 30.0, (-0.16, -0.15, -0.14)),
)


@dataclass(frozen=True, slots=True)
class Studio:
    """A room with windows, lamps and doors, z up.

    Parameters
    ----------
    turn_rad
        How far it is turned about the object.
    panels
        Brighter and darker rectangles in it.
    floor, wall, ceiling
        Radiance of the rest: red, green, blue.
    """

    turn_rad: float = 0.0
    panels: tuple[Panel, ...] = _PANELS
    floor: tuple[float, float, float] = (0.30, 0.275, 0.25)
    wall: tuple[float, float, float] = (0.66, 0.68, 0.71)
    ceiling: tuple[float, float, float] = (0.90, 0.92, 0.94)

    def radiance(self, directions: Directions, blur_rad: Float[np.ndarray, "n"]) -> Radiance:
        """Light that comes from directions, each averaged over a Gaussian spot.

        Parameters
        ----------
        directions
            Unit vectors, object frame.
        blur_rad
            Standard deviation of the spot around each.
        """
        blur = np.maximum(blur_rad, SHARPEST_RAD)
        turned = self._turned(directions)
        elevation = np.arcsin(turned[:, 2].clip(-1, 1))
        above = ndtr(elevation / blur)[:, None]
        high = ndtr((elevation - 0.9) / np.hypot(blur, 0.25))[:, None]
        floor, wall, ceiling = (np.array(one) for one in (self.floor, self.wall, self.ceiling))
        light = floor + above * (wall - floor) + high * (ceiling - wall)
        for panel in self.panels:
            light += panel.share(turned, blur)[:, None] * np.array(panel.radiance)
        return np.asarray(light.clip(min=0.02))

    def _turned(self, directions: Directions) -> Directions:
        cos, sin = np.cos(self.turn_rad), np.sin(self.turn_rad)
        return np.asarray(directions @ [[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])


def studio_of(object_id: str) -> Studio:
    """Return the room of an object, turned at random but always the same for one id."""
    turn = np.random.default_rng([*object_id.encode()]).uniform(0, 2 * np.pi)
    return Studio(turn_rad=float(turn))


def _within(
    offset_rad: Float[np.ndarray, "n"], half_rad: float, blur_rad: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """Share of Gaussians around offsets that lies within a strip."""
    inside = ndtr((offset_rad + half_rad) / blur_rad) - ndtr((offset_rad - half_rad) / blur_rad)
    return np.asarray(inside)
