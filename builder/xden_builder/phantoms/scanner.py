"""The simulated scanner: cone beams along +y (PA) and +x (LAT), one photon energy, a flat panel.

Each effect is a field of :class:`Scanner`. What the fit assumes is not what makes the images:
more rays a pixel are averaged here than there, and nothing of the fit is imported.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, UInt16

from xden1k.arrays import Image
from xden1k.errors import DataError
from xden1k.materials import load_materials
from xden1k.rays import path_lengths
from xden1k.views import ViewGeometry, XRayView
from xden_builder.attenuation import mac_cm2_g
from xden_builder.capture import Detector, ScannerFile, Tube, ViewFile
from xden_builder.phantoms.phantom import Phantom, PhantomPart, Plan, random_numbers

__all__ = ["VIEWS", "Calibration", "Scanner"]

VIEWS = ("pa", "lat")
Raw = UInt16[np.ndarray, "rows columns"] | Image


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """Reference images of one view: without object and without beam, as the panel stores them."""

    flat: UInt16[np.ndarray, "rows columns"]
    dark: UInt16[np.ndarray, "rows columns"]


@dataclass(frozen=True, slots=True)
class Scanner:
    """Two sources, two panels, and what goes wrong on the way.

    Parameters
    ----------
    size_px
        Pixels along each side of a panel.
    panel_cm
        Side of a panel.
    source_object_cm, source_detector_cm
        From the focal spot to the origin of the object frame, and to the panel.
    energy_kev
        Of every photon.
    subrays
        Rays along each side of a pixel; their intensities are averaged.
    open_counts
        Mean signal of a pixel without object, above the dark: one count for each detected photon.
    dark_counts
        Offset of the panel.
    quantum_noise
        Whether detected photons follow Poisson's law.
    readout_sd_counts
        Standard deviation of the electronic noise of a pixel.
    exposure_sd
        Relative standard deviation of a view's exposure against that of its flat.
    flat_frames
        How many frames the flat averages; the dark is one frame.
    bits
        Of the converter; None stores transmission as floating-point numbers instead of counts.

    Raises
    ------
    DataError
        If the panel has no pixel, is not behind the object, or the open field does not fit the
        converter.
    """

    size_px: int = 512
    panel_cm: float = 43.0
    source_object_cm: float = 100.0
    source_detector_cm: float = 120.0
    energy_kev: float = 100.0
    subrays: int = 6
    open_counts: float = 50_000.0
    dark_counts: float = 100.0
    quantum_noise: bool = True
    readout_sd_counts: float = 5.0
    exposure_sd: float = 0.03
    flat_frames: int = 64
    bits: int | None = 16

    def __post_init__(self) -> None:
        if self.size_px < 1:
            raise DataError(f"a panel needs at least 1 pixel a side, got {self.size_px}")
        if not 0 < self.source_object_cm < self.source_detector_cm:
            raise DataError(
                f"the panel must stand behind the object, got {self.source_detector_cm} cm and "
                f"{self.source_object_cm} cm from the source"
            )
        if self.bits is not None and not self.open_counts + self.dark_counts < 2**self.bits - 1:
            raise DataError(f"{self.open_counts:g} counts do not fit a {self.bits}-bit converter")

    def ideal(self) -> Scanner:
        """Return the same scanner without noise, exposure error or rounding."""
        return replace(self, quantum_noise=False, readout_sd_counts=0.0, exposure_sd=0.0, bits=None)

    def geometry(self, view: str) -> ViewGeometry:
        """Place source and panel of a view; columns run to the viewer's right, rows down."""
        along, right = {
            "pa": (np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])),
            "lat": (np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0])),
        }[view]
        pitch, down = self.panel_cm / self.size_px, np.array([0.0, 0.0, -1.0])
        behind = self.source_detector_cm - self.source_object_cm
        return ViewGeometry(
            beam="cone",
            source_cm=0.0 - self.source_object_cm * along,  # 0 - x, since -x writes zeros as -0.0
            pixel00_cm=behind * along - (self.panel_cm - pitch) / 2 * (right + down),
            column_step_cm=pitch * right,
            row_step_cm=pitch * down,
            shape=(self.size_px, self.size_px),
        )

    def lac_per_cm(self, part: PhantomPart) -> float:
        """Attenuation coefficient of a part at the scanner's energy."""
        composition = load_materials()[part.material].composition
        return part.density_g_cm3 * float(mac_cm2_g(composition, self.energy_kev))

    def transmission(self, phantom: Phantom, view: str) -> Image:
        """Transmission without any error but that of finitely many rays a pixel.

        Raises
        ------
        DataError
            If the object is not wholly inside the view.
        """
        geometry = self.geometry(view)
        meshes = [part.mesh for part in phantom.parts]
        columns, rows, _ = geometry.project(np.concatenate([m.vertices for m in meshes])).T
        if min(columns.min(), rows.min()) < 0 or max(columns.max(), rows.max()) > self.size_px - 1:
            raise DataError(f"{phantom.plan.object_id} reaches beyond the panel of view {view}")
        lengths = path_lengths(meshes, range(len(meshes)), geometry, self.subrays)
        return lengths.image(np.array([self.lac_per_cm(part) for part in phantom.parts]))

    def exposure(self, plan: Plan, view: str) -> float:
        """Exposure of an object's view, as a factor on that of the flat."""
        return float(np.exp(plan.rng(f"exposure/{view}").normal(0.0, self.exposure_sd)))

    def radiograph(self, phantom: Phantom, view: str) -> Raw:
        """Take a radiograph: counts, or transmission where there is no converter."""
        share = self.exposure(phantom.plan, view) * self.transmission(phantom, view)
        if self.bits is None:
            return share
        rng = phantom.plan.rng(f"noise/{view}")
        return self._digitised(self._counts(share.astype(np.float64), 1, rng))

    def calibration(self, seed: int, view: str) -> Calibration | None:
        """Take flat and dark of a view's panel; None where there is no converter."""
        if self.bits is None:
            return None
        rng, ones = random_numbers(seed, f"panel/{view}"), np.ones((self.size_px, self.size_px))
        flat, dark = self._counts(ones, self.flat_frames, rng), self._counts(0 * ones, 1, rng)
        return Calibration(self._digitised(flat), self._digitised(dark))

    def _counts(
        self, share: Float[np.ndarray, "rows columns"], frames: int, rng: np.random.Generator
    ) -> Float[np.ndarray, "rows columns"]:
        """Mean of some frames in which each pixel gets a share of the open beam."""
        photons = frames * self.open_counts * share
        if self.quantum_noise:
            photons = rng.poisson(photons).astype(np.float64)
        electronic = rng.normal(0.0, self.readout_sd_counts / np.sqrt(frames), share.shape)
        return np.asarray(photons / frames + self.dark_counts + electronic)

    def _digitised(
        self, counts: Float[np.ndarray, "rows columns"]
    ) -> UInt16[np.ndarray, "rows columns"]:
        assert self.bits is not None
        return counts.round().clip(0, 2**self.bits - 1).astype(np.uint16)

    def corrected(self, phantom: Phantom, view: str) -> XRayView:
        """Take a radiograph and correct it for flat and dark, as the builder does on reading."""
        raw, calibration = self.radiograph(phantom, view), self.calibration(phantom.plan.seed, view)
        if calibration is None or self.bits is None:
            return XRayView(view, raw, np.ones(raw.shape, dtype=np.bool_), self.geometry(view))
        flat, dark = (image.astype(np.float64) for image in (calibration.flat, calibration.dark))
        full = 2**self.bits - 1
        valid = (raw < full) & (calibration.flat < full)
        transmission = np.where(valid, (raw - dark) / (flat - dark), np.nan).astype(np.float32)
        return XRayView(view, transmission, valid, self.geometry(view))

    def file(self) -> ScannerFile:
        """Give what ``scanner.toml`` says of this scanner."""
        counted = self.bits is not None
        return ScannerFile(
            tube=Tube(energy_kev=self.energy_kev),
            detector=Detector(bits=self.bits),
            views={
                name: ViewFile(
                    image=f"{name}.tif",
                    quantity="counts" if counted else "transmission",
                    geometry=self.geometry(name),
                    polarity="linear" if counted else None,
                    flat=f"flat_{name}.tif" if counted else None,
                    dark=f"dark_{name}.tif" if counted else None,
                )
                for name in VIEWS
            },
        )

    def settings(self) -> dict[str, Any]:
        """Give every effect and its size, in JSON's types."""
        return asdict(self)
