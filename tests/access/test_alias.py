"""``load_dataset("xden1k")``: the same rows by every way in, and never stale ones."""

from __future__ import annotations

import os
import pickle
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import datasets
import datasets.load
import numpy as np
import pytest
from datasets import get_dataset_config_names, get_dataset_split_names, load_dataset

import xden1k
from tests.phantoms import objects
from xden1k.access import alias
from xden1k.access.hub import ROOT_VARIABLE, SAMPLE
from xden1k.errors import DataError
from xden1k.folder import open_folder, write_folder
from xden1k.format.features import PackedArray
from xden1k.format.manifest import Manifest
from xden1k.format.schema import ARRAY_COLUMNS, COLUMNS, LIGHT_COLUMNS


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("alias") / "root"
    write_folder(objects(), root, version="1.2.0", builder="test", shard_bytes=1)
    return root


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def root(
    written: Path, cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Path]:
    """The folder the name stands for; the working directory is empty, the terminal quiet."""
    monkeypatch.setenv(ROOT_VARIABLE, str(written))
    monkeypatch.setattr(datasets.config, "HF_DATASETS_CACHE", cache)
    monkeypatch.chdir(tmp_path)
    datasets.disable_progress_bars()
    yield written
    datasets.enable_progress_bars()


def assert_same_row(one: dict[str, Any], other: dict[str, Any]) -> None:
    assert one.keys() == other.keys()
    for name, value in one.items():
        if name.startswith("preview"):
            assert value.tobytes() == other[name].tobytes()
        else:
            np.testing.assert_equal(value, other[name])


def test_rows_hold_what_was_written(root: Path) -> None:
    rows = load_dataset("xden1k", split="test")
    assert rows.column_names == [column.name for column in COLUMNS]
    assert rows["object_id"][:] == ["bar-0002", "filled-0001", "hollow-0001"]
    folder = open_folder(root)
    for row in rows:
        obj = folder.object(row["object_id"])
        for view in obj.views:
            np.testing.assert_array_equal(row[f"xray_{view.name}"], view.transmission, strict=True)
        np.testing.assert_array_equal(row["labels"], obj.labels, strict=True)
        np.testing.assert_array_equal(row["density"], obj.density.density_g_cm3, strict=True)
        np.testing.assert_array_equal(row["envelope"], obj.envelope, strict=True)
        assert row["mesh_vertices"].shape == (sum(len(p.mesh.vertices) for p in obj.parts), 3)
        assert len(row["face_part"]) == len(row["mesh_faces"])
        assert row["mass_g"] == pytest.approx(obj.mass_g)
    assert {image.shape for image in rows["xray_pa"]} == {(24, 20), (16, 30)}


def test_an_unknown_density_is_none_in_every_format() -> None:
    rows = load_dataset("xden1k", split="val")
    assert rows[0]["density"] is None
    for kind in ("numpy", "torch"):
        assert rows.with_format(kind)[0]["density"] is None
        assert rows.with_format(kind)[:]["density"][0] is None


def test_configs_and_splits_are_those_of_the_card() -> None:
    assert get_dataset_config_names("xden1k") == ["default", "metadata"]
    assert get_dataset_split_names("xden1k") == ["train", "val", "test"]
    both = {name: load_dataset("xden1k", name) for name in ("default", "metadata")}
    for name, columns in (("default", [c.name for c in COLUMNS]), ("metadata", LIGHT_COLUMNS)):
        assert {split: len(rows) for split, rows in both[name].items()} == {
            "train": 2,
            "val": 1,
            "test": 3,
        }
        assert both[name]["train"].column_names == list(columns)
        assert both[name]["train"].info.dataset_name == "xden1k"
        assert str(both[name]["train"].info.version) == "1.2.0"
    with pytest.raises(ValueError, match=r"'nope' not found. Available: \['default', 'metadata'\]"):
        load_dataset("xden1k", "nope")


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"columns": ["xray_lat"], "filters": [("category", "==", "bar")]},
        *(
            pytest.param(one, marks=pytest.mark.slow)
            for one in (
                {"columns": ["xray_pa", "object_id"]},
                {"columns": ["labels", "mesh_faces"]},
                {"filters": [("object_id", "==", "hollow-0001")]},
            )
        ),
    ],
)
def test_the_name_the_stream_and_the_explicit_form_give_the_same_rows(options: dict) -> None:
    rows = load_dataset("xden1k", split="test", **options)
    others = [
        load_dataset("xden1k", split="test", streaming=True, **options),
        xden1k.load_dataset(split="test", **options),
        xden1k.load_dataset(split="test", streaming=True, **options),
    ]
    assert set(rows.column_names) == set(options.get("columns", rows.column_names))
    assert len(rows) == (1 if "filters" in options else 3)
    for other in others:
        for one, two in zip(rows, other, strict=True):
            assert_same_row(one, two)


def test_the_explicit_form_shares_the_cache_of_the_name() -> None:
    for name, options in (("default", {}), ("metadata", {}), ("default", {"columns": ["labels"]})):
        named = load_dataset("xden1k", name, split="train", **options)
        explicit = xden1k.load_dataset(name, "train", **options)
        assert explicit.cache_files == named.cache_files
    with pytest.raises(DataError, match="config must be one of"):
        xden1k.load_dataset("nope")


def test_the_cache_has_the_size_that_the_manifest_gives_as_unpacked(root: Path) -> None:
    files = [file["filename"] for file in load_dataset("xden1k", split="test").cache_files]
    unpacked = sum(file.num_bytes for file in Manifest.read(root).shards(split="test"))
    assert sum(os.path.getsize(file) for file in files) == pytest.approx(unpacked, rel=0.01)


def test_a_wrong_revision_is_refused_by_both_forms() -> None:
    assert len(load_dataset("xden1k", split="val", revision="v1.2.0")) == 1
    with pytest.raises(DataError, match=r"revision nope was asked for, but .* holds 1\.2\.0"):
        load_dataset("xden1k", split="val", revision="nope")
    with pytest.raises(DataError, match=r"revision nope was asked for"):
        xden1k.load_dataset(split="val", revision="nope")


def test_a_revision_without_a_download_says_that_nothing_is_downloaded(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with pytest.raises(DataError, match=r"revision main was asked for, but nothing is downloaded"):
        xden1k.load_dataset(split="val", root=SAMPLE, revision="main")
    commit = tmp_path / ("0123456789" * 4)
    write_folder(objects()[:1], commit, version="1.2.0", builder="test")
    assert len(xden1k.load_dataset(split="train", root=commit, revision=commit.name)) == 1


@pytest.mark.parametrize("streaming", [False, True])
def test_a_split_of_another_name_is_hinted_at(streaming: bool) -> None:
    for load in (
        lambda s: load_dataset("xden1k", split=s, streaming=streaming),
        lambda s: xden1k.load_dataset(split=s, streaming=streaming),
    ):
        with pytest.raises(DataError, match=r"no split validation; there are \['train', 'val'"):
            load("validation")
        with pytest.raises(ValueError, match="nope"):
            load("nope")


def test_an_absolute_data_dir_is_the_root_and_a_relative_one_lies_inside(
    tmp_path: Path, root: Path
) -> None:
    write_folder(objects()[:1], tmp_path / "other", version="1.2.0", builder="test")
    other = load_dataset("xden1k", data_dir=str(tmp_path / "other"))
    assert {split: rows["object_id"][:] for split, rows in other.items()} == {"train": ["bar-0001"]}
    assert xden1k.load_dataset(split="train", root=tmp_path / "other")["object_id"][:] == [
        "bar-0001"
    ]
    inside = load_dataset("xden1k", data_dir="metadata", split="train")
    assert inside.column_names == list(LIGHT_COLUMNS)
    with pytest.raises(DataError, match="not a dataset folder"):
        load_dataset("xden1k", data_dir=str(tmp_path))


def test_a_relative_data_dir_is_a_dataset_folder_or_lies_inside_the_root(tmp_path: Path) -> None:
    write_folder(objects()[:1], tmp_path / "other", version="1.2.0", builder="test")
    assert load_dataset("xden1k", data_dir="other", split="train")["object_id"][:] == ["bar-0001"]
    with pytest.raises(DataError, match=r"data_dir='nope' is neither a dataset folder .* nor a"):
        load_dataset("xden1k", data_dir="nope")


@pytest.mark.parametrize("flaw", ["missing", "cut short"])
def test_a_damaged_shard_is_named_by_both_forms(tmp_path: Path, flaw: str) -> None:
    write_folder(objects()[4:], tmp_path / "mine", version="1.2.0", builder="test")
    shard = tmp_path / "mine" / "data" / "test-00000-of-00002.parquet"
    whole = shard.read_bytes()
    shard.unlink() if flaw == "missing" else shard.write_bytes(whole[:1000])
    for load in (
        lambda: load_dataset("xden1k", data_dir=str(tmp_path / "mine")),
        lambda: xden1k.load_dataset(root=tmp_path / "mine"),
        lambda: xden1k.load_dataset("metadata", root=tmp_path / "mine", streaming=True),
    ):
        with pytest.raises(DataError, match=flaw) as caught:
            load()
        assert str(shard) in str(caught.value)
        assert f"{len(whole)}" in str(caught.value)
        assert ("1000 bytes" in str(caught.value)) == (flaw == "cut short")


def test_a_rewritten_folder_is_seen_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(ROOT_VARIABLE, str(tmp_path / "mine"))
    for kept in (objects()[4:], objects()[5:]):
        write_folder(kept, tmp_path / "mine", version="1.2.0", builder="test")
        ids = [obj.object_id for obj in kept]
        assert load_dataset("xden1k", split="test")["object_id"][:] == ids
        assert xden1k.load_dataset(split="test")["object_id"][:] == ids


def test_features_of_the_user_hold() -> None:
    plain = datasets.Features({"labels": datasets.Value("binary")})
    row = load_dataset("xden1k", split="val", columns=["labels"], features=plain)[0]
    assert len(row["labels"]) == 128**3


def test_other_paths_are_left_alone(root: Path, tmp_path: Path) -> None:
    shutil.copytree(root / "metadata", tmp_path / "light")
    rows = load_dataset(str(tmp_path / "light"), split="test")
    assert rows.info.dataset_name == "light"
    files = {"test": str(root / "data" / "test-*.parquet")}
    assert isinstance(load_dataset("parquet", data_files=files)["test"][0]["labels"], bytes)


def test_a_builder_says_what_it_would_load_before_it_does() -> None:
    info = datasets.load_dataset_builder("xden1k").info
    assert {n for n, each in info.features.items() if isinstance(each, PackedArray)} == set(
        ARRAY_COLUMNS
    )
    assert {name: split.num_examples for name, split in info.splits.items()} == {
        "train": 2,
        "val": 1,
        "test": 3,
    }
    assert info.description.startswith("XDen-1K, simulated objects. **Where it comes from.**")
    assert info.citation.startswith("@article{zhang2025xden1k,")
    assert (info.license, info.homepage) == ("CC-BY-4.0", "https://arxiv.org/abs/2512.10668")
    assert load_dataset("xden1k", split="val").info.description == info.description


def test_a_hub_repository_is_read_by_our_builder_if_its_card_lists_our_columns() -> None:
    def found(names: list[str]) -> Any:
        features = datasets.Features({name: datasets.Value("binary") for name in names})
        infos = datasets.info.DatasetInfosDict(default=datasets.DatasetInfo(features=features))
        parquet = "datasets.packaged_modules.parquet.parquet"
        module = datasets.load.DatasetModule(parquet, "commit", {}, dataset_infos=infos)
        return alias._with_arrays("owner/name", module, {}), module

    ours, module = found([column.name for column in COLUMNS])
    assert ours.module_path == "xden1k.access.rows"
    assert ours.hash != module.hash
    theirs, module = found(["labels", "image"])
    assert theirs is module


def test_the_builder_is_picklable() -> None:
    builder = datasets.load_dataset_builder("xden1k")
    again = pickle.loads(pickle.dumps(builder))  # noqa: S301
    assert next(iter(again.as_streaming_dataset("val")))["labels"].shape == (128,) * 3


def test_train_test_split_shuffle_and_concatenation_keep_decoding() -> None:
    rows = load_dataset("xden1k", split="train+test").shuffle(seed=1)
    halves = rows.train_test_split(test_size=2, seed=1)
    joined = datasets.concatenate_datasets([halves["train"], halves["test"]])
    assert sorted(joined["object_id"]) == sorted(rows["object_id"])
    assert joined[0]["labels"].shape == (128,) * 3
    assert [len(part["object_id"]) for part in joined.iter(2)] == [2, 2, 1]
    decoded = {n for n, each in joined.features.items() if isinstance(each, PackedArray)}
    assert decoded == set(ARRAY_COLUMNS)


def test_registering_again_changes_nothing() -> None:
    factory, finders = datasets.load.dataset_module_factory, list(sys.meta_path)
    alias.register()
    assert datasets.load.dataset_module_factory is factory
    assert sys.meta_path == finders


@pytest.mark.parametrize(
    "changed",
    [
        {"DatasetModule": datasets.load.DatasetModule},
        {"dataset_module_factory": print},
        {"dataset_module_factory": print, "DatasetModule": SimpleNamespace},
    ],
)
def test_an_unknown_version_of_datasets_gives_a_warning_that_names_the_explicit_form(
    changed: dict[str, object],
) -> None:
    strange = ModuleType("datasets.load")
    vars(strange).update(changed)
    with pytest.warns(UserWarning, match=r"use xden1k\.load_dataset\(\) instead"):
        alias._patch(strange)
    assert {name: vars(strange)[name] for name in changed} == changed


def test_the_explicit_form_does_not_need_the_alias(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(datasets.load, "dataset_module_factory")
    assert xden1k.load_dataset(split="val")[0]["object_id"] == "cube-0002"
