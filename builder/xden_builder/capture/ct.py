"""The CT reference of an object, which only the audit reads."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32

from xden1k.errors import DataError
from xden1k.values.arrays import Labels, Vec3
from xden_builder.capture.damage import decoding

__all__ = ["CTReference", "read_ct"]

_KINDS = {"floats": "f", "integers": "iu", "numbers": "fiu", "text": "U"}
"""Kinds of NumPy's data types."""


@dataclass(frozen=True, slots=True, eq=False)
class CTReference:
    """Attenuation on a regular grid, whose voxels need not be cubes.

    Parameters
    ----------
    mu_per_cm
        Shape (x, y, z), finite.
    origin_cm
        Shape (3,): centre of voxel (0, 0, 0) in the object frame.
    spacing_cm
        Shape (3,): edges of a voxel.
    labels
        Shape (x, y, z) uint8, 0 = outside; None where nothing was segmented.
    label_names
        Name of each label; names that are no part, such as an air cavity, may occur.

    Raises
    ------
    DataError
        If a value is not finite, the spacing not positive, or labels and names do not go together.
    """

    mu_per_cm: Float32[np.ndarray, "x y z"]
    origin_cm: Vec3
    spacing_cm: Vec3
    labels: Labels | None = None
    label_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.mu_per_cm.size == 0:
            raise DataError(f"mu_per_cm holds no voxel: its shape is {self.mu_per_cm.shape}")
        if bad := int((~np.isfinite(self.mu_per_cm)).sum()):
            raise DataError(f"mu_per_cm: {bad} voxels are not finite")
        if not np.isfinite(self.origin_cm).all():
            raise DataError(f"origin_cm must be finite, got {self.origin_cm.tolist()}")
        if not (np.isfinite(self.spacing_cm) & (self.spacing_cm > 0)).all():
            raise DataError(f"spacing_cm must be positive, got {self.spacing_cm.tolist()}")
        if self.labels is None:
            return
        if self.labels.shape != self.mu_per_cm.shape:
            raise DataError(
                f"labels must have the grid's shape {self.mu_per_cm.shape}, got {self.labels.shape}"
            )
        if self.labels.max() >= len(self.label_names):
            raise DataError(
                f"label_names must name every label up to {self.labels.max()}, "
                f"got {len(self.label_names)} names"
            )

    @property
    def voxel_cm3(self) -> float:
        """Volume of a voxel."""
        return float(np.prod(self.spacing_cm))


def read_ct(path: Path) -> CTReference:
    """Read a ``ct.npz``.

    Hounsfield units become ``mu_water_per_cm * (1 + hu / 1000)``.

    Raises
    ------
    DataError
        If the file is damaged, holds pickled objects, lacks an array, or an array breaks the
        format; the message names file and array.
    """
    if not zipfile.is_zipfile(path):
        raise DataError(f"{path}: not an npz archive")
    kind = "an npz archive without pickled objects"
    with decoding(path, kind), np.load(path, allow_pickle=False) as stored:
        arrays = dict(stored.items())
    try:
        return _reference(arrays)
    except DataError as err:
        raise DataError(f"{path}: {err}") from err


def _reference(arrays: Mapping[str, Any]) -> CTReference:
    mu_per_cm = _attenuation(arrays)
    labels = None
    if "labels" in arrays:
        labels = _array(arrays, "labels", "integers", 3)
        if labels.dtype != np.uint8:
            raise DataError(f"labels must be uint8, got {labels.dtype}")
    names = _array(arrays, "label_names", "text", 1) if labels is not None else ()
    return CTReference(
        mu_per_cm,
        origin_cm=_triple(arrays, "origin_cm"),
        spacing_cm=_triple(arrays, "spacing_cm"),
        labels=labels,
        label_names=tuple(str(name) for name in names),
    )


def _attenuation(arrays: Mapping[str, Any]) -> Float32[np.ndarray, "x y z"]:
    if ("mu_per_cm" in arrays) == ("hu" in arrays):
        raise DataError("expected either mu_per_cm or hu")
    if "mu_per_cm" in arrays:
        return np.asarray(_array(arrays, "mu_per_cm", "floats", 3), dtype=np.float32)
    water = _array(arrays, "mu_water_per_cm", "numbers", 0)
    if not 0 < water < np.inf:
        raise DataError(f"mu_water_per_cm must be positive, got {water}")
    hounsfield = _array(arrays, "hu", "integers", 3).astype(np.float32)
    return np.asarray(np.float32(water) * (1 + hounsfield / 1000), dtype=np.float32)


def _triple(arrays: Mapping[str, Any], key: str) -> Vec3:
    values = _array(arrays, key, "numbers", 1).astype(np.float64)
    if values.shape != (3,):
        raise DataError(f"{key} must hold 3 values, got {values.size}")
    return np.asarray(values)


def _array(arrays: Mapping[str, Any], key: str, kind: str, axes: int) -> Any:
    """Return an array of the archive that must have this kind of values and so many axes."""
    if key not in arrays:
        raise DataError(f"{key} is missing")
    array = arrays[key]
    if array.dtype.kind not in _KINDS[kind] or array.ndim != axes:
        raise DataError(
            f"{key} must be {kind} along {axes} axes, got {array.dtype} along {array.ndim}"
        )
    return array
