"""What the documents of a dataset folder are made from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq

from xden1k.documents.maintainer import Answers
from xden1k.errors import DataError
from xden1k.format.manifest import Manifest

__all__ = ["FACT_COLUMNS", "Facts", "read_facts"]

FACT_COLUMNS: Final = (
    *("category", "source", "flags", "weighed_mass_g", "mass_g"),
    *("part_names", "part_flags"),
)
"""Columns that documents are made from, of the light ones."""


@dataclass(frozen=True)
class Facts:
    """What is known of a dataset as a whole.

    Parameters
    ----------
    manifest
        Of the folder.
    table
        :data:`FACT_COLUMNS` of every object.
    answers
        What the maintainer says.
    """

    manifest: Manifest
    table: pa.Table
    answers: Answers

    @property
    def simulated(self) -> bool:
        """Whether no object was ever on a scanner."""
        return self.manifest.simulated

    @property
    def flags(self) -> list[str]:
        """Flags of all objects and of all parts, each as often as it is raised."""
        return [*self._object_flags(), *self._part_flags()]

    def _object_flags(self) -> Iterator[str]:
        for row in self.table["flags"].to_pylist():
            yield from row

    def _part_flags(self) -> Iterator[str]:
        for parts in self.table["part_flags"].to_pylist():
            for part in parts:
                yield from part


def read_facts(root: Path, manifest: Manifest, answers: Answers) -> Facts:
    """Read the facts of a folder whose Parquet files are there.

    Parameters
    ----------
    root
        The folder.
    manifest
        Its manifest.
    answers
        What the maintainer says.

    Raises
    ------
    DataError
        If one of them cannot be read.
    """
    paths = [root / file.path for file in manifest.shards("metadata")]
    return Facts(manifest, pa.concat_tables(map(_read, paths)), answers)


def _read(path: Path) -> pa.Table:
    try:
        return pq.read_table(path, columns=list(FACT_COLUMNS), page_checksum_verification=True)
    except (pa.ArrowException, OSError) as err:
        reason = str(err).partition("\n")[0]
        raise DataError(f"{path}: cannot be read as Parquet: {reason}") from err
