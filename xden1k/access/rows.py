"""The ``datasets`` builder of our shards: Parquet rows whose array columns decode.

Nothing else belongs here: ``datasets`` patches ``open``, ``Path`` and more in a builder's module.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pyarrow as pa
import pyarrow.dataset as ds
import pyarrow.parquet as pq
from datasets import Features, builder
from datasets.packaged_modules.parquet.parquet import Parquet, ParquetConfig

from xden1k.documents.card import HOMEPAGE, bibtex_entry
from xden1k.documents.statements import dataset_title, licence_text, provenance_text
from xden1k.errors import DataError
from xden1k.folder import open_folder
from xden1k.folder.reader import other_name
from xden1k.format.manifest import MANIFEST_NAME, Manifest
from xden1k.format.packing import pack, scanned_columns, with_arrays
from xden1k.format.remote import is_url
from xden1k.format.schema import DATA_SCHEMA, METADATA_SCHEMA
from xden1k.format.shards import ShardReader

__all__ = ["Rows", "RowsConfig"]

VERIFIES_PAGES = "fragment_scan_options" in ParquetConfig.__dataclass_fields__
"""Whether this version of ``datasets`` can be told to compare pages with their checksums: 4.2 and
newer. For older ones each file is read twice, first by us, who compare them."""


@dataclass
class RowsConfig(ParquetConfig):  # type: ignore[misc]
    """A Parquet config whose cache does not depend on how its files were named.

    The builder's hash says which they are, so that every way in shares one cache.
    """

    def create_config_id(self, config_kwargs: dict[str, Any], *features: Any, **more: Any) -> str:
        """Name of the cache: the config's, and what follows from the other options."""
        options = {name: value for name, value in config_kwargs.items() if name != "data_files"}
        return str(super().create_config_id(options, *features, **more))


class Rows(Parquet):  # type: ignore[misc]
    """Reads shards as the Parquet builder does, and makes the array columns decode.

    Where the user passes ``features=``, these hold and nothing is changed.
    """

    BUILDER_CONFIG_CLASS = RowsConfig
    DEFAULT_WRITER_BATCH_SIZE = 8
    """Rows of some 10 MB: the library's 100 or 1000 in one batch would fill the memory."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        if self.config.features is None and self.info.features is not None:
            self.info.features = with_arrays(self.info.features)
        for name, value in _about(self.base_path).items():
            setattr(self.info, name, getattr(self.info, name) or value)

    def as_dataset(self, split: Any = None, **more: Any) -> Any:
        """Rows of a split, as every builder gives them.

        Raises
        ------
        DataError
            If there is no such split, but one that other datasets call so.
        """
        with self._other_names(split):
            return super().as_dataset(split=split, **more)

    def as_streaming_dataset(self, split: Any = None, **more: Any) -> Any:
        """Rows of a split while they are read, as every builder gives them.

        Raises
        ------
        DataError
            If there is no such split, but one that other datasets call so.
        """
        with self._other_names(split):
            return super().as_streaming_dataset(split=split, **more)

    @contextmanager
    def _other_names(self, split: Any) -> Iterator[None]:
        try:
            yield
        except ValueError as err:
            known = list(self.info.splits or self.config.data_files or ())
            if not (hint := other_name(str(split), known)):
                raise
            raise DataError(f"no split {split!s}; there are {known}{hint}") from err

    def _split_generators(self, dl_manager: Any) -> Any:
        if is_url(self.base_path):  # the files stay where they are
            dl_manager = _NoDownload()
            if self.info.features is None:
                schema = METADATA_SCHEMA if self.config.name == "metadata" else DATA_SCHEMA
                self.info.features = Features.from_arrow_schema(schema)
        splits = super()._split_generators(dl_manager)
        if self.config.filters is not None:
            self.info.splits = None  # else fewer rows than the card promises are an error
        if self.config.features is None:
            self.info.features = with_arrays(self.info.features)
        return splits

    def _generate_tables(self, *files: Any, **more: Any) -> Iterator[Any]:
        paths = _paths(*files, **more)
        if is_url(self.base_path):
            yield from self._remote_tables(paths)
            return
        reader = copy.copy(self)
        reader.config = copy.copy(self.config)
        if self.config.features is None and self.config.columns is not None:
            reader.config.columns = scanned_columns(self.config.columns)
        if not VERIFIES_PAGES:
            _check(None if self.config.filters is not None else reader.config.columns, paths)
        elif reader.config.fragment_scan_options is None:
            reader.config.fragment_scan_options = ds.ParquetFragmentScanOptions(
                page_checksum_verification=True
            )
        tables = super(Rows, reader)._generate_tables(*files, **more)
        try:
            yield from tables
        except (pa.ArrowException, OSError) as err:
            _check(reader.config.columns, paths)
            raise DataError(str(err)) from err

    def _remote_tables(self, urls: Iterable[str]) -> Iterator[Any]:
        """Tables of files at URLs, a row group each; only the columns asked for are fetched."""
        folder = open_folder(self.base_path)
        columns = self.config.columns
        if columns is not None and self.config.features is None:
            columns = scanned_columns(columns)
        wanted = _Wanted(columns, self.config.filters)
        number = 0  # of files that gave rows: datasets 5.0 wants them without a gap
        for url in urls:
            reader = folder.shard(url.removeprefix(f"{self.base_path}/"))
            index = -1
            for index, table in enumerate(wanted.tables(reader)):
                yield _key(number, index), self._cast_table(table)
            number += index >= 0

    def _cast_table(self, pa_table: Any) -> Any:
        if self.config.features is None:
            pa_table = pack(pa_table, self.info.features)
        return super()._cast_table(pa_table)


def _about(base_path: str | None) -> dict[str, str]:
    """Return what a card says in words and ``datasets`` does not read from it."""
    about = {"citation": bibtex_entry(), "homepage": HOMEPAGE, "license": "CC-BY-4.0"}
    if base_path and not is_url(base_path) and (Path(base_path) / MANIFEST_NAME).is_file():
        manifest = Manifest.read(Path(base_path), damaged=True)
        about["description"] = f"{dataset_title(manifest)}. {provenance_text(manifest)}"
        about["license"] = licence_text(manifest)
    return about


class _NoDownload:
    """Stands in for the download manager of ``datasets``, and leaves files where they are."""

    def __init__(self) -> None:
        self.download_config = SimpleNamespace()

    def download(self, files: Any) -> Any:
        return files

    download_and_extract = download

    def iter_files(self, file: str) -> list[str]:
        return [file]


class _Wanted:
    """Columns of the rows that pass the filters, of one row group after the other."""

    def __init__(self, columns: list[str] | None, filters: Any) -> None:
        self._columns = columns
        named = isinstance(filters, list)
        self._filter = pq.filters_to_expression(filters) if named else filters
        self._looked_at: list[str] | None = None
        if named:
            terms = [t for one in filters for t in (one if isinstance(one, list) else [one])]
            self._looked_at = sorted({term[0] for term in terms})

    def tables(self, reader: ShardReader) -> Iterator[pa.Table]:
        """Yield what there is of each row group that has rows to give."""
        tables = (self._read(reader, index) for index in range(reader.row_groups))
        return (table for table in tables if table.num_rows)

    def _read(self, reader: ShardReader, index: int) -> pa.Table:
        if self._filter is None:
            return reader.table(index, self._columns)
        light = reader.table(index, self._looked_at)
        if self._looked_at is not None and not light.filter(self._filter).num_rows:
            return light.slice(0, 0)
        every = self._columns or reader.schema.names
        looked_at = reader.schema.names if self._looked_at is None else self._looked_at
        table = reader.table(index, [*dict.fromkeys((*every, *looked_at))])
        return table.filter(self._filter).select(every)


def _key(file: int, batch: int) -> Any:
    """Name a batch as this version of datasets does."""
    key = getattr(builder, "Key", None)
    return f"{file}_{batch}" if key is None else key(file, batch)


def _paths(files: Any, *_: Any, **__: Any) -> list[str]:
    """Return the files of a split, which older versions of datasets give as lists of lists."""
    return [path for each in files for path in ([each] if isinstance(each, str) else each)]


def _check(columns: list[str] | None, paths: Iterable[str]) -> None:
    """Read files and compare pages with their checksums; the error names file and object."""
    for path in paths:
        with open(path, "rb") as file:  # as datasets patches it: local, or from anywhere
            for _ in ShardReader(Path(path), file).groups(columns):
                pass
