"""The beam as each pixel meets it: energy groups and their shares, hardness varying by heel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from jaxtyping import Float, Float64, Int64

from xden1k.errors import require
from xden1k.values.arrays import Image
from xden1k.values.materials import Composition
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.capture import Capture
from xden_builder.physics.attenuation import element_fractions, mac_cm2_g
from xden_builder.physics.source import Tube
from xden_builder.physics.spectrum import Spectrum, absorbed_share, tube_fluence, tube_spectrum
from xden_builder.physics.spectrum.tables import TABLE_SLOPES

__all__ = ["GROUPS", "EnergyGroups", "Heel", "ViewBeam", "energy_groups", "find_heel", "view_beam"]

GROUPS: Final = 24
HEEL_AXES: Final = {"row": (1, 0), "-row": (-1, 0), "column": (0, 1), "-column": (0, -1)}
CLEARLY: Final = 0.5
"""An axis is believed if its profile leaves less than this share of the open field's variation."""
FLAT_FIELD: Final = 0.005
"""An open field that varies less shows no heel."""
SAMPLES: Final = 64


@dataclass(frozen=True, slots=True, eq=False)
class EnergyGroups:
    """A tube's spectrum, as the scintillator takes it in, in few groups of energy.

    Parameters
    ----------
    spectrum
        Of the central ray, ungrouped.
    count
        How many groups were asked for.
    slopes
        Shape (nodes,): offset of a ray towards the cathode, per distance along the central ray.
    weights
        Shape (nodes, groups): share of each group in the open field's signal at that slope.
    """

    spectrum: Spectrum
    count: int
    slopes: Float64[np.ndarray, "nodes"]
    weights: Float64[np.ndarray, "nodes groups"]

    def mac_cm2_g(self, composition: Composition) -> Float64[np.ndarray, "groups"]:
        """Mass attenuation coefficient in each group."""
        return _group_mac(self, composition)

    def scattering_cm2_g(self, composition: Composition) -> Float64[np.ndarray, "groups"]:
        """Coherent and incoherent part of it."""
        return _group_scattering(self, composition)

    def weights_at(self, slopes: Float[np.ndarray, "n"]) -> Float64[np.ndarray, "n groups"]:
        """Shares of the groups at any slopes, those beyond the table taken at its end."""
        place = np.interp(slopes, self.slopes, np.arange(len(self.slopes)))
        below = np.minimum(place.astype(np.int64), max(len(self.slopes) - 2, 0))
        share = (place - below)[:, None]
        above = np.minimum(below + 1, len(self.slopes) - 1)
        return np.asarray((1 - share) * self.weights[below] + share * self.weights[above])


@lru_cache(maxsize=512)
def _group_mac(groups: EnergyGroups, composition: Composition) -> Float64[np.ndarray, "groups"]:
    mac = mac_cm2_g(composition, groups.spectrum.energies_kev)
    return groups.spectrum.group_means(mac, groups.count)


@lru_cache(maxsize=512)
def _group_scattering(
    groups: EnergyGroups, composition: Composition
) -> Float64[np.ndarray, "groups"]:
    xraydb = require("xraydb", "build")
    total = np.zeros_like(groups.spectrum.energies_kev)
    for element, fraction in element_fractions(composition).items():
        for kind in ("coh", "incoh"):
            energies_ev = 1000 * groups.spectrum.energies_kev
            total += fraction * xraydb.mu_elam(element, energies_ev, kind=kind)
    return groups.spectrum.group_means(total, groups.count)


def energy_groups(tube: Tube, scintillator: str, count: int = GROUPS) -> EnergyGroups:
    """Pool a source's spectrum into groups, on the central ray and beside it.

    Parameters
    ----------
    tube
        A tube, or a monochromatic source, which is one group.
    scintillator
        ``CsI`` or ``GOS``; empty: caesium iodide is assumed.
    count
        Of groups, equally wide.

    Raises
    ------
    DataError
        If the voltage lies outside the tables, or a filter or the scintillator is unknown.
    """
    return _energy_groups(
        tube.energy_kev, tube.kv, tuple(tube.filtration_cm.items()), scintillator or "CsI", count
    )


@lru_cache(maxsize=8)
def _energy_groups(
    energy_kev: float | None,
    kv: float | None,
    filters_cm: tuple[tuple[str, float], ...],
    scintillator: str,
    count: int,
) -> EnergyGroups:
    tube = Tube(energy_kev=energy_kev, kv=kv, filtration_cm=dict(filters_cm))
    spectrum = tube_spectrum(tube, scintillator=scintillator)
    central = spectrum.grouped(count).weights
    if energy_kev is not None:
        return EnergyGroups(spectrum, count, np.zeros(1), central[None])
    slopes = np.array(TABLE_SLOPES)
    energies_kev, fluence = tube_fluence(tube, slopes)
    signal = fluence * absorbed_share(energies_kev, scintillator) * energies_kev
    relative = spectrum.group_means(signal / spectrum.signal_kev_per_cm2, count)
    weights = relative * central
    return EnergyGroups(spectrum, count, slopes, weights / weights.sum(axis=1, keepdims=True))


@dataclass(frozen=True, slots=True)
class Heel:
    """Which way the cathode lies, as steps along rows and columns of a panel; (0, 0): not told."""

    rows: int = 0
    columns: int = 0

    def slopes(
        self, geometry: ViewGeometry, rows: Float[np.ndarray, "n"], columns: Float[np.ndarray, "n"]
    ) -> Float64[np.ndarray, "n"]:
        """Offset towards the cathode of the rays through pixels, per distance of the panel.

        The central ray is the one that meets the panel's plane at right angles.
        """
        if geometry.source_cm is None or self == Heel():
            return np.zeros(len(rows))
        normal = np.cross(geometry.column_step_cm, geometry.row_step_cm)
        normal /= np.linalg.norm(normal)
        distance = (geometry.pixel00_cm - geometry.source_cm) @ normal
        axis = self.rows * geometry.row_step_cm + self.columns * geometry.column_step_cm
        offsets = geometry.pixel_centres_cm(rows, columns) - geometry.source_cm
        return np.asarray(offsets @ (axis / np.linalg.norm(axis)) / abs(distance))


def find_heel(
    open_field: Image | None, geometry: ViewGeometry, tube: Tube, scintillator: str
) -> Heel:
    """Tell from an open-field image on which side the cathode lies.

    The open field of a tube falls towards the anode; its profile along each axis of the panel, by
    the tabulated spectra and the inverse square of the distance, is compared with the image.

    Parameters
    ----------
    open_field
        Light of the bare beam above the dark, in any unit; None where it is not known.
    geometry
        Of the view.
    tube, scintillator
        As of :func:`energy_groups`.
    """
    if open_field is None or geometry.source_cm is None or tube.kv is None:
        return Heel()
    places = [
        np.linspace(0, size - 1, min(size, SAMPLES)).astype(np.int64) for size in geometry.shape
    ]
    seen = open_field[np.ix_(*places)].astype(np.float64).ravel()
    usable = np.isfinite(seen) & (seen > 0.05 * np.nanmedian(seen))
    rows, columns = (each.ravel()[usable] for each in np.meshgrid(*places, indexing="ij"))
    seen = np.log(seen[usable])
    seen -= seen.mean()
    if np.sqrt((seen**2).mean()) < FLAT_FIELD:
        return Heel()
    left = {}
    for name, (row, column) in HEEL_AXES.items():
        heel = Heel(row, column)
        slopes = heel.slopes(geometry, rows.astype(float), columns.astype(float))
        expected = _log_profile(tube, scintillator or "CsI", slopes)
        left[name] = float(((seen - expected + expected.mean()) ** 2).mean())
    best = min(left, key=left.__getitem__)
    return Heel(*HEEL_AXES[best]) if left[best] < CLEARLY * float((seen**2).mean()) else Heel()


def _log_profile(
    tube: Tube, scintillator: str, slopes: Float[np.ndarray, "n"]
) -> Float64[np.ndarray, "n"]:
    nodes = np.array(TABLE_SLOPES)
    energies_kev, fluence = tube_fluence(tube, nodes)
    signal = (fluence * absorbed_share(energies_kev, scintillator) * energies_kev).sum(axis=1)
    return np.asarray(np.interp(slopes, nodes, np.log(signal)))


@dataclass(frozen=True, slots=True, eq=False)
class ViewBeam:
    """The beam of one view.

    Parameters
    ----------
    groups
        Of energy.
    geometry
        Of the panel as the scanner file gives it.
    heel
        Which way the cathode lies.
    """

    groups: EnergyGroups
    geometry: ViewGeometry
    heel: Heel

    def weights(
        self, pixels: Int64[np.ndarray, "n"], binning: int = 1
    ) -> Float64[np.ndarray, "n groups"]:
        """Shares of the energy groups in the open field of some pixels.

        Parameters
        ----------
        pixels
            Flat indices into an image of ``binning * binning`` pixels each.
        binning
            How many pixels of the panel were averaged along each side.
        """
        columns = self.geometry.shape[1] // binning
        middle = (binning - 1) / 2
        row, column = (binning * index + middle for index in np.divmod(pixels, columns))
        return self.groups.weights_at(self.heel.slopes(self.geometry, row, column))


def view_beam(capture: Capture, view: XRayView, groups: EnergyGroups) -> ViewBeam:
    """Prepare the beam of a view of a capture whose source is known."""
    assert capture.tube is not None
    heel = find_heel(
        capture.open_field.get(view.name),
        view.geometry,
        capture.tube,
        capture.detector.scintillator,
    )
    return ViewBeam(groups, view.geometry, heel)
