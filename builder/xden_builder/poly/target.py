"""What the search for the pose compares: radiographs, and the object before them.

:mod:`pyramid` renders the one and weighs it against the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
import trimesh
from jaxtyping import Float, Float64

from xden1k.values.arrays import Image, Mask
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.poly.model.beam import ViewBeam
from xden_builder.poly.model.frames import any_of, binned, coarse
from xden_builder.poly.model.stray import GLARE, pitches_cm, spread_by_glare

__all__ = ["Averaged", "Bounds", "Target", "Window", "window"]

Window = tuple[slice, slice]
"""Rows and columns of an image."""
Bounds = tuple[Float64[np.ndarray, "u"], Float64[np.ndarray, "u"]]
"""Least and most unknowns."""

DENSITY_SHARES: Final = (0.1, 100.0)
"""Least and most density in shares of the first guess: a part that fades away has no pose, and a
label may call steel wood."""


@dataclass(frozen=True, eq=False)
class Target:
    """Radiographs, and the object that is to be laid onto its shadows in them.

    Parameters
    ----------
    views, saturated, gains, beams
        The radiographs, which of their pixels are known from below alone, means and standard
        deviations of their gains, and what reaches their panels.
    regions
        What is each part's: they share no space.
    mac_cm2_g
        Shape (K, groups): of the material each part is taken for.
    glare
        Mean, standard deviation, least and most of the share of a view's light that spreads.
    """

    views: Sequence[XRayView]
    saturated: Sequence[Mask]
    gains: Sequence[tuple[float, float]]
    beams: Sequence[ViewBeam]
    regions: Sequence[trimesh.Trimesh]
    mac_cm2_g: Float64[np.ndarray, "k groups"]
    glare: tuple[float, float, float, float] = GLARE

    @cached_property
    def points_cm(self) -> Float64[np.ndarray, "n 3"]:
        """All vertices."""
        return np.concatenate([np.asarray(mesh.vertices) for mesh in self.regions])

    @cached_property
    def centre_cm(self) -> Float64[np.ndarray, "3"]:
        """Middle of the box around the object."""
        return np.asarray((self.points_cm.min(axis=0) + self.points_cm.max(axis=0)) / 2)

    @cached_property
    def radius_cm(self) -> float:
        """Of the sphere about the middle that holds the object."""
        return float(np.linalg.norm(self.points_cm - self.centre_cm, axis=1).max())

    def only(self, *numbers: int) -> Target:
        """Return the same object in some of the views."""
        return replace(
            self,
            views=[self.views[n] for n in numbers],
            saturated=[self.saturated[n] for n in numbers],
            gains=[self.gains[n] for n in numbers],
            beams=[self.beams[n] for n in numbers],
        )

    def start(
        self, density_g_cm3: Float64[np.ndarray, "k"], pose: Float64[np.ndarray, "p"]
    ) -> Float64[np.ndarray, "u"]:
        """Gather unknowns: densities, usual gain and glare of each view, and those of the poses."""
        gains, glares = [mean for mean, _ in self.gains], [self.glare[0]] * len(self.gains)
        return np.concatenate([density_g_cm3, gains, glares, pose])

    def bounds(
        self,
        density_g_cm3: Float64[np.ndarray, "k"],
        poses: int,
        shares: tuple[float, float] = DENSITY_SHARES,
    ) -> Bounds:
        """Bounds of the unknowns: shares of some densities, what glare can be, none of the others.

        Parameters
        ----------
        density_g_cm3
            Shape (K,).
        poses
            Count of their unknowns.
        shares
            Least and most.
        """
        gains, rest = np.full(len(self.gains), np.inf), np.full(poses, np.inf)
        (least, most), (dark, bright) = shares, np.repeat([self.glare[2:]], len(gains), axis=0).T
        low = np.concatenate([least * density_g_cm3, -gains, dark, -rest])
        return low, np.concatenate([most * density_g_cm3, gains, bright, rest])


class Averaged(NamedTuple):
    """A radiograph averaged over ``binning * binning`` pixels.

    Parameters
    ----------
    image, known
        Transmission, and which bins have any valid pixel.
    at_least
        Which bins hold a pixel that is known from below alone.
    glare
        What each gets of light that spreads in the scintillator, less what it loses, by a share
        of 1.
    """

    image: Image
    known: Mask
    at_least: Mask
    glare: Float64[np.ndarray, "rows columns"]

    @classmethod
    def of(cls, view: XRayView, saturated: Mask, binning: int) -> Averaged:
        """Average a radiograph."""
        image, known = binned(view, binning)
        light = image.astype(np.float64)
        glare = spread_by_glare(light, pitches_cm(view, binning)) - light
        return cls(image, known, any_of(saturated, binning), glare)


def window(geometry: ViewGeometry, points: Float[np.ndarray, "n 3"], binning: int) -> Window:
    """Rows and columns of the binned image around the object, and some air."""
    places = coarse(geometry, binning).project(points)[:, 1::-1]
    margin = 0.08 * np.ptp(places, axis=0).max() + 4
    low = np.floor(places.min(axis=0) - margin).astype(int).clip(min=0)
    high = (np.ceil(places.max(axis=0) + margin).astype(int) + 1).clip(min=0)
    return slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1]))
