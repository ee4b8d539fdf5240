"""A dataset folder: written whole or not at all, and read object by object."""

from __future__ import annotations

import json
import multiprocessing
import os
import pickle
import re
import signal
import subprocess
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from tests import phantoms
from tests.strategies import density_objects
from xden1k.errors import DataError, MissingObjectError
from xden1k.folder import open_folder, write_folder, write_rows
from xden1k.format.manifest import Disturbed, Manifest
from xden1k.format.records import decode_array, object_row
from xden1k.format.schema import DATA_SCHEMA
from xden1k.format.shards import ShardWriter
from xden1k.values.types import DensityObject

RELEASE = {"version": "1.2.3", "builder": "test 1"}


@pytest.fixture(scope="module")
def rows() -> list[dict[str, Any]]:
    return [object_row(obj) for obj in phantoms.objects()]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, rows: list[dict[str, Any]]) -> Path:
    out = tmp_path_factory.mktemp("dataset") / "folder"
    write_rows(rows, out, **RELEASE)
    return out


def contents(folder: Path) -> dict[str, bytes]:
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


@settings(max_examples=8, deadline=None)
@given(st.lists(density_objects(), min_size=1, max_size=3, unique_by=lambda obj: obj.object_id))
def test_every_column_survives_writing_and_reading(
    tmp_path_factory: pytest.TempPathFactory, objects: list[DensityObject]
) -> None:
    rows = [object_row(obj) for obj in sorted(objects, key=lambda obj: obj.object_id)]
    out = tmp_path_factory.mktemp("dataset") / "folder"
    write_rows(rows, out, **RELEASE)
    dataset = open_folder(out)
    assert set(dataset.ids()) == {row["object_id"] for row in rows}
    for row in rows:
        stored = dataset.row(row["object_id"])
        assert list(stored) == list(row)
        for name, value in row.items():
            plain = bytes(stored[name]) if isinstance(value, bytes) else stored[name]
            assert repr(plain) == repr(value), name


def test_writing_twice_gives_the_same_bytes(tmp_path: Path, folder: Path) -> None:
    write_folder(phantoms.objects(), tmp_path / "again", **RELEASE)
    assert contents(tmp_path / "again") == contents(folder)


def test_objects_written_read_and_written_again_give_the_same_bytes(
    tmp_path: Path, folder: Path
) -> None:
    objects = sorted(open_folder(folder).objects(), key=lambda obj: obj.object_id)
    write_folder(objects, tmp_path / "again", **RELEASE)
    assert contents(tmp_path / "again") == contents(folder)


def breaking_off(rows: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    yield from rows[:4]
    raise KeyboardInterrupt


def test_an_interrupted_write_leaves_nothing(tmp_path: Path, rows: list[dict[str, Any]]) -> None:
    with pytest.raises(KeyboardInterrupt):
        write_rows(breaking_off(rows), tmp_path / "out", **RELEASE)
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_write_leaves_the_older_folder(
    tmp_path: Path, rows: list[dict[str, Any]]
) -> None:
    write_rows(rows[:2], tmp_path / "out", **RELEASE)
    before = contents(tmp_path / "out")
    with pytest.raises(KeyboardInterrupt):
        write_rows(breaking_off(rows), tmp_path / "out", **RELEASE)
    assert contents(tmp_path / "out") == before
    assert os.listdir(tmp_path) == ["out"]


def killed_in_mid_write(out: Path) -> None:
    def rows() -> Iterator[dict[str, Any]]:
        yield object_row(phantoms.objects()[0])
        os.kill(os.getpid(), signal.SIGKILL)

    write_rows(rows(), out, **RELEASE)


@pytest.mark.slow
def test_a_killed_write_leaves_nothing_visible(tmp_path: Path) -> None:
    process = multiprocessing.get_context("spawn").Process(
        target=killed_in_mid_write, args=(tmp_path / "out",)
    )
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    assert not (tmp_path / "out").exists()
    assert all(path.name.startswith(".out.") for path in tmp_path.iterdir())


def test_an_older_dataset_is_replaced_as_a_whole(
    tmp_path: Path, rows: list[dict[str, Any]]
) -> None:
    write_rows(rows, tmp_path / "out", **RELEASE)
    (tmp_path / "out" / "stray").write_text("")
    write_rows(rows[:1], tmp_path / "out", **RELEASE)
    assert open_folder(tmp_path / "out").ids() == ("bar-0001",)
    assert not (tmp_path / "out" / "stray").exists()
    assert os.listdir(tmp_path) == ["out"]


def test_a_folder_of_something_else_is_not_replaced(
    tmp_path: Path, rows: list[dict[str, Any]]
) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(DataError, match="is not a dataset folder: remove it yourself"):
        write_rows(rows, tmp_path, **RELEASE)
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


@pytest.mark.parametrize(
    ("order", "change", "message"),
    [
        ([1, 0], {}, "ascending: bar-0001 after bar-0002"),
        ([0, 0], {}, "ascending: bar-0001 after bar-0001"),
        ([], {}, "no objects"),
        ([0], {"object_id": "a/b"}, "object_id must be of A-Z"),
        ([0], {"split": "validation"}, "bar-0001: split must be one of"),
    ],
)
def test_rows_that_make_no_dataset_are_refused(
    tmp_path: Path,
    rows: list[dict[str, Any]],
    order: list[int],
    change: dict[str, Any],
    message: str,
) -> None:
    with pytest.raises(DataError, match=message):
        write_rows([rows[i] | change for i in order], tmp_path / "out", **RELEASE)
    assert list(tmp_path.iterdir()) == []


def test_a_version_that_is_no_version_is_refused(
    tmp_path: Path, rows: list[dict[str, Any]]
) -> None:
    with pytest.raises(DataError, match=r"MAJOR\.MINOR\.PATCH, got 'v1'"):
        write_rows(rows, tmp_path / "out", version="v1", builder="test")


@pytest.mark.parametrize(
    ("objects", "shard_rows", "shards"),
    [
        (3, 9, [1, 1, 1]),
        (11, 2, [2, 2, 2, 2, 2, 1]),
        *(
            pytest.param(*one, marks=pytest.mark.slow)
            for one in (
                (1, 9, [1]),
                (7, 9, [1, 2, 2, 2]),
                (7, 4, [1, 2, 2, 2]),
                (7, 1, [1, 1, 1, 1, 1, 1, 1]),
            )
        ),
    ],
)
def test_a_split_has_four_shards_where_it_can_and_more_where_it_is_large(
    tmp_path: Path, rows: list[dict[str, Any]], objects: int, shard_rows: int, shards: list[int]
) -> None:
    small = rows[0] | {"occupancy": bytes(9999)}
    many = [small | {"object_id": f"bar-{i:04d}"} for i in range(objects)]
    with closing(ShardWriter(tmp_path / "one.parquet", DATA_SCHEMA)) as shard:
        shard.write(small)
        size = shard.file_bytes
    root = write(tmp_path / "many", many, shard_bytes=shard_rows * size - size // 2)
    files = Manifest.read(root).shards()
    assert [file.rows for file in files] == shards
    assert [file.path for file in files] == [
        f"data/train-{i:05d}-of-{len(shards):05d}.parquet" for i in range(len(shards))
    ]
    assert len(list(root.glob("data/*"))) == len(shards)
    assert open_folder(root).ids("train") == tuple(row["object_id"] for row in many)


def write(out: Path, rows: list[dict[str, Any]], **more: Any) -> Path:
    write_rows(rows, out, **RELEASE, **more)
    return out


def test_a_copy_with_disturbed_radiographs_says_so_and_no_other_folder_has_a_word_of_it(
    folder: Path, rows: list[dict[str, Any]], tmp_path: Path
) -> None:
    told = Disturbed("were shifted by 3 px", seed=7, of="0123456789abcdef")
    copy = write(tmp_path / "copy", rows, disturbed=told)
    assert Manifest.read(copy).disturbed == told
    assert Manifest.read(folder).disturbed is None
    said = "manifest `0123456789ab` in which radiographs were shifted by 3 px (seed 7)"
    for name in ("README.md", "DATASHEET.md", "croissant.json"):
        assert said in (copy / name).read_text(encoding="utf-8"), name
    assert "disturbed radiographs" in (copy / "CITATION.cff").read_text(encoding="utf-8")
    assert not [name for name, data in contents(folder).items() if b"isturbed" in data]


def test_an_object_is_found_in_any_split(folder: Path) -> None:
    dataset = open_folder(folder)
    assert dataset.ids("test") == ("bar-0002", "filled-0001", "hollow-0001")
    assert set(dataset.ids()) == {obj.object_id for obj in phantoms.objects()}
    assert dataset.object("bar-0001").mass_g == pytest.approx(72)
    assert [row["object_id"] for row in dataset.rows("val", ["object_id"])] == ["cube-0002"]
    assert dataset.light_column("object_id") == list(dataset.ids())


def test_a_missing_object_or_split_is_named_with_what_there_is(folder: Path) -> None:
    with pytest.raises(MissingObjectError, match="no object 'bar-003' among 6; did you mean bar-"):
        open_folder(folder).object("bar-003")
    with pytest.raises(DataError, match=r"no split 'dev'; there are \['train', 'val', 'test'\]"):
        open_folder(folder).ids("dev")


def test_a_folder_without_a_manifest_is_no_dataset(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"not a dataset folder: no manifest\.json"):
        open_folder(tmp_path)
    (tmp_path / "manifest.json").write_text('{"schema": "other/1"}')
    with pytest.raises(DataError, match="schema is other/1"):
        open_folder(tmp_path)


def test_a_shard_cut_short_is_named_with_both_sizes(
    tmp_path: Path, rows: list[dict[str, Any]]
) -> None:
    shard = write(tmp_path / "out", rows) / "data/train-00000-of-00002.parquet"
    shard.write_bytes(shard.read_bytes()[:-1])
    with pytest.raises(DataError, match=r"train-0.*: \d+ bytes, the manifest says \d+: cut short"):
        open_folder(tmp_path / "out").object("bar-0001")


def test_a_copy_in_another_process_opens_its_own_files(folder: Path) -> None:
    dataset = open_folder(folder)
    dataset.row("bar-0001", ["mass_g"])
    copy = pickle.loads(pickle.dumps(dataset))  # noqa: S301
    assert copy._readers.of == {}
    assert copy.row("bar-0001", ["mass_g"]) == {"mass_g": 72.0}


def test_checksums_are_those_of_the_usual_tool(folder: Path) -> None:
    command = ["sha256sum", "--check", "--strict", "SHA256SUMS"]
    ran = subprocess.run(command, cwd=folder, capture_output=True)  # noqa: S603
    assert ran.returncode == 0, ran.stdout
    listed = {line.split("  ")[1] for line in (folder / "SHA256SUMS").read_text().splitlines()}
    assert listed == set(contents(folder)) - {"SHA256SUMS"}


def card(folder: Path) -> dict[str, Any]:
    text = (folder / "README.md").read_text(encoding="utf-8")
    return yaml.safe_load(text.split("---\n")[1])


@pytest.mark.parametrize(("number", "config"), [(0, "default"), (1, "metadata")])
def test_card_gives_the_features_and_sizes_that_datasets_finds(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, config: str
) -> None:
    from datasets import Features, load_dataset

    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    names, info = card(folder)["configs"][number], card(folder)["dataset_info"][number]
    assert names["config_name"] == info["config_name"] == config
    files = {each["split"]: str(folder / each["path"]) for each in names["data_files"]}
    # the plain Parquet builder: what somebody without this package gets
    loaded = load_dataset("parquet", data_files=files, cache_dir=str(tmp_path))
    for split in info["splits"]:
        rows = loaded[split["name"]]
        assert rows.features == Features._from_yaml_list(info["features"])
        assert split["num_examples"] == rows.num_rows
        # but for validity bitmaps, which come and go with batches
        found = rows.info.splits[split["name"]].num_bytes
        assert split["num_bytes"] == pytest.approx(found, abs=32 * rows.num_rows)


def test_card_snippet_decodes_without_the_package(folder: Path, rows: list[dict[str, Any]]) -> None:
    text = (folder / "README.md").read_text(encoding="utf-8")
    (snippet,) = re.findall(r"```python\n(import numpy.*?)```", text, re.DOTALL)
    names: dict[str, Any] = {"row": rows[0]}
    exec(snippet, names)  # noqa: S102
    np.testing.assert_allclose(names["transmission"], decode_array(rows[0], "xray_pa"), rtol=1e-6)
    np.testing.assert_array_equal(names["labels"], decode_array(rows[0], "labels"))


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the reader, by its libraries
def test_croissant_file_is_valid_and_reads_the_rows(folder: Path) -> None:
    import mlcroissant

    described = mlcroissant.Dataset(jsonld=str(folder / "croissant.json"))
    assert not described.metadata.issues.errors
    (warning,) = described.metadata.issues.warnings
    assert "datePublished" in warning  # which comes with publishing
    assert described.metadata.data_limitations[0] in (folder / "DATASHEET.md").read_text("utf-8")
    masses = {
        row["default/object_id"].decode(): row["default/mass_g"]
        for row in described.records("default")
    }
    assert masses["bar-0001"] == pytest.approx(72)
    assert len(masses) == 6
    assert len(list(described.records("metadata"))) == 6
    files = json.loads((folder / "croissant.json").read_text(encoding="utf-8"))["distribution"]
    sums = {file["@id"]: file["sha256"] for file in files if "sha256" in file}
    assert sums == {file.path: file.sha256 for file in Manifest.read(folder).files}


def test_documents_say_that_simulated_objects_are_simulated(
    tmp_path: Path, folder: Path, rows: list[dict[str, Any]]
) -> None:
    write(tmp_path / "scans", [row | {"source": "scan"} for row in rows])
    for name in ("README.md", "DATASHEET.md"):
        claim = "simulated, which were never on a scanner"
        assert claim in (folder / name).read_text(encoding="utf-8")
        assert claim not in (tmp_path / "scans" / name).read_text(encoding="utf-8")


def test_citation_and_registration_are_yaml_of_the_known_forms(folder: Path) -> None:
    citation = yaml.safe_load((folder / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["cff-version"] == "1.2.0"
    assert citation["preferred-citation"]["authors"]
    tasks = yaml.safe_load((folder / "eval.yaml").read_text(encoding="utf-8"))["tasks"]
    assert [task["id"] for task in tasks] == ["density-mae", "com-l1", "mass-mape"]
