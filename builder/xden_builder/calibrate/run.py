"""Calibrate a scanner: a folder of phantoms' radiographs into a ``scanner.toml``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from xden1k.errors import DataError
from xden1k.folder.place import publish, staging
from xden_builder.calibrate.figures import draw_balls, draw_steps
from xden_builder.calibrate.geometry import (
    TOLD_WITHIN_CM,
    GeometryFit,
    ViewFit,
    fit_geometry,
    source_moved_cm,
)
from xden_builder.calibrate.readings import ImageReadings, read_image_steps
from xden_builder.calibrate.response import PROBES, Response
from xden_builder.calibrate.spectrum import FAR_SDS, SpectrumFit, fit_spectrum
from xden_builder.calibrate.told import CalibrationFolder, read_folder
from xden_builder.capture import ScannerFile, write_scanner
from xden_builder.capture.calibrated import ScannerCalibration
from xden_builder.capture.calibration import CalibratedView, calibrate
from xden_builder.capture.scanner import DATASET_VIEWS, ViewFile
from xden_builder.capture.writing import write_json
from xden_builder.physics.source import Detector, Tube

__all__ = ["Calibration", "calibrate_scanner"]

DIGITS: Final = 6
"""Of numbers for people."""
TOGETHER: Final = "the steps tell what it does together with the others, not which of them does it"
HINTS: Final = {"kv": "thick steps of steel or copper would tell it"}
"""Why an unknown of the spectrum was not measured; :data:`TOGETHER` for the others."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """What came out of a folder.

    Parameters
    ----------
    folder
        What was told.
    images
        Readings of the wedges.
    spectrum
        None where there is no wedge.
    geometry
        None where there are no balls.
    flags
        Of the images, as ``SCAN/VIEW:flag``.
    """

    folder: CalibrationFolder
    images: tuple[ImageReadings, ...]
    spectrum: SpectrumFit | None
    geometry: GeometryFit | None
    flags: tuple[str, ...] = ()

    @property
    def scanner(self) -> ScannerFile:
        """What was told, corrected by what was found."""
        told, name = self.folder.scanner, self.folder.tube
        tube, detector = told.tube, told.detector
        if self.spectrum is not None:
            tube, detector = _rounded(self.spectrum.response)
        if tube is not None:
            tube = replace(tube, name=name or tube.name)
        found = {} if self.geometry is None else self.geometry.views
        views = {
            name: replace(view, geometry=found[name].geometry) if name in found else view
            for name, view in told.views.items()
        }
        note = self._note(tube, detector)
        return replace(told, views=views, tube=tube, detector=detector, calibration=note)

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return {
            "schema": "xden-calibration-report/1",
            "date": self.folder.date.isoformat(),
            "tube": self.folder.tube,
            "made_from": list(self._made_from()),
            **self._found(),
            "flags": list(self.flags),
            "sentences": list(self.sentences()),
        }

    def sentences(self) -> tuple[str, ...]:
        """Say in words what was found and what was not."""
        told = self.folder.scanner.views
        spectrum = () if self.spectrum is None else _of_spectrum(self.spectrum)
        geometry = () if self.geometry is None else _of_geometry(self.geometry.views, told)
        missing = [
            text
            for is_missing, text in (
                (self.spectrum is None, "no wedge was scanned: tube and filters are as told"),
                (self.geometry is None, "no balls were scanned: the geometry is as told"),
            )
            if is_missing
        ]
        return (*spectrum, *geometry, *missing)

    def _note(self, tube: Tube | None, detector: Detector) -> ScannerCalibration:
        told, measured = self.folder, self.spectrum is not None
        return ScannerCalibration(
            told.date,
            told.valid_until,
            tube if measured else Tube(name=told.tube),
            replace(detector, bits=None) if measured else None,
            self._made_from(),
            self._found(),
        )

    def _made_from(self) -> tuple[str, ...]:
        balls = self.folder.balls
        views = () if self.geometry is None else self.geometry.views
        seen = () if balls is None else tuple(f"{balls.scan}/{view}" for view in views)
        return (*(image.name for image in self.images), *seen)

    def _found(self) -> dict[str, Any]:
        spectrum = {} if self.spectrum is None else _spectrum_values(self.spectrum)
        geometry = {} if self.geometry is None else _geometry_values(self.geometry)
        return spectrum | geometry


def calibrate_scanner(root: Path, out: Path) -> Calibration:
    """Read a folder, fit what its phantoms tell, and write a ``scanner.toml`` with its evidence.

    Parameters
    ----------
    root
        Holds ``scanner.toml``, ``calibration.toml`` and the scans.
    out
        A folder that does not exist; it appears complete or not at all.

    Raises
    ------
    DataError
        If ``out`` is there, or anything of the folder is wrong; nothing is written then.
    """
    if out.exists():
        raise DataError(f"{out}: is there already; nothing is overwritten")
    found = _fit(read_folder(root))
    out.parent.mkdir(parents=True, exist_ok=True)
    with staging(out) as beside:
        made = beside / "made"
        made.mkdir()
        _write(found, made)
        publish(made, out)
    return found


def _fit(folder: CalibrationFolder) -> Calibration:
    names = dict.fromkeys((wedge.scan, wedge.view) for wedge in folder.wedges)
    seen = {name: _seen(folder, *name) for name in names}
    images, balls = _read_images(folder, seen), _ball_views(folder)
    spectrum, geometry = None, None
    if images:
        if folder.scanner.tube is None:
            raise DataError(f"{folder.root / 'scanner.toml'}: tube is missing, wedges need its kv")
        told = Response(folder.scanner.tube, folder.scanner.detector)
        spectrum = fit_spectrum(images, told)
    if folder.balls is not None:
        geometry = fit_geometry(folder.balls, {name: each.view for name, each in balls.items()})
        seen |= {(folder.balls.scan, name): each for name, each in balls.items()}
    flags = tuple(f"{scan}/{flag}" for (scan, _), each in seen.items() for flag in each.flags)
    return Calibration(folder, images, spectrum, geometry, flags)


def _read_images(
    folder: CalibrationFolder, seen: Mapping[tuple[str, str], CalibratedView]
) -> tuple[ImageReadings, ...]:
    return tuple(
        read_image_steps(
            image,
            [wedge for wedge in folder.wedges if (wedge.scan, wedge.view) == name],
        )
        for name, image in seen.items()
    )


def _ball_views(folder: CalibrationFolder) -> dict[str, CalibratedView]:
    """Read both views of the balls, if they were scanned, and further ones that were.

    Raises
    ------
    DataError
        If the phantom was turned by hand before one: it stands otherwise then, by an unknown turn,
        and tells nothing of where the panel is.
    """
    if folder.balls is None:
        return {}
    scan = folder.balls.scan
    names = [
        name
        for name, stored in folder.scanner.views.items()
        if name in DATASET_VIEWS or (folder.root / scan / stored.image).is_file()
    ]
    for name in names:
        if folder.scanner.views[name].turned:
            raise DataError(
                f"{folder.root / 'scanner.toml'}: views.{name}.turned must be false where balls "
                "are scanned, which tell the place of a panel that stands: leave out [balls]"
            )
    return {name: _seen(folder, scan, name) for name in names}


def _seen(folder: CalibrationFolder, scan: str, view: str) -> CalibratedView:
    stored = folder.scanner.views[view]
    return calibrate(view, stored, folder.root / scan, folder.root, folder.scanner.detector)


def _write(found: Calibration, out: Path) -> None:
    write_scanner(found.scanner, out / "scanner.toml")
    write_json(out / "calibration.json", found.to_dict())
    if found.spectrum is not None:
        draw_steps(found.images, found.spectrum, out / "steps.png")
    if found.geometry is not None:
        draw_balls(found.geometry, out / "balls.png")


def _rounded(found: Response) -> tuple[Tube, Detector]:
    """Leave out digits that mean nothing, so that a file says what a person can compare."""
    tube, detector = found.tube, found.detector
    assert tube.kv is not None
    filters = {name: round(cm, DIGITS) for name, cm in tube.filtration_cm.items()}
    panel = {
        key: round(value, DIGITS)
        for key in ("layer_g_cm2", "escape", "threshold_kev")
        if (value := getattr(detector, key)) is not None
    }
    return replace(tube, kv=round(tube.kv, 3), filtration_cm=filters), replace(detector, **panel)


def _spectrum_values(fit: SpectrumFit) -> dict[str, Any]:
    return {
        "spectrum_sd": {
            term.name: round(sd, DIGITS) for term, sd in zip(fit.terms, fit.sd, strict=True)
        },
        "at_prior": [term.name for term in fit.at_prior],
        "transmission_sd": {
            probe.name: round(sd, DIGITS) for probe, sd in zip(PROBES, fit.probe_sd, strict=True)
        },
        "steps_rms_sd": round(fit.rms, 3),
        "stray_light": {each.name: round(each.mean_share, DIGITS) for each in fit.stray},
        "gain": {each.name: round(each.gain, DIGITS) for each in fit.stray},
    }


def _geometry_values(fit: GeometryFit) -> dict[str, Any]:
    return {
        "source_sd_cm": {name: _digits(view.source_sd_cm) for name, view in fit.views.items()},
        "panel_sd_cm": {name: _digits(view.panel_sd_cm) for name, view in fit.views.items()},
        "panel_sd_deg": {name: _digits(view.panel_sd_deg) for name, view in fit.views.items()},
        "balls_rms_px": {name: round(view.rms_px, 4) for name, view in fit.views.items()},
        "phantom_shift_cm": _digits(fit.shift_cm),
        "phantom_rotation_deg": _digits(fit.rotation_deg),
    }


def _digits(values: tuple[float, ...]) -> list[float]:
    return [round(value, DIGITS) for value in values]


def _of_spectrum(fit: SpectrumFit) -> list[str]:
    values = dict(zip(fit.terms, fit.response.known(fit.terms).tolist(), strict=True))
    found = zip(fit.terms, values.values(), fit.sd, strict=True)
    said = ", ".join(
        f"{term.times * value:.2f} ± {term.times * sd:.2f} {term.unit}" for term, value, sd in found
    )
    probes = zip(PROBES, fit.probe_sd, strict=True)
    through = ", ".join(f"{probe.name} ± {sd:.1%}" for probe, sd in probes)
    stays = [
        f"{term.name} stays at its prior, {term.times * term.mean:.4g} ± "
        f"{term.times * term.sd:.3g} {term.unit}, within which "
        f"{term.times * values[term]:.4g} is written: {HINTS.get(term.name, TOGETHER)}"
        for term in fit.at_prior
    ]
    elsewhere = [
        f"needs you: {term.name} was told as {term.times * term.mean:.4g} {term.unit}, within "
        f"{term.times * term.sd:.3g}, and is found more than {FAR_SDS:g} times as far off: is "
        "scanner.toml of this tube and panel, with filters in cm?"
        for term in fit.elsewhere
    ]
    stray = [
        f"{each.name}: stray light behind the steps is {each.mean_share:.2%} of the open field"
        for each in fit.stray
    ]
    return [
        f"spectrum: {said}; steps lie within {fit.rms:.2f} sd",
        f"light that comes through: {through}",
        *stays,
        *elsewhere,
        *stray,
    ]


def _of_geometry(views: Mapping[str, ViewFit], told: Mapping[str, ViewFile]) -> tuple[str, ...]:
    within = [
        f"{name}: balls lie within {view.rms_px:.3f} pixels; source ± "
        f"{10 * max(view.source_sd_cm):.2f} mm in the phantom's frame"
        for name, view in views.items()
    ]
    far = [
        f"needs you: {name}: the source is found {moved_cm:.1f} cm from where it was told, "
        f"expected within {FAR_SDS * TOLD_WITHIN_CM:g}: are source_cm, the pixel pitch and the "
        "table of the balls right, and does the phantom stand as told?"
        for name, view in views.items()
        if (moved_cm := source_moved_cm(told[name].geometry, view.geometry))
        > FAR_SDS * TOLD_WITHIN_CM
    ]
    return (*within, *far)
