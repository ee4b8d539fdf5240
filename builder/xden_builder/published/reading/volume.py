"""The volume of attenuation coefficients, from NIfTI."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float32

from xden1k.errors import DataError, require
from xden1k.values.physics import PAPER_MAC_CM2_G
from xden_builder.capture.damage import decoding
from xden_builder.published.labels import LEAST_PER_CM, air_per_cm
from xden_builder.published.reading.table import PartTable

__all__ = ["VolumeHeader", "read_header", "read_volume"]

MOST_AIR_PER_CM: Final = 0.005
LIKE: Final = 0.004
"""Share within which a voxel is at a level."""
NIFTI: Final = "a NIfTI volume"

Volume = Float32[np.ndarray, "x y z"]


@dataclass(frozen=True, slots=True)
class VolumeHeader:
    """What the head of a volume tells.

    Parameters
    ----------
    shape
        Voxels along each axis.
    dtype
        As stored.
    identity
        Whether its affine is the identity, and so tells nothing.
    """

    shape: tuple[int, ...]
    dtype: str
    identity: bool


def read_header(path: Path) -> VolumeHeader:
    """Read the head of a volume.

    Raises
    ------
    DataError
        If it is none.
    """
    image = _opened(path)
    with decoding(path, NIFTI):
        return VolumeHeader(
            tuple(map(int, image.shape)),
            str(image.get_data_dtype()),
            bool(np.array_equal(image.affine, np.eye(4))),
        )


def read_volume(path: Path, table: PartTable | None) -> tuple[Volume, bool]:
    """Read a volume of attenuation coefficients.

    Returns
    -------
    volume
        1/cm.
    was_density
        Whether the file held LAC / 0.17, by the levels of the table, and was taken back to LAC.

    Raises
    ------
    DataError
        If it is no NIfTI file of three axes, is cut off, holds what is negative or not a number,
        has no air around the object, or nothing else.
    """
    image = _opened(path)
    with decoding(path, NIFTI, zlib.error):
        values = np.asarray(image.dataobj, dtype=np.float32)
    if values.ndim == 4 and values.shape[3] == 1:
        values = values[..., 0]
    if values.ndim != 3 or min(values.shape) < 2:
        raise DataError(f"{path}: expected a volume of three axes, got shape {values.shape}")
    bad = ~np.isfinite(values) | (values < 0)
    if bad.any():
        first = tuple(np.argwhere(bad)[0].tolist())
        raise DataError(
            f"{path}: expected attenuation coefficients from 0 up, got {values[first]} at {first}"
        )
    _check_air(path, values)
    if table is not None and _holds_densities(values, table):
        return np.float32(PAPER_MAC_CM2_G) * values, True
    return values, False


def _opened(path: Path) -> Any:
    nibabel = require("nibabel", "import")
    with decoding(path, NIFTI, nibabel.filebasedimages.ImageFileError):
        return nibabel.load(path)


def _check_air(path: Path, values: Volume) -> None:
    air = air_per_cm(values)
    if air >= MOST_AIR_PER_CM:
        raise DataError(
            f"{path}: expected air around the object, below {MOST_AIR_PER_CM} 1/cm in the median "
            f"of its six faces, got {air:.3g}: no volume of attenuation coefficients"
        )
    if values.max() <= LEAST_PER_CM:
        raise DataError(
            f"{path}: expected an object, above {LEAST_PER_CM} 1/cm, got {values.max():.3g} at "
            "most: nothing but air"
        )


def _holds_densities(values: Volume, table: PartTable) -> bool:
    """Whether more voxels are at the levels of the densities than at those of attenuation."""
    if not table.density_g_cm3:
        return False
    met = values[values > MOST_AIR_PER_CM]
    as_lac = _at_levels(met, list(table.lac_per_cm.values()))
    return _at_levels(met, list(table.density_g_cm3.values())) > as_lac


def _at_levels(values: Float32[np.ndarray, "n"], levels: list[float]) -> int:
    return sum(int((np.abs(values - level) <= LIKE * level).sum()) for level in levels)
