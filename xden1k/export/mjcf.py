"""MJCF, MuJoCo's own format: one free body, an explicit inertial, geoms without mass.

With an inertial and densities of geoms side by side ``inertiafromgeom`` would decide which counts.
Here geoms have no mass, so the inertial counts whatever a scene that includes the file says; and
there is no compiler setting that would change that scene.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Final

import numpy as np

from xden1k.errors import DataError, require
from xden1k.export.body import Body
from xden1k.export.si import Inertial
from xden1k.export.text import element, numbers, read_xml, vector, write_meshes, write_xml

__all__ = ["SUFFIX", "check", "expected", "read", "write"]

SUFFIX: Final = ".xml"
SEEN: Final = {"contype": "0", "conaffinity": "0", "group": "2", "mass": "0"}
FELT: Final = {"group": "3", "mass": "0"}


def write(body: Body, path: Path) -> None:
    """Write the model, and its meshes beside it."""
    root = ET.Element("mujoco", model=body.name)
    asset = element(root, "asset")
    model = element(element(root, "worldbody"), "body", name=body.name)
    element(model, "freejoint", name=f"{body.name}_free")
    _inertial(model, body.inertial)
    for shape, (visual, hulls) in zip(body.shapes, write_meshes(body, path.parent), strict=True):
        name = shape.name
        element(asset, "material", name=name, rgba=numbers([*shape.part.color_rgb, 1]))
        # as a shell: no mass is taken from it, and MuJoCo refuses to find the volume of thin solids
        element(asset, "mesh", name=name, file=visual, inertia="shell")
        element(model, "geom", name=name, type="mesh", mesh=name, material=name, **SEEN)
        for number, file in enumerate(hulls):
            hull = f"{name}.hull{number}"
            element(asset, "mesh", name=hull, file=file)
            element(model, "geom", name=hull, type="mesh", mesh=hull, **FELT)
    write_xml(root, path)


def _inertial(model: ET.Element, inertial: Inertial) -> None:
    tensor = inertial.inertia_kg_m2
    six = [tensor[pair] for pair in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    element(
        model,
        "inertial",
        pos=numbers(inertial.com_m),
        mass=numbers([inertial.mass_kg]),
        fullinertia=numbers(six),
    )


def expected(body: Body) -> Inertial:
    """Return what a reader should find."""
    return body.inertial


def read(path: Path, body: Body) -> Inertial:
    """Read the inertial as it stands in the file."""
    found = read_xml(path).find("./worldbody/body/inertial")
    if found is None:
        raise DataError(f"{path}: no inertial")
    xx, yy, zz, xy, xz, yz = vector(found.get("fullinertia"))
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Inertial(float(found.get("mass", "nan")), vector(found.get("pos")), tensor)


def check(path: Path, body: Body) -> Inertial:
    """Compile with MuJoCo, and return what it made of the body.

    Raises
    ------
    DataError
        If it does not compile to one free body.
    MissingExtraError
        If MuJoCo is not installed.
    """
    return compiled(path, body.name)


def compiled(path: Path, name: str) -> Inertial:
    """Return the inertial of a body of a model, MJCF or URDF, as MuJoCo has it."""
    mujoco = require("mujoco", "sim")
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as err:
        raise DataError(f"{path}: MuJoCo: {' '.join(str(err).split())}") from err
    body = model.body(name)
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, body.iquat)
    if model.nbody != 2:
        raise DataError(f"{path}: MuJoCo: expected one body, got {model.nbody - 1}")
    return Inertial.of_principal(
        float(body.mass[0]), np.array(body.ipos), np.array(body.inertia), turn.reshape(3, 3)
    )
