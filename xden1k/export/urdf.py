"""URDF: one link with an explicit inertial, a visual and collision meshes for each part.

A URDF says nothing of how its root hangs in the world: MuJoCo welds it there, and by its default
merges it into the world, mass and all (mujoco issue 1176). The element ``mujoco``, which others
skip, keeps the link, and keeps MuJoCo from looking for the meshes in the wrong folder; it stays
without freedom. For MuJoCo take MJCF.
"""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any, Final

import numpy as np

from xden1k.errors import DataError, require
from xden1k.export.body import Body
from xden1k.export.si import SIX, Inertial, Matrix
from xden1k.export.text import element, numbers, read_xml, vector, write_meshes, write_xml

__all__ = ["SUFFIX", "check", "expected", "read", "write"]

SUFFIX: Final = ".urdf"
COMPILER: Final = {"strippath": "false", "fusestatic": "false", "discardvisual": "false"}


def write(body: Body, path: Path) -> None:
    """Write the robot of one link, and its meshes beside it."""
    root = ET.Element("robot", name=body.name)
    element(element(root, "mujoco"), "compiler", **COMPILER)
    link = element(root, "link", name=body.name)
    inertial = element(link, "inertial")
    element(inertial, "origin", xyz=numbers(body.inertial.com_m), rpy="0 0 0")
    element(inertial, "mass", value=numbers([body.inertial.mass_kg]))
    element(inertial, "inertia", **_six(body.inertial.inertia_kg_m2))
    for shape, (visual, hulls) in zip(body.shapes, write_meshes(body, path.parent), strict=True):
        seen = element(link, "visual", name=shape.name)
        element(element(seen, "geometry"), "mesh", filename=visual)
        rgba = numbers([*shape.part.color_rgb, 1])
        element(element(seen, "material", name=shape.name), "color", rgba=rgba)
        for number, file in enumerate(hulls):
            felt = element(link, "collision", name=f"{shape.name}.hull{number}")
            element(element(felt, "geometry"), "mesh", filename=file)
    write_xml(root, path)


def _six(tensor: Matrix) -> dict[str, str]:
    return {name: numbers([tensor[pair]]) for name, pair in SIX.items()}


def expected(body: Body) -> Inertial:
    """Return what a reader should find."""
    return body.inertial


def read(path: Path, body: Body) -> Inertial:
    """Read the inertial as it stands in the file."""
    inertial = read_xml(path).find("./link/inertial")
    if inertial is None:
        raise DataError(f"{path}: no inertial")
    origin, mass, inertia = (inertial.find(tag) for tag in ("origin", "mass", "inertia"))
    if origin is None or mass is None or inertia is None:
        raise DataError(f"{path}: no whole inertial")
    tensor = np.empty((3, 3))
    for name, (row, column) in SIX.items():
        tensor[row, column] = tensor[column, row] = float(inertia.get(name, "nan"))
    return Inertial(float(mass.get("value", "nan")), vector(origin.get("xyz")), tensor)


def check(path: Path, body: Body) -> Inertial:
    """Load and validate with yourdfpy, meshes included.

    Raises
    ------
    DataError
        If it finds faults.
    MissingExtraError
        If yourdfpy is not installed.
    """
    yourdfpy: Any = require("yourdfpy", "sim")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # its own calls of trimesh
        robot = yourdfpy.URDF.load(
            str(path), load_collision_meshes=True, build_collision_scene_graph=True
        )
    if not robot.validate():
        raise DataError(f"{path}: yourdfpy: {'; '.join(map(str, robot.errors))}")
    inertial = robot.link_map[body.name].inertial
    turn, com = inertial.origin[:3, :3], inertial.origin[:3, 3]
    return Inertial(float(inertial.mass), com, turn @ inertial.inertia @ turn.T)
