"""NumPy archive: everything the dataset has of one object, in its units (cm, g) and names."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any, Final

import numpy as np

from xden1k.errors import DataError
from xden1k.export.arrays import arrays_of, of_arrays
from xden1k.export.body import Body
from xden1k.export.si import Inertial

__all__ = ["SUFFIX", "check", "expected", "read", "write"]

SUFFIX: Final = ".npz"


def write(body: Body, path: Path) -> None:
    """Write the arrays; the same bytes for the same object."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in arrays_of(body.obj).items():
            file = io.BytesIO()
            np.lib.format.write_array(file, values, allow_pickle=False)
            member = zipfile.ZipInfo(f"{name}.npy")  # its time is 1980
            archive.writestr(member, file.getvalue(), zipfile.ZIP_DEFLATED)


def expected(body: Body) -> Inertial:
    """Return what a reader should find."""
    return body.inertial


def read(path: Path, body: Body) -> Inertial:
    """Integrate the meshes as NumPy gives them, with the densities beside them.

    Raises
    ------
    DataError
        If an array is missing.
    """
    with np.load(path, allow_pickle=False) as file:
        arrays: dict[str, Any] = dict(file)
    try:
        return of_arrays(arrays)
    except KeyError as err:
        raise DataError(f"{path}: no array {err}") from err


check = read
