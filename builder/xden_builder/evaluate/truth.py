"""What the simulator knows of an object, in the frame of the meshes it handed over."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float64

from xden1k.errors import DataError
from xden1k.values.arrays import Vec3
from xden1k.values.mass import mass_of_meshes
from xden1k.values.types import Part
from xden_builder.capture import CapturePart

__all__ = ["Errors", "Truth", "errors_of", "read_truth"]


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What is to be found.

    Parameters
    ----------
    density_g_cm3
        Shape (K,), in the order of the capture's parts.
    mass_g
        Of the true object.
    com_cm
        Shape (3,): its centre of mass, where the meshes handed over show it.
    """

    density_g_cm3: Float64[np.ndarray, "k"]
    mass_g: float
    com_cm: Vec3


@dataclass(frozen=True, slots=True)
class Errors:
    """How far an answer is off.

    Parameters
    ----------
    density_mae_g_cm3
        Mean absolute error of the density, weighted by the volume of the parts.
    mass_ape
        Absolute error of the mass, as a share of it.
    com_l1_cm
        Sum of the three absolute errors of the centre of mass.
    """

    density_mae_g_cm3: float
    mass_ape: float
    com_l1_cm: float


def read_truth(folder: Path, parts: Sequence[CapturePart | Part]) -> Truth:
    """Read ``truth.json`` of a simulated capture.

    Parameters
    ----------
    folder
        Of the object.
    parts
        As the capture, or what was made of it, has them.

    Raises
    ------
    DataError
        If there is no truth, or it is of other parts.
    """
    path = folder / "truth.json"
    if not path.is_file():
        raise DataError(f"{path}: expected the truth of a simulated object, found none")
    values = json.loads(path.read_text(encoding="utf-8"))
    known = {part["name"]: part["density_g_cm3"] for part in values["parts"]}
    if missing := [part.name for part in parts if part.name not in known]:
        raise DataError(f"{path}: no part {missing[0]!r}; parts are {sorted(known)}")
    matrix = np.array(values["mesh_error"]["matrix"])
    return Truth(
        np.array([known[part.name] for part in parts]),
        float(values["mass_g"]),
        np.asarray(matrix[:3, :3] @ np.array(values["com_cm"]) + matrix[:3, 3]),
    )


def errors_of(
    density_g_cm3: Float64[np.ndarray, "k"], regions: Sequence[trimesh.Trimesh], truth: Truth
) -> Errors:
    """Compare densities of parts with the truth.

    Parameters
    ----------
    density_g_cm3
        Shape (K,).
    regions
        Space that each part owns, as handed over.
    truth
        What is to be found.
    """
    volumes = np.array([float(region.volume) for region in regions])
    body = mass_of_meshes(regions, density_g_cm3.tolist())
    off = np.abs(density_g_cm3 - truth.density_g_cm3)
    com_l1 = float(np.abs(body.com_cm - truth.com_cm).sum()) if body.mass_g else float("nan")
    return Errors(
        float(np.average(off, weights=volumes)), abs(body.mass_g / truth.mass_g - 1), com_l1
    )
