"""The ``datasets`` builder of our shards: Parquet rows whose array columns decode.

Nothing else belongs here: ``datasets`` patches ``open``, ``Path`` and more in a builder's module.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from datasets.packaged_modules.parquet.parquet import Parquet, ParquetConfig

from xden1k.format.packing import pack, scanned_columns, with_arrays

__all__ = ["Rows", "RowsConfig"]


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

    def _split_generators(self, dl_manager: Any) -> Any:
        splits = super()._split_generators(dl_manager)
        if self.config.filters is not None:
            self.info.splits = None  # else fewer rows than the card promises are an error
        if self.config.features is None:
            self.info.features = with_arrays(self.info.features)
        return splits

    def _generate_tables(self, *files: Any, **more: Any) -> Iterator[Any]:
        reader = self
        if self.config.features is None and self.config.columns is not None:
            reader = copy.copy(self)
            reader.config = copy.copy(self.config)
            reader.config.columns = scanned_columns(self.config.columns)
        yield from super(Rows, reader)._generate_tables(*files, **more)

    def _cast_table(self, pa_table: Any) -> Any:
        if self.config.features is None:
            pa_table = pack(pa_table, self.info.features)
        return super()._cast_table(pa_table)
