"""Radiographs in DICOM files: pixels, polarity and pixel spacing."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from xden1k.errors import DataError, MissingExtraError, install_command, require
from xden_builder.capture.damage import decoding
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
        If it is no DICOM image of one grey frame, or is damaged.
    MissingExtraError
        If a package that decoding needs is not installed.
    """
    with _decoding(path) as pydicom:
        return _image(path, pydicom.dcmread(path))


def _image(path: Path, data: Any) -> ImageFile:
    photometry = str(data.get("PhotometricInterpretation", "none"))
    if photometry not in _BY_PHOTOMETRY:
        raise DataError(
            f"{path}: expected a DICOM image that is MONOCHROME1 or MONOCHROME2, got {photometry}"
        )
    if data.file_meta.TransferSyntaxUID in _JPEG_2000:
        _require_decoders(path)
    slope = float(data.get("RescaleSlope", None) or 1.0)
    intercept = float(data.get("RescaleIntercept", None) or 0.0)
    pixels = data.pixel_array
    if (slope, intercept) != (1.0, 0.0):
        pixels = pixels * slope + intercept
    sign = data.get("PixelIntensityRelationshipSign", None)
    if sign is not None and slope < 0:  # it is of what is stored
        sign = -sign
    return ImageFile(
        path,
        pixels,
        polarity=_BY_SIGN.get(sign, _BY_PHOTOMETRY[photometry]),
        intensity_relation=str(data.get("PixelIntensityRelationship", None) or ""),
        bits=int(data.BitsStored),
        rescale=(slope, intercept),
    )


def _require_decoders(path: Path) -> None:
    """Name the package that is missing; pydicom would name every plugin it knows."""
    for module, package in _JPEG_2000_DECODERS.items():
        if importlib.util.find_spec(module) is None:
            command = install_command("build")
            raise MissingExtraError(f"{path}: JPEG 2000 needs {package}: {command}")


def dicom_pixel_spacing_cm(path: Path) -> tuple[float, float]:
    """Return the distance of neighbouring rows and of neighbouring columns.

    ImagerPixelSpacing, on the detector, goes before PixelSpacing, which may be that of a plane in
    the patient.

    Raises
    ------
    DataError
        If both are missing, or the one that is there is not two positive numbers.
    """
    with _decoding(path) as pydicom:
        return _spacing_cm(path, pydicom.dcmread(path, stop_before_pixels=True))


def _spacing_cm(path: Path, data: Any) -> tuple[float, float]:
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


@contextmanager
def _decoding(path: Path) -> Iterator[Any]:
    """Yield pydicom, whose complaints become DataErrors."""
    pydicom = require("pydicom", "build")
    own_errors = (pydicom.errors.InvalidDicomError, pydicom.errors.BytesLengthException)
    with decoding(path, "a DICOM image", *own_errors):
        yield pydicom
