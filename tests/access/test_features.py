"""The feature type of array columns: exact, self-describing, kept by what datasets does to rows."""

from __future__ import annotations

import pickle

import numpy as np
import pyarrow as pa
import pytest
from datasets import Dataset, Features, Value, load_from_disk
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from xden1k.errors import DataError
from xden1k.format.features import PackedArray
from xden1k.format.packing import pack, scanned_columns, with_arrays
from xden1k.format.schema import ARRAY_COLUMNS, DATA_SCHEMA

TRANSMISSION = PackedArray("<u2", scale=1.25 / 65535)
SHAPES = hnp.array_shapes(min_dims=1, max_dims=4, min_side=0, max_side=5)


@given(st.data(), st.sampled_from(sorted(ARRAY_COLUMNS)))
def test_what_a_column_can_hold_comes_back_bit_for_bit(data: st.DataObject, name: str) -> None:
    codec = ARRAY_COLUMNS[name]
    codes = data.draw(
        hnp.arrays(
            codec.stored,
            SHAPES,
            elements={"allow_nan": False} if codec.stored[1] == "f" else None,
        )
    )
    values = codes if codec.scale is None else codes.astype(np.float32) * np.float32(codec.scale)
    feature = PackedArray(codec.stored, codec.scale)
    back = feature.decode_example(feature.encode_example(values))
    assert back.dtype == values.dtype
    np.testing.assert_array_equal(back, values, strict=True)
    assert back.flags.writeable


@given(hnp.arrays("<i4", SHAPES))
def test_a_value_never_ends_in_a_zero_byte_which_numpy_would_drop(codes: np.ndarray) -> None:
    value = PackedArray("<i4").encode_example(codes)
    assert np.asarray([value])[0] == value


@settings(max_examples=30)
@given(st.lists(hnp.arrays("<u2", hnp.array_shapes(min_dims=2, max_dims=2)), min_size=1))
def test_nested_lists_as_map_makes_them_are_stored_again_as_they_were(codes: list) -> None:
    values = [array.astype(np.float32) * np.float32(TRANSMISSION.scale) for array in codes]
    nested = pa.array([value.tolist() for value in values] + [None])
    stored = TRANSMISSION.cast_storage(nested).to_pylist()
    assert stored[-1] is None
    for value, each in zip(values, stored, strict=False):
        np.testing.assert_array_equal(TRANSMISSION.decode_example(each), value, strict=True)


@pytest.mark.parametrize(
    ("feature", "value", "kind"),
    [
        (TRANSMISSION, [[1.3]], "f8"),
        (TRANSMISSION, [[-0.1]], "f8"),
        (TRANSMISSION, [[float("nan")]], "f8"),
        (TRANSMISSION, np.float32([[0.123456789, 2]]), "f4"),
        (TRANSMISSION, [[1, 1000]], "i8"),
        (PackedArray("|u1"), [256], "i8"),
        (PackedArray("|u1"), np.int16([-1]), "i2"),
        (PackedArray("|u1"), [1.5], "f8"),
        (PackedArray("<f2", 1.0), np.array([0.1], ">f4"), "f4"),
        (PackedArray("<i4"), np.uint64([1 << 62]), "u8"),
    ],
)
def test_what_its_type_cannot_hold_is_held_in_its_own_and_never_rounded(
    feature: PackedArray, value: object, kind: str
) -> None:
    array = np.asarray(value)
    back = feature.decode_example(feature.encode_example(value))
    assert f"{back.dtype.kind}{back.dtype.itemsize}" == kind
    np.testing.assert_array_equal(back, array)
    assert back.flags.writeable
    (stored,) = feature.cast_storage(pa.array([array.tolist()])).to_pylist()
    np.testing.assert_array_equal(feature.decode_example(stored), array.astype(float))
    assert np.asarray([stored])[0] == stored


@given(st.data())
def test_any_array_of_numbers_comes_back(data: st.DataObject) -> None:
    kinds = hnp.boolean_dtypes() | hnp.integer_dtypes() | hnp.floating_dtypes(sizes=(16, 32, 64))
    array = data.draw(hnp.arrays(kinds, SHAPES))
    feature = PackedArray(ARRAY_COLUMNS["labels"].stored)
    back = feature.decode_example(feature.encode_example(array))
    np.testing.assert_array_equal(back, array)


@pytest.mark.parametrize("value", ["text", 1.5, ["a", "b"], [[1], [2, 3]]])
def test_what_is_no_array_of_numbers_is_refused(value: object) -> None:
    with pytest.raises((DataError, ValueError), match=r"no array of numbers|inhomogeneous"):
        TRANSMISSION.encode_example(value)


def test_ragged_lists_make_no_array() -> None:
    with pytest.raises(pa.ArrowInvalid, match=r"lists of lengths \[1, 2\] make no array"):
        TRANSMISSION.cast_storage(pa.array([[[0.0], [0.0, 0.0]]]))


@pytest.mark.parametrize(
    "value",
    [
        *(b"", b"\x05", b"\x80", b"\x85", b"\x01\x02\x00\x00\x00\x01"),
        b"\x01\x01\x00\x00\x00c8\x81",
        b"\x01\x01\x00\x00\x00f4\x81",
    ],
)
def test_bytes_that_lack_their_shape_are_refused(value: bytes) -> None:
    with pytest.raises(DataError):
        PackedArray("|u1").decode_example(value)


def test_only_plain_binary_array_columns_get_the_type() -> None:
    features = with_arrays(Features.from_arrow_schema(DATA_SCHEMA))
    decoding = {name for name, feature in features.items() if isinstance(feature, PackedArray)}
    assert decoding == set(ARRAY_COLUMNS)
    mine = Features({"labels": Value("string"), "other": Value("binary")})
    assert with_arrays(mine) == mine
    assert with_arrays(features) == features


def test_the_columns_with_shapes_are_read_along_and_dropped() -> None:
    assert scanned_columns(["xray_pa", "labels"]) == ["xray_pa", "labels", "xray_pa_shape"]
    assert scanned_columns(["xray_pa_shape", "xray_pa"]) == ["xray_pa_shape", "xray_pa"]
    table = pa.table({"xray_pa": [bytes(12), None], "xray_pa_shape": [[2, 3], [1, 1]]})
    features = with_arrays(Features({"xray_pa": Value("binary")}))
    packed = pack(table, features)
    assert packed.column_names == ["xray_pa"]
    first, second = packed["xray_pa"].to_pylist()
    assert TRANSMISSION.decode_example(first).shape == (2, 3)
    assert second is None


@pytest.fixture
def rows() -> Dataset:
    """Three rows whose images differ in size, and whose last figures are zeros."""
    images = [np.full((2 + i, 3), 0.0, np.float32) for i in range(3)]
    features = Features(
        {"name": Value("string"), "image": TRANSMISSION, "mask": PackedArray("|u1")}
    )
    masks = [np.eye(4, dtype=np.uint8), None, np.zeros((4, 4), np.uint8)]
    return Dataset.from_dict({"name": ["a", "b", "c"], "image": images, "mask": masks}, features)


@pytest.mark.parametrize("kind", [None, "numpy", "torch", "pandas"])
def test_rows_slices_columns_and_batches_decode_in_every_format(
    rows: Dataset, kind: str | None
) -> None:
    rows = rows.with_format(kind)
    assert np.asarray(rows["mask"][0]).tolist() == np.eye(4).tolist()
    assert [np.asarray(image).shape for image in rows["image"][:]] == [(2, 3), (3, 3), (4, 3)]
    for sizes, part in (([4], rows[2:]), ([3, 2], rows[[1, 0]]), ([2, 3], rows.select([0, 1])[:])):
        assert [np.asarray(image).shape for image in part["image"]] == [(n, 3) for n in sizes]
    one = rows[1]
    image, mask = (
        (one["image"], one["mask"]) if kind != "pandas" else one[["image", "mask"]].iloc[0]
    )
    assert np.asarray(image).shape == (3, 3)
    assert mask is None


def test_streams_decode_and_batches_of_streams_do(rows: Dataset) -> None:
    stream = rows.to_iterable_dataset(num_shards=3)
    assert [row["image"].shape for row in stream] == [(2, 3), (3, 3), (4, 3)]
    assert [len(batch["image"]) for batch in stream.batch(2)] == [2, 1]
    doubled = stream.map(lambda row: {"twice": row["image"] * 2})
    assert [row["twice"].shape for row in doubled] == [(2, 3), (3, 3), (4, 3)]
    torch_rows = list(stream.with_format("torch"))
    assert [tuple(row["image"].shape) for row in torch_rows] == [(2, 3), (3, 3), (4, 3)]


def test_map_keeps_the_type_of_arrays_it_reads_and_of_those_it_can_store(rows: Dataset) -> None:
    read = rows.map(lambda row: {"mean": float(row["image"].mean())})
    cropped = rows.map(lambda row: {"image": row["image"][:1]})
    batched = rows.map(lambda part: {"n": [image.size for image in part["image"]]}, batched=True)
    for mapped in (read, cropped, batched):
        assert mapped.features["image"] == rows.features["image"]
        assert mapped.features["mask"] == rows.features["mask"]
    assert cropped[2]["image"].shape == (1, 3)
    assert batched["n"][:] == [6, 9, 12]
    np.testing.assert_array_equal(read[0]["mask"], rows[0]["mask"], strict=True)


def test_map_keeps_arrays_arrays_whatever_is_done_to_them(rows: Dataset) -> None:
    shifted = rows.map(lambda row: {"image": row["image"] - np.float32(0.1)})
    assert shifted.features["image"] == rows.features["image"]
    np.testing.assert_array_equal(
        shifted[0]["image"], np.full((2, 3), np.float32(-0.1)), strict=True
    )
    named = rows.map(lambda row: {"image": row["image"] - 0.1}, features=rows.features)
    np.testing.assert_array_equal(named[0]["image"], rows[0]["image"] - 0.1, strict=True)
    for kind in (None, "numpy", "torch"):
        assert np.asarray(shifted.with_format(kind)[1]["image"]).shape == (3, 3)
    again = shifted.map(lambda row: {"image": row["image"] * 0 + np.float32(1.25)})
    np.testing.assert_array_equal(again[2]["image"], np.full((4, 3), np.float32(1.25)))


def test_map_gives_what_is_no_array_another_type(rows: Dataset) -> None:
    for other in ("text", 1, ["a", "list"]):
        mapped = rows.map(lambda row, value: {"mask": value}, fn_kwargs={"value": other})
        assert mapped[0]["mask"] == other


def test_pickling_saving_parquet_and_the_card_keep_the_type(
    rows: Dataset, tmp_path: object
) -> None:
    rows.save_to_disk(tmp_path / "saved")
    rows.to_parquet(tmp_path / "rows.parquet")
    for copy in (
        pickle.loads(pickle.dumps(rows)),  # noqa: S301
        load_from_disk(tmp_path / "saved"),
        Dataset.from_parquet(str(tmp_path / "rows.parquet"), cache_dir=str(tmp_path / "cache")),
    ):
        assert copy.features == rows.features
        assert copy[2]["image"].shape == (4, 3)
    assert Features._from_yaml_list(rows.features._to_yaml_list()) == rows.features


def test_decoding_can_be_turned_off_to_pass_bytes_on(rows: Dataset) -> None:
    raw = rows.cast_column("image", PackedArray("<u2", TRANSMISSION.scale, decode=False))
    value = raw[1]["image"]
    assert isinstance(value, bytes)
    np.testing.assert_array_equal(TRANSMISSION.decode_example(value), rows[1]["image"], strict=True)
