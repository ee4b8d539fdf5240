"""preds.npz: what is written is read, and the bytes depend on the values alone."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from xden1k.errors import DataError, MissingObjectError, SubmissionError
from xden1k.predictions import (
    CODES,
    Predictions,
    PredictionsWriter,
    SubmissionMeta,
    open_predictions,
    write_predictions,
)
from xden1k.predictions.meta import parse_meta
from xden1k.values.modality import INPUTS

META = SubmissionMeta(
    method="test",
    dataset_revision="0.1.0",
    config="default",
    split="test",
    inputs=("mesh", "parts"),
    training_data=(),
    external_data=False,
)
GRID = np.zeros((64, 64, 64), np.float32)
GRID[20:40, 10:30, 5:60] = 7.8
PARTS = np.array([0, 1.5, 7.8], np.float32)


def test_what_is_written_is_read(tmp_path: Path) -> None:
    write_predictions(tmp_path / "preds.npz", META, [("mug-1", GRID), ("bar_2", PARTS)])
    with open_predictions(tmp_path / "preds.npz") as predictions:
        assert predictions.ids == ("bar_2", "mug-1")
        assert predictions.meta == META
        np.testing.assert_array_equal(predictions.read("mug-1"), GRID)
        np.testing.assert_array_equal(predictions.read("bar_2"), PARTS)
        assert "bar_2" in predictions
        assert "bar_3" not in predictions


def test_numpy_reads_the_file_as_any_other_npz(tmp_path: Path) -> None:
    write_predictions(tmp_path / "preds.npz", META, [("mug-1", GRID)], dtype="float16")
    with np.load(tmp_path / "preds.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["density/mug-1"], GRID.astype(np.float16))
        assert json.loads(str(arrays["__meta__"]))["method"] == "test"


def test_a_path_may_be_text(tmp_path):
    path = str(tmp_path / "preds.npz")
    write_predictions(path, META, [("mug-1", GRID)])
    with open_predictions(path) as predictions:
        assert np.array_equal(predictions.read("mug-1"), GRID)


def test_a_file_saved_by_numpy_is_read(tmp_path: Path) -> None:
    arrays = {"density/mug-1": np.asfortranarray(GRID), "__meta__": np.array(META.to_json())}
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "preds.npz", **arrays)
        with open_predictions(tmp_path / "preds.npz") as predictions:
            np.testing.assert_array_equal(predictions.read("mug-1"), GRID)


def test_writing_twice_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        write_predictions(tmp_path / name, META, [("mug-1", GRID), ("bar_2", PARTS)])
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_kg_per_m3_arrive_as_g_per_cm3(tmp_path: Path) -> None:
    meta = dataclasses.replace(META, units="kg/m3")
    write_predictions(tmp_path / "preds.npz", meta, [("mug-1", GRID * 1000)])
    with open_predictions(tmp_path / "preds.npz") as predictions:
        np.testing.assert_allclose(predictions.read("mug-1"), GRID, rtol=1e-6)


def test_float16_keeps_three_digits(tmp_path: Path) -> None:
    write_predictions(tmp_path / "preds.npz", META, [("mug-1", GRID)], dtype="float16")
    with open_predictions(tmp_path / "preds.npz") as predictions:
        np.testing.assert_allclose(predictions.read("mug-1"), GRID, atol=0.004)


def test_standard_deviations_come_back_in_g_per_cm3(tmp_path: Path) -> None:
    meta = dataclasses.replace(META, units="kg/m3")
    triples = [("mug-1", GRID * 1000, GRID * 100), ("bar_2", PARTS * 1000, PARTS * 100)]
    write_predictions(tmp_path / "preds.npz", meta, triples, dtype="float16")
    with open_predictions(tmp_path / "preds.npz") as predictions:
        assert predictions.has_sd
        np.testing.assert_allclose(predictions.read_sd("mug-1"), GRID / 10, rtol=1e-3)
        np.testing.assert_allclose(predictions.read_sd("bar_2"), PARTS / 10, rtol=1e-6)
        np.testing.assert_allclose(predictions.read("bar_2"), PARTS, rtol=1e-6)


def test_a_file_without_standard_deviations_has_none(tmp_path: Path) -> None:
    write_predictions(tmp_path / "preds.npz", META, [("mug-1", GRID)])
    with open_predictions(tmp_path / "preds.npz") as predictions:
        assert not predictions.has_sd
        assert predictions.examine_sd("mug-1") == (None, [])
        with pytest.raises(MissingObjectError, match="no density_sd for mug-1"):
            predictions.read_sd("mug-1")


@pytest.mark.parametrize(
    ("sd", "message"),
    [
        (GRID[:32], r"mug-1: sd: shape must be \(64, 64, 64\)"),
        (PARTS, r"mug-1: sd: shape must be \(64, 64, 64\), got \(3,\)"),
        (-GRID, "mug-1: sd: values must be finite, >= 0"),
        (GRID * np.nan, "mug-1: sd: values must be finite, >= 0"),
        (0.1, "mug-1: sd: must be a NumPy array of floats or integers, got float"),
    ],
)
def test_a_bad_standard_deviation_is_refused(tmp_path: Path, sd: object, message: str) -> None:
    with (
        PredictionsWriter(tmp_path / "preds.npz") as writer,
        pytest.raises(DataError, match=message),
    ):
        writer.add("mug-1", GRID, sd)


def test_standard_deviations_are_written_for_all_or_none(tmp_path: Path) -> None:
    pairs = [("mug-1", GRID, GRID), ("bar_2", PARTS, None)]
    for order in (pairs, pairs[::-1]):
        with pytest.raises(DataError, match="sd must be given for all objects or for none"):
            write_predictions(tmp_path / "preds.npz", META, order)


def test_an_object_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    write_predictions(tmp_path / "preds.npz", META, [])
    with (
        open_predictions(tmp_path / "preds.npz") as predictions,
        pytest.raises(MissingObjectError, match="no prediction for mug-9"),
    ):
        predictions.read("mug-9")


@pytest.mark.parametrize(
    ("object_id", "values", "message"),
    [
        ("mug-1", GRID[:, :, :63], r"shape must be \(64, 64, 64\)"),
        ("mug-1", -GRID, "finite, >= 0 and <= .* as float16"),
        ("mug-1", GRID * 1e5, "finite, >= 0 and <= .* as float16"),
        ("mug-1", np.full(3, np.nan), "finite, >= 0 and <= .* as float32"),
        ("../mug", GRID, "object id '../mug' must match"),
    ],
)
def test_a_bad_prediction_is_refused_and_nothing_is_left(
    tmp_path: Path, object_id: str, values: np.ndarray, message: str
) -> None:
    with pytest.raises(DataError, match=message):
        write_predictions(tmp_path / "preds.npz", META, [(object_id, values)], dtype="float16")
    assert list(tmp_path.iterdir()) == []


def test_an_object_is_written_once(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="mug-1 was predicted twice"):
        write_predictions(tmp_path / "preds.npz", META, [("mug-1", GRID), ("mug-1", PARTS)])


@pytest.mark.parametrize("name", [" ", "---", "..."])
def test_bad_meta_data_are_refused_and_the_old_file_stays(tmp_path: Path, name: str) -> None:
    write_predictions(tmp_path / "preds.npz", META, [("mug-1", GRID)])
    before = (tmp_path / "preds.npz").read_bytes()
    with pytest.raises(SubmissionError, match="E203: method must be one printable line"):
        write_predictions(tmp_path / "preds.npz", dataclasses.replace(META, method=name), [])
    assert (tmp_path / "preds.npz").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["preds.npz"]


def test_a_writer_left_early_writes_nothing(tmp_path: Path) -> None:
    with PredictionsWriter(tmp_path / "preds.npz") as writer:
        writer.add("mug-1", GRID)
    assert list(tmp_path.iterdir()) == []


def test_the_checksum_is_that_of_the_file(tmp_path: Path) -> None:
    import hashlib

    write_predictions(tmp_path / "preds.npz", META, [("mug-1", GRID)])
    with Predictions(tmp_path / "preds.npz") as predictions:
        digest = hashlib.sha256((tmp_path / "preds.npz").read_bytes()).hexdigest()
        assert predictions.sha256 == digest
        np.testing.assert_array_equal(predictions.read("mug-1"), GRID)


def lines(codec: str) -> st.SearchStrategy[str]:
    printable = st.characters(codec=codec, exclude_categories=["C", "Z"], include_characters=" ")
    return st.text(printable, min_size=1, max_size=80).filter(lambda text: bool(text.strip()))


names = lines("ascii").filter(lambda text: any(map(str.isalnum, text)))
printable = lines("utf-8")


@given(
    st.fixed_dictionaries(
        {
            "method": names,
            "dataset_revision": names,
            "config": names,
            "split": names,
            "inputs": st.lists(st.sampled_from(INPUTS), unique=True).map(tuple),
            "training_data": st.lists(printable, max_size=3).map(tuple),
            "external_data": st.booleans(),
            "units": st.sampled_from(["g/cm3", "kg/m3"]),
            "target": st.sampled_from(["density", "apparent_density"]),
            "notes": printable,
            "seed": st.none() | st.integers(0, 2**63 - 1),
            "seconds_per_object": st.none() | st.floats(0, 1e8),
            "processor_seconds_per_object": st.none() | st.floats(0, 1e8),
            "peak_memory_gb": st.none() | st.floats(0, 1e8),
        }
    )
)
def test_meta_data_survive_the_way_through_json(values: dict[str, Any]) -> None:
    meta = SubmissionMeta(**values)
    assert parse_meta(meta.to_json(), SubmissionMeta) == (meta, [])


@given(npst.arrays(np.float32, 5, elements=st.floats(0, 1e4, width=32)))
def test_part_densities_survive_to_the_bit(
    tmp_path_factory: pytest.TempPathFactory, values: np.ndarray
) -> None:
    values[0] = 0
    path = tmp_path_factory.mktemp("parts") / "preds.npz"
    write_predictions(path, META, [("mug-1", values)])
    with open_predictions(path) as predictions:
        np.testing.assert_array_equal(predictions.read("mug-1"), values)


@pytest.mark.parametrize(
    ("inputs", "track"),
    [
        ((), "geometry"),
        (("mesh", "text"), "geometry"),
        (("mesh", "rgb"), "rgb"),
        (("mesh", "parts"), "rgb_parts"),
        (("rgb", "parts"), "rgb_parts"),
        (("xray",), "xray"),
        (("xray", "parts", "rgb"), "xray"),
    ],
)
def test_the_inputs_decide_the_track(inputs: tuple[str, ...], track: str) -> None:
    assert dataclasses.replace(META, inputs=inputs).track == track


def test_every_code_has_one_line() -> None:
    assert list(CODES) == sorted(CODES)
    assert all("\n" not in meaning for meaning in CODES.values())
