"""The beam as each pixel meets it: shares of the energy groups, hardness varying by heel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float, Float64, Int64

from xden1k.values.arrays import Image
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.capture import Capture
from xden_builder.physics.groups import EnergyGroups
from xden_builder.physics.source import Detector, Tube
from xden_builder.physics.spectrum import panel_signal, tube_fluence
from xden_builder.physics.spectrum.tables import TABLE_SLOPES

__all__ = ["Heel", "ViewBeam", "find_heel", "view_beam"]

HEEL_AXES: Final = {"row": (1, 0), "-row": (-1, 0), "column": (0, 1), "-column": (0, -1)}
CLEARLY: Final = 0.5
"""An axis is believed if its profile leaves less than this share of the open field's variation."""
FLAT_FIELD: Final = 0.005
"""An open field that varies less shows no heel."""
SAMPLES: Final = 64


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
    open_field: Image | None, geometry: ViewGeometry, tube: Tube, detector: Detector
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
    tube, detector
        As of :func:`xden_builder.physics.groups.energy_groups`.
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
        expected = _log_profile(tube, detector, slopes)
        left[name] = float(((seen - expected + expected.mean()) ** 2).mean())
    best = min(left, key=left.__getitem__)
    return Heel(*HEEL_AXES[best]) if left[best] < CLEARLY * float((seen**2).mean()) else Heel()


def _log_profile(
    tube: Tube, detector: Detector, slopes: Float[np.ndarray, "n"]
) -> Float64[np.ndarray, "n"]:
    nodes = np.array(TABLE_SLOPES)
    energies_kev, fluence = tube_fluence(tube, nodes)
    signal = panel_signal(fluence, energies_kev, detector).sum(axis=1)
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

    def regrouped(self, groups: EnergyGroups) -> ViewBeam:
        """Return the same beam in other groups of energy."""
        return replace(self, groups=groups)


def view_beam(capture: Capture, view: XRayView, groups: EnergyGroups) -> ViewBeam:
    """Prepare the beam of a view of a capture whose source is known."""
    assert capture.tube is not None
    open_field = capture.open_field.get(view.name)
    heel = find_heel(open_field, view.geometry, capture.tube, capture.detector)
    return ViewBeam(groups, view.geometry, heel)
