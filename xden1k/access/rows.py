"""The ``datasets`` builder of our shards: Parquet rows whose array columns decode.

Nothing else belongs here: ``datasets`` patches ``open``, ``Path`` and more in a builder's module.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.dataset as ds
from datasets.packaged_modules.parquet.parquet import Parquet, ParquetConfig

from xden1k.documents.card import HOMEPAGE, bibtex_entry, dataset_title, provenance_text
from xden1k.errors import DataError
from xden1k.folder.reader import other_name
from xden1k.format.manifest import MANIFEST_NAME, Manifest
from xden1k.format.packing import pack, scanned_columns, with_arrays
from xden1k.format.shards import ShardReader

__all__ = ["Rows", "RowsConfig"]

UNKNOWN = "before datasets 4.2, which cannot be told to verify pages"


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
        splits = super()._split_generators(dl_manager)
        if self.config.filters is not None:
            self.info.splits = None  # else fewer rows than the card promises are an error
        if self.config.features is None:
            self.info.features = with_arrays(self.info.features)
        return splits

    def _generate_tables(self, *files: Any, **more: Any) -> Iterator[Any]:
        reader = copy.copy(self)
        reader.config = copy.copy(self.config)
        if self.config.features is None and self.config.columns is not None:
            reader.config.columns = scanned_columns(self.config.columns)
        if getattr(reader.config, "fragment_scan_options", UNKNOWN) is None:
            reader.config.fragment_scan_options = ds.ParquetFragmentScanOptions(
                page_checksum_verification=True
            )
        tables = super(Rows, reader)._generate_tables(*files, **more)
        try:
            yield from tables
        except (pa.ArrowException, OSError) as err:
            raise DataError(_damage(reader.config.columns, *files, **more) or str(err)) from err

    def _cast_table(self, pa_table: Any) -> Any:
        if self.config.features is None:
            pa_table = pack(pa_table, self.info.features)
        return super()._cast_table(pa_table)


def _about(base_path: str | None) -> dict[str, str]:
    """Return what a card says in words and ``datasets`` does not read from it."""
    about = {"citation": bibtex_entry(), "homepage": HOMEPAGE, "license": "CC-BY-4.0"}
    if base_path and (Path(base_path) / MANIFEST_NAME).is_file():
        manifest = Manifest.read(Path(base_path), damaged=True)
        about["description"] = f"{dataset_title(manifest)}. {provenance_text(manifest)}"
    return about


def _damage(columns: list[str] | None, files: Any, *_: Any, **__: Any) -> str | None:
    """Say which object of which file cannot be read; None where each can."""
    for path in files:
        with open(path, "rb") as file:  # as datasets patches it: local, or from anywhere
            try:
                for _ in ShardReader(Path(str(path)), file).groups(columns):
                    pass
            except DataError as err:
                return str(err)
    return None
