"""Wavefront OBJ: an object and a material for each part, m, z up."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import trimesh

from xden1k.errors import DataError
from xden1k.export.body import Body
from xden1k.export.si import KG_M3_PER_G_CM3, Inertial
from xden1k.export.text import numbers, obj_lines
from xden1k.values.mass import mass_of_meshes

__all__ = ["SUFFIX", "check", "expected", "of_meshes", "read", "write"]

SUFFIX: Final = ".obj"


def write(body: Body, path: Path) -> None:
    """Write the meshes, and a library of materials beside them."""
    lines = [f"# {body.name}: m, z up", f"mtllib {path.stem}.mtl"]
    first = 1
    for shape in body.shapes:
        lines += [f"o {shape.name}", f"usemtl {shape.name}", *obj_lines(shape.visual, first)]
        first += len(shape.visual.vertices)
    path.write_text("\n".join([*lines, ""]), encoding="ascii")
    materials = [
        line
        for shape in body.shapes
        for line in (f"newmtl {shape.name}", f"Kd {numbers(shape.part.color_rgb)}", "")
    ]
    path.with_suffix(".mtl").write_text("\n".join(materials), encoding="ascii")


def expected(body: Body) -> Inertial:
    """Return what a reader should find who knows the densities."""
    return body.inertial


def read(path: Path, body: Body) -> Inertial:
    """Integrate the meshes as ``trimesh.load`` gives them, with the densities of the parts.

    Raises
    ------
    DataError
        If a part is missing, or no longer closed.
    """
    scene = trimesh.load_scene(path)
    meshes = [scene.geometry.get(shape.name) for shape in body.shapes]
    return of_meshes(path, body, meshes)


check = read


def of_meshes(path: Path, body: Body, meshes: Sequence[object]) -> Inertial:
    """Return mass, centre and inertia of meshes that were read back, m, one for each part.

    Raises
    ------
    DataError
        If a part is missing, or no longer closed.
    """
    solids: list[trimesh.Trimesh] = []
    for shape, mesh in zip(body.shapes, meshes, strict=True):
        if not isinstance(mesh, trimesh.Trimesh) or not mesh.is_watertight:
            state = "not closed" if isinstance(mesh, trimesh.Trimesh) else "not there"
            raise DataError(f"{path}: part {shape.name} is {state} once it is read back")
        solids.append(mesh)
    densities = [KG_M3_PER_G_CM3 * shape.part.density_g_cm3 for shape in body.shapes]
    mass = mass_of_meshes(solids, densities)  # linear in the unit of mass, whatever the lengths
    return Inertial(mass.mass_g, mass.com_cm, mass.inertia_g_cm2)
