"""Image files into values: TIFF, PNG, NumPy and DICOM."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from xden1k.errors import DataError, require
from xden_builder.capture.dicom import read_dicom
from xden_builder.capture.images import ImageFile

__all__ = ["read_image"]

_PNG_MODES = ("L", "I;16", "I;16B", "I")
_DAMAGE = (OSError, ValueError, LookupError, EOFError, struct.error, zlib.error)


def read_image(path: Path) -> ImageFile:
    """Read an image of one grey value per pixel.

    Parameters
    ----------
    path
        ``.tif`` (plain or deflate), ``.png`` (8 or 16 bits), ``.npy`` or ``.dcm``.

    Raises
    ------
    DataError
        If the file is missing or damaged, of another format, has several frames or colours, or
        holds a value that is not finite.
    MissingExtraError
        If a package that decoding needs is not installed.
    """
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise DataError(f"{path}: expected one of {', '.join(_READERS)}, got {path.suffix!r}")
    if not path.is_file():
        raise DataError(f"{path}: no such image")
    return reader(path)


def _read_tiff(path: Path) -> ImageFile:
    tifffile = require("tifffile", "build")
    return ImageFile(path, _decode(path, tifffile.imread, tifffile.TiffFileError))


def _read_png(path: Path) -> ImageFile:
    image_module = require("PIL.Image", "build")

    def decode(file: Path) -> Any:
        with image_module.open(file, formats=["PNG"]) as image:
            if image.mode not in _PNG_MODES:
                raise DataError(f"{file}: expected grey values of 8 or 16 bits, got {image.mode}")
            return np.asarray(image)

    return ImageFile(path, _decode(path, decode, SyntaxError))


def _read_npy(path: Path) -> ImageFile:
    def decode(file: Path) -> Any:
        with file.open("rb") as stream:
            return np.lib.format.read_array(stream, allow_pickle=False)

    return ImageFile(path, _decode(path, decode))


def _decode(path: Path, decode: Callable[[Path], Any], *errors: type[Exception]) -> Any:
    """Decode a file; whatever a damaged one raises becomes one DataError."""
    damage: tuple[type[Exception], ...] = (*_DAMAGE, *errors)
    try:
        return decode(path)
    except DataError:
        raise
    except damage as err:
        raise DataError(f"{path}: damaged, or not what its suffix says: {err}") from err


_READERS: dict[str, Callable[[Path], ImageFile]] = {
    ".tif": _read_tiff,
    ".tiff": _read_tiff,
    ".png": _read_png,
    ".npy": _read_npy,
    ".dcm": read_dicom,
}
