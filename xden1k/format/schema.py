"""The columns of a dataset: the one place that names and types them.

Writer, reader, card and Croissant file all follow :data:`COLUMNS`. A figure that was never
measured is null (``weighed_mass_g``, ``density``); a figure computed from an unknown one is not
a number (``mass_g``, ``com_cm``, ``inertia_g_cm2`` and the parts' figures of an object of which
only the attenuation is known). An object without radiographs has null in all of
:data:`RADIOGRAPH_COLUMNS`. In the split ``private`` every answer is unknown; see
:mod:`xden1k.folder.withheld`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from xden1k.format.codec import MAX_TRANSMISSION, ArrayCodec
from xden1k.values.types import FIELD_SIZE, LABEL_SIZE

__all__ = [
    "ARRAY_COLUMNS",
    "COLUMNS",
    "DATA_SCHEMA",
    "LIGHT_COLUMNS",
    "METADATA_SCHEMA",
    "NULLABLE_COLUMNS",
    "PREVIEW_COLUMNS",
    "RADIOGRAPH_COLUMNS",
    "Column",
    "feature",
]

IMAGE = pa.struct({"bytes": pa.binary(), "path": pa.string()})
"""How ``datasets`` stores an encoded image."""


@dataclass(frozen=True)
class Column:
    """One column.

    Parameters
    ----------
    name
        As in the Parquet files.
    type
        Its Arrow type.
    text
        What it holds, for people.
    codec
        How its bytes make an array; None where the column is no array.
    """

    name: str
    type: pa.DataType
    text: str
    codec: ArrayCodec | None = None


def _lists(item: pa.DataType, length: int = -1) -> pa.DataType:
    return pa.list_(item, length)


def _array(name: str, text: str, codec: ArrayCodec) -> Column:
    return Column(name, pa.binary(), text, codec)


_STRING, _FLOAT, _COUNT = pa.string(), pa.float64(), pa.int32()
_FIELD = (FIELD_SIZE,) * 3
_TRANSMISSION_STEP = MAX_TRANSMISSION / 65535

_LIGHT = (
    Column("object_id", _STRING, "Unique name"),
    Column("category", _STRING, "Class of the object"),
    Column("split", _STRING, "train, val, test, unseen, or private (answers withheld)"),
    Column(
        "source",
        _STRING,
        "scan, phantom (simulated, truth known), ct (views from a CT), published (by the authors)",
    ),
    Column("flags", _lists(_STRING), "Remarks on the object as a whole"),
    Column("weighed_mass_g", _FLOAT, "Mass by a scale, g; null if never on one"),
    Column("mass_g", _FLOAT, "Mass, g, exact from part meshes and densities"),
    Column("com_cm", _lists(_FLOAT, 3), "Centre of mass, cm, object frame, exact"),
    Column(
        "inertia_g_cm2",
        _lists(_FLOAT, 6),
        "Inertia about the centre of mass, g·cm²: xx, yy, zz, xy, xz, yz of the tensor",
    ),
    Column("grid_origin_cm", _lists(_FLOAT, 3), "Centre of field voxel (0, 0, 0), cm"),
    Column("voxel_size_cm", _FLOAT, "Edge of a field voxel, cm; a label voxel has half of it"),
    Column("part_names", _lists(_STRING), "Entry k - 1 of this and the next lists is part k"),
    Column("part_materials", _lists(_STRING), "Material or family; empty = unknown"),
    Column("part_lac_per_cm", _lists(_FLOAT), "Linear attenuation coefficient, 1/cm"),
    Column("part_apparent_density_g_cm3", _lists(_FLOAT), "LAC / 0.17, the paper's rule, g/cm³"),
    Column("part_density_g_cm3", _lists(_FLOAT), "Best estimate of the density, g/cm³"),
    Column("part_density_sd_g_cm3", _lists(_FLOAT), "Its standard deviation, g/cm³"),
    Column("part_density_source", _lists(_STRING), "xray, prior, weighed, truth, none or withheld"),
    Column("part_flags", _lists(_lists(_STRING)), "What to know before trusting the figures"),
    Column("part_color_rgb", _lists(_lists(_FLOAT, 3)), "Base colour, three values from 0 to 1"),
    Column("preview_pa", IMAGE, "PA radiograph, 8 bit, reduced, for viewers only; air is black"),
    Column("preview_lat", IMAGE, "LAT radiograph, 8 bit, reduced, for viewers only"),
)

_HEAVY = (
    _array(
        "xray_pa",
        "PA transmission I / I0, (rows, columns); 65535 = 1.25, 0 = invalid pixel",
        ArrayCodec("<u2", "xray_pa_shape", _TRANSMISSION_STEP),
    ),
    _array(
        "xray_lat",
        "LAT transmission I / I0, (rows, columns); 65535 = 1.25, 0 = invalid pixel",
        ArrayCodec("<u2", "xray_lat_shape", _TRANSMISSION_STEP),
    ),
    Column("xray_pa_shape", _lists(_COUNT, 2), "Rows and columns of xray_pa"),
    Column("xray_lat_shape", _lists(_COUNT, 2), "Rows and columns of xray_lat"),
    _array(
        "labels",
        "Part at each voxel's centre: 0 = air, k = part k",
        ArrayCodec("|u1", (LABEL_SIZE,) * 3),
    ),
    _array(
        "density",
        "Density, g/cm³, voxel means; null where only attenuation is known",
        ArrayCodec("<f2", _FIELD, 1.0),
    ),
    _array(
        "apparent_density",
        "LAC / 0.17, g/cm³, voxel means",
        ArrayCodec("<f2", _FIELD, 1.0),
    ),
    _array(
        "occupancy",
        "Share of the voxel filled with material, 255 = full",
        ArrayCodec("|u1", _FIELD, 1 / 255),
    ),
    _array(
        "envelope",
        "Share inside the outer surface, enclosed cavities included, 255 = full",
        ArrayCodec("|u1", _FIELD, 1 / 255),
    ),
    _array("mesh_vertices", "Part meshes, vertices, cm", ArrayCodec("<f4", (-1, 3))),
    _array(
        "mesh_faces",
        "Vertex indices of triangles, counter-clockwise seen from outside, part after part",
        ArrayCodec("<i4", (-1, 3)),
    ),
    _array("face_part", "Part of each face, ascending from 1", ArrayCodec("|u1", (-1,))),
    Column("meta_json", _STRING, "JSON: geometry of the views, fit report, provenance"),
)

COLUMNS = _LIGHT + _HEAVY
"""Every column of ``data``, in order."""
LIGHT_COLUMNS = tuple(column.name for column in _LIGHT)
"""Names of the columns of ``metadata``, in order."""
ARRAY_COLUMNS = {column.name: column.codec for column in COLUMNS if column.codec is not None}
"""How each binary array column is decoded."""
NULLABLE_COLUMNS = ("weighed_mass_g", "density")
"""Columns that may be null, each on its own."""
PREVIEW_COLUMNS = ("preview_pa", "preview_lat")
"""Columns that hold PNG images."""
RADIOGRAPH_COLUMNS = (
    *PREVIEW_COLUMNS,
    *("xray_pa", "xray_lat", "xray_pa_shape", "xray_lat_shape"),
)
"""Columns that are null together: of an object without radiographs."""

_VALUE_NAMES = {pa.float64(): "float64", pa.int32(): "int32", pa.binary(): "binary"}


def feature(arrow_type: pa.DataType) -> dict[str, Any]:
    """Return the type as ``datasets.Features.to_dict`` writes it; ``datasets`` is not imported.

    Examples
    --------
    >>> feature(pa.string())
    {'dtype': 'string', '_type': 'Value'}
    """
    if arrow_type == IMAGE:
        return {"_type": "Image"}
    if pa.types.is_fixed_size_list(arrow_type):
        return {
            "feature": feature(arrow_type.value_type),
            "length": arrow_type.list_size,
            "_type": "List",
        }
    if pa.types.is_list(arrow_type):
        return {"feature": feature(arrow_type.value_type), "_type": "List"}
    return {"dtype": _VALUE_NAMES.get(arrow_type, str(arrow_type)), "_type": "Value"}


def _schema(columns: Iterable[Column]) -> pa.Schema:
    """Arrow schema with the metadata that types the previews for ``datasets`` and the Hub."""
    columns = tuple(columns)
    features = {column.name: feature(column.type) for column in columns}
    return pa.schema(
        [(column.name, column.type) for column in columns],
        metadata={"huggingface": json.dumps({"info": {"features": features}})},
    )


DATA_SCHEMA = _schema(COLUMNS)
"""Arrow schema of ``data/*.parquet``."""
METADATA_SCHEMA = _schema(_LIGHT)
"""Arrow schema of ``metadata/*.parquet``."""
