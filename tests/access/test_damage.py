"""A bit that a disk has lost is an error, or changes nothing: never other values."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from datasets.exceptions import DatasetGenerationError

import xden1k
from tests.phantoms import objects
from xden1k.access import rows
from xden1k.access.dataset import XDen1K
from xden1k.errors import DataError, XDenError
from xden1k.folder import open_folder, write_folder
from xden1k.folder.verify import verify_folder
from xden1k.format.checksums import CHECKSUMS_NAME
from xden1k.format.shards import ShardReader

SPLIT = "test"
SHARD = "data/test-00000-of-00002.parquet"
FLIPS = 12
MANY_FLIPS = 1000


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two objects in one split."""
    out = tmp_path_factory.mktemp("sound") / "folder"
    write_folder(objects()[4:], out, version="1.2.0", builder="test")
    return out


@contextmanager
def flipped(path: Path, byte: int, bit: int) -> Iterator[None]:
    """Change one bit of a file for a while."""
    whole = path.read_bytes()
    damaged = bytearray(whole)
    damaged[byte] ^= 1 << bit
    path.write_bytes(damaged)
    try:
        yield
    finally:
        path.write_bytes(whole)


def by_folder(root: Path) -> list[Any]:
    return [sorted((k, as_bytes(v)) for k, v in row.items()) for row in open_folder(root).rows()]


def by_torch(root: Path) -> list[Any]:
    return [sorted((k, as_bytes(v)) for k, v in sample.items()) for sample in XDen1K(root, SPLIT)]


def by_stream(root: Path) -> list[Any]:
    rows = xden1k.load_dataset(split=SPLIT, root=root, streaming=True)
    return [sorted((k, as_bytes(v)) for k, v in row.items()) for row in rows]


def as_bytes(value: Any) -> Any:
    if isinstance(value, pa.Buffer):
        return value.to_pybytes()
    return value.tobytes() if hasattr(value, "tobytes") else repr(value)


REFUSALS = (XDenError, DatasetGenerationError)


def silent_changes(root: Path, read: Callable[[Path], list[Any]], flips: int) -> list[Any]:
    """Flips, by file, byte and bit, after which other values were read without a word."""
    rng, expected = np.random.default_rng(0), read(root)
    files = [path for path in sorted(root.rglob("*")) if path.is_file()]
    sizes = np.array([path.stat().st_size for path in files])
    silent = []
    for _ in range(flips):
        path = files[rng.choice(len(files), p=sizes / sizes.sum())]
        byte, bit = int(rng.integers(path.stat().st_size)), int(rng.integers(8))
        with flipped(path, byte, bit):
            try:
                found = read(root)
            except REFUSALS:
                continue
        if found != expected:
            silent.append((path.name, byte, bit))
    return silent


@pytest.mark.parametrize(
    "read", [by_folder, by_torch, pytest.param(by_stream, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("flips", [FLIPS, pytest.param(MANY_FLIPS, marks=pytest.mark.slow)])
def test_no_flipped_bit_of_any_file_is_read_as_another_value(
    sound: Path, tmp_path: Path, read: Callable[[Path], list[Any]], flips: int
) -> None:
    root = Path(shutil.copytree(sound, tmp_path / "folder"))
    assert silent_changes(root, read, flips) == []


@pytest.mark.parametrize("flips", [FLIPS, pytest.param(MANY_FLIPS, marks=pytest.mark.slow)])
def test_verification_finds_every_flipped_bit(sound: Path, tmp_path: Path, flips: int) -> None:
    root = Path(shutil.copytree(sound, tmp_path / "folder"))
    rng = np.random.default_rng(1)
    files = [path for path in sorted(root.rglob("*")) if path.is_file()]
    for _ in range(flips):
        path = files[int(rng.integers(len(files)))]
        byte, bit = int(rng.integers(path.stat().st_size)), int(rng.integers(8))
        with flipped(path, byte, bit):
            assert verify_folder(root), (path.name, byte, bit)


def test_a_page_that_was_damaged_is_named_with_its_object(sound: Path, tmp_path: Path) -> None:
    root = Path(shutil.copytree(sound, tmp_path / "folder"))
    shard = root / SHARD
    with (
        flipped(shard, shard.stat().st_size // 3, 0),
        pytest.raises(DataError, match=rf"{shard}: cannot read [\w-]+ \(row group \d\): .*CRC"),
    ):
        by_folder(root)


@pytest.mark.parametrize("streaming", [True, False])
@pytest.mark.parametrize("verifies_pages", [rows.VERIFIES_PAGES, False])
def test_rows_of_datasets_name_the_damaged_object_too(
    sound: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    streaming: bool,
    verifies_pages: bool,
) -> None:
    monkeypatch.setattr(rows, "VERIFIES_PAGES", verifies_pages)  # False: before datasets 4.2
    root = Path(shutil.copytree(sound, tmp_path / "folder"))
    shard = root / SHARD
    with (
        flipped(shard, shard.stat().st_size // 3, 0),
        pytest.raises(DataError, match=rf"{shard.name}: cannot read [\w-]+ \(row group \d\)"),
    ):
        list(
            xden1k.load_dataset(
                split=SPLIT, root=root, streaming=streaming, cache_dir=tmp_path / "cache"
            )
        )


def test_a_footer_that_was_damaged_is_refused_before_anything_is_read(
    sound: Path, tmp_path: Path
) -> None:
    root = Path(shutil.copytree(sound, tmp_path / "folder"))
    shard = root / SHARD
    with (
        flipped(shard, shard.stat().st_size - 100, 0),
        pytest.raises(DataError, match=r"its footer is not the manifest's"),
    ):
        by_folder(root)


@pytest.mark.parametrize("name", ["manifest.json", "README.md"])
def test_a_document_that_was_changed_is_refused(sound: Path, tmp_path: Path, name: str) -> None:
    root = Path(shutil.copytree(sound, tmp_path / "folder"))
    with (
        flipped(root / name, 200, 0),
        pytest.raises(DataError, match=rf"{name}: its sha256 is not the one in {CHECKSUMS_NAME}"),
    ):
        xden1k.load_dataset(split=SPLIT, root=root, streaming=True)


def test_files_without_page_checksums_stay_readable(sound: Path, tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    table = pq.read_table(sound / SHARD)
    old = tmp_path / "old.parquet"
    pq.write_table(table, old, row_group_size=1, compression="zstd", use_dictionary=False)
    assert [row["object_id"] for row in ShardReader(old)] == table["object_id"].to_pylist()


def test_threads_that_share_a_dataset_read_what_one_thread_reads(sound: Path) -> None:
    dataset = XDen1K(sound, SPLIT)
    expected = [sample["labels"].numpy().tobytes() for sample in dataset]
    wrong: list[int] = []
    start = threading.Barrier(8)

    def read(number: int) -> None:
        start.wait()
        for turn in range(20):
            index = (number + turn) % len(expected)
            if dataset[index]["labels"].numpy().tobytes() != expected[index]:
                wrong.append(index)

    threads = [threading.Thread(target=read, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []
