"""Radiographs in DICOM files: pixels, polarity and pixel spacing."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np

from xden1k.errors import DataError, MissingExtraError, require
from xden_builder.capture.images import ImageFile, Polarity

__all__ = ["dicom_pixel_spacing_cm", "read_dicom", "spacing_note"]

_JPEG_2000 = ("1.2.840.10008.1.2.4.90", "1.2.840.10008.1.2.4.91")
_JPEG_2000_DECODERS = {"pylibjpeg": "pylibjpeg", "openjpeg": "pylibjpeg-openjpeg"}
_BY_PHOTOMETRY: dict[str, Polarity] = {"MONOCHROME1": "inverted", "MONOCHROME2": "linear"}
_BY_SIGN: dict[int, Polarity] = {-1: "inverted", 1: "linear"}


def read_dicom(path: Path) -> ImageFile:
    """Read pixels and what the header says of them.

    RescaleSlope and RescaleIntercept are applied. The polarity is PixelIntensityRelationshipSign
    where the header has it (DICOM PS3.3, C.8.11.3.1.2), else it follows from
    PhotometricInterpretation: MONOCHROME1 shows low values bright, hence ``inverted``. That is a
    rule of display, and many a MONOCHROME1 radiograph stores more for more photons, so that bone
    is shown white; a polarity in the scanner file stands above both.

    Raises
    ------
    DataError
        If it is no DICOM image of one grey frame, or cannot be decoded.
    MissingExtraError
        If a package that decoding needs is not installed.
    """
    data = _read_dataset(path)
    if "PixelData" not in data:
        raise DataError(f"{path}: the DICOM file holds no image")
    photometry = str(data.get("PhotometricInterpretation", ""))
    if photometry not in _BY_PHOTOMETRY:
        raise DataError(f"{path}: expected MONOCHROME1 or MONOCHROME2, got {photometry or 'none'}")
    _require_decoders(path, str(data.file_meta.TransferSyntaxUID))
    try:
        stored = data.pixel_array
    except (RuntimeError, ValueError, AttributeError, NotImplementedError) as err:
        raise DataError(f"{path}: its pixels cannot be decoded: {err}") from err
    slope = float(data.get("RescaleSlope", None) or 1.0)
    intercept = float(data.get("RescaleIntercept", None) or 0.0)
    rescaled = (slope, intercept) != (1.0, 0.0)
    sign = data.get("PixelIntensityRelationshipSign", None)
    return ImageFile(
        path,
        pixels=stored * slope + intercept if rescaled else stored,
        polarity=_BY_SIGN.get(sign, _BY_PHOTOMETRY[photometry]),
        intensity_relation=str(data.get("PixelIntensityRelationship", None) or ""),
        bits=int(data.BitsStored),
        rescale=(slope, intercept),
    )


def dicom_pixel_spacing_cm(path: Path) -> tuple[float, float]:
    """Return the distance of neighbouring rows and of neighbouring columns.

    ImagerPixelSpacing, on the detector, goes before PixelSpacing, which may be that of a plane in
    the patient.

    Raises
    ------
    DataError
        If both are missing, or the one that is there is not two positive numbers.
    """
    data = _read_dataset(path, stop_before_pixels=True)
    found = [name for name in ("ImagerPixelSpacing", "PixelSpacing") if data.get(name, None)]
    if not found:
        raise DataError(f"{path}: PixelSpacing is missing; give the geometry in scanner.toml")
    spacing_mm = np.atleast_1d(np.array(data[found[0]].value, dtype=np.float64))
    if spacing_mm.shape != (2,) or not (np.isfinite(spacing_mm) & (spacing_mm > 0)).all():
        shown = ", ".join(f"{size:g}" for size in spacing_mm)
        raise DataError(f"{path}: {found[0]} is [{shown}]; give the geometry in scanner.toml")
    return float(spacing_mm[0]) / 10, float(spacing_mm[1]) / 10


def spacing_note(path: Path) -> str:
    """Say in a few words what a DICOM header offers where a view's geometry is missing."""
    try:
        rows, columns = dicom_pixel_spacing_cm(path)
    except DataError as err:
        return str(err)
    return (
        f"{path}: its header gives a pixel of {rows:g} x {columns:g} cm but not where the detector "
        "stands; give the geometry in scanner.toml"
    )


def _read_dataset(path: Path, stop_before_pixels: bool = False) -> Any:
    pydicom = require("pydicom", "build")
    try:
        return pydicom.dcmread(path, stop_before_pixels=stop_before_pixels)
    except (pydicom.errors.InvalidDicomError, OSError, ValueError, KeyError) as err:
        raise DataError(f"{path}: not a DICOM file: {err}") from err


def _require_decoders(path: Path, transfer_syntax: str) -> None:
    """Name the package that is missing; pydicom would name every plugin it knows."""
    if transfer_syntax not in _JPEG_2000:
        return
    for module, package in _JPEG_2000_DECODERS.items():
        if importlib.util.find_spec(module) is None:
            raise MissingExtraError(
                f"{path}: JPEG 2000 needs {package}: pip install 'xden1k[build]'"
            )
