"""What was pushed gives the rows of the folder by every way in, bit for bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import xden1k
from tests.hub_server import HubServer
from tests.phantoms import objects
from xden1k.access.hub import ROOT_VARIABLE, download
from xden1k.folder import open_folder, verify, write_folder
from xden1k.format import remote
from xden1k.format.schema import ARRAY_COLUMNS
from xden_builder.pipeline.publish import push

REPO = "owner/name"
TAG = "v1.2.0"
URL = f"hf://datasets/{REPO}@{TAG}"
pytestmark = pytest.mark.filterwarnings("ignore:Use 'content=:DeprecationWarning")  # the client's


@pytest.fixture
def root(hub: HubServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that was pushed."""
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("HF_DATASETS_CACHE", str(tmp_path / "arrow"))
    monkeypatch.delenv(ROOT_VARIABLE, raising=False)
    monkeypatch.setattr(verify, "CAN_LABEL", False)
    remote._cache_at.cache_clear()
    write_folder(objects()[1:5], tmp_path / "root", version="1.2.0", builder="test", shard_bytes=1)
    push(tmp_path / "root", REPO)
    return tmp_path / "root"


def plain(value: Any) -> Any:
    return bytes(value) if hasattr(value, "to_pybytes") else repr(value)


def rows(root: str | Path) -> list[dict[str, Any]]:
    return [{k: plain(v) for k, v in row.items()} for row in open_folder(root).rows()]


def test_a_download_gives_the_rows_and_becomes_the_root(root: Path) -> None:
    here = download(REPO, TAG)
    assert xden1k.data_root() == here
    assert verify.verify_folder(here) == []
    assert rows(here) == rows(URL) == rows(root)


@pytest.mark.slow
def test_rows_of_datasets_and_torch_are_the_folders(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = {"split": "test", "cache_dir": tmp_path / "arrow"}
    expected = list(xden1k.load_dataset(root=root, **options))
    for found in (
        xden1k.load_dataset(repo_id=REPO, revision=TAG, **options),
        xden1k.load_dataset(repo_id=REPO, revision=TAG, streaming=True, **options),
    ):
        for one, two in zip(expected, found, strict=True):
            assert one.keys() == two.keys()
            for name, value in one.items():
                assert np.array_equal(np.asarray(value), np.asarray(two[name])) or (
                    repr(value) == repr(two[name])
                )
    monkeypatch.setenv(ROOT_VARIABLE, URL)
    samples = list(xden1k.XDen1K(split="train"))
    for one, two in zip(xden1k.XDen1K(root, "train"), samples, strict=True):
        assert repr(one) == repr(two)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the reader, by its libraries
def test_croissant_reads_the_rows_from_the_hub(
    hub: HubServer, root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import mlcroissant
    from mlcroissant._src.operation_graph.operations import download as downloading

    cache = type(downloading.constants.DOWNLOAD_PATH)(tmp_path / "croissant")
    cache.mkdir()
    monkeypatch.setattr(downloading.constants, "DOWNLOAD_PATH", cache)
    document = f"{hub.url}/datasets/{REPO}/resolve/{TAG}/croissant.json"
    described = mlcroissant.Dataset(jsonld=document)
    assert not described.metadata.issues.errors
    assert not described.metadata.issues.warnings
    assert described.metadata.date_published
    assert "Software Collection" in described.metadata.data_collection_type
    folder, found = open_folder(root), []
    for file in folder.manifest.shards():
        name = f"default/{Path(file.path).stem}"
        for record in described.records(name):
            found.append(record[f"{name}/object_id"].decode())
            stored = folder.row(found[-1])
            for column in ARRAY_COLUMNS:
                value = stored[column] and stored[column].to_pybytes()
                assert record[f"{name}/{column}"] == value
            mass = record[f"{name}/mass_g"]
            assert (np.nan if mass is None else mass) == pytest.approx(
                stored["mass_g"], nan_ok=True
            )
    assert sorted(found) == sorted(folder.ids())
    light = [record["metadata/test/object_id"] for record in described.records("metadata/test")]
    assert [each.decode() for each in light] == list(folder.ids("test"))
