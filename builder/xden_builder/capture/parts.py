"""The parts of an object: their meshes and what ``parts.csv`` says of them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from xden1k.errors import DataError
from xden1k.values.materials import check_label
from xden1k.values.ply import CM_PER_UNIT
from xden_builder.capture.meshes import composed, read_meshes
from xden_builder.capture.solids import closed_mesh
from xden_builder.capture.tables import CsvRow, read_csv, refuse_wrong

__all__ = ["EXTENT_CM", "CapturePart", "read_parts"]

EXTENT_CM = (0.1, 500.0)
"""An object's largest extent lies between; outside, the unit is wrong."""


@dataclass(frozen=True, slots=True, eq=False)
class CapturePart:
    """One annotated part.

    Parameters
    ----------
    name
        Unique in its object.
    mesh
        In cm, vertices merged, closed, wound outwards.
    material
        A name or a family of the material library, in its spelling; empty = unknown.
    priority
        Where parts overlap, the higher owns the space; None: by volume.
    hollow
        Whether its density may lie below the material's range.
    """

    name: str
    mesh: trimesh.Trimesh
    material: str = ""
    priority: int | None = None
    hollow: bool = False


def read_parts(
    mesh_folder: Path, table: Path, mesh_units: str, strict: bool = True
) -> tuple[tuple[CapturePart, ...], tuple[str, ...]]:
    """Read the parts of an object, sorted by name.

    Parameters
    ----------
    mesh_folder
        Holds ``parts/`` or ``mesh.glb``.
    table
        A ``parts.csv``, which need not exist.
    mesh_units
        A key of ``CM_PER_UNIT``.
    strict
        Whether a row of the table that names no mesh is an error, rather than left out.

    Returns
    -------
    parts
        At least one.
    flags
        ``PART:mesh_inverted`` for each mesh that was inside out.

    Raises
    ------
    DataError
        If a mesh is missing, damaged or no solid, the object's size shows a wrong unit, or the
        table names an unknown part, material or priority.
    """
    meshes = read_meshes(mesh_folder)
    rows = _read_table(table) if table.is_file() else {}
    solids = {
        name: closed_mesh(mesh, CM_PER_UNIT[mesh_units], f"{path}, part {name}")
        for name, (path, mesh) in meshes.items()
    }
    _check_extent([solid for solid, _ in solids.values()], mesh_folder, mesh_units)
    told = f"no mesh of that name; meshes are {', '.join(meshes)}"
    unknown = [row for name, row in rows.items() if name not in meshes and strict]
    parts, wrong = [], {row.number: row.error("name", told) for row in unknown}
    for name, (solid, _) in solids.items():
        try:
            parts.append(_part(name, solid, rows.get(name)))
        except DataError as err:
            wrong[rows[name].number] = err
    refuse_wrong(dict(sorted(wrong.items())))
    return tuple(parts), tuple(
        f"{name}:mesh_inverted" for name, (_, back) in solids.items() if back
    )


def _read_table(path: Path) -> dict[str, CsvRow]:
    rows: dict[str, CsvRow] = {}
    for row in read_csv(path, required=("name",), optional=("material", "priority", "hollow")):
        name = composed(row["name"])
        if name in rows:
            raise row.error("name", f"{name!r} stands in row {rows[name].number} too")
        rows[name] = row
    return rows


def _part(name: str, mesh: trimesh.Trimesh, row: CsvRow | None) -> CapturePart:
    if row is None:
        return CapturePart(name, mesh)
    try:
        material = check_label(row["material"])
    except DataError as err:
        raise row.error("material", str(err)) from err
    priority = row["priority"]
    if not re.fullmatch(r"([+-]?\d+)?", priority):
        raise row.error("priority", f"must be a whole number or empty, got {priority!r}")
    hollow = row.choice("hollow", ("yes", "no"), default="no") == "yes"
    return CapturePart(name, mesh, material, int(priority) if priority else None, hollow)


def _check_extent(meshes: list[trimesh.Trimesh], folder: Path, mesh_units: str) -> None:
    low = np.min([mesh.bounds[0] for mesh in meshes], axis=0)
    high = np.max([mesh.bounds[1] for mesh in meshes], axis=0)
    largest = float((high - low).max())
    if not EXTENT_CM[0] <= largest <= EXTENT_CM[1]:
        raise DataError(
            f"{folder}: with mesh_units {mesh_units} the largest extent of the object is "
            f"{largest:.3g} cm, expected {EXTENT_CM[0]:g} to {EXTENT_CM[1]:g} cm"
        )
