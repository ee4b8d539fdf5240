"""Grain of surfaces, solid: it fills the part, and a surface shows a cut through it.

Every texture is a function of places in the part's own frame, in units of the size of its
features, x along the longest axis of the part. It says by how much the surface is lighter there
(*tone*, about -1 to 1), where it is rougher (the same), and which way it is tilted (*tilt*, a
vector as long as the slope).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from jaxtyping import Float
from scipy.ndimage import map_coordinates

__all__ = ["TEXTURES", "Grain", "noise"]

Places = Float[np.ndarray, "n 3"]
Values = Float[np.ndarray, "n"]

LATTICE = 64
SPLINE_DEVIATION = 0.55**1.5
"""Of white noise after interpolation by quadratic B-splines in three dimensions: the mean square of
their weights is 11/20 on each axis."""
_APART = np.array([[0.0, 0.0, 0.0], [19.3, 7.1, 41.7], [43.9, 31.3, 11.9]])
"""Where three noises that have nothing to do with each other are read."""


@dataclass(frozen=True, slots=True, eq=False)
class Grain:
    """What a texture does to a surface.

    Parameters
    ----------
    tone
        Lighter where positive; mean near 0, and about -1 to 1.
    rough
        Rougher where positive, the same.
    tilt
        What is added to the unit normal, before it is made unit again, at a relief of 1.
    """

    tone: Values
    rough: Values
    tilt: Places


@cache
def _lattice() -> Float[np.ndarray, "x y z"]:
    return np.random.default_rng(64).normal(size=(LATTICE,) * 3)


def noise(places: Places) -> Values:
    """Smooth noise of mean 0 and standard deviation 1; its features are about 1 apart."""
    found = map_coordinates(_lattice(), places.T, order=2, mode="grid-wrap", prefilter=False)
    return np.asarray(found / SPLINE_DEVIATION)


def _layered(places: Places, octaves: int = 3) -> Values:
    """Noise of coarse features and finer ones, half as strong each time; the finest are 1 apart."""
    strengths = 2.0 ** np.arange(octaves)
    layers = [strength * noise(places / strength) for strength in strengths]
    return np.asarray(np.sum(layers, axis=0) / np.linalg.norm(strengths))


def _tilts(places: Places) -> Places:
    return np.stack([noise(places + apart) for apart in _APART], axis=1)


def _tilts_across(places: Places) -> Places:
    """Return tilts that do not go along the part."""
    across = (noise(places + apart) for apart in _APART[1:])
    return np.stack([np.zeros(len(places)), *across], axis=1)


def _bounded(values: Values) -> Values:
    """Noise of standard deviation 1, squeezed into -1 to 1."""
    return np.asarray(np.tanh(0.7 * values))


def _even(places: Places, normals: Places) -> Grain:
    """No grain at all."""
    none = np.zeros(len(places))
    return Grain(none, none, np.zeros((len(places), 3)))


def _waves(places: Places, normals: Places) -> Grain:
    """Long and shallow waves of what was moulded, blown or polished."""
    return replace(_even(places, normals), tilt=_tilts(places))


def _grit(places: Places, normals: Places) -> Grain:
    """Fine pits and bumps with cloudy shades: castings, blasted metal, moulded texture, clay."""
    tone = _bounded(_layered(places, octaves=5))
    return Grain(tone, 0.5 * tone, 0.7 * _tilts(places) + 0.5 * _tilts(places / 4))


def _streaks(places: Places, normals: Places) -> Grain:
    """Scratches along the part, as a brush or a belt leaves them."""
    drawn = places * np.array([0.02, 1.0, 1.0])
    streak = _layered(drawn, octaves=4)
    tilt = _tilts_across(drawn) + _tilts_across(drawn / 4)
    return Grain(_bounded(streak), 0.5 * _bounded(noise(drawn / 6)), tilt)


def _scuffs(places: Places, normals: Places) -> Grain:
    """Paint: an uneven film, rubbed pale and dull in places, with a few scratches."""
    rubbed = (_layered(places / 12) - 1.0).clip(0, 1)
    scratch = (np.abs(noise(places * np.array([0.04, 0.5, 0.5]))) < 0.03) * 1.0
    tone = rubbed + 0.7 * scratch - 0.12
    return Grain(tone, 0.6 * rubbed + 0.4 * scratch, _tilts(places / 2))


def _dust(places: Places, normals: Places) -> Grain:
    """Rubber: a dull skin, paler where it is worn and dusty."""
    tone = _bounded(_layered(places, octaves=4))
    return Grain(tone, np.zeros(len(places)), _tilts(places * 4))


def _pits(places: Places, normals: Places) -> Grain:
    """Open pores, dark inside."""
    pore = (-noise(places) - 0.4).clip(0, 1)
    return Grain(0.25 - 1.2 * pore, np.zeros(len(places)), 0.8 * _tilts(places))


def _cells(places: Places, normals: Places) -> Grain:
    """Bulges with creases between them: beads of foam, leather."""
    ridge = np.minimum(np.abs(noise(places)), np.abs(noise(places + _APART[1])))
    crease = np.exp(-((ridge / 0.12) ** 2))
    tone = 0.15 * _bounded(_layered(places)) - 0.9 * crease + 0.15
    return Grain(tone, 0.3 * crease, 0.6 * _tilts(places))


def _rings(places: Places, normals: Places) -> Grain:
    """Wood: growth rings about an axis beside the part, fibres and pores along it."""
    along = places * np.array([0.06, 1.0, 1.0])
    bent = places[:, 1:] + np.array([6.0, 2.5]) + 1.1 * _tilts_across(along / 5)[:, 1:]
    phase = np.hypot(bent[:, 0], bent[:, 1]) % 1.0
    late = phase**3 * (1 - np.exp((phase - 1) * 14))
    fibre = _layered(along * np.array([1.0, 9.0, 9.0]), octaves=3)
    tone = 0.45 - 1.9 * late + 0.28 * _bounded(fibre) + 0.25 * _bounded(noise(along / 8))
    tilt = _tilts_across(along * np.array([1.0, 9.0, 9.0]))
    return Grain(tone, 0.6 * late, tilt)


def _layers(places: Places, normals: Places) -> Grain:
    """Plywood: thin sheets of wood on each other, the fibres of every second one across."""
    sheet = np.floor(places[:, 2]).astype(np.int64)
    crossed = np.where((sheet % 2 == 0)[:, None], places, places[:, [1, 0, 2]])
    fibre = _layered(crossed * np.array([0.05, 1.2, 0.3]) + sheet[:, None] * 5.3, octaves=4)
    glue = np.abs(places[:, 2] - np.round(places[:, 2])) < 0.07
    tone = np.where(sheet % 2 == 0, 0.2, -0.3) + 0.4 * _bounded(fibre) - 0.4 * glue
    return Grain(tone, np.zeros(len(places)), _tilts(crossed * np.array([0.1, 2.0, 2.0])))


def _flecks(places: Places, normals: Places) -> Grain:
    """Grains, chips or fibres pressed together."""
    flat = places * np.array([0.6, 1.0, 1.0])
    dark, pale = (noise(flat) > 1.1) * 1.0, (noise(flat + _APART[2]) > 1.2) * 1.0
    tone = 0.8 * pale - 0.9 * dark + 0.4 * _bounded(_layered(places))
    return Grain(tone, np.zeros(len(places)), _tilts(places))


def _threads(places: Places, normals: Places) -> Grain:
    """Cloth: threads over and under each other, on whichever side the surface faces."""
    flat = _unrolled(places, normals) + 0.25 * _tilts(places / 5)[:, :2]
    over = np.sign(np.sin(np.pi * flat[:, 0]) * np.sin(np.pi * flat[:, 1]))
    warp, weft = (np.cos(2 * np.pi * flat[:, axis]) for axis in (0, 1))
    height = np.where(over > 0, warp, weft)
    fuzz = _bounded(_layered(places * 2))
    tilt = 0.5 * _tilts(places * 2) + 0.25 * _tilts(places / 6)
    return Grain(0.45 * height + 0.35 * over * 0.5 + 0.4 * fuzz, np.zeros(len(places)), tilt)


def _tracks(places: Places, normals: Places) -> Grain:
    """Circuit boards: straight copper tracks under lacquer, pads between them."""
    flat = _unrolled(places, normals)
    cell = np.floor(flat)
    chance = noise(np.column_stack([cell * 7.3, np.zeros(len(cell))]))
    off = np.abs(flat - cell - 0.5)
    track = np.where(chance > 0, off[:, 0], off[:, 1]) < 0.17
    pad = np.hypot(off[:, 0], off[:, 1]) < np.where(chance > 0.9, 0.3, 0.0)
    return Grain(0.8 * track + 1.2 * pad - 0.3, 0.2 * track, _tilts(places))


def _unrolled(places: Places, normals: Places) -> Float[np.ndarray, "n 2"]:
    """Take the two coordinates along which the surface lies best."""
    facing = np.abs(normals).argmax(axis=1)
    pairs = np.array([[1, 2], [0, 2], [0, 1]])[facing]
    return np.take_along_axis(places, pairs, axis=1)


TEXTURES: dict[str, Callable[[Places, Places], Grain]] = {
    "cells": _cells,
    "dust": _dust,
    "even": _even,
    "flecks": _flecks,
    "grit": _grit,
    "layers": _layers,
    "pits": _pits,
    "rings": _rings,
    "scuffs": _scuffs,
    "streaks": _streaks,
    "threads": _threads,
    "tracks": _tracks,
    "waves": _waves,
}
"""By name: a function of places and unit normals in the part's frame."""
