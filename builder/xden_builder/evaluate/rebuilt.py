"""A rebuilt dataset folder against the truth beside its captures."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from xden1k.folder import open_folder
from xden1k.values.types import DensityObject, Part
from xden_builder.capture import CaptureFolder
from xden_builder.evaluate.run import PartCheck
from xden_builder.evaluate.truth import Errors, errors_of, read_truth, size_of
from xden_builder.registration.placement import RigidPlacement

__all__ = ["RebuiltObject", "RebuiltPart", "RebuiltSet", "read_rebuilt"]


@dataclass(frozen=True, slots=True)
class RebuiltPart:
    """One part of a rebuilt object and its truth.

    Parameters
    ----------
    name
        Unique in its object.
    material, label
        What it is made of, and what the annotator wrote; empty where nothing.
    volume_share
        Of the object's volume.
    check
        Its density, standard deviation, source and flags.
    """

    name: str
    material: str
    label: str
    volume_share: float
    check: PartCheck


@dataclass(frozen=True, slots=True)
class RebuiltObject:
    """One rebuilt object: how far it is off, and its parts."""

    object_id: str
    errors: Errors
    parts: tuple[RebuiltPart, ...]


@dataclass(frozen=True, slots=True)
class RebuiltSet:
    """A rebuilt folder.

    Parameters
    ----------
    objects
        Sorted by id.
    missing
        Ids of the captures that were not rebuilt.
    """

    objects: tuple[RebuiltObject, ...]
    missing: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return asdict(self)


def read_rebuilt(captures: Path, root: Path) -> RebuiltSet:
    """Compare what ``xden-build run`` made of simulated captures with their truth.

    Parameters
    ----------
    captures
        Folder of simulated captures, with ``truth.json`` in each object's folder.
    root
        The dataset folder.

    Raises
    ------
    DataError
        If either folder cannot be read, or the truth is missing or of other parts.
    """
    folder = open_folder(root)
    wanted = sorted(CaptureFolder(captures).object_ids)
    built = set(folder.ids())
    return RebuiltSet(
        tuple(_compared(captures / key, folder.object(key)) for key in wanted if key in built),
        tuple(key for key in wanted if key not in built),
    )


def _compared(folder: Path, rebuilt: DensityObject) -> RebuiltObject:
    truth = read_truth(folder, rebuilt.parts, _placement(rebuilt)).enlarged(size_of(rebuilt))
    regions = [part.mesh for part in rebuilt.parts]
    density_g_cm3 = np.array([part.density_g_cm3 for part in rebuilt.parts])
    volumes = np.array([float(region.volume) for region in regions])
    shares, known = (volumes / volumes.sum()).tolist(), _known_parts(folder)
    errors = errors_of(density_g_cm3, regions, truth)
    parts = zip(rebuilt.parts, truth.density_g_cm3.tolist(), shares, strict=True)
    return RebuiltObject(
        rebuilt.object_id,
        errors,
        tuple(_part(part, known[part.name], density, share) for part, density, share in parts),
    )


def _placement(rebuilt: DensityObject) -> RigidPlacement | None:
    """By which its meshes came into the scanner's frame; None where they were in it."""
    found = rebuilt.meta.get("registration")
    return None if found is None else RigidPlacement.from_dict(found)


def _part(part: Part, known: Mapping[str, Any], truth_g_cm3: float, share: float) -> RebuiltPart:
    check = PartCheck(
        part.density_g_cm3, part.density_sd_g_cm3, truth_g_cm3, part.density_source, part.flags
    )
    return RebuiltPart(part.name, known["material"], known["label"], share, check)


def _known_parts(folder: Path) -> Mapping[str, Mapping[str, Any]]:
    """Give what ``truth.json`` says of each part, which :func:`read_truth` has checked."""
    values = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    return {part["name"]: part for part in values["parts"]}
