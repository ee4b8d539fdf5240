"""VTK ImageData, for ParaView: voxel means as **cell** data, cm.

A voxel mean belongs to the cell, not to a point: so ``Origin`` is the corner of voxel (0, 0, 0),
half a voxel below its centre, and there is one point more than cells along each axis. The field is
in ``NAME.vti``, the finer labels in ``NAME.labels.vti``. There is no checker for Python without
VTK itself: what is checked is what stands in the file.
"""

from __future__ import annotations

import base64
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Shaped

from xden1k.errors import DataError
from xden1k.export.body import Body
from xden1k.export.si import Inertial
from xden1k.export.text import element, numbers, read_xml, vector, write_xml
from xden1k.export.voxels import Volume, field_inertial, field_volumes, label_volume, of_density

__all__ = ["SUFFIX", "check", "expected", "read", "write"]

SUFFIX: Final = ".vti"
HEADER: Final = {
    "type": "ImageData",
    "version": "1.0",
    "byte_order": "LittleEndian",
    "header_type": "UInt64",
    "compressor": "vtkZLibDataCompressor",
}
TYPES: Final = {np.dtype("<f4"): "Float32", np.dtype("u1"): "UInt8"}


def write(body: Body, path: Path) -> None:
    """Write the fields, and the labels beside them."""
    _write(path, field_volumes(body.obj))
    _write(path.with_name(f"{path.stem}.labels{SUFFIX}"), [label_volume(body.obj)])


def _write(path: Path, volumes: Sequence[Volume]) -> None:
    first = volumes[0]
    extent = " ".join(f"0 {count}" for count in first.values.shape)
    root = ET.Element("VTKFile", HEADER)
    image = element(
        root,
        "ImageData",
        WholeExtent=extent,
        Origin=numbers(first.origin_cm - first.voxel_size_cm / 2),
        Spacing=numbers([first.voxel_size_cm] * 3),
    )
    cells = element(element(image, "Piece", Extent=extent), "CellData", Scalars=first.name)
    for volume in volumes:
        kind = TYPES[volume.values.dtype]
        words = _packed(volume.values)
        element(cells, "DataArray", words, type=kind, Name=volume.name, format="binary")
    write_xml(root, path)


def _packed(values: Shaped[np.ndarray, "x y z"]) -> str:
    """Base64 of one zlib block and its header; x runs fastest in VTK."""
    data = np.asfortranarray(values).tobytes(order="F")
    block = zlib.compress(data, 6)
    header = np.array([1, len(data), 0, len(block)], dtype="<u8").tobytes()
    return base64.b64encode(header).decode() + base64.b64encode(block).decode()


def _unpacked(text: str) -> bytes:
    start = len(base64.b64encode(bytes(32)))
    return zlib.decompress(base64.b64decode(text.strip()[start:]))


def expected(body: Body) -> Inertial:
    """Return what a reader should find: the field's, not the meshes'."""
    return field_inertial(body.obj)


def read(path: Path, body: Body) -> Inertial:
    """Integrate the density as it stands in the file.

    Raises
    ------
    DataError
        If there is none.
    """
    image = read_xml(path).find("./ImageData")
    array = None if image is None else image.find("./Piece/CellData/DataArray[@Name='density']")
    if image is None or array is None:
        raise DataError(f"{path}: no density")
    shape = vector(image.get("WholeExtent"))[1::2].astype(int)
    values = np.frombuffer(_unpacked(array.text or ""), dtype="<f4").reshape(shape, order="F")
    size = vector(image.get("Spacing"))[0]
    origin = vector(image.get("Origin")) + size / 2
    return of_density(Volume("density", values, origin, float(size), ""))


check = read
