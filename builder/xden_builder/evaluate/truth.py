"""What the simulator knows of an object, in the frame of the meshes it handed over."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float64

from xden1k.errors import DataError
from xden1k.values.arrays import Vec3
from xden1k.values.mass import mass_of_meshes
from xden1k.values.types import DensityObject, Part
from xden_builder.capture import CapturePart
from xden_builder.poly.model.size import Size
from xden_builder.registration.placement import RigidPlacement

__all__ = ["Errors", "Truth", "errors_of", "read_truth", "size_of"]


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

    def enlarged(self, size: Size) -> Truth:
        """Show it where the meshes handed over were given a size."""
        return replace(self, com_cm=size.applied(self.com_cm[None])[0])


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


def size_of(rebuilt: DensityObject) -> Size:
    """Give the size that a rebuilt object was found to have beside its meshes."""
    found = rebuilt.meta.get("mesh_size")
    return Size(1.0, 0.0, np.zeros(3)) if found is None else Size.from_dict(found)


def read_truth(
    folder: Path,
    parts: Sequence[CapturePart | Part],
    placement: RigidPlacement | None = None,
) -> Truth:
    """Read ``truth.json`` of a simulated capture.

    Parameters
    ----------
    folder
        Of the object.
    parts
        As the capture, or what was made of it, has them.
    placement
        By which they came into the scanner's frame; None where they were in it.

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
    return Truth(
        np.array([known[part.name] for part in parts]),
        float(values["mass_g"]),
        _com_cm(values, placement),
    )


def _com_cm(values: Mapping[str, Any], placement: RigidPlacement | None) -> Vec3:
    """Centre of mass where the meshes show it: as handed over, or where they were found to be.

    Meshes of an unknown pose that are said to stand in the scanner's frame stand as the object.
    """
    com_cm = np.array(values["com_cm"])
    if "mesh_pose" not in values:
        matrix = np.array(values["mesh_error"]["matrix"])
        handed_over = matrix[:3, :3] @ com_cm + matrix[:3, 3]
    elif placement is None:
        return com_cm
    else:
        handed_over = RigidPlacement.from_dict(values["mesh_pose"]).undone(com_cm[None])[0]
    return np.asarray(handed_over if placement is None else placement.apply(handed_over[None])[0])


def errors_of(
    density_g_cm3: Float64[np.ndarray, "k"], regions: Sequence[trimesh.Trimesh], truth: Truth
) -> Errors:
    """Compare densities of parts with the truth.

    Parameters
    ----------
    density_g_cm3
        Shape (K,).
    regions
        Space that each part owns, as the truth shows it.
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
