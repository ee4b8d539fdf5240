"""An outer surface as the eye sees it: one colour, lit from the upper left. Extra ``build``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Bool, Float64

from xden1k.rays.surfaces import Surfaces
from xden1k.values.arrays import Vec3
from xden1k.values.views import ViewGeometry

__all__ = ["shaded"]

COLOUR: Final = np.array([0.80, 0.83, 0.87])
LIGHT: Final = np.array([-0.45, -0.65, -0.61])
"""Where light comes from: right, down, away from the eye; of length 1."""
AMBIENT: Final = 0.5
MARGIN: Final = 1.06
FINER: Final = 3
"""Rays along each side of a pixel."""
STEP: Final = 0.03
"""A jump in depth that gets a line, as a share of the picture's width."""
LINE: Final = 0.55
"""How much darker such a line is."""

Depths = Float64[np.ndarray, "rows columns"]


def shaded(
    mesh: trimesh.Trimesh,
    size_px: int,
    azimuths_deg: Sequence[float] = (-60.0, 30.0),
    elevation_deg: float = 22.0,
) -> Float64[np.ndarray, "size size 3"]:
    """Draw a closed mesh on white, seen in parallel projection.

    Parameters
    ----------
    mesh
        Closed, cm; z is up.
    size_px
        Rows and columns.
    azimuths_deg, elevation_deg
        Where the eye may be, of which it takes what shows most: -90 and 0 see along +y, as the
        view PA does.

    Returns
    -------
    array
        Red, green and blue from 0 to 1.

    Examples
    --------
    >>> ball = shaded(trimesh.creation.icosphere(subdivisions=3), 32)
    >>> ball.shape, ball[0, 0].tolist(), bool((ball[16, 16] < 1).all())
    ((32, 32, 3), [1.0, 1.0, 1.0], True)
    """
    seen_from = [
        _view(mesh, FINER * size_px, *np.radians([azimuth, elevation_deg]).tolist())
        for azimuth in azimuths_deg
    ]
    eye, depths = max(((eye, _depths(mesh, eye)) for eye in seen_from), key=_seen_cm2)
    pixel_cm = float(np.linalg.norm(eye.column_step_cm))
    seen = np.isfinite(depths)
    light = _light(depths, pixel_cm)
    light[_lines(depths, STEP * pixel_cm * len(depths))] *= LINE
    colours = np.where(seen[..., None], light[..., None] * COLOUR, 1.0)
    means = colours.reshape(size_px, FINER, size_px, FINER, 3).mean(axis=(1, 3))
    return np.asarray(means.clip(0, 1))


def _view(mesh: trimesh.Trimesh, size: int, azimuth: float, elevation: float) -> ViewGeometry:
    """Square parallel view that shows all of a mesh."""
    away = -np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    down = np.cross(away, right)
    places = mesh.vertices @ np.column_stack([right, down, away])
    lowest, highest = places.min(axis=0), places.max(axis=0)
    step = MARGIN * float((highest - lowest)[:2].max()) / size
    middle = (lowest + highest) / 2
    corner: Vec3 = middle[0] * right + middle[1] * down + (lowest[2] - step) * away
    return ViewGeometry(
        beam="parallel",
        pixel00_cm=corner - (size - 1) / 2 * step * (right + down),
        column_step_cm=step * right,
        row_step_cm=step * down,
        shape=(size, size),
        direction=away,
    )


def _seen_cm2(seen: tuple[ViewGeometry, Depths]) -> float:
    eye, depths = seen
    return float(np.isfinite(depths).sum() * np.sum(eye.column_step_cm**2))


def _depths(mesh: trimesh.Trimesh, eye: ViewGeometry) -> Depths:
    """Depth of the first crossing of each ray, cm; not a number where there is none."""
    surfaces = Surfaces.seen([mesh], [0], eye)
    rows, columns = eye.shape
    window = (0, rows, 0, columns)
    counts = surfaces.count(window)
    hit: Bool[np.ndarray, "rows columns"] = counts > 0
    crossings, _ = surfaces.cross(window, counts)
    depths = np.full(eye.shape, np.nan)
    depths[hit] = np.minimum.reduceat(crossings, counts[hit])
    return depths


def _light(depths: Depths, pixel_cm: float) -> Depths:
    """Brightness of the surface, by the way in which it slopes."""
    right, down = (_slopes(depths, axis) / pixel_cm for axis in (1, 0))
    towards = right * LIGHT[0] + down * LIGHT[1] - LIGHT[2]
    cosine = towards / np.sqrt(1 + right**2 + down**2)
    return np.asarray(AMBIENT + (1.25 - AMBIENT) * cosine.clip(0, None))


def _slopes(depths: Depths, axis: int) -> Depths:
    """Change of depth from pixel to pixel, to the nearer neighbour: edges stay sharp."""
    steps = np.diff(depths, axis=axis)
    gap = np.full_like(np.take(depths, [0], axis), np.nan)
    before, after = (np.concatenate(parts, axis) for parts in ((gap, steps), (steps, gap)))
    nearer = np.where(np.abs(before) < np.abs(after), before, after)
    return np.nan_to_num(np.where(np.isnan(after), before, nearer))


def _lines(depths: Depths, jump_cm: float) -> Bool[np.ndarray, "rows columns"]:
    """Pixels behind which the surface falls away, but not to nothing."""
    lines = np.zeros(depths.shape, dtype=np.bool_)
    lines[:, :-1] |= np.diff(depths, axis=1) > jump_cm
    lines[:, 1:] |= np.diff(depths, axis=1) < -jump_cm
    lines[:-1] |= np.diff(depths, axis=0) > jump_cm
    lines[1:] |= np.diff(depths, axis=0) < -jump_cm
    return lines
