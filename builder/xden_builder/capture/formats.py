"""Image files into values: TIFF, PNG, NumPy and DICOM."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from xden1k.errors import DataError, require
from xden_builder.capture.damage import decoding
from xden_builder.capture.dicom import read_dicom
from xden_builder.capture.images import ImageFile

__all__ = ["read_image"]

_PNG_MODES = ("L", "I;16", "I;16B", "I")
_TIFF_PACKED = {"NONE", "LZW", "DEFLATE", "ADOBE_DEFLATE", "PACKBITS"}


def read_image(path: Path) -> ImageFile:
    """Read an image of one grey value per pixel.

    Parameters
    ----------
    path
        ``.tif`` (plain, deflate, LZW or PackBits), ``.png`` (8 or 16 bits), ``.npy`` or ``.dcm``.

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
        said = "not a file" if os.path.lexists(path) else "no such image"
        raise DataError(f"{path}: {said}")
    return reader(path)


def _read_tiff(path: Path) -> ImageFile:
    tifffile = require("tifffile", "build")
    require("imagecodecs", "build")
    with decoding(path, "a TIFF image", tifffile.TiffFileError), tifffile.TiffFile(path) as file:
        whole = [each for each in file.series if not each.keyframe.is_reduced] or file.series
        sizes = [each.keyframe.imagelength * each.keyframe.imagewidth for each in whole]
        images = [each for each, size in zip(whole, sizes, strict=True) if size > max(sizes) / 2]
        if len(images) > 1:
            shapes = " and ".join(" x ".join(map(str, each.shape)) for each in images)
            raise DataError(f"{path}: expected one image, got {len(images)}: {shapes}")
        if others := {_packing(page.compression) for page in images[0].pages} - _TIFF_PACKED:
            raise DataError(
                f"{path}: expected a TIFF image that is plain or packed without loss by deflate, "
                f"LZW or PackBits, got {', '.join(sorted(others))}"
            )
        pixels = images[0].asarray()
    return ImageFile(path, pixels)


def _packing(compression: int) -> str:
    """Name a compression; a file that tells none has the plain one's number."""
    tifffile = require("tifffile", "build")
    known: dict[int, str] = {each.value: each.name for each in tifffile.COMPRESSION}
    return known.get(int(compression), f"compression {int(compression)}")


def _read_png(path: Path) -> ImageFile:
    pillow = require("PIL.Image", "build")
    too_large = pillow.DecompressionBombError
    with decoding(path, "a PNG image", too_large), pillow.open(path, formats=["PNG"]) as image:
        if image.mode not in _PNG_MODES:
            raise DataError(f"{path}: expected grey values of 8 or 16 bits, got {image.mode}")
        pixels = np.asarray(image)
    return ImageFile(path, pixels)


def _read_npy(path: Path) -> ImageFile:
    with decoding(path, "a NumPy array"), path.open("rb") as stream:
        pixels = np.lib.format.read_array(stream, allow_pickle=False)
    return ImageFile(path, pixels)


_READERS: dict[str, Callable[[Path], ImageFile]] = {
    ".tif": _read_tiff,
    ".tiff": _read_tiff,
    ".png": _read_png,
    ".npy": _read_npy,
    ".dcm": read_dicom,
}
