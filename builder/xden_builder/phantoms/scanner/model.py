"""The simulated scanner: cone beams along +y (PA) and +x (LAT), a tube, a flat panel.

With one tube, an object is turned by hand for LAT (:mod:`.turning`).

Each effect is a field of :class:`Scanner`. What the fit assumes is not what makes the images:
more rays a pixel are averaged here than there, and nothing of the fit is imported.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float, Float64, UInt16

from xden1k.errors import DataError
from xden1k.rays import path_lengths
from xden1k.values.arrays import Image
from xden1k.values.materials import Composition, load_materials
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.capture.tables import is_number
from xden_builder.phantoms.phantom import Identity, Phantom, random_numbers
from xden_builder.phantoms.scanner.beam import Beam, kept_beam
from xden_builder.phantoms.scanner.composition import MOST_COMPOSITION_SD, photoelectric_factors
from xden_builder.phantoms.scanner.handover import MeshError, draw_mesh_error
from xden_builder.phantoms.scanner.panel import Calibration, Panel
from xden_builder.phantoms.scanner.primary import Absorber, Primary, pixel_kernel, render
from xden_builder.phantoms.scanner.scatter import ScatterDraw, draw_scatter, scatter_image
from xden_builder.phantoms.scanner.signal import Signal
from xden_builder.phantoms.scanner.spread import gaussian_spread
from xden_builder.phantoms.scanner.turning import draw_turn, seen_by_object
from xden_builder.physics.attenuation import mac_cm2_g, scattering_cm2_g
from xden_builder.physics.source import Tube

__all__ = ["VIEWS", "Raw", "Scanner"]

VIEWS = ("pa", "lat")
AIR_BESIDE = 0.01
"""Least open field on each side of an object, as a share of the panel's side."""
_LATER = ("exposure_ratio", "one_tube", "dead_lines", "mesh_warp_cm", "composition_sd")
"""Settings that earlier files lack."""
_TWICE_AS_LARGE = (
    "panel_cm",
    "source_object_cm",
    "source_detector_cm",
    "scatter_near_cm",
    "scatter_far_cm",
)
Raw = UInt16[np.ndarray, "rows columns"] | Image
_Mac = Callable[[Composition], Float[np.ndarray, "groups"]]


@dataclass(frozen=True, slots=True)
class Scanner:
    """Two sources, two panels, and what goes wrong on the way.

    The defaults are :meth:`monochromatic`: one photon energy, quantum and electronic noise, an
    exposure error and a converter. :meth:`realistic` has every effect. 0 or False switches an
    effect off.

    Parameters
    ----------
    size_px
        Pixels along each side of a panel.
    panel_cm
        Side of a panel.
    source_object_cm, source_detector_cm
        From the focal spot to the origin of the object frame, and to the panel.
    energy_kev
        Of every photon; None for a tube.
    kv, mas, filtration_cm
        Voltage, charge and filters of the tube.
    energy_groups
        Equally wide, that stand for the tube's spectrum.
    scintillator_g_cm2
        Areal density of caesium iodide, which takes up a tube's photons.
    heel
        Whether intensity and hardness of a tube vary over the panel.
    subrays
        Rays along each side of a pixel; their intensities are averaged.
    focal_spot_cm
        Width of the focal spot. Its image, of a point in the middle of the object, is spread over
        this times ``source_detector_cm / source_object_cm - 1``.
    detector_blur_cm
        Standard deviation of the light's spread in the scintillator.
    glare_share, glare_cm
        Share of the light that spreads further, and the standard deviation of that.
    scatter_level
        Mean scatter over an object's shadow, in shares of the open field; varies from object to
        object, see :mod:`xden_builder.phantoms.scanner.scatter`.
    scatter_near_cm, scatter_far_cm
        Usual standard deviations of its two Gaussians, on the panel.
    open_counts
        Mean signal in the middle of the panel without object, above the dark. Of a monochromatic
        source it is one count for each detected photon; of a tube, ``mas`` gives the photons.
    dark_counts
        Offset of the panel.
    quantum_noise
        Whether detected photons follow Poisson's law.
    readout_sd_counts
        Standard deviation of the electronic noise of a pixel.
    dead_share, dead_lines
        Share of pixels that see no light; and how many rows, and as many columns, see none.
    exposure_ratio, exposure_sd
        Mean exposure of a view against that of its flat, and its relative standard deviation. What
        the converter does not hold is saturated.
    flat_frames
        How many frames the flat averages; the dark is one frame.
    bits
        Of the converter; None stores transmission as floating-point numbers instead of counts,
        without noise.
    mesh_rotation_deg, mesh_shift_cm, mesh_scale_sd, mesh_tolerance_cm, mesh_warp_cm
        Errors of the part meshes written: see :func:`draw_mesh_error`. The truth keeps the true
        ones.
    composition_sd
        Relative standard deviation of the attenuation coefficient of each material, at
        :attr:`reference_kev`, from one object to another: see :func:`photoelectric_factors`.
    one_tube
        Whether the tube and the panel of PA take LAT too, of an object that is turned by hand:
        see :func:`draw_turn`. Then :meth:`geometry` of LAT is what is told, and
        :meth:`true_geometry` what is.

    Raises
    ------
    DataError
        If the panel has no pixel or more dead lines than it has, is not behind the object, the
        open field does not fit the converter, a size is negative, a heel or compositions that err
        are wanted of one photon energy, or compositions err by more than
        :data:`MOST_COMPOSITION_SD`.
    """

    size_px: int = 512
    panel_cm: float = 43.0
    source_object_cm: float = 100.0
    source_detector_cm: float = 120.0
    energy_kev: float | None = 100.0
    kv: float = 100.0
    mas: float = 126.0
    filtration_cm: Mapping[str, float] = field(default_factory=lambda: {"Al": 0.25})
    energy_groups: int = 24
    scintillator_g_cm2: float = 0.22
    heel: bool = False
    subrays: int = 6
    focal_spot_cm: float = 0.0
    detector_blur_cm: float = 0.0
    glare_share: float = 0.0
    glare_cm: float = 1.0
    scatter_level: float = 0.0
    scatter_near_cm: float = 2.0
    scatter_far_cm: float = 6.0
    open_counts: float = 50_000.0
    dark_counts: float = 100.0
    quantum_noise: bool = True
    readout_sd_counts: float = 5.0
    dead_share: float = 0.0
    dead_lines: int = 0
    exposure_ratio: float = 1.0
    exposure_sd: float = 0.03
    flat_frames: int = 64
    bits: int | None = 16
    mesh_rotation_deg: float = 0.0
    mesh_shift_cm: float = 0.0
    mesh_scale_sd: float = 0.0
    mesh_tolerance_cm: float = 0.0
    mesh_warp_cm: float = 0.0
    composition_sd: float = 0.0
    one_tube: bool = False

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
        if self.dead_lines > self.size_px:
            raise DataError(f"{self.dead_lines} dead lines of {self.size_px}: expected no more")
        if self.heel and self.energy_kev is not None:
            raise DataError("the heel effect needs a tube: no energy_kev")
        if self.composition_sd and self.energy_kev is not None:
            raise DataError("compositions that err need a tube: no energy_kev")
        if self.composition_sd > MOST_COMPOSITION_SD:
            raise DataError(
                f"composition_sd: expected {MOST_COMPOSITION_SD} at most, got "
                f"{self.composition_sd:g}"
            )
        numbers = {name: value for name, value in asdict(self).items() if is_number(value)}
        if negative := sorted(name for name, value in numbers.items() if value < 0):
            raise DataError(f"{negative[0]} must not be negative, got {numbers[negative[0]]:g}")

    @classmethod
    def monochromatic(cls, size_px: int = 512) -> Scanner:
        """Give a scanner that a fit of one attenuation coefficient for each part describes."""
        return cls(size_px=size_px)

    @classmethod
    def realistic(cls, size_px: int = 512) -> Scanner:
        """Give a scanner with every effect of a real one, of assumed but usual sizes."""
        return cls(
            size_px=size_px,
            energy_kev=None,
            heel=True,
            focal_spot_cm=0.12,
            detector_blur_cm=0.015,
            glare_share=0.03,
            scatter_level=0.05,
            readout_sd_counts=1.5,
            dead_share=1e-4,
            mesh_rotation_deg=1.0,
            mesh_shift_cm=0.1,
            mesh_scale_sd=0.005,
            mesh_tolerance_cm=0.01,
        )

    def ideal(self) -> Scanner:
        """Return the same source and panel without anything that errs or blurs."""
        return replace(
            self,
            heel=False,
            focal_spot_cm=0.0,
            detector_blur_cm=0.0,
            glare_share=0.0,
            scatter_level=0.0,
            quantum_noise=False,
            readout_sd_counts=0.0,
            dead_share=0.0,
            dead_lines=0,
            exposure_ratio=1.0,
            exposure_sd=0.0,
            bits=None,
            mesh_rotation_deg=0.0,
            mesh_shift_cm=0.0,
            mesh_scale_sd=0.0,
            mesh_tolerance_cm=0.0,
            mesh_warp_cm=0.0,
            composition_sd=0.0,
        )

    def large(self) -> Scanner:
        """Return the setting for large objects: twice the distances, a panel twice as wide.

        Four panels side by side, read out as one of as many pixels. The angular field is the same,
        and so are the heel's profile and the solid angle that catches scatter, which spreads over
        twice the width. At the same ``mas`` a pixel gets as many quanta: a quarter of the fluence
        falls on four times the area. Focal spot, blur and glare stay what they are in cm, half of
        it in pixels.
        """
        return replace(self, **{name: 2 * getattr(self, name) for name in _TWICE_AS_LARGE})

    def setting_for(self, phantom: Phantom) -> tuple[str, Scanner]:
        """Choose how an object is scanned: ``standard`` where the panel holds it, else ``large``.

        Raises
        ------
        DataError
            If it is too large for both.
        """
        for name, scanner in (("standard", self), ("large", self.large())):
            beyond = scanner._beyond(phantom)
            if not beyond:
                return name, scanner
        raise DataError(
            f"{phantom.plan.object_id} reaches beyond the panel of view {beyond[0]}, and beyond "
            "one twice as wide at twice the distance too"
        )

    def holds(self, phantom: Phantom) -> bool:
        """Whether an object lies inside both views, with some air beside it."""
        return not self._beyond(phantom)

    def _beyond(self, phantom: Phantom) -> list[str]:
        return [view for view in VIEWS if not self._holds(phantom, view, AIR_BESIDE)]

    def _holds(self, phantom: Phantom, view: str, air: float = 0.0) -> bool:
        """Whether an object lies inside a view, with a share of the panel beside it."""
        points = np.concatenate([part.mesh.vertices for part in phantom.parts])
        at = self.true_geometry(phantom.plan, view).project(points)[:, :2] / self.size_px
        last = 1 - 1 / self.size_px
        return bool(at.min() >= air and at.max() <= last - air)

    @property
    def pixel_cm(self) -> float:
        """Width of a pixel of a panel."""
        return self.panel_cm / self.size_px

    @property
    def tube(self) -> Tube:
        """What sends the beam."""
        if self.energy_kev is not None:
            return Tube(energy_kev=self.energy_kev)
        return Tube(kv=self.kv, mas=self.mas, filtration_cm=self.filtration_cm)

    @property
    def beam(self) -> Beam:
        """The beam over a panel."""
        return kept_beam(
            self.tube,
            groups=self.energy_groups,
            scintillator_g_cm2=self.scintillator_g_cm2,
            heel=self.heel,
            size_px=self.size_px,
            panel_cm=self.panel_cm,
            distance_cm=self.source_detector_cm,
        )

    @property
    def reference_kev(self) -> float:
        """Photon energy, or the mean energy of the open field's signal."""
        return self.beam.spectrum.mean_detected_kev if self.energy_kev is None else self.energy_kev

    def geometry(self, view: str) -> ViewGeometry:
        """Place source and panel of a view; columns run to the viewer's right, rows down."""
        along, right = {
            "pa": (np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])),
            "lat": (np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0])),
        }[view]
        pitch, down = self.pixel_cm, np.array([0.0, 0.0, -1.0])
        behind = self.source_detector_cm - self.source_object_cm
        return ViewGeometry(
            beam="cone",
            source_cm=0.0 - self.source_object_cm * along,  # 0 - x, since -x writes zeros as -0.0
            pixel00_cm=behind * along - (self.panel_cm - pitch) / 2 * (right + down),
            column_step_cm=pitch * right,
            row_step_cm=pitch * down,
            shape=(self.size_px, self.size_px),
        )

    def true_geometry(self, plan: Identity, view: str) -> ViewGeometry:
        """Place source and panel of a view as they were, in the frame of PA."""
        geometry, turn = self.geometry(view), self.turn(plan, view)
        return geometry if turn is None else seen_by_object(geometry, turn)

    def turn(self, plan: Identity, view: str) -> Float64[np.ndarray, "4 4"] | None:
        """How an object that was turned by hand stood in a view; None where it was not turned."""
        return draw_turn(plan.rng("turn")) if self.is_turned(view) else None

    def is_turned(self, view: str) -> bool:
        """Whether objects are turned by hand before a view."""
        return self.one_tube and view != "pa"

    def panel_of(self, view: str) -> str:
        """Give the view whose tube and panel take a view."""
        return "pa" if self.one_tube else view

    def lac_per_cm(self, phantom: Phantom) -> Float64[np.ndarray, "parts"]:
        """Attenuation coefficient of each part at the energy :attr:`reference_kev`."""
        at = np.array([self.reference_kev])
        total, _ = self._coefficients(
            phantom, partial(mac_cm2_g, energy_kev=at), partial(scattering_cm2_g, energies_kev=at)
        )
        return total[:, 0]

    def _coefficients(
        self, phantom: Phantom, whole: _Mac, scattered: _Mac
    ) -> tuple[Float64[np.ndarray, "parts groups"], Float64[np.ndarray, "parts groups"]]:
        """Return linear attenuation coefficients of the parts, and those of scattering alone.

        Both in 1/cm, from what gives the mass coefficients of a composition in cm²/g.
        """
        compositions = [load_materials()[part.material].composition for part in phantom.parts]
        total, scattering = (
            np.stack([of(each) for each in compositions]) for of in (whole, scattered)
        )
        if self.composition_sd:
            factors = photoelectric_factors(phantom, self.composition_sd, self.reference_kev)
            total = scattering + factors[:, None] * (total - scattering)
        densities = np.array([part.density_g_cm3 for part in phantom.parts])[:, None]
        return densities * total, densities * scattering

    def transmission(self, phantom: Phantom, view: str) -> Image:
        """Transmission without any error but that of finitely many rays a pixel.

        Raises
        ------
        DataError
            If the object is not wholly inside the view.
        """
        return replace(self, focal_spot_cm=0.0, detector_blur_cm=0.0)._primary(phantom, view)[0]

    def _primary(self, phantom: Phantom, view: str) -> tuple[Image, Primary | None]:
        """Transmission of the direct beam, and the rest of it if it is needed."""
        geometry = self.true_geometry(phantom.plan, view)
        meshes = [part.mesh for part in phantom.parts]
        if not self._holds(phantom, view):
            raise DataError(f"{phantom.plan.object_id} reaches beyond the panel of view {view}")
        spread_cm = self.focal_spot_cm * (self.source_detector_cm / self.source_object_cm - 1)
        if self.energy_kev is not None and not (
            spread_cm or self.detector_blur_cm or self.scatter_level
        ):
            lengths = path_lengths(meshes, range(len(meshes)), geometry, self.subrays)
            return lengths.image(self.lac_per_cm(phantom)), None
        kernel = pixel_kernel(self.subrays, self.pixel_cm, spread_cm, self.detector_blur_cm)
        primary = render(self._absorber(phantom), self.beam, geometry, self.subrays, kernel)
        return primary.transmission, primary

    def _absorber(self, phantom: Phantom) -> Absorber:
        both = self._coefficients(phantom, self.beam.mac_cm2_g, self.beam.scattering_cm2_g)
        total, scattering = (each.astype(np.float32) for each in both)
        return Absorber([part.mesh for part in phantom.parts], total, scattering)

    def signal(self, phantom: Phantom, view: str) -> Signal:
        """Compute what the panel of a view would read on average.

        Raises
        ------
        DataError
            If the object is not wholly inside the view.
        """
        transmission, primary = self._primary(phantom, view)
        if primary is None:
            mean_kev = np.full_like(transmission, self.reference_kev)
            return Signal(self._glared(transmission), mean_kev, 0.0)
        open_field = self.beam.open_field.astype(np.float32)
        direct = transmission * open_field
        veil = np.zeros_like(direct)
        if self.scatter_level:
            veil = scatter_image(
                primary.scattered * open_field, self.scatter(phantom.plan), self.pixel_cm
            )
        both = direct + veil
        energy = direct * primary.mean_kev + veil * np.float32(self.reference_kev)
        shadow = primary.scattered > 0
        share = float(veil[shadow].sum() / both[shadow].sum().clip(min=1e-30))  # nothing: 0
        return Signal(self._glared(both), energy / both.clip(min=1e-30), share)

    def _glared(self, light: Image) -> Image:
        if not self.glare_share:
            return light
        spread = gaussian_spread(light, self.glare_cm / self.pixel_cm)
        return np.asarray((1 - self.glare_share) * light + self.glare_share * spread)

    def scatter(self, plan: Identity) -> ScatterDraw:
        """Scatter kernel of an object, the same in both views."""
        widths_cm = (self.scatter_near_cm, self.scatter_far_cm)
        return draw_scatter(plan.rng("scatter"), self.scatter_level, *widths_cm)

    def mesh_error(self, plan: Identity) -> MeshError:
        """How the part meshes of an object are written."""
        return draw_mesh_error(
            plan.rng("meshes"),
            self.mesh_rotation_deg,
            self.mesh_shift_cm,
            self.mesh_scale_sd,
            self.mesh_tolerance_cm,
            self.mesh_warp_cm,
        )

    def exposure(self, plan: Identity, view: str) -> float:
        """Exposure of an object's view, as a factor on that of the flat."""
        drawn = plan.rng(f"exposure/{view}").normal(0.0, self.exposure_sd)
        return self.exposure_ratio * float(np.exp(drawn))

    def radiograph(self, phantom: Phantom, view: str, signal: Signal | None = None) -> Raw:
        """Take a radiograph: counts, or transmission where there is no converter.

        Parameters
        ----------
        phantom, view
            What, and from where.
        signal
            Of :meth:`signal`, where it is known already.
        """
        signal = signal or self.signal(phantom, view)
        share = self.exposure(phantom.plan, view) * signal.values
        if self.bits is None:
            return np.asarray(share / self._open_signal(), dtype=np.float32)
        rng = phantom.plan.rng(f"noise/{view}")
        return self._panel(phantom.plan.seed, view, self.bits).read(
            share.astype(np.float64), signal.mean_kev, 1, rng
        )

    def calibration(self, seed: int, view: str) -> Calibration | None:
        """Take flat and dark of a view's panel; None where there is no converter."""
        if self.bits is None:
            return None
        rng, panel = self._panel_rng(seed, view, "panel"), self._panel(seed, view, self.bits)
        light = self._open_signal().astype(np.float64)
        mean_kev = np.full(light.shape, self.reference_kev, dtype=np.float32)
        mean_kev[:] = (self.beam.row_weights @ self.beam.energies_kev)[:, None]
        flat = panel.read(light, mean_kev, self.flat_frames, rng)
        return Calibration(flat, panel.read(0 * light, mean_kev, 1, rng))

    def _open_signal(self) -> Image:
        """Compute the expected signal without object."""
        return self._glared(self.beam.open_field.astype(np.float32))

    def _panel(self, seed: int, view: str, bits: int) -> Panel:
        shape = (self.size_px, self.size_px)
        dead = self._panel_rng(seed, view, "dead").random(shape) < self.dead_share
        if self.dead_lines:
            rng = self._panel_rng(seed, view, "dead lines")
            rows, columns = (rng.choice(self.size_px, self.dead_lines, False) for _ in range(2))
            dead[rows] = dead[:, columns] = True
        taken_up = self.beam.kev_per_cm2
        return Panel(
            open_counts=self.open_counts,
            dark_counts=self.dark_counts,
            readout_sd_counts=self.readout_sd_counts,
            quantum_noise=self.quantum_noise,
            bits=bits,
            counts_per_kev=taken_up and self.open_counts / (taken_up * self.pixel_cm**2),
            dead=dead,
        )

    def _panel_rng(self, seed: int, view: str, purpose: str) -> np.random.Generator:
        """Random numbers of one panel; another size is another panel."""
        return random_numbers(seed, f"{purpose}/{self.panel_of(view)}/{self.panel_cm:g} cm")

    def corrected(self, phantom: Phantom, view: str, signal: Signal | None = None) -> XRayView:
        """Take a radiograph and correct it for flat and dark, as the builder does on reading."""
        raw, calibration = (
            self.radiograph(phantom, view, signal),
            self.calibration(phantom.plan.seed, view),
        )
        geometry = self.true_geometry(phantom.plan, view)
        if calibration is None or self.bits is None:
            return XRayView(view, raw, np.ones(raw.shape, dtype=np.bool_), geometry)
        panel = self._panel(phantom.plan.seed, view, self.bits)
        return XRayView(view, *panel.corrected(raw, calibration), geometry)

    def settings(self) -> dict[str, Any]:
        """Give every effect and its size, in JSON's types.

        What came later goes without saying where it is as it was before: so do the usual exposure,
        two tubes, no dead lines, meshes that are not warped and the library's compositions.
        """
        values = asdict(self)
        usual = Scanner()
        for name in _LATER:
            if values[name] == getattr(usual, name):
                del values[name]
        return values
