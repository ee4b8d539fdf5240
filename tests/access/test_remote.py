"""A folder at a URL gives the rows of the folder, and fetches what is asked for."""

from __future__ import annotations

import functools
import os
import pickle
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fsspec
import numpy as np
import pyarrow as pa
import pyarrow.dataset as pds
import pytest
from click.testing import CliRunner

import xden1k
from tests.hub_server import Commit, Fault, HubServer, duplicates
from tests.phantoms import CUBE, box_object, objects
from xden1k.access.hub import ROOT_VARIABLE, data_root
from xden1k.cli import cli
from xden1k.errors import DataError, MissingExtraError
from xden1k.folder import open_folder, write_folder, write_rows
from xden1k.format import cache as caching
from xden1k.format import remote
from xden1k.format.codec import to_planes
from xden1k.format.manifest import Manifest
from xden1k.format.records import object_row
from xden1k.format.remote import RemotePath

REPO = "owner/name"
TAG = "v1.2.0"
URL = f"hf://datasets/{REPO}"
MEMORY = "memory://folder"
SIZE = 256


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("remote") / "root"
    write_folder(objects(), root, version="1.2.0", builder="test", shard_bytes=1)
    return root


@pytest.fixture(autouse=True)
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty user's cache."""
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv(ROOT_VARIABLE, raising=False)
    remote._cache_at.cache_clear()
    return tmp_path / "cache" / "xden1k" / "remote"


def content(root: Path) -> dict[str, bytes]:
    files = [path for path in root.rglob("*") if path.is_file()]
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in files}


@pytest.fixture
def on_hub(hub: HubServer, written: Path) -> HubServer:
    """The folder on the Hub, under a tag."""
    repo = hub.make(REPO, content(written))
    repo.tags[TAG] = repo.branches["main"]
    return hub


@pytest.fixture
def in_memory(written: Path) -> Iterator[fsspec.AbstractFileSystem]:
    """The folder in the memory of this process."""
    fs = fsspec.filesystem("memory")
    for name, text in content(written).items():
        fs.pipe_file(f"/folder/{name}", text)
    yield fs
    fs.rm("/folder", recursive=True)


def plain(value: Any) -> Any:
    if isinstance(value, pa.Buffer):
        return value.to_pybytes()
    if isinstance(value, dict):
        return {name: plain(each) for name, each in value.items()}
    if hasattr(value, "tobytes"):  # an array or a picture
        return str(getattr(value, "dtype", "")), value.tobytes()
    return repr(value)


def rows(root: str | Path) -> list[Any]:
    return [plain(row) for row in open_folder(root).rows()]


def test_the_rows_of_every_scheme_are_those_of_the_folder(
    on_hub: HubServer, in_memory: object, written: Path
) -> None:
    expected = rows(written)
    for url in (f"{URL}@{TAG}", URL, f"{URL}/", MEMORY, written.as_uri()):
        assert rows(url) == expected
    here, there = open_folder(written), open_folder(f"{URL}@{TAG}")
    assert there.manifest_sha256 == here.manifest_sha256
    assert [there.ids(split) for split in ("train", "test", None)] == [
        here.ids(split) for split in ("train", "test", None)
    ]
    assert there.light_column("mass_g") == pytest.approx(here.light_column("mass_g"), nan_ok=True)
    assert plain(there.row("bar-0001", ["labels"])) == plain(here.row("bar-0001", ["labels"]))
    with pytest.raises(xden1k.MissingObjectError, match=r"hf://.*did you mean bar-0001"):
        there.row("bar-001")
    with pytest.raises(DataError, match="no column"):
        there.row("bar-0001", ["nope"])


def test_torch_samples_of_a_url_are_those_of_the_folder_after_pickling_too(
    on_hub: HubServer, written: Path
) -> None:
    here, there = xden1k.XDen1K(written, "test"), xden1k.XDen1K(f"{URL}@{TAG}", "test")
    again = pickle.loads(pickle.dumps(there))  # noqa: S301
    for one, two, three in zip(here, there, again, strict=True):
        for name, value in one.items():
            for other in (two[name], three[name]):
                assert repr(value) == repr(other)
                assert not hasattr(value, "numpy") or np.array_equal(value, other, equal_nan=True)
    assert there.object("cube-0001").mass_g == pytest.approx(16)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"filters": pds.field("mass_g") > 70, "columns": ["object_id", "labels"]},
        pytest.param({"columns": ["object_id", "xray_pa"]}, marks=pytest.mark.slow),
        pytest.param(
            {"filters": [[("category", "==", "hollow")], [("object_id", "==", "bar-0002")]]},
            marks=pytest.mark.slow,
        ),
    ],
    ids=["all", "expression", "columns", "filters"],
)
def test_rows_of_datasets_are_those_of_the_folder(
    on_hub: HubServer,
    in_memory: object,
    written: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    options: dict[str, Any],
) -> None:
    import datasets

    load = functools.partial(
        xden1k.load_dataset, split="test", cache_dir=tmp_path / "arrow", **options
    )
    expected = [plain(row) for row in load(root=written)]
    others = [load(repo_id=REPO, revision=TAG, streaming=True)]
    others += [load(repo_id=REPO), load(root=MEMORY, streaming=True)] if not options else []
    for name in (URL, MEMORY) if not options else (MEMORY,):
        monkeypatch.setenv(ROOT_VARIABLE, name)
        named = functools.partial(datasets.load_dataset, "xden1k", split="test", **options)
        others += [named(streaming=True), named(cache_dir=str(tmp_path / "arrow"))]
    for other in others:
        assert [plain(row) for row in other] == expected
    assert expected


def test_the_light_table_and_infos_of_a_url_are_those_of_the_folder(
    on_hub: HubServer, written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import datasets

    monkeypatch.setenv(ROOT_VARIABLE, f"{URL}@{TAG}")
    assert datasets.get_dataset_config_names("xden1k") == ["default", "metadata"]
    light = datasets.load_dataset("xden1k", "metadata", cache_dir=str(tmp_path / "arrow"))
    same = xden1k.load_dataset("metadata", root=written, cache_dir=tmp_path / "arrow")
    assert {split: rows.column_names for split, rows in light.items()} == {
        split: rows.column_names for split, rows in same.items()
    }
    for split in light:
        assert light[split]["object_id"][:] == same[split]["object_id"][:]
    with pytest.raises(DataError, match=r"revision v9 was asked for, but hf://.* holds 1\.2\.0"):
        datasets.load_dataset("xden1k", revision="v9")
    with pytest.raises(DataError, match="is read as a whole"):
        datasets.load_dataset("xden1k", data_dir="metadata")


def noisy_rows(count: int) -> Iterator[dict[str, Any]]:
    """One object with radiographs that do not pack, under many ids."""
    rng = np.random.default_rng(0)
    row = object_row(box_object("x", CUBE, shape=(SIZE, SIZE)))
    codes = [rng.normal(40_000, 300, (SIZE, SIZE)).astype(np.uint16) for _ in range(2)]
    row |= {
        f"xray_{name}": to_planes(image) for name, image in zip(("pa", "lat"), codes, strict=True)
    }
    for number in range(count):
        split = ("train", "train", "train", "val", "test")[number % 5]
        yield row | {"object_id": f"cube-{number:04d}", "split": split}


@pytest.mark.parametrize("count", [60, pytest.param(1000, marks=pytest.mark.slow)])
def test_one_object_costs_its_own_bytes_and_a_small_directory(
    hub: HubServer, tmp_path: Path, count: int
) -> None:
    write_rows(
        noisy_rows(count), tmp_path / "many", version="1.2.0", builder="test", shard_bytes=10**7
    )
    hub.make(REPO, content(tmp_path / "many"))
    shutil.rmtree(tmp_path / "many")

    def cost(object_id: str, columns: list[str] | None = None) -> int:
        before = hub.sent("/resolve/.*/data/")
        folder.row(object_id, columns)
        return hub.sent("/resolve/.*/data/") - before

    folder = open_folder(URL)
    assert len(folder.ids()) == count
    one, two, three = folder.ids("train")[4:7]
    folder.row(one)  # opens the shard
    directory = hub.sent() - folder_bytes(folder, one)
    assert directory < 2e6
    row_bytes = folder_bytes(folder, two)
    assert row_bytes > 150_000
    assert cost(two) <= 1.3 * row_bytes
    assert cost(three, ["labels"]) < 0.1 * row_bytes
    assert cost(two) == cost(three, ["labels"]) == 0
    before = hub.sent()
    sample = xden1k.XDen1K(URL, "val", fields=["labels"])[0]
    assert sample["labels"].shape == (128,) * 3
    assert hub.sent() - before < 0.1 * row_bytes + directory


def folder_bytes(folder: Any, object_id: str) -> int:
    """Bytes of the row group of an object."""
    file, index = folder._places[object_id]
    group = folder.shard(file.path)._file.metadata.row_group(index)
    return sum(group.column(i).total_compressed_size for i in range(group.num_columns))


def test_what_was_read_is_not_fetched_again(on_hub: HubServer) -> None:
    first = rows(URL)
    lines = len(on_hub.log)
    assert rows(URL) == first
    assert [line.path for line in on_hub.log[lines:]] == [
        f"/api/datasets/{REPO}/revision/main"  # which commit is it now?
    ]
    on_hub.log.clear()
    remote._cache_at.cache_clear()
    list(open_folder(URL).objects("train"))
    assert on_hub.sent("/resolve/") == 0
    assert not duplicates([line for line in on_hub.log if "/resolve/" in line.path])


def test_a_commit_that_comes_later_does_not_change_an_open_folder(
    on_hub: HubServer, written: Path
) -> None:
    folder = open_folder(URL)
    repo = on_hub.repos[REPO]
    empty = {".gitattributes": repo.commits[repo.branches["main"]].tree[".gitattributes"]}
    repo.commit("main", Commit(repo.branches["main"], "gone", empty))
    assert [plain(row) for row in pickle.loads(pickle.dumps(folder)).rows()] == rows(written)  # noqa: S301
    assert folder.root == RemotePath(f"{URL}@{repo.tags[TAG]}")
    with pytest.raises(DataError, match=r"no manifest.json among \.gitattributes; only what xden-"):
        open_folder(URL)


def test_offline_gives_what_is_cached_or_one_line(
    on_hub: HubServer, written: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from huggingface_hub import HfFileSystem, constants

    folder = open_folder(f"{URL}@{TAG}")
    expected = [plain(folder.row(name)) for name in folder.ids("train")]
    HfFileSystem.clear_instance_cache()
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True)
    again = open_folder(f"{URL}@{TAG}")
    assert [plain(again.row(name)) for name in again.ids("train")] == expected
    with pytest.raises(DataError, match=r"^cannot read hf://.*offline mode is enabled"):
        again.row(again.ids("val")[0])
    with pytest.raises(DataError, match=r"HF_HUB_OFFLINE is set, and owner/name at v9 is not in"):
        open_folder(f"{URL}@v9")


@pytest.mark.parametrize(
    ("url", "line"),
    [
        (f"{URL}@v9", r"owner/name has no revision v9; it has \['main', 'v1\.2\.0'\]"),
        ("hf://datasets/owner/other", "the Hub has no dataset owner/other, or shows it to other"),
        ("hf://datasets/name", r"wanted hf://datasets/OWNER/NAME, with @REVISION if not main"),
        (f"{URL}/data", r"data: not a dataset folder: no manifest\.json among test-00000-of-00003"),
        ("memory://nowhere", r"memory://nowhere: not a dataset folder: .*, there is nothing"),
        ("nope://folder", "nope://folder: Protocol not known: nope"),
    ],
)
def test_a_url_that_leads_nowhere_is_one_line(on_hub: HubServer, url: str, line: str) -> None:
    with pytest.raises(DataError, match=line) as caught:
        open_folder(url)
    assert len(str(caught.value).splitlines()) == 1


def test_a_scheme_without_its_package_names_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def missing(url: str) -> None:
        raise ImportError("Install s3fs to access S3")

    monkeypatch.setattr("fsspec.core.url_to_fs", missing)
    with pytest.raises(MissingExtraError, match=r"s3:// needs more: pip install s3fs"):
        xden1k.XDen1K("s3://bucket/folder")


def test_urls_stay_urls_wherever_a_root_is_given(
    on_hub: HubServer, in_memory: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert data_root(MEMORY) == RemotePath(MEMORY)
    monkeypatch.setenv(ROOT_VARIABLE, f"{URL}@{TAG}")
    assert data_root() == RemotePath(f"{URL}@{on_hub.repos[REPO].tags[TAG]}")
    shown = CliRunner().invoke(cli, ["info", "--root", MEMORY])
    assert "train 2, val 1, test 3" in shown.stdout
    with pytest.raises(DataError, match="is a URL: this needs a folder here"):
        _ = open_folder(MEMORY).path
    refused = CliRunner().invoke(cli, ["verify", URL])
    assert (refused.exit_code, refused.stderr) == (
        1,
        f"Error: {URL} is a URL: this needs a folder here; get it by `xden download`\n",
    )
    with pytest.raises(DataError, match="root and repo_id both say"):
        xden1k.load_dataset(root=MEMORY, repo_id=REPO)


def test_a_connection_that_ends_early_is_one_line_and_the_next_try_reads(
    on_hub: HubServer, written: Path
) -> None:
    on_hub.faults = [Fault("GET /datasets/.*/data/", cut_after=100)]
    folder = open_folder(URL)
    with pytest.raises(DataError, match=r"^cannot read hf://.*/data/.*\.parquet: ") as caught:
        folder.row("bar-0001")
    assert len(str(caught.value).splitlines()) == 1
    on_hub.faults = []
    assert plain(folder.row("bar-0001")) == plain(open_folder(written).row("bar-0001"))
    on_hub.faults = [Fault("GET /datasets/.*/data/", cut_after=100, times=1)]  # the client retries
    assert folder.row("bar-0002")["object_id"] == "bar-0002"


def test_threads_that_share_a_folder_read_what_one_reads(on_hub: HubServer, written: Path) -> None:
    folder, expected = open_folder(URL), rows(written)
    found: list[list[Any]] = []
    threads = [
        threading.Thread(target=lambda: found.append([plain(row) for row in folder.rows()]))
        for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [expected] * 4


# What changes or is damaged, there or in the cache


def test_a_folder_that_changes_while_it_is_read_is_an_error(
    in_memory: fsspec.AbstractFileSystem, written: Path, tmp_path: Path
) -> None:
    write_folder(objects()[1:], tmp_path / "new", version="1.2.0", builder="new", shard_bytes=1)
    folder = open_folder(MEMORY)
    file = next(file for file in folder.manifest.files if file.path.startswith("data/test-00000"))
    for name, text in content(tmp_path / "new").items():
        in_memory.pipe_file(f"/folder/{name}", text)
    in_memory.pipe_file(f"/folder/{file.path}", b"x" * file.bytes)
    with pytest.raises(DataError, match=r"memory://folder/.*parquet.*(cut short|not the manifest)"):
        list(folder.rows())
    in_memory.rm(f"/folder/{file.path}")
    with pytest.raises(DataError, match=r"parquet is missing: the manifest lists it"):
        folder.shard(file.path)


def test_a_shard_that_was_cut_short_is_an_error(in_memory: fsspec.AbstractFileSystem) -> None:
    (file, *_) = Manifest.read(RemotePath(MEMORY)).shards()
    in_memory.pipe_file(f"/folder/{file.path}", in_memory.cat_file(f"/folder/{file.path}")[:-50])
    with pytest.raises(DataError, match=f"{file.path}.*cut short or changed"):
        rows(MEMORY)


@pytest.mark.parametrize("flips", [12, pytest.param(300, marks=pytest.mark.slow)])
def test_no_bit_that_flips_there_is_read_as_another_value(
    in_memory: fsspec.AbstractFileSystem, written: Path, kept: Path, flips: int
) -> None:
    rng, expected = np.random.default_rng(0), rows(written)
    files = content(written)
    names = sorted(files)
    sizes = np.array([len(files[name]) for name in names])
    told = 0
    for _ in range(flips):
        name = names[rng.choice(len(names), p=sizes / sizes.sum())]
        damaged = bytearray(files[name])
        damaged[rng.integers(len(damaged))] ^= 1 << int(rng.integers(8))
        in_memory.pipe_file(f"/folder/{name}", bytes(damaged))
        try:
            assert rows(MEMORY) == expected
        except DataError:
            told += 1
        in_memory.pipe_file(f"/folder/{name}", files[name])
        assert rows(MEMORY) == expected  # what was damaged has not been kept
        shutil.rmtree(kept, ignore_errors=True)
    assert told > flips / 3


def test_a_piece_that_the_disk_has_damaged_is_fetched_again(
    in_memory: object, written: Path, kept: Path
) -> None:
    expected = rows(MEMORY)
    pieces = [path for path in kept.rglob("*") if path.is_file()]
    assert len(pieces) > 20
    for path in pieces:
        text = bytearray(path.read_bytes())
        text[len(text) // 2] ^= 1
        path.write_bytes(text)
    assert rows(MEMORY) == expected == rows(written)


def test_the_cache_keeps_to_its_limit_and_drops_the_oldest(tmp_path: Path) -> None:
    cache = caching.PieceCache(tmp_path / "pieces", 10_000)
    for number in range(40):
        cache.put(f"shards/{number:02d}", bytes(1000))
        os.utime(tmp_path / "pieces" / "shards" / f"{number:02d}", ns=(number, number))
    left = sorted(path.name for path in (tmp_path / "pieces" / "shards").iterdir())
    assert len(left) * 1004 <= 10_000
    assert left == [f"{number:02d}" for number in range(40 - len(left), 40)]
    assert cache.get("shards/39") == bytes(1000)
    assert cache.get("shards/00") is None
    cache.put("large", bytes(10_001))
    assert cache.get("large") is None


def test_a_limit_of_nothing_keeps_nothing_and_reads_the_same(
    in_memory: object, written: Path, kept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(caching.LIMIT_VARIABLE, "0")
    assert rows(MEMORY) == rows(written)
    assert not kept.exists()
    for wrong in ("much", "-1", "nan", "inf"):
        monkeypatch.setenv(caching.LIMIT_VARIABLE, wrong)
        with pytest.raises(DataError, match=f"XDEN1K_CACHE_GB must be a number.*'{wrong}'"):
            rows(MEMORY)


def test_a_cache_without_room_is_said_once_and_reading_goes_on(
    in_memory: object, written: Path, kept: Path, caplog: pytest.LogCaptureFixture
) -> None:
    kept.parent.mkdir(parents=True)
    kept.write_text("a file where the folder should be")
    assert rows(MEMORY) == rows(written)
    (said,) = caplog.messages
    assert said.startswith(f"what is read is not kept in {kept}: ")
