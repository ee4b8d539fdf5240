"""Read a dataset folder, object by object."""

from __future__ import annotations

import hashlib
import os
import re
import threading
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from xden1k.errors import DataError, MissingObjectError, did_you_mean
from xden1k.format.manifest import MANIFEST_NAME, DataFile, Manifest
from xden1k.format.records import has_radiographs, row_object
from xden1k.format.remote import RemotePath, root_of
from xden1k.format.shards import Row, ShardReader
from xden1k.values.types import DensityObject

__all__ = ["DatasetFolder", "open_folder", "other_name"]

_NAMES_OF_VAL = ("validation", "valid", "dev")


def open_folder(root: str | Path | RemotePath) -> DatasetFolder:
    """Open a dataset folder.

    Parameters
    ----------
    root
        A folder of this machine, or any URL that fsspec knows: ``hf://datasets/OWNER/NAME@TAG``,
        ``s3://...``. Of a URL only the rows and columns are fetched that are asked for, through a
        cache of ``XDEN1K_CACHE_GB`` gigabytes (10); a name on the Hub is pinned to its commit.

    Raises
    ------
    DataError
        If it is not one, or cannot be reached.
    MissingExtraError
        If the package for the URL's scheme is not installed.
    """
    return DatasetFolder(root_of(root))


def other_name(split: str, splits: Iterable[str]) -> str:
    """Return a hint where a split is called otherwise here, as ``validation`` is ``val``.

    Examples
    --------
    >>> other_name("validation[:10]", ["train", "val"]), other_name("test", ["train", "val"])
    (': validation is called val here', '')
    """
    words = [word for word in re.findall(r"\w+", split) if word in _NAMES_OF_VAL]
    return f": {words[0]} is called val here" if words and "val" in splits else ""


class _Readers(threading.local):
    """Open files of one thread of one process."""

    def __init__(self) -> None:
        self.process = os.getpid()
        self.of: dict[str, ShardReader] = {}

    def mine(self) -> dict[str, ShardReader]:
        """Return those opened here; after a fork the parent's handles are the parent's."""
        if self.process != os.getpid():
            self.process, self.of = os.getpid(), {}
        return self.of


class DatasetFolder:
    """Reads the objects of a dataset folder, each on its own.

    Files are opened when they are needed, once in each thread of each process, and stay open; a
    copy sent to another process opens its own.

    Parameters
    ----------
    root
        The folder; :func:`open_folder` takes URLs.

    Raises
    ------
    DataError
        If it is not a dataset folder.
    """

    def __init__(self, root: Path | RemotePath) -> None:
        self.root = root
        self.manifest = Manifest.read(root)
        self._readers = _Readers()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_readers"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _readers=_Readers())

    @property
    def path(self) -> Path:
        """The folder on this machine.

        Raises
        ------
        DataError
            If it is at a URL.
        """
        if isinstance(self.root, RemotePath):
            raise DataError(
                f"{self.root} is a URL: this needs a folder here; get it by `xden download`"
            )
        return self.root

    @cached_property
    def manifest_sha256(self) -> str:
        """Checksum of the manifest, which holds those of all files: tells datasets apart."""
        return hashlib.sha256((self.root / MANIFEST_NAME).read_bytes()).hexdigest()

    def ids(self, split: str | None = None) -> tuple[str, ...]:
        """Ids of one split, or of all, each split in ascending order.

        Raises
        ------
        DataError
            If there is no such split, or a shard cannot be read.
        """
        if split is None:
            return tuple(self._places)
        if split not in self.manifest.splits:
            splits = list(self.manifest.splits)
            hint = other_name(split, splits)
            raise DataError(f"{self.root}: no split {split!r}; there are {splits}{hint}")
        return tuple(name for name, (file, _) in self._places.items() if file.split == split)

    def row(self, object_id: str, columns: Sequence[str] | None = None) -> Row:
        """Return the encoded row of one object; only the columns asked for are read.

        Raises
        ------
        MissingObjectError
            If there is no such object.
        DataError
            If its shard is damaged or has no such column.
        """
        if object_id not in self._places:
            raise MissingObjectError(self._missing_message(object_id))
        file, index = self._places[object_id]
        if not isinstance(self.root, RemotePath) or columns is None:
            row = self._reader(file).row(index, columns)
        else:
            row = self._reader(file).row(index, [*dict.fromkeys((*columns, "object_id"))])
        if row.get("object_id", object_id) != object_id:
            raise DataError(f"{self.root / file.path}: {row['object_id']} is where {object_id} was")
        return row if columns is None else {name: row[name] for name in dict.fromkeys(columns)}

    def rows(self, split: str | None = None, columns: Sequence[str] | None = None) -> Iterator[Row]:
        """Iterate over the encoded rows of one split, or of all."""
        for object_id in self.ids(split):
            yield self.row(object_id, columns)

    def object(self, object_id: str) -> DensityObject:
        """Return one object.

        Raises
        ------
        MissingObjectError
            If there is no such object.
        DataError
            If its row breaks the format.
        """
        return row_object(self.row(object_id))

    def objects(self, split: str | None = None) -> Iterator[DensityObject]:
        """Objects of one split, or of all."""
        return map(self.object, self.ids(split))

    def light_column(self, name: str) -> list[Any]:
        """Return one light column of every object, in the order of :meth:`ids`, in one read.

        Raises
        ------
        DataError
            If there is no such column, or a file cannot be read.
        """
        files = (
            file
            for split in self.manifest.splits
            for file in self.manifest.shards("metadata", split)
        )
        return [value for file in files for value in self._reader(file).column(name)]

    def without_radiographs(self, split: str) -> frozenset[str]:
        """Ids of the objects of one split that have no radiographs.

        Raises
        ------
        DataError
            If there is no such split, or a file cannot be read.
        """
        ids, count = self.ids(split), self.manifest.without_radiographs.get(split, 0)
        if count in (0, len(ids)):
            return frozenset(ids[:count])
        rows = zip(ids, self.rows(split, ["xray_pa_shape"]), strict=True)
        return frozenset(object_id for object_id, row in rows if not has_radiographs(row))

    @cached_property
    def _places(self) -> dict[str, tuple[DataFile, int]]:
        """Shard and row group of each object."""
        if isinstance(self.root, RemotePath):
            return dict(self._places_by_metadata())
        return {
            object_id: (file, index)
            for split in self.manifest.splits
            for file in self.manifest.shards(split=split)
            for index, object_id in enumerate(self._reader(file).column("object_id"))
        }

    def _places_by_metadata(self) -> Iterator[tuple[str, tuple[DataFile, int]]]:
        """Take the ids from the light files, which have the order of the shards: few requests."""
        for split in self.manifest.splits:
            shards = self.manifest.shards(split=split)
            places = ((file, index) for file in shards for index in range(file.rows))
            light = self.manifest.shards("metadata", split)
            ids = (name for file in light for name in self._reader(file).column("object_id"))
            yield from zip(ids, places, strict=True)

    def shard(self, path: str) -> ShardReader:
        """Return the reader of one Parquet file, by its path inside the folder."""
        (file,) = (file for file in self.manifest.files if file.path == path)
        return self._reader(file)

    def _reader(self, file: DataFile) -> ShardReader:
        readers = self._readers.mine()
        if file.path not in readers:
            readers[file.path] = self._open(file)
        return readers[file.path]

    def _open(self, file: DataFile) -> ShardReader:
        if isinstance(self.root, RemotePath):
            return ShardReader(self.root / file.path, file.remote(self.root))
        file.check(self.root)
        return ShardReader(self.root / file.path)

    def _missing_message(self, object_id: str) -> str:
        hint = did_you_mean(object_id, self._places)
        return f"{self.root}: no object {object_id!r} among {len(self._places)}{hint}"
