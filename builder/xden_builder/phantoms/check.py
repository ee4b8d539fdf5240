"""Whether simulated captures are sound: parts closed and disjoint, grids that weigh right."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from xden1k.errors import DataError, XDenError
from xden1k.rays import disjoint_regions
from xden1k.values.closed import edge_faults
from xden_builder.capture import CaptureFolder
from xden_builder.capture.damage import decoding
from xden_builder.phantoms.grid import TruthGrid
from xden_builder.phantoms.phantom import Phantom, Plan, make_phantom
from xden_builder.phantoms.realism import Realism
from xden_builder.phantoms.writer import each_object

__all__ = ["MEDIAN_MASS_ERROR", "WORST_MASS_ERROR", "ObjectCheck", "SetReport", "check_set"]

MEDIAN_MASS_ERROR, WORST_MASS_ERROR = 1e-3, 1e-2
"""Limits of the difference between a grid's mass and its parts', as a share of it."""


@dataclass(frozen=True, slots=True)
class ObjectCheck:
    """What was found of one object.

    Parameters
    ----------
    object_id
        Which.
    mass_error
        |Mass of the truth grid / sum of the parts' masses - 1|; nan where it could not be read.
    faults
        One line each; none if it is sound.
    """

    object_id: str
    mass_error: float
    faults: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class SetReport:
    """What was found of a set.

    Parameters
    ----------
    checks
        By object, in the order of ``objects.csv``.
    """

    checks: tuple[ObjectCheck, ...]

    @property
    def median_mass_error(self) -> float:
        """Of the objects that could be read; nan if none could."""
        return float(np.median(self._mass_errors)) if self._mass_errors else np.nan

    @property
    def worst_mass_error(self) -> float:
        """Of the objects that could be read; nan if none could."""
        return max(self._mass_errors, default=np.nan)

    @property
    def _mass_errors(self) -> list[float]:
        return [check.mass_error for check in self.checks if not np.isnan(check.mass_error)]

    @property
    def failures(self) -> tuple[ObjectCheck, ...]:
        """The objects with faults."""
        return tuple(check for check in self.checks if check.faults)

    @property
    def good(self) -> bool:
        """Whether no object has a fault, and the median of the mass errors is within its limit."""
        return not self.failures and self.median_mass_error <= MEDIAN_MASS_ERROR

    def to_dict(self) -> dict[str, Any]:
        """Give the summary and what failed, in JSON's types."""
        return {
            "objects": len(self.checks),
            "median_mass_error": self.median_mass_error,
            "worst_mass_error": self.worst_mass_error,
            "failures": [asdict(check) for check in self.failures],
        }


def check_set(
    root: Path, *, workers: int = 1, progress: Callable[[str], None] = lambda _: None
) -> SetReport:
    """Check a folder that :func:`xden_builder.phantoms.write_captures` wrote.

    Each object is made again and must be the one of ``truth.json``. Its parts must be closed,
    wound outwards and disjoint, by the rays with which the builder looks for shared space; the
    builder must be able to read what was handed over; and the truth grid must weigh what the
    parts weigh together.

    Parameters
    ----------
    root
        The capture folder.
    workers
        Number of processes.
    progress
        Called with the id of each object that is done.

    Raises
    ------
    DataError
        If there is no such folder, or it was not simulated.
    """
    settings = _read_json(root / "simulation.json")
    seed, realism = int(settings["seed"]), Realism(**settings["realism"])
    plans = [Plan.of(seed, object_id) for object_id in CaptureFolder(root).object_ids]
    return SetReport(
        tuple(each_object(partial(_check_object, root, seed, realism), plans, workers, progress))
    )


def _check_object(root: Path, seed: int, realism: Realism, object_id: str) -> ObjectCheck:
    try:
        phantom = make_phantom(Plan.of(seed, object_id), realism)
        truth = _read_json(root / object_id / "truth.json")
        grid = TruthGrid.load(root / object_id / "truth.npz")
        masses_g = [part["density_g_cm3"] * part["volume_cm3"] for part in truth["parts"]]
        mass_error = abs(grid.density.mass_g / sum(masses_g) - 1)
        faults = (*_shape_faults(phantom), *_truth_faults(phantom, truth, mass_error))
        flags = CaptureFolder(root).read(object_id).flags
    except XDenError as err:
        return ObjectCheck(object_id, np.nan, (str(err),))
    inverted = (flag for flag in flags if flag.endswith(":mesh_inverted"))
    return ObjectCheck(object_id, mass_error, (*faults, *inverted))


def _shape_faults(phantom: Phantom) -> Iterator[str]:
    meshes = [part.mesh for part in phantom.parts]
    for part in phantom.parts:
        edges = edge_faults(part.mesh.faces)
        if edges.open or edges.twisted or not part.mesh.volume > 0:
            yield (
                f"part {part.name}: {edges.open} open and {edges.twisted} twisted edges, "
                f"volume {part.mesh.volume:.3g} cm³"
            )
            return  # what is not closed cannot be cut
    for part, left in zip(phantom.parts, disjoint_regions(meshes, range(len(meshes))), strict=True):
        if left is not part.mesh:
            yield f"part {part.name}: shares space with another part, and no priority is declared"


def _truth_faults(phantom: Phantom, truth: Mapping[str, Any], mass_error: float) -> Iterator[str]:
    made = phantom.mass_properties.mass_g
    if not np.isclose(truth["mass_g"], made, rtol=1e-9):
        yield f"truth.json: mass {truth['mass_g']:.6g} g, but the object made again has {made:.6g}"
    if not mass_error <= WORST_MASS_ERROR:
        yield f"truth.npz: its mass is {mass_error:.2%} off the sum of the parts' masses"


def _read_json(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise DataError(f"{path}: no such file; only simulated captures can be checked")
    with decoding(path, "JSON"):
        values: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return values
