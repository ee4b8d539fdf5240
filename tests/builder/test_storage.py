"""Captures, work files and datasets at URLs: the same bytes as at paths."""

import shutil
from pathlib import Path

import fsspec
import pytest

from tests.builder.folders import contents
from xden1k.errors import DataError
from xden1k.folder import open_folder
from xden_builder.capture import CaptureFolder
from xden_builder.phantoms import write_captures
from xden_builder.pipeline.run import build
from xden_builder.pipeline.storage import (
    dataset_path,
    object_capture,
    object_rows,
    read_bytes,
    refuse_other_folders,
)
from xden_builder.reconstruct.settings import BuildSettings

pytestmark = pytest.mark.usefixtures("in_this_process")


@pytest.fixture(scope="module")
def captures(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("captures") / "captures"
    write_captures(root, 2, 5, size=64, categories=["hammer", "mug"])
    return root


@pytest.fixture
def memory():
    """An object store that lives in this process."""
    store = fsspec.filesystem("memory")
    yield store
    store.rm("/", recursive=True)


def stored(store, root: str) -> dict[str, bytes]:
    return {path.removeprefix(f"{root}/"): store.cat_file(path) for path in store.find(root)}


def put(store, folder: Path, root: str) -> None:
    for name, data in contents(folder).items():
        store.pipe_file(f"{root}/{name}", data)


def test_an_object_fetched_from_a_url_has_the_digest_it_has_at_its_path(captures, memory):
    put(memory, captures, "/captures")
    folder = CaptureFolder(captures)
    assert object_rows("memory://captures") == folder.rows
    for object_id, row in folder.rows.items():
        with object_capture("memory://captures/", None, row) as fetched:
            assert fetched.root != captures
            assert fetched.digest(object_id) == folder.digest(object_id)
            assert len(fetched.read(object_id).parts) == len(folder.read(object_id).parts)
        assert not fetched.root.exists(), "the copy stayed"


def test_only_what_a_rebuild_reads_is_fetched(captures, memory):
    put(memory, captures, "/captures")
    object_id, row = next(iter(CaptureFolder(captures).rows.items()))
    memory.pipe_file(f"/captures/{object_id}/ct.npz", b"large")
    with object_capture("memory://captures", None, row) as fetched:
        names = {path.name for path in fetched.root.rglob("*") if path.is_file()}
        assert [path.name for path in fetched.root.iterdir() if path.is_dir()] == [object_id]
    assert not {"ct.npz", "truth.json", "objects.csv"} & names


def test_other_part_meshes_come_from_their_own_url(captures, memory, tmp_path):
    object_id, row = next(iter(CaptureFolder(captures).rows.items()))
    other = tmp_path / "other"
    shutil.copytree(captures / object_id / "parts", other / object_id / "parts")
    moved = next((other / object_id / "parts").iterdir())
    moved.rename(moved.with_stem("renamed"))
    put(memory, other, "/other")
    local = CaptureFolder(captures, other)
    with object_capture(captures, "memory://other", row) as fetched:
        assert fetched.root == captures
        assert fetched.digest(object_id) == local.digest(object_id)


def test_what_is_wrong_with_a_copy_is_said_of_the_url(captures, memory):
    put(memory, captures, "/captures")
    object_id, row = next(iter(CaptureFolder(captures).rows.items()))
    memory.rm_file(f"/captures/{object_id}/lat.tif")
    with (
        pytest.raises(DataError, match=f"^memory://captures/{object_id}/lat.tif"),
        object_capture("memory://captures", None, row) as fetched,
    ):
        fetched.read(object_id)
    with pytest.raises(DataError, match=r"^memory://nowhere/objects\.csv"):
        object_rows("memory://nowhere")


def write_dataset(folder: Path, **files: str) -> None:
    (folder / "data").mkdir(parents=True)
    (folder / "manifest.json").write_text("{}")
    for name, text in files.items():
        (folder / "data" / name).write_text(text)


def test_an_older_dataset_at_a_url_is_replaced_as_a_whole(memory):
    with dataset_path("memory://out/dataset") as folder:
        write_dataset(folder, one="1", two="2")
    with dataset_path("memory://out/dataset") as folder:
        write_dataset(folder, one="3")
    assert stored(memory, "/out/dataset") == {"manifest.json": b"{}", "data/one": b"3"}


def test_a_dataset_half_way_to_a_url_is_none_and_may_be_replaced(memory, monkeypatch, tmp_path):
    def broken(*_):
        raise ConnectionError("gone")

    out = "memory://out/dataset"
    with dataset_path(out) as folder:
        write_dataset(folder, one="1")
    monkeypatch.setattr(type(memory), "put_file", broken)
    with pytest.raises(ConnectionError), dataset_path(out) as folder:
        write_dataset(folder, one="2")
    assert read_bytes(f"{out}/manifest.json") == b""
    memory.get("/out/dataset", str(tmp_path / "seen"), recursive=True)
    with pytest.raises(DataError, match=r"manifest\.json"):
        open_folder(tmp_path / "seen")
    refuse_other_folders(out)


def test_what_is_no_dataset_at_a_url_is_not_replaced(memory):
    memory.pipe_file("/out/thesis.tex", b"years of work")
    with pytest.raises(DataError, match="memory://out is not a dataset folder"):
        refuse_other_folders("memory://out")


def test_a_rebuild_from_and_to_urls_gives_the_same_bytes_and_resumes(captures, tmp_path):
    build(captures, tmp_path / "at_path", BuildSettings(), workers=2)
    for status in ("built", "kept"):
        report = build(
            f"file://{captures}", f"file://{tmp_path}/at_url", BuildSettings(), workers=2
        )
        assert report.count(status) == 2
        assert contents(tmp_path / "at_url") == contents(tmp_path / "at_path")
