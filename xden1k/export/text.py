"""Numbers, XML and mesh files as text: the same bytes for the same values."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float

from xden1k.errors import DataError
from xden1k.export.body import Body

__all__ = ["element", "numbers", "obj_lines", "read_xml", "vector", "write_meshes", "write_xml"]

MESHES = "meshes"
"""The folder of mesh files beside an XML file."""


def numbers(values: Iterable[float]) -> str:
    """Write numbers so that they read back the very same.

    Examples
    --------
    >>> numbers([1, 0.1, 1e-7])
    '1.0 0.1 1e-07'
    """
    return " ".join(repr(float(value)) for value in values)


def vector(text: str | None) -> Float[np.ndarray, "_"]:
    """Read what :func:`numbers` wrote."""
    return np.array((text or "").split(), dtype=np.float64)


def element(parent: ET.Element, tag: str, text: str | None = None, **attributes: str) -> ET.Element:
    """Append an element; of attribute names a trailing underscore is dropped."""
    names = {name.rstrip("_"): value for name, value in attributes.items()}
    made = ET.SubElement(parent, tag, names)
    made.text = text
    return made


def write_xml(root: ET.Element, path: Path) -> None:
    """Write an XML file, indented."""
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode")
    path.write_text(f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n', encoding="utf-8")


def read_xml(path: Path) -> ET.Element:
    """Read an XML file of ours.

    Raises
    ------
    DataError
        If it is not one.
    """
    try:
        return ET.parse(path).getroot()  # noqa: S314 (it was written here)
    except ET.ParseError as err:
        raise DataError(f"{path}: {err}") from err


def obj_lines(mesh: trimesh.Trimesh, first: int = 1) -> Iterable[str]:
    """Yield the lines of a mesh in an OBJ file, where ``first`` is the number of its vertex 0."""
    for x, y, z in mesh.vertices.tolist():
        yield f"v {x!r} {y!r} {z!r}"
    for a, b, c in (mesh.faces + first).tolist():
        yield f"f {a} {b} {c}"


def write_meshes(body: Body, folder: Path) -> list[tuple[str, list[str]]]:
    """Write the meshes of all parts, m, as OBJ files of their own.

    Returns
    -------
    list
        For each part the visual mesh, and the collision meshes; relative to ``folder``.
    """
    (folder / MESHES).mkdir()
    return [
        (
            _written(folder, shape.name, shape.visual),
            [
                _written(folder, f"{shape.name}.hull{number}", piece)
                for number, piece in enumerate(shape.collision)
            ],
        )
        for shape in body.shapes
    ]


def _written(folder: Path, name: str, mesh: trimesh.Trimesh) -> str:
    place = f"{MESHES}/{name}.obj"
    text = "\n".join(["# m, kg", f"o {name}", *obj_lines(mesh), ""])
    (folder / place).write_text(text, encoding="ascii")
    return place
