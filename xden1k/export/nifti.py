"""NIfTI-1, for medical viewers and torchio: voxels with an affine in mm, the format's unit.

Densities stay g/cm³. The axes of the object frame are taken for right, anterior and superior.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from xden1k.errors import DataError, require
from xden1k.export.body import Body
from xden1k.export.si import MM_PER_CM, Inertial
from xden1k.export.voxels import Volume, field_inertial, field_volumes, label_volume, of_density

__all__ = ["SUFFIX", "check", "expected", "read", "write"]

SUFFIX: Final = ".nii.gz"
DENSITY: Final = "density"


def write(body: Body, path: Path) -> None:
    """Write the density, and beside it each other grid: ``NAME.labels.nii.gz`` and so on."""
    nibabel: Any = require("nibabel", "volumes")
    stem = path.name.removesuffix(SUFFIX)
    for volume in [*field_volumes(body.obj), label_volume(body.obj)]:
        affine = np.diag([*[MM_PER_CM * volume.voxel_size_cm] * 3, 1.0])
        affine[:3, 3] = MM_PER_CM * volume.origin_cm
        image = nibabel.Nifti1Image(volume.values, affine)
        image.header.set_xyzt_units("mm")
        image.set_sform(affine, code="scanner")
        image.set_qform(affine, code="scanner")
        image.header["descrip"] = volume.words.encode("ascii")
        other = "" if volume.name == DENSITY else f".{volume.name}"
        nibabel.save(image, path.with_name(f"{stem}{other}{SUFFIX}"))


def expected(body: Body) -> Inertial:
    """Return what a reader should find: the field's, not the meshes'."""
    return field_inertial(body.obj)


def read(path: Path, body: Body) -> Inertial:
    """Integrate the density as nibabel gives it.

    Raises
    ------
    DataError
        If its affine is no cubic grid in mm along the axes.
    MissingExtraError
        If nibabel is not installed.
    """
    nibabel: Any = require("nibabel", "volumes")
    image = nibabel.load(path)
    affine, unit = image.affine, image.header.get_xyzt_units()[0]
    size = float(affine[0, 0])
    if unit != "mm" or not np.allclose(affine[:3, :3], size * np.eye(3), rtol=1e-6, atol=0):
        raise DataError(f"{path}: expected a cubic grid in mm along the axes, got {affine} {unit}")
    volume = Volume(
        DENSITY, np.asarray(image.dataobj), affine[:3, 3] / MM_PER_CM, size / MM_PER_CM, ""
    )
    return of_density(volume)


check = read
