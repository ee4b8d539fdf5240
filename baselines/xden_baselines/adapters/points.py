"""``generic_points`` and ``gaussianproperty``: clouds with a density or a material each.

::

    RUNS/NAME/points.npz         points (N, 3), density (N,) or (N, 2)
    RUNS/NAME/labels.npz         points (N, 3), material (N,) text or density
    RUNS/NAME/point_cloud.ply    3D Gaussians: x, y, z, density
    RUNS/NAME/NAME.txt           a case of GaussianProperty: see .case
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float, Shaped

from xden1k.access.samples import SampleView
from xden1k.errors import DataError
from xden1k.values.materials import load_materials
from xden_baselines.adapters.case import read_case
from xden_baselines.adapters.cloud import Cloud, Unit, middle
from xden_baselines.adapters.files import (
    checked_points,
    numbers,
    read_json,
    read_npz,
    read_ply,
)

__all__ = ["density_table", "material_densities_g_cm3", "read_gaussian_property", "read_points"]

Table = Mapping[str, float]


def read_points(folder: Path, name: str, unit: Unit) -> Cloud:
    """Read ``points.npz``.

    Raises
    ------
    DataError
        If it is missing or breaks the format.
    """
    path = folder / name / "points.npz"
    points, density = checked_points(
        read_npz(path, ("points", "density")), "points", "density", path
    )
    return Cloud(points, middle(density, f"{path}: density"), unit)


def read_gaussian_property(
    folder: Path, name: str, sample: SampleView, unit: Unit, table: Table
) -> Cloud:
    """Read whichever of the three a case folder holds.

    Parameters
    ----------
    folder, name
        The run, and what it calls the object.
    sample
        The object.
    unit
        Of densities; materials have theirs from the table.
    table
        See :func:`density_table`.

    Raises
    ------
    DataError
        If there is none or more than one, or it breaks its format.
    """
    case = folder / name
    if not case.is_dir():
        raise DataError(f"{case}: no such folder")
    choices = [case / "labels.npz", case / "point_cloud.ply", case / f"{name}.txt"]
    there = [path.name for path in choices if path.exists()]
    if len(there) != 1:
        expected = [path.name for path in choices]
        raise DataError(f"{case}: expected one of {expected}, found {there}")
    if there[0] == "labels.npz":
        return _labels(case / there[0], unit, table)
    if there[0] == "point_cloud.ply":
        found = read_ply(case / there[0], ("x", "y", "z", "density"))
        points = np.stack([found[axis] for axis in "xyz"], axis=1)
        arrays = {"points": points, "density": found["density"]}
        return Cloud(*checked_points(arrays, "points", "density", case / there[0]), unit)
    return read_case(case, sample, lambda names: material_densities_g_cm3(names, table))


def density_table(path: Path | None) -> Table:
    """Read what stands for each material: a JSON object of names and [low, high] in kg/m³.

    Raises
    ------
    DataError
        If the file is no such table.
    """
    values = {} if path is None else read_json(path)
    ranges = {name: numbers(one, (2,), f"{path}: {name}")[None] for name, one in values.items()}
    return {
        _spelled(name): float(middle(one, f"{path}: {name}")[0]) / 1000
        for name, one in ranges.items()
    }


def material_densities_g_cm3(
    names: Shaped[np.ndarray, "materials"], table: Table
) -> Float[np.ndarray, "materials"]:
    """Density of each material: the table's, else that of the material library.

    A family, such as ``metal``, spans too much to have one.

    Raises
    ------
    DataError
        If neither knows one.

    Examples
    --------
    >>> material_densities_g_cm3(np.array(["Steel", "wood"]), {"wood": 0.6}).tolist()
    [7.85, 0.6]
    """
    library = load_materials()
    labels = [_spelled(str(name)) for name in names]
    if unknown := sorted({one for one in labels if one not in table and one not in library.labels}):
        raise DataError(
            f"no density is known for the materials {unknown}: give them in --densities"
        )
    return np.array(
        [table[one] if one in table else library[one].density_nominal_g_cm3 for one in labels]
    )


def _labels(path: Path, unit: Unit, table: Table) -> Cloud:
    arrays = read_npz(path, ("points", "material", "density"))
    if ("material" in arrays) == ("density" in arrays):
        raise DataError(f"{path}: expected either material or density, found {sorted(arrays)}")
    if "density" in arrays:
        points, density = checked_points(arrays, "points", "density", path)
        return Cloud(points, middle(density, f"{path}: density"), unit)
    material = arrays["material"]
    if material.dtype.kind != "U" or material.ndim != 1:
        raise DataError(
            f"{path}: material must be text of shape (N,), got {material.dtype} {material.shape}"
        )
    names, which = np.unique(material, return_inverse=True)
    density = material_densities_g_cm3(names, table)[which]
    points, density = checked_points({**arrays, "density": density}, "points", "density", path)
    return Cloud(points, density, "g/cm3")


def _spelled(name: str) -> str:
    return "_".join(name.lower().split())
