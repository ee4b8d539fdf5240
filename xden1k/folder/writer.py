"""Write a dataset folder: whole, or not at all."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from itertools import islice, pairwise
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from xden1k.documents.facts import read_facts
from xden1k.documents.maintainer import Answers
from xden1k.errors import DataError
from xden1k.folder.documents import write_documents
from xden1k.folder.place import publish, staging
from xden1k.format.checksums import file_sha256, footer_sha256
from xden1k.format.label_counts import LABEL_COUNTS, label_counts
from xden1k.format.manifest import MANIFEST_NAME, DataFile, Disturbed, Manifest
from xden1k.format.records import has_radiographs, object_row
from xden1k.format.schema import DATA_SCHEMA, METADATA_SCHEMA
from xden1k.format.shapes import is_on_partnext
from xden1k.format.shards import ShardReader, ShardWriter
from xden1k.values.types import ALL_SPLITS, DensityObject

__all__ = [
    "OBJECT_ID",
    "SHARD_BYTES",
    "refuse_to_replace_others",
    "write_folder",
    "write_rows",
]

SHARD_BYTES = 128 << 20
"""A shard is closed by the row that makes it this large: about fifty objects of 2.5 MB."""
FEWEST_SHARDS = 4
"""Of a split, unless it has fewer objects: processes that read together share out whole shards."""
METADATA_GROUP_ROWS = 64
OBJECT_ID = re.compile(r"[A-Za-z0-9._-]+")
NO_ANSWERS: Final = Answers()


def write_folder(
    objects: Iterable[DensityObject],
    out: Path,
    *,
    version: str,
    builder: str,
    config_sha256: str = "",
    shard_bytes: int = SHARD_BYTES,
    answers: Answers = NO_ANSWERS,
) -> Manifest:
    """Write objects as a dataset folder; see :func:`write_rows`."""
    return write_rows(
        map(object_row, objects),
        out,
        version=version,
        builder=builder,
        config_sha256=config_sha256,
        shard_bytes=shard_bytes,
        answers=answers,
    )


def write_rows(
    rows: Iterable[Mapping[str, Any]],
    out: Path,
    *,
    version: str,
    builder: str,
    config_sha256: str = "",
    shard_bytes: int = SHARD_BYTES,
    answers: Answers = NO_ANSWERS,
    disturbed: Disturbed | None = None,
    more: Callable[[str], Mapping[str, str]] = lambda _: {},
) -> Manifest:
    """Write encoded rows as a dataset folder.

    Rows are taken one at a time and go straight to the disk. The folder is built beside ``out``
    and renamed when it is complete, so that ``out`` is there whole or not at all; an older
    dataset folder is replaced as a whole, on Linux in one step. What a killed writer left beside
    ``out`` is removed. The same rows and arguments give the same bytes.

    Parameters
    ----------
    rows
        From :func:`xden1k.format.records.object_row`, in ascending order of ``object_id``.
    out
        The folder to make.
    version
        Of the data, ``MAJOR.MINOR.PATCH``.
    builder
        Name and version of the program that made the rows.
    config_sha256
        Checksum of its settings.
    shard_bytes
        A shard is closed by the row that makes it this large.
    answers
        What the maintainer says in the datasheet; kept in the folder.
    disturbed
        What was done to the radiographs, where the rows are copies.
    more
        Gives further documents, name and text, for the checksum of the manifest.

    Returns
    -------
    Manifest
        What was written.

    Raises
    ------
    DataError
        If there is no row, an id is not ascending or has other characters than
        ``[A-Za-z0-9._-]``, a row breaks the format, the version is not of its form, or ``out``
        is something else than a dataset folder.
    """
    if not re.fullmatch(r"\d+\.\d+\.\d+", version):
        raise DataError(f"version must be MAJOR.MINOR.PATCH, got {version!r}")
    out = out.resolve()
    refuse_to_replace_others(out)
    out.parent.mkdir(parents=True, exist_ok=True)
    with staging(out) as beside:
        root = beside / "folder"
        tally = _Tally()
        files = _write_shards(map(tally.counted, _ascending(rows)), root, shard_bytes)
        rows_in = {file.split: file.rows for file in files if file.config == "metadata"}
        manifest = Manifest(
            version=version,
            builder=builder,
            config_sha256=config_sha256,
            splits={split: rows_in[split] for split in ALL_SPLITS if split in rows_in},
            sources=dict(sorted(tally.sources.items())),
            density_sources=dict(sorted(tally.density_sources.items())),
            files=files,
            labels={name: tally.labels[name] for name in LABEL_COUNTS},
            without_radiographs=dict(sorted(tally.without_radiographs.items())),
            disturbed=disturbed,
            on_partnext=tally.on_partnext,
        )
        write_documents(root, read_facts(root, manifest, answers), more)
        for path in (root, *root.rglob("*")):
            _sync(path)
        publish(root, out)
        _sync(out.parent)
    return manifest


def refuse_to_replace_others(out: Path) -> None:
    """Check that a dataset folder may be written at a place: nothing is there, or an older one.

    Raises
    ------
    DataError
        If there is a file, or a folder that is not empty and no dataset folder.
    """
    ours = (out / MANIFEST_NAME).is_file()
    if out.is_file() or (out.is_dir() and not ours and any(out.iterdir())):
        raise DataError(f"{out} is not a dataset folder: remove it yourself, or choose another")


class _Tally:
    """Counts what a manifest tells of all rows."""

    def __init__(self) -> None:
        self.sources: Counter[str] = Counter()
        self.density_sources: Counter[str] = Counter()
        self.labels: Counter[str] = Counter()
        self.without_radiographs: Counter[str] = Counter()
        self.on_partnext = 0

    def counted(self, row: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the row."""
        self.sources[row["source"]] += 1
        self.density_sources.update(row["part_density_source"])
        self.labels.update(label_counts(row))
        self.on_partnext += is_on_partnext(row)
        if not has_radiographs(row):
            self.without_radiographs[row["split"]] += 1
        return row


class _SplitWriter:
    """Shards and metadata of one split; the stack closes its files."""

    def __init__(self, root: Path, split: str, shard_bytes: int, stack: ExitStack) -> None:
        self._root, self._split, self._shard_bytes, self._stack = root, split, shard_bytes, stack
        self._metadata = self._open(f"metadata/{split}", METADATA_SCHEMA, METADATA_GROUP_ROWS)
        self._shards: list[ShardWriter] = []

    def _open(self, stem: str, schema: pa.Schema, group_rows: int) -> ShardWriter:
        writer = ShardWriter(self._root / f"{stem}.parquet", schema, group_rows)
        self._stack.callback(writer.close)
        return writer

    def write(self, row: Mapping[str, Any]) -> None:
        if not self._shards or self._shards[-1].file_bytes >= self._shard_bytes:
            self._next_shard()
        self._shards[-1].write(row)
        self._metadata.write(row)

    def _next_shard(self) -> None:
        for full in self._shards[-1:]:
            full.close()
        # The name gets its "of n" when n is known.
        stem = f"data/{self._split}-{len(self._shards):05d}"
        self._shards.append(self._open(stem, DATA_SCHEMA, 1))

    def close(self) -> None:
        """Complete the files, and see that there are shards enough: now all rows are counted."""
        for writer in (self._metadata, self._shards[-1]):
            writer.close()
        fewest = min(FEWEST_SHARDS, self._metadata.rows)
        if len(self._shards) < fewest:
            self._spread(fewest)

    def _spread(self, count: int) -> None:
        """Write the rows of the shards again, evenly into more."""
        old = [shard.path.rename(shard.path.with_suffix(".old")) for shard in self._shards]
        rows = (row for path in old for row in ShardReader(path))
        self._shards = []
        for start, stop in pairwise(self._metadata.rows * i // count for i in range(count + 1)):
            self._next_shard()
            for row in islice(rows, stop - start):
                self._shards[-1].write(row)
        self._shards[-1].close()
        for path in old:
            path.unlink()

    def files(self) -> Iterator[DataFile]:
        for shard in self._shards:
            path = shard.path.with_stem(f"{shard.path.stem}-of-{len(self._shards):05d}")
            shard.path.rename(path)
            yield self._file(shard, path, "default")
        yield self._file(self._metadata, self._metadata.path, "metadata")

    def _file(self, writer: ShardWriter, path: Path, config: str) -> DataFile:
        return DataFile(
            path=path.relative_to(self._root).as_posix(),
            config=config,
            split=self._split,
            rows=writer.rows,
            bytes=path.stat().st_size,
            num_bytes=writer.num_bytes,
            sha256=file_sha256(path),
            footer_sha256=footer_sha256(path),
        )


def _write_shards(
    rows: Iterable[Mapping[str, Any]], root: Path, shard_bytes: int
) -> tuple[DataFile, ...]:
    for name in ("data", "metadata"):
        (root / name).mkdir(parents=True)
    writers: dict[str, _SplitWriter] = {}
    with ExitStack() as stack:
        for row in rows:
            split = row["split"]
            if split not in writers:
                writers[split] = _SplitWriter(root, split, shard_bytes, stack)
            writers[split].write(row)
        for writer in writers.values():
            writer.close()
    files = [file for writer in writers.values() for file in writer.files()]
    return tuple(sorted(files, key=lambda file: file.path))


def _ascending(rows: Iterable[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    last = ""
    for row in rows:
        object_id, split = row["object_id"], row["split"]
        if not OBJECT_ID.fullmatch(object_id):
            raise DataError(f"object_id must be of A-Z a-z 0-9 . _ -, got {object_id!r}")
        if object_id <= last:
            raise DataError(f"object ids must be unique and ascending: {object_id} after {last}")
        if split not in ALL_SPLITS:
            raise DataError(f"{object_id}: split must be one of {ALL_SPLITS}, got {split!r}")
        last = object_id
        yield row
    if not last:
        raise DataError("no objects: nothing to write")


def _sync(path: Path) -> None:
    """Wait until a file or folder is on the disk."""
    if os.name == "nt" and path.is_dir():  # folders cannot be opened there
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
