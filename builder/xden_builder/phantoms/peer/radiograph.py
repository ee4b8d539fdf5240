"""The image of one view: direct beam, scatter, blur, gain and noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Float32
from scipy.ndimage import gaussian_filter

from xden1k.values.arrays import Image
from xden1k.values.views import ViewGeometry
from xden_builder.phantoms.peer.matter import compton_cm2_g, mac_cm2_g
from xden_builder.phantoms.peer.objects import PeerObject
from xden_builder.phantoms.peer.rays import cropped, path_lengths_cm, shadow
from xden_builder.phantoms.peer.scatter import draw_scatter, single_scatter
from xden_builder.phantoms.peer.setup import Setup

__all__ = ["Beam", "expose", "make_beam"]

FINE_PX: Final = 2048
"""Rays across the longest side of a shadow, about; the intensities of a pixel's are averaged."""
LEAST_SUBRAYS, MOST_SUBRAYS = 4, 16
"""Along each side of a pixel. With 4 an edge that runs along the pixels is off by up to an eighth
of one, which turns an eraser of 30 pixels by 0.4 degrees."""
BLUR_SDS: Final = 4.0
"""So far light is spread."""
GAIN_SD: Final = 0.025
READOUT_SD: Final = 2e-4
"""Electronic noise, as a share of the open field."""
_CHUNK: Final = 2**16

Lengths = Float32[np.ndarray, "parts fine_rows fine_columns"]


@dataclass(frozen=True, slots=True, eq=False)
class Beam:
    """The open field.

    Parameters
    ----------
    energies_kev, weights
        Shape (n,): share of each energy in the signal; they add up to 1.
    quanta_per_cm2
        Equal quanta of the same noise, 100 cm from the source.
    """

    energies_kev: Float[np.ndarray, "n"]
    weights: Float[np.ndarray, "n"]
    quanta_per_cm2: float

    @property
    def mean_kev(self) -> float:
        """Mean energy of the signal."""
        return float(self.energies_kev @ self.weights)


def make_beam(setup: Setup) -> Beam:
    """Let the screen take up the tube's photons."""
    energies_kev, photons = setup.tube.photons_per_cm2()
    signal = photons * setup.screen.signal(energies_kev)
    squares = photons @ setup.screen.signal_squared(energies_kev)
    return Beam(energies_kev, signal / signal.sum(), float(signal.sum() ** 2 / squares))


def expose(
    setup: Setup, beam: Beam, thing: PeerObject, view: str, scatter: float | None = None
) -> Image:
    """Take a radiograph: signal over that of the open field.

    Parameters
    ----------
    setup, beam
        Of the scanner.
    thing, view
        What, and from where.
    scatter
        Factor on single scatter; drawn where it is None.

    Raises
    ------
    DataError
        If the object reaches beyond the panel.
    """
    direct, scattered = _averaged(setup, beam, thing, setup.geometry(view))
    once = single_scatter(scattered, setup.pitch_cm, setup.gap_cm, beam.mean_kev)
    around = draw_scatter(thing.plan.rng("peer/scatter"), scatter)
    expected = direct + around.factor * once + around.floor
    return _read(setup, beam, expected, thing.plan.rng(f"peer/noise/{view}"))


def _averaged(
    setup: Setup, beam: Beam, thing: PeerObject, panel: ViewGeometry
) -> tuple[Image, Image]:
    """Direct light of each pixel, blurred as the panel does, and what of it is scattered."""
    meshes = [part.mesh for part in thing.parts]
    blur_px = setup.blur_cm / setup.pitch_cm
    rows, columns = shadow(meshes, panel, math.ceil(BLUR_SDS * blur_px))
    inside = cropped(panel, rows, columns)
    subrays = min(max(FINE_PX // max(inside.shape), LEAST_SUBRAYS), MOST_SUBRAYS)
    lengths = path_lengths_cm(meshes, inside.refined(subrays))
    densities = np.array([part.density_g_cm3 for part in thing.parts])
    compositions = [part.substance.composition for part in thing.parts]
    lac = densities[:, None] * np.stack([mac_cm2_g(c, beam.energies_kev) for c in compositions])
    compton = densities * [compton_cm2_g(c, beam.mean_kev) for c in compositions]
    fine = _transmission(lengths, lac, beam)
    fine_scattered = fine * np.tensordot(compton.astype(np.float32), lengths, axes=1)
    direct = np.ones(panel.shape, dtype=np.float32)
    scattered = np.zeros_like(direct)
    blurred = gaussian_filter(fine, blur_px * subrays, truncate=BLUR_SDS)
    direct[rows, columns] = _pixels(blurred, subrays)
    scattered[rows, columns] = _pixels(fine_scattered, subrays)
    return direct, scattered


def _transmission(lengths: Lengths, lac: Float[np.ndarray, "parts n"], beam: Beam) -> Image:
    """Beer and Lambert's law at every energy, only where there is something."""
    met = lengths.any(axis=0)
    paths, found = lengths[:, met].T, []
    for start in range(0, len(paths), _CHUNK):
        found.append(np.exp(-paths[start : start + _CHUNK] @ lac) @ beam.weights)
    image = np.ones(met.shape, dtype=np.float32)
    image[met] = np.concatenate(found)
    return image


def _pixels(fine: Float32[np.ndarray, "fine_rows fine_columns"], subrays: int) -> Image:
    rows, columns = (side // subrays for side in fine.shape)
    return np.asarray(fine.reshape(rows, subrays, columns, subrays).mean(axis=(1, 3)))


def _read(
    setup: Setup, beam: Beam, expected: Float[np.ndarray, "r c"], rng: np.random.Generator
) -> Image:
    """Give an expected image its gain and noise."""
    distance_cm = setup.source_object_cm + setup.gap_cm
    quanta = beam.quanta_per_cm2 * (100 / distance_cm * setup.pitch_cm) ** 2
    gain = np.exp(rng.normal(0.0, GAIN_SD))
    light = rng.poisson(quanta * gain * expected) / quanta
    return np.asarray(light + rng.normal(0.0, READOUT_SD, light.shape), dtype=np.float32)
