"""SDFormat 1.9, for Gazebo and Drake: one link, the inertial's pose at the centre of mass.

There is no checker for Python: what is checked is what stands in the file.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Final

import numpy as np

from xden1k.errors import DataError
from xden1k.export.body import Body
from xden1k.export.si import SIX, Inertial
from xden1k.export.text import element, numbers, read_xml, vector, write_meshes, write_xml

__all__ = ["SUFFIX", "check", "expected", "read", "write"]

SUFFIX: Final = ".sdf"
VERSION: Final = "1.9"


def write(body: Body, path: Path) -> None:
    """Write the model, its meshes, and the ``model.config`` by which Gazebo finds it."""
    root = ET.Element("sdf", version=VERSION)
    model = element(root, "model", name=body.name)
    link = element(model, "link", name=body.name)
    inertial = element(link, "inertial")
    element(inertial, "pose", numbers([*body.inertial.com_m, 0, 0, 0]))
    element(inertial, "mass", numbers([body.inertial.mass_kg]))
    tensor = element(inertial, "inertia")
    for name, (row, column) in SIX.items():
        element(tensor, name, numbers([body.inertial.inertia_kg_m2[row, column]]))
    for shape, (visual, hulls) in zip(body.shapes, write_meshes(body, path.parent), strict=True):
        seen = element(link, "visual", name=shape.name)
        _mesh(seen, visual)
        material = element(seen, "material")
        for light in ("ambient", "diffuse"):
            element(material, light, numbers([*shape.part.color_rgb, 1]))
        for number, file in enumerate(hulls):
            _mesh(element(link, "collision", name=f"{shape.name}.hull{number}"), file)
    write_xml(root, path)
    config = ET.Element("model")
    element(config, "name", body.name)
    element(config, "sdf", path.name, version=VERSION)
    write_xml(config, path.with_name("model.config"))


def _mesh(parent: ET.Element, uri: str) -> None:
    element(element(element(parent, "geometry"), "mesh"), "uri", uri)


def expected(body: Body) -> Inertial:
    """Return what a reader should find."""
    return body.inertial


def read(path: Path, body: Body) -> Inertial:
    """Read the inertial as it stands in the file.

    Raises
    ------
    DataError
        If there is none.
    """
    inertial = read_xml(path).find("./model/link/inertial")
    if inertial is None:
        raise DataError(f"{path}: no inertial")
    tensor = np.empty((3, 3))
    for name, (row, column) in SIX.items():
        tensor[row, column] = tensor[column, row] = float(inertial.findtext(f"inertia/{name}", ""))
    mass_kg = float(inertial.findtext("mass", "nan"))
    return Inertial(mass_kg, vector(inertial.findtext("pose"))[:3], tensor)


check = read
