"""The packaged spectra of a tungsten tube before any filter.

The table says itself where it comes from;
:mod:`xden_builder.physics.spectrum.make_tables` makes it.
"""

from __future__ import annotations

from functools import lru_cache
from importlib.resources import files
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from xden1k.errors import DataError

__all__ = [
    "ANODE_DEG",
    "LOWEST_KEV",
    "TABLE",
    "TABLE_DISTANCE_CM",
    "TABLE_KV",
    "TABLE_SLOPES",
    "bare_fluence",
    "bin_centres_kev",
]

TABLE: Final = "tungsten.csv"
TABLE_DISTANCE_CM: Final = 100.0
ANODE_DEG: Final = 12.0
"""Angle of the anode's face to the central ray; usual for such tubes, an assumption for ours."""
LOWEST_KEV: Final = 10.0
"""Fewer than 1e-7 of the photons below it pass 2.5 mm of aluminium."""
TABLE_KV: Final = tuple(float(kv) for kv in range(80, 121, 5))
TABLE_SLOPES: Final = tuple(round(0.03 * step, 2) for step in range(-6, 7))
"""Negative towards the anode. The face of the anode cuts the beam off at -0.21."""


@lru_cache(maxsize=1)
def _tables() -> dict[float, Float[np.ndarray, "energies slopes"]]:
    """Fluence by voltage, on the bins up to the highest voltage: zero above their own."""
    text = (files("xden_builder.physics.spectrum") / TABLE).read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    values = np.loadtxt(lines, delimiter=",", skiprows=1)
    full = np.zeros((len(TABLE_KV), len(bin_centres_kev(TABLE_KV[-1])), len(TABLE_SLOPES)))
    for place, kv in enumerate(TABLE_KV):
        mine = values[values[:, 0] == kv, 2:]
        full[place, : len(mine)] = mine
    return dict(zip(TABLE_KV, full, strict=True))


def bin_centres_kev(kv: float) -> Float[np.ndarray, "energies"]:
    """Centres of the 1 keV bins from ``LOWEST_KEV`` to a voltage, the last one begun included."""
    return np.arange(LOWEST_KEV, kv, 1.0) + 0.5


def bare_fluence(
    kv: float, slopes: Float[np.ndarray, "slopes"]
) -> Float[np.ndarray, "slopes energies"]:
    """Photons per cm², keV and mAs of the bare tube, 100 cm along the central ray.

    Between voltages linear, as a multiple of how far each energy lies below the highest, which
    Duane and Hunt's law makes the end of the spectrum go to nothing with; between slopes a cubic of
    the logarithm. Behind 2.5 mm of aluminium both stay within 1 % of the fluence and 0.1 keV of the
    mean energy; behind 10 mm of iron as well the light stays within 0.4 %.

    Raises
    ------
    DataError
        If the voltage or a slope lies outside the table.
    """
    if not TABLE_KV[0] <= kv <= TABLE_KV[-1]:
        raise DataError(
            f"tube.kv: tube spectra are tabulated from {TABLE_KV[0]:g} to {TABLE_KV[-1]:g} kV, "
            f"got {kv:g}"
        )
    if slopes.size and not np.abs(slopes).max() <= TABLE_SLOPES[-1]:
        raise DataError(
            f"rays may lean by {TABLE_SLOPES[-1]:g} at most towards anode or cathode, "
            f"got {np.abs(slopes).max():g}"
        )
    below = max(known for known in TABLE_KV if known <= kv)
    above = min(known for known in TABLE_KV if known >= kv)
    curves = CubicSpline(TABLE_SLOPES, np.log(_between(kv, below, above).clip(min=1e-30)), axis=1)
    return np.asarray(np.exp(curves(slopes)).T)


def _between(kv: float, below: float, above: float) -> Float[np.ndarray, "energies slopes"]:
    """Fluence at a voltage by the tables of two."""
    tables, energies_kev = _tables(), bin_centres_kev(kv)
    if below == above:
        return tables[kv][: len(energies_kev)]
    share = (kv - below) / (above - below)
    low, high = (_below_end(end, energies_kev)[:, None] for end in (below, above))
    by_high = tables[above][: len(energies_kev)] / high
    by_low = np.where(low > 0, tables[below][: len(energies_kev)] / np.maximum(low, 1e-9), by_high)
    return np.asarray(
        _below_end(kv, energies_kev)[:, None] * ((1 - share) * by_low + share * by_high)
    )


def _below_end(
    kv: float, energies_kev: Float[np.ndarray, "energies"]
) -> Float[np.ndarray, "energies"]:
    """How far each bin lies below the highest energy, times the width that it has below it."""
    low = energies_kev - 0.5
    width = np.clip(kv - low, 0.0, 1.0)
    return np.asarray(width * (kv - low - width / 2))
