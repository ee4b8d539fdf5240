"""What a panel reads behind a step: the direct beam, and light that comes from elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float64, Int64

from xden1k.rays import PathLengths
from xden1k.values.materials import Composition
from xden_builder.calibrate.readings import ImageReadings
from xden_builder.calibrate.response import Response
from xden_builder.physics.attenuation import mac_cm2_g
from xden_builder.physics.groups import energy_groups
from xden_builder.physics.spectrum import panel_signal, tube_fluence
from xden_builder.poly.model.beam import Heel, ViewBeam, find_heel
from xden_builder.poly.model.stray import WIDTHS, coarse_binning, interpolated, stray_light

__all__ = ["STRAY_TERMS", "LitImage", "PlateStray", "light_up"]

STRAY_TERMS: Final = ("near_scatter", "far_scatter", "glare", "even")
"""Light that is not the direct beam's: the fit's three shapes, and a constant."""


NEAR_CM: Final = 2.0
FAR_CM: Final = 6.0
"""Standard deviations on the panel of near and far scatter: assumed."""


@dataclass(frozen=True, slots=True, eq=False)
class PlateStray:
    """Shapes of stray light, that of near scatter for several widths.

    Parameters
    ----------
    each
        Near scatter for each of :data:`xden_builder.poly.model.stray.WIDTHS`, then the other terms.
    """

    each: Float64[np.ndarray, "n shapes"]

    def at(self, width: float) -> Float64[np.ndarray, "n terms"]:
        """Shapes by :data:`STRAY_TERMS` where the logarithm of the near scatter's width is this."""
        count = len(WIDTHS)
        near = self.each[:, :count] @ interpolated(width)
        return np.column_stack([near, self.each[:, count:]])


@dataclass(frozen=True, slots=True, eq=False)
class LitImage:
    """Readings, and the beam as it meets them.

    Parameters
    ----------
    image
        The readings.
    heel
        Which way the cathode lies.
    """

    image: ImageReadings
    heel: Heel

    @property
    def transmission(self) -> Float64[np.ndarray, "n"]:
        """What was read."""
        return np.array([reading.transmission for reading in self.image.readings])

    @property
    def sd(self) -> Float64[np.ndarray, "n"]:
        """Its standard deviation by noise."""
        return np.array([reading.sd for reading in self.image.readings])

    @property
    def pixels(self) -> Int64[np.ndarray, "n"]:
        """Flat index of each reading."""
        return np.array([reading.pixel for reading in self.image.readings])

    @property
    def steps(self) -> dict[tuple[str, str, int, float], int]:
        """Place among the readings of each step that is told from all others of the image.

        By scan, material, number and thickness.
        """
        found: dict[tuple[str, str, int, float], list[int]] = {}
        for at, reading in enumerate(self.image.readings):
            if reading.wedge >= 0:
                wedge = self.image.wedges[reading.wedge]
                thick = wedge.thickness_cm[reading.step]
                key = wedge.scan, wedge.material.name, reading.step, thick
                found.setdefault(key, []).append(at)
        return {key: places[0] for key, places in found.items() if len(places) == 1}

    @property
    def places_cm(self) -> Float64[np.ndarray, "n 3"]:
        """Where each reading is on the panel."""
        rows, columns = (each.astype(float) for each in self._rows_columns())
        return self.image.view.geometry.pixel_centres_cm(rows, columns)

    def direct(self, response: Response) -> Float64[np.ndarray, "n"]:
        """Transmission of the direct beam at each reading, by the whole spectrum."""
        shares, depths = self._beams(response)
        return np.asarray((shares * np.exp(-depths)).sum(axis=1))

    def by_thickness(self, response: Response) -> Float64[np.ndarray, "n"]:
        """Differentiate that by the relative thickness of what is before each reading.

        By Beer and Lambert's law at each energy; the hardened beam loses less than ``T ln T``.
        """
        shares, depths = self._beams(response)
        return np.asarray((shares * -depths * np.exp(-depths)).sum(axis=1))

    def stray(self, response: Response) -> PlateStray:
        """Stray light at each reading by :data:`STRAY_TERMS`, in shares of the open field.

        Scatter and glare as the fit of objects has them 20 cm before the panel.
        Means over all pixels that were read: beside air, glare is far from linear.
        """
        regions = [reading.region for reading in self.image.readings]
        sizes = np.array([len(region) for region in regions])
        groups = energy_groups(response.tube, response.detector)
        compositions = self._compositions()
        found = stray_light(
            self.image.view,
            ViewBeam(groups, self.image.view.geometry, self.heel),
            _coarse(self.image.lengths),
            np.stack([groups.mac_cm2_g(each) for each in compositions]),
            np.stack([groups.scattering_cm2_g(each) for each in compositions]),
            np.array([wedge.density_g_cm3 for wedge in self.image.wedges]),
            np.concatenate(regions),
            np.repeat(self.transmission, sizes),
            reaches_cm=[*(NEAR_CM * np.exp(WIDTHS)), FAR_CM],
        )
        starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        means = np.add.reduceat(found, starts, axis=0) / sizes[:, None]
        return PlateStray(np.column_stack([means, np.ones(len(means))]))

    def _beams(
        self, response: Response
    ) -> tuple[Float64[np.ndarray, "n e"], Float64[np.ndarray, "n e"]]:
        """Share of each energy in the signal of the open field, and optical depth in it."""
        slopes, place = np.unique(self._slopes(), return_inverse=True)
        energies_kev, fluence = tube_fluence(response.tube, slopes)
        signal = panel_signal(fluence, energies_kev, response.detector)
        shares = signal / signal.sum(axis=1, keepdims=True)
        return shares[place], self._areal_g_cm2() @ self._mac_cm2_g(energies_kev)

    def _slopes(self) -> Float64[np.ndarray, "n"]:
        rows, columns = (each.astype(float) for each in self._rows_columns())
        return self.heel.slopes(self.image.view.geometry, rows, columns)

    def _rows_columns(self) -> tuple[Int64[np.ndarray, "n"], Int64[np.ndarray, "n"]]:
        rows, columns = np.divmod(self.pixels, self.image.view.geometry.shape[1])
        return rows, columns

    def _compositions(self) -> list[Composition]:
        return [wedge.material.composition for wedge in self.image.wedges]

    def _mac_cm2_g(self, energies_kev: Float64[np.ndarray, "e"]) -> Float64[np.ndarray, "w e"]:
        return np.stack([mac_cm2_g(each, energies_kev) for each in self._compositions()])

    def _areal_g_cm2(self) -> Float64[np.ndarray, "n w"]:
        """Mass per area of each wedge before each reading."""
        areal = np.zeros((len(self.image.readings), len(self.image.wedges)))
        for row, reading in zip(areal, self.image.readings, strict=True):
            if reading.wedge >= 0:
                density = self.image.wedges[reading.wedge].density_g_cm3
                row[reading.wedge] = density * reading.path_cm
        return areal


def light_up(image: ImageReadings, told: Response) -> LitImage:
    """Find out which way the heel of a tube lies in an image."""
    heel = find_heel(image.open_field, image.view.geometry, told.tube, told.detector)
    return LitImage(image, heel)


def _coarse(lengths: PathLengths) -> PathLengths:
    """Take one pixel for each block: stray light is smooth."""
    binning = coarse_binning(lengths.shape)
    rows, columns = np.divmod(lengths.pixels, lengths.shape[1])
    shape = (lengths.shape[0] // binning, lengths.shape[1] // binning)
    middle = binning // 2
    kept = (rows % binning == middle) & (columns % binning == middle)
    kept &= (rows // binning < shape[0]) & (columns // binning < shape[1])
    pixels = np.ravel_multi_index((rows[kept] // binning, columns[kept] // binning), shape)
    return PathLengths(
        pixels, lengths.lengths_cm[kept], lengths.shared_cm[kept], lengths.broken[kept], shape
    )
