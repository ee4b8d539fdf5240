"""The dataset row of an object, and the object of a row."""

from __future__ import annotations

import functools
import io
import itertools
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float32, Shaped, UInt16

from xden1k.errors import DataError, about
from xden1k.format.codec import (
    MAX_TRANSMISSION,
    Buffer,
    encode_density,
    encode_share,
    encode_transmission,
    to_planes,
)
from xden1k.format.schema import ARRAY_COLUMNS, LIGHT_COLUMNS, RADIOGRAPH_COLUMNS
from xden1k.format.shards import Row
from xden1k.values.arrays import Grid
from xden1k.values.mass import MassProperties, mass_of_meshes
from xden1k.values.types import FIELD_SIZE, LABEL_SIZE, DensityField, DensityObject, Part
from xden1k.values.views import ViewGeometry, XRayView

__all__ = [
    "decode_array",
    "decode_codes",
    "decode_geometry",
    "has_radiographs",
    "mass_columns",
    "object_row",
    "preview_png",
    "radiograph_columns",
    "row_object",
    "split_meshes",
]

PREVIEW_SIZE = 160
"""Longest edge of a preview, pixels."""
OPAQUE = 1e-3
"""Transmission below which a preview makes no difference."""
_FIGURES = ("lac_per_cm", "apparent_density_g_cm3", "density_g_cm3", "density_sd_g_cm3")
_PART_LISTS = tuple(name for name in LIGHT_COLUMNS if name.startswith("part_"))


def object_row(obj: DensityObject) -> Row:
    """Encode an object as a dataset row, columns in the schema's order.

    Mass, centre of mass and inertia are those of the stored meshes, whose vertices are float32,
    so that a reader who integrates them gets the same figures.

    Raises
    ------
    DataError
        If a grid has the wrong size, a label has no part, or a value does not fit its column.
    """
    try:
        return _row(obj)
    except DataError as err:
        raise DataError(f"{obj.object_id}: {err}") from err


def _row(obj: DensityObject) -> Row:
    _check_grids(obj)
    meshes = [_mesh_as_stored(part.mesh) for part in obj.parts]
    mass = mass_of_meshes(meshes, [part.density_g_cm3 for part in obj.parts])
    return {
        "object_id": obj.object_id,
        "category": obj.category,
        "split": obj.split,
        "source": obj.source,
        "flags": list(obj.flags),
        "weighed_mass_g": obj.weighed_mass_g,
        **mass_columns(mass),
        "grid_origin_cm": obj.origin_cm.tolist(),
        "voxel_size_cm": float(obj.voxel_size_cm),
        **_part_columns(obj.parts),
        **radiograph_columns(obj.views),
        **_grid_columns(obj),
        **_mesh_columns(meshes),
        "meta_json": _meta_json(obj),
    }


def _check_grids(obj: DensityObject) -> None:
    field, label = (FIELD_SIZE,) * 3, (LABEL_SIZE,) * 3
    densities = {"apparent_density": obj.apparent_density, "density": obj.density}
    wanted = {
        "labels": (obj.labels, label),
        "occupancy": (obj.occupancy, field),
        "envelope": (obj.envelope, field),
        **{name: (one.density_g_cm3, field) for name, one in densities.items() if one},
    }
    for name, (grid, shape) in wanted.items():
        if grid.shape != shape:
            raise DataError(f"{name} must have shape {shape}, got {grid.shape}")
    if (highest := int(obj.labels.max())) > len(obj.parts):
        raise DataError(f"labels reach {highest}, but there are {len(obj.parts)} parts")


def _mesh_as_stored(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    vertices = np.asarray(mesh.vertices, dtype=np.float32)
    return trimesh.Trimesh(vertices, mesh.faces, process=False)


def mass_columns(mass: MassProperties) -> Row:
    """Return the columns of mass, centre of mass and inertia."""
    inertia = mass.inertia_g_cm2
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    return {
        "mass_g": float(mass.mass_g),
        "com_cm": mass.com_cm.tolist(),
        "inertia_g_cm2": [float(inertia[pair]) for pair in pairs],
    }


def _part_columns(parts: Sequence[Part]) -> Row:
    return {
        "part_names": [part.name for part in parts],
        "part_materials": [part.material for part in parts],
        **{f"part_{name}": [float(getattr(part, name)) for part in parts] for name in _FIGURES},
        "part_density_source": [part.density_source for part in parts],
        "part_flags": [list(part.flags) for part in parts],
        "part_color_rgb": [[float(value) for value in part.color_rgb] for part in parts],
    }


def radiograph_columns(views: Sequence[XRayView]) -> Row:
    """Return the columns of the radiographs: all null where there are none."""
    codes = {view.name: encode_transmission(view.transmission, view.valid) for view in views}
    return dict.fromkeys(RADIOGRAPH_COLUMNS) | {
        **{f"preview_{name}": preview_png(image) for name, image in codes.items()},
        **{f"xray_{name}": to_planes(image) for name, image in codes.items()},
        **{f"xray_{name}_shape": list(image.shape) for name, image in codes.items()},
    }


def has_radiographs(row: Mapping[str, Any]) -> bool:
    """Whether an encoded row has any of the columns of radiographs, of those that were read."""
    return any(row.get(name) is not None for name in RADIOGRAPH_COLUMNS)


def _grid_columns(obj: DensityObject) -> Row:
    return {
        "labels": to_planes(obj.labels),
        "density": _densities(obj.density),
        "apparent_density": _densities(obj.apparent_density),
        "occupancy": to_planes(encode_share(obj.occupancy)),
        "envelope": to_planes(encode_share(obj.envelope)),
    }


def _densities(field: DensityField | None) -> bytes | None:
    return None if field is None else to_planes(encode_density(field.density_g_cm3))


def _mesh_columns(meshes: Sequence[trimesh.Trimesh]) -> Row:
    counts = [len(mesh.vertices) for mesh in meshes]
    starts = np.cumsum(counts) - counts
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    numbers = np.arange(1, len(meshes) + 1, dtype=np.uint8)
    return {
        "mesh_vertices": to_planes(vertices.astype(np.float32)),
        "mesh_faces": to_planes(np.concatenate(faces).astype(np.int32)),
        "face_part": to_planes(np.repeat(numbers, [len(mesh.faces) for mesh in meshes])),
    }


def _meta_json(obj: DensityObject) -> str:
    if "views" in obj.meta:
        raise DataError("meta must not have the key 'views', which holds the geometry")
    views = {view.name: view.geometry.to_dict() for view in obj.views}
    try:
        return json.dumps(
            {**obj.meta, "views": views}, sort_keys=True, ensure_ascii=False, allow_nan=False
        )
    except (TypeError, ValueError) as err:
        raise DataError(f"meta must be of JSON's types: {err}") from err


def preview_png(codes: UInt16[np.ndarray, "rows columns"]) -> bytes:
    """Reduced 8-bit picture of a stored radiograph: air black, the most attenuated pixel white.

    Grey is the attenuation -ln T of the mean transmission over a block of pixels; invalid pixels,
    of code 0, do not count, and a block without a valid one is black.
    """
    from PIL import Image as PILImage

    factor = -(-max(codes.shape) // PREVIEW_SIZE)
    weight = _block_sums(codes > 0, factor)
    signal = _block_sums(codes, factor) * np.float32(MAX_TRANSMISSION / 65535)
    mean = np.divide(signal, weight, out=np.ones_like(signal), where=weight > 0)
    attenuation = -np.log(mean.clip(OPAQUE, 1.0))
    grey = np.rint(attenuation * (255 / max(float(attenuation.max()), 1e-6)))
    file = io.BytesIO()
    PILImage.fromarray(grey.astype(np.uint8)).save(file, format="png")
    return file.getvalue()


def _block_sums(
    image: Shaped[np.ndarray, "rows columns"], factor: int
) -> Float32[np.ndarray, "blocks_down blocks_across"]:
    """Sum blocks of factor x factor pixels; the last ones may be smaller."""
    padding = [(0, -length % factor) for length in image.shape]
    padded = np.pad(image.astype(np.float32), padding)
    rows = functools.reduce(np.add, (padded[start::factor] for start in range(factor)))
    return functools.reduce(np.add, (rows[:, start::factor] for start in range(factor)))


def decode_array(row: Mapping[str, Any], name: str) -> np.ndarray:
    """Array of one column of an encoded row, in the units of its column.

    Parameters
    ----------
    row
        With the column, and the one that holds its shape if there is one.
    name
        One of :data:`xden1k.format.schema.ARRAY_COLUMNS`.

    Raises
    ------
    DataError
        If the bytes do not make an array of that shape.
    """
    return ARRAY_COLUMNS[name].values(decode_codes(row, name))


def decode_codes(row: Mapping[str, Any], name: str) -> np.ndarray:
    """Return the stored values of one column of an encoded row: :func:`decode_array` scales them.

    Raises
    ------
    DataError
        If the bytes do not make an array of that shape.
    """
    codec = ARRAY_COLUMNS[name]
    shape = tuple(row[codec.shape] or ()) if isinstance(codec.shape, str) else None
    data: Buffer | None = row[name]
    try:
        if data is None:
            raise DataError("expected an array, got nothing")
        return codec.codes(data, shape)
    except DataError as err:
        raise DataError(f"{row.get('object_id', 'row')}: column {name}: {err}") from err


def decode_target(row: Mapping[str, Any], object_id: str, target: str) -> Grid:
    """Field of one encoded row, if it is known.

    Parameters
    ----------
    row
        With the column.
    object_id
        For the message.
    target
        ``density`` or ``apparent_density``.

    Raises
    ------
    ObjectError
        If only the object's attenuation is known, or nothing, or the bytes do not make a grid.
    """
    with about(object_id):
        if row[target] is None and target == "apparent_density":
            raise DataError(f"{object_id} has no {target}: its answers are withheld")
        if row[target] is None:
            raise DataError(f"{object_id} has no {target}, only attenuation: take apparent_density")
        return decode_array({**row, "object_id": object_id}, target)


def row_object(row: Mapping[str, Any]) -> DensityObject:
    """Object of an encoded row.

    Raises
    ------
    DataError
        If the row breaks the format.
    """
    meta, views = _views(row)
    origin, voxel_size = np.array(row["grid_origin_cm"]), row["voxel_size_cm"]

    def field(name: str) -> DensityField | None:
        if row[name] is None:
            return None
        return DensityField(decode_array(row, name), origin, voxel_size)

    return DensityObject(
        object_id=row["object_id"],
        category=row["category"],
        split=row["split"],
        source=row["source"],
        views=views,
        parts=_parts(row),
        labels=decode_array(row, "labels"),
        occupancy=decode_array(row, "occupancy"),
        envelope=decode_array(row, "envelope"),
        density=field("density"),
        apparent_density=field("apparent_density"),
        origin_cm=origin,
        voxel_size_cm=voxel_size,
        weighed_mass_g=row["weighed_mass_g"],
        flags=tuple(row["flags"]),
        meta=meta,
    )


def decode_geometry(row: Mapping[str, Any]) -> dict[str, ViewGeometry]:
    """Where the radiographs of an encoded row were taken from, by view name: ``pa`` and ``lat``.

    Nothing of an object without radiographs.

    Parameters
    ----------
    row
        With the column ``meta_json``.

    Raises
    ------
    DataError
        If the column is no JSON, or has not the geometry of both views, nor an empty one.
    """
    return _meta_and_geometry(row)[1]


def _meta_and_geometry(row: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, ViewGeometry]]:
    try:
        meta: dict[str, Any] = json.loads(row["meta_json"])
        views = meta.pop("views")
        names = ("pa", "lat") if views != {} else ()
        return meta, {name: ViewGeometry.from_dict(views[name]) for name in names}
    except DataError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError) as err:
        raise DataError(
            f"{row.get('object_id', 'row')}: meta_json must be JSON with the geometry of pa and "
            f"lat: {err!r}"
        ) from err


def _views(
    row: Mapping[str, Any],
) -> tuple[dict[str, Any], tuple[XRayView, XRayView] | tuple[()]]:
    """Return the rest of the meta data, and the radiographs if there are any."""
    meta, places = _meta_and_geometry(row)
    if not places and not has_radiographs(row):
        return meta, ()
    if not places:
        raise DataError(f"{row['object_id']}: it has radiographs, and meta_json no geometry of any")
    return meta, (_view(row, "pa", places["pa"]), _view(row, "lat", places["lat"]))


def _view(row: Mapping[str, Any], name: str, geometry: ViewGeometry) -> XRayView:
    transmission = decode_array(row, f"xray_{name}")
    return XRayView(name, transmission, transmission > 0, geometry)


def _parts(row: Mapping[str, Any]) -> tuple[Part, ...]:
    counts = {name: len(row[name]) for name in _PART_LISTS}
    if len(set(counts.values())) > 1:
        raise DataError(f"{row['object_id']}: one entry for each part is wanted, got {counts}")
    meshes = split_meshes(row)
    return tuple(
        Part(
            name=row["part_names"][k],
            mesh=mesh,
            material=row["part_materials"][k],
            **{name: row[f"part_{name}"][k] for name in _FIGURES},
            density_source=row["part_density_source"][k],
            flags=tuple(row["part_flags"][k]),
            color_rgb=tuple(row["part_color_rgb"][k]),
        )
        for k, mesh in enumerate(meshes)
    )


def split_meshes(row: Mapping[str, Any]) -> list[trimesh.Trimesh]:
    """Part meshes of an encoded row, in the order of the parts.

    Vertices are as stored, so that a mesh closed by its indices stays closed. A part without
    faces has an empty mesh.

    Raises
    ------
    DataError
        If ``face_part`` does not go with the faces and the parts.
    """
    vertices, faces = decode_array(row, "mesh_vertices"), decode_array(row, "mesh_faces")
    owner, count = decode_array(row, "face_part"), len(row["part_names"])
    if len(owner) != len(faces) or (np.diff(owner.astype(np.int16)) < 0).any():
        raise DataError(f"{row['object_id']}: face_part must give each face's part, ascending")
    if len(owner) and not 1 <= owner[0] <= owner[-1] <= count:
        raise DataError(f"{row['object_id']}: face_part must be 1 to {count}")
    if len(faces) and not 0 <= faces.min() <= faces.max() < len(vertices):
        raise DataError(f"{row['object_id']}: mesh_faces must be 0 to {len(vertices) - 1}")
    bounds = np.searchsorted(owner, np.arange(1, count + 2))
    return [_submesh(vertices, faces[a:b]) for a, b in itertools.pairwise(bounds)]


def _submesh(vertices: np.ndarray, faces: np.ndarray) -> trimesh.Trimesh:
    if not len(faces):
        return trimesh.Trimesh()
    first, last = int(faces.min()), int(faces.max())
    return trimesh.Trimesh(vertices[first : last + 1], faces - first, process=False)
