"""Rows decoded, made plain, made tensors, by every way they come."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import datasets
import numpy as np
import pytest
import torch
from datasets import Dataset, DatasetDict, load_dataset, load_from_disk

import xden1k
from tests.phantoms import BAR, CUBE, box_object, objects, published_object
from xden1k.access import conversion
from xden1k.access.conversion import decode, to_plain, to_tensors
from xden1k.access.dataset import XDen1K
from xden1k.documents.card import readme_text
from xden1k.errors import DataError, MissingExtraError
from xden1k.folder import write_folder
from xden1k.format.features import PackedArray
from xden1k.format.manifest import Manifest
from xden1k.format.schema import ARRAY_COLUMNS


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("conversion") / "folder"
    write_folder(objects(), out, version="1.2.0", builder="test")
    return out


@pytest.fixture(scope="module")
def rows(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return xden1k.load_dataset(
        split="test", root=root, cache_dir=tmp_path_factory.mktemp("rows_cache")
    )


@pytest.fixture(autouse=True)
def cache(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("cache")
    monkeypatch.setattr(datasets.config, "HF_DATASETS_CACHE", folder)
    datasets.disable_progress_bars()
    yield folder
    datasets.enable_progress_bars()


def raw(root: Path, **options: Any) -> Any:
    files = {"test": str(root / "data" / "test-*.parquet"), "val": str(root / "data/val-*.parquet")}
    return load_dataset("parquet", data_files=files, **options)


def assert_same_arrays(made: Any, rows: Dataset) -> None:
    for one, other in zip(made, rows, strict=True):
        assert one["object_id"] == other["object_id"]
        for name in ARRAY_COLUMNS:
            np.testing.assert_array_equal(one[name], other[name], strict=True)


def test_bytes_of_any_origin_become_arrays(root: Path, rows: Dataset) -> None:
    plain = raw(root)
    assert isinstance(plain["test"][0]["labels"], bytes)
    both = decode(plain)
    assert isinstance(both, DatasetDict)
    assert both["test"].column_names == plain["test"].column_names
    assert_same_arrays(both["test"], rows)
    assert both["val"][0]["density"] is None
    assert_same_arrays(decode(raw(root, streaming=True)["test"]), rows)
    backwards = decode(plain["test"].select([2, 0]).shuffle(seed=0))
    expected = rows.select(
        [["bar-0002", "filled-0001", "hollow-0001"].index(i) for i in backwards["object_id"]]
    )
    assert_same_arrays(backwards, expected)
    assert decode(rows) is rows
    light = plain["test"].select_columns(["object_id", "mass_g"])
    assert decode(light) is light


def test_a_radiograph_without_its_shape_is_told_so(root: Path) -> None:
    with pytest.raises(DataError, match="xray_pa cannot be decoded without the column xray_pa_sh"):
        decode(raw(root)["test"].remove_columns("xray_pa_shape"))
    for other in (7, {"a": 1}, [b"bytes"]):
        with pytest.raises(DataError, match="rows of datasets are wanted"):
            decode(other)


def test_a_format_that_was_chosen_stays(root: Path) -> None:
    made = decode(raw(root)["test"].with_format("numpy", columns=["labels"]))
    assert made.format["type"] == "numpy"
    assert made[0].keys() == {"labels"}


def test_streams_are_refused_where_datasets_would_leave_them_bytes(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(conversion, "_STREAMS_DECODE", False)  # before datasets 4.8.4
    with pytest.raises(MissingExtraError, match=r"datasets [\d.]+ does not decode a stream"):
        decode(raw(root, streaming=True)["test"])


def test_paths_of_dataset_folders_decode_when_the_package_is_imported(
    root: Path, rows: Dataset, tmp_path: Path
) -> None:
    made = load_dataset(str(root), split="test")
    assert made.info.dataset_name == root.name
    assert_same_arrays(made, rows)
    assert_same_arrays(load_dataset(str(root), split="test", streaming=True), rows)
    assert load_dataset(str(root), "metadata", split="val")[0]["object_id"] == "cube-0002"
    files = load_dataset(str(root), data_files="data/val-*.parquet", split="train")
    assert files["object_id"][:] == ["cube-0002"]
    write_folder(objects()[:1], tmp_path / "mine", version="1.2.0", builder="test")
    assert len(load_dataset(str(tmp_path / "mine"), split="train")) == 1
    write_folder(objects()[:3:2], tmp_path / "mine", version="1.2.0", builder="test")
    assert len(load_dataset(str(tmp_path / "mine"), split="train")) == 2


SHAPED = ("inertia_g_cm2", "part_color_rgb", "weighed_mass_g")
"""Fields that have another form in a sample than in a row."""
READER = """
import datasets, sys
rows = datasets.load_from_disk(sys.argv[1])
labels, image = rows.with_format("numpy")[0]["labels"], rows[0]["xray_pa"]
print(labels.shape, image.mode, image.size, "xden1k" in sys.modules)
"""


@pytest.mark.slow
def test_plain_rows_are_read_without_this_package(rows: Dataset, tmp_path: Path) -> None:
    plain = to_plain(rows)
    assert not any(isinstance(each, PackedArray) for each in plain.features.values())
    plain.save_to_disk(tmp_path / "plain")
    for one, other in zip(
        load_from_disk(tmp_path / "plain").with_format("numpy"), rows, strict=True
    ):
        for name in ARRAY_COLUMNS:
            value = one[name] * np.float32(1.25 / 65535) if name.startswith("xray") else one[name]
            np.testing.assert_allclose(value, other[name], atol=1e-7)
    ran = subprocess.run(  # noqa: S603
        [sys.executable, "-c", READER, str(tmp_path / "plain")],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
    )
    assert ran.stdout == "(128, 128, 128) I;16 (20, 24) False\n"


def test_plain_streams_and_unknown_densities(root: Path) -> None:
    stream = xden1k.load_dataset(split="val", root=root, streaming=True)
    (row,) = to_plain(stream)
    assert row["density"] is None
    assert np.asarray(row["apparent_density"]).shape == (64, 64, 64)
    assert row["xray_lat"]["bytes"].startswith(b"\x89PNG")


def test_what_cannot_be_made_plain_is_told_so(root: Path, rows: Dataset) -> None:
    with pytest.raises(DataError, match=r"are bytes: give xden1k\.decode\(rows\)"):
        to_plain(raw(root)["test"])
    few = rows.select_columns(["object_id", "xray_pa"])
    changed = few.map(lambda row: {"xray_pa": row["xray_pa"] * np.float32(0.3)})
    with pytest.raises(DataError, match="xray_pa is no transmission in 65535 steps any more"):
        to_plain(changed)
    light = rows.select_columns(["object_id"])
    assert to_plain(light) is light


def test_a_transform_gives_tensors_of_the_types_that_samples_have(
    root: Path, rows: Dataset
) -> None:
    sample = XDen1K(root, "test")[0]
    row = rows.with_transform(to_tensors)[0]
    for name, value in sample.items():
        if name in row and isinstance(value, torch.Tensor) and name not in SHAPED:
            assert torch.equal(row[name], value), name
            assert row[name].dtype == value.dtype
    assert row["part_names"] == sample["part_names"]
    assert row["part_color_rgb"].shape == (2, 3)
    assert row["flags"] == []
    batch = rows.with_transform(to_tensors)[:2]
    assert [tuple(each.shape) for each in batch["labels"]] == [(128,) * 3] * 2
    assert rows.with_transform(to_tensors)[1]["weighed_mass_g"] is None


def test_the_card_says_in_five_lines_how_to_read_without_the_package(
    root: Path, rows: Dataset
) -> None:
    text = readme_text(Manifest.read(root))
    (code,) = re.findall(r"```python\n(import numpy as np\n.*?)```", text, re.DOTALL)
    names: dict[str, Any] = {"row": raw(root)["test"][0]}
    exec(code, names)  # noqa: S102
    np.testing.assert_allclose(names["transmission"], rows[0]["xray_pa"], atol=1e-6)
    np.testing.assert_array_equal(names["labels"], rows[0]["labels"])


def test_rows_without_radiographs_load_as_none(tmp_path: Path) -> None:
    published = tmp_path / "folder"
    made = [published_object("bar-0001", BAR), box_object("cube-0001", CUBE)]
    write_folder(made, published, version="1.0.0", builder="test")
    rows = xden1k.load_dataset(root=published, split="test", cache_dir=tmp_path / "cache")
    assert [rows[k]["xray_pa"] is None for k in range(2)] == [True, False]
    assert rows[0]["xray_pa_shape"] is rows[0]["preview_pa"] is None
    assert rows[0]["labels"].shape == (128, 128, 128)
    batch = rows.with_transform(to_tensors)[:2]
    assert batch["xray_pa"][0] is None
    assert batch["xray_pa"][1].shape == (24, 20)
    streamed = xden1k.load_dataset(root=published, split="test", streaming=True)
    assert [row["xray_pa"] is None for row in streamed] == [True, False]
