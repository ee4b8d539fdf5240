"""An object as a row, and back."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings

from tests import phantoms
from tests.strategies import density_objects
from xden1k.errors import DataError
from xden1k.format.records import decode_array, object_row, preview_png, row_object, split_meshes
from xden1k.format.schema import COLUMNS
from xden1k.values.types import DensityObject


@pytest.fixture(scope="module")
def bar() -> DensityObject:
    return phantoms.box_object("bar", phantoms.BAR)


def same(one: object, other: object) -> bool:
    """Equality in which not a number is itself."""
    return repr(one) == repr(other)


@settings(max_examples=10, deadline=None)
@given(density_objects())
def test_a_row_holds_the_object_and_encodes_to_itself(obj: DensityObject) -> None:
    row = object_row(obj)
    back = row_object(row)
    assert list(row) == [column.name for column in COLUMNS]
    for name in ("object_id", "category", "split", "source", "flags", "weighed_mass_g"):
        assert same(getattr(back, name), getattr(obj, name)), name
    assert back.meta == obj.meta
    for part, stored in zip(obj.parts, back.parts, strict=True):
        values = [name for name in part.__slots__ if name != "mesh"]
        assert all(same(getattr(part, name), getattr(stored, name)) for name in values)
        np.testing.assert_array_equal(stored.mesh.faces, part.mesh.faces)
        np.testing.assert_array_equal(stored.mesh.vertices, np.float32(part.mesh.vertices))
    for view, stored in zip(obj.views, back.views, strict=True):
        np.testing.assert_array_equal(stored.valid, view.valid)
        assert stored.geometry.to_dict() == view.geometry.to_dict()
    np.testing.assert_array_equal(back.labels, obj.labels)
    np.testing.assert_allclose(back.occupancy, obj.occupancy, atol=0.51 / 255)
    stored, given_ = back.apparent_density.density_g_cm3, obj.apparent_density.density_g_cm3
    np.testing.assert_allclose(stored, given_, rtol=2**-11, atol=2**-25)  # half a step of float16
    assert (back.density is None) == (obj.density is None)
    again = object_row(back)
    assert all(same(again[name], row[name]) for name in row)


@pytest.mark.parametrize("boxes", [phantoms.CUBE, phantoms.BAR, phantoms.HOLLOW, phantoms.FILLED])
def test_mass_and_centre_of_mass_are_those_of_the_meshes(boxes: tuple[phantoms.Box, ...]) -> None:
    row = object_row(phantoms.box_object("x", boxes))
    assert row["mass_g"] == pytest.approx(phantoms.exact_mass_g(boxes), rel=1e-6)
    np.testing.assert_allclose(row["com_cm"], phantoms.exact_com_cm(boxes), atol=1e-6)


def test_inertia_is_the_tensor_in_the_order_of_its_name() -> None:
    row = object_row(phantoms.box_object("x", (phantoms.Box("b", (0, 0, 0), (1, 2, 3), 2.0),)))
    mass = 12.0
    expected = [mass * 13 / 12, mass * 10 / 12, mass * 5 / 12, 0, 0, 0]
    np.testing.assert_allclose(row["inertia_g_cm2"], expected, atol=1e-5)


def test_unknown_density_is_null_in_the_field_and_not_a_number_in_the_mass() -> None:
    row = object_row(phantoms.box_object("x", phantoms.BAR, density_known=False))
    assert row["density"] is None
    assert np.isnan([row["mass_g"], *row["com_cm"], *row["part_density_g_cm3"]]).all()


def test_a_mesh_closed_by_its_indices_stays_closed(bar: DensityObject) -> None:
    meshes = split_meshes(object_row(bar))
    assert all(mesh.is_watertight for mesh in meshes)
    assert [mesh.volume for mesh in meshes] == pytest.approx([8, 8])


def test_a_part_without_faces_keeps_its_place(bar: DensityObject) -> None:
    covered = replace(bar.parts[0], mesh=trimesh.Trimesh())
    back = row_object(object_row(replace(bar, parts=(covered, bar.parts[1]))))
    assert [len(part.mesh.faces) for part in back.parts] == [0, 12]


def test_preview_is_black_in_air_and_white_in_the_densest_pixel() -> None:
    import io

    from PIL import Image

    codes = np.full((500, 300), 52428, dtype=np.uint16)  # transmission 1
    codes[100:200, 100:200] = 5000
    codes[400:, :] = 0
    picture = np.asarray(Image.open(io.BytesIO(preview_png(codes))))
    assert max(picture.shape) <= 160
    assert picture[0, 0] == 0
    assert picture[150 // 4, 150 // 4] == 255
    assert (picture[-10:] == 0).all()


def test_labels_without_a_part_are_refused(bar: DensityObject) -> None:
    labels = bar.labels.copy()
    labels[0, 0, 0] = 3
    with pytest.raises(DataError, match=r"bar: labels reach 3, but there are 2 parts"):
        object_row(replace(bar, labels=labels))


def test_a_grid_of_another_size_is_refused(bar: DensityObject) -> None:
    with pytest.raises(DataError, match=r"labels must have shape \(128, 128, 128\), got \(64"):
        object_row(replace(bar, labels=bar.labels[::2, ::2, ::2]))


@pytest.mark.parametrize("meta", [{"views": {}}, {"a": np.nan}, {"a": object()}])
def test_meta_that_json_cannot_hold_is_refused(bar: DensityObject, meta: dict) -> None:
    with pytest.raises(DataError, match="meta must"):
        object_row(replace(bar, meta=meta))


@pytest.mark.parametrize("text", ["{", "[]", "{}", json.dumps({"views": {"pa": {}, "lat": {}}})])
def test_meta_without_geometry_is_refused(bar: DensityObject, text: str) -> None:
    with pytest.raises(DataError, match="meta_json must be JSON with the geometry of pa and lat"):
        row_object(object_row(bar) | {"meta_json": text})


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("face_part", bytes([2] * 12 + [1] * 12), "ascending"),
        ("face_part", bytes([1] * 12 + [3] * 12), "face_part must be 1 to 2"),
        ("face_part", bytes([1] * 23), "face_part must give each face's part"),
        ("mesh_vertices", bytes(24), "mesh_faces must be 0 to 1"),
        ("mesh_vertices", bytes(25), "column mesh_vertices: 25 bytes do not make float32"),
        ("part_materials", ["one"], "one entry for each part is wanted"),
        ("xray_pa_shape", [3, 3], "column xray_pa: 960 bytes do not make uint16"),
    ],
)
def test_a_broken_row_says_what_is_wrong(
    bar: DensityObject, column: str, value: object, message: str
) -> None:
    with pytest.raises(DataError, match=message):
        row_object(object_row(bar) | {column: value})


def test_decoded_arrays_are_writable_and_in_the_units_of_their_column(bar: DensityObject) -> None:
    density = decode_array(object_row(bar), "density")
    assert density.dtype == np.float32
    assert density.max() == 8.0
    density += 1
