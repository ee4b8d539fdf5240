"""What each object of a published dataset holds, column by column, in a few bytes."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.format.records import decode_codes
from xden1k.format.schema import ARRAY_COLUMNS, DATA_SCHEMA
from xden1k.format.shards import Row

__all__ = ["SCORED", "Difference", "differences", "published", "write_fingerprints"]

SCORED: Final = frozenset(
    {"object_id", "split", "density", "apparent_density", "envelope"}
    | {"grid_origin_cm", "voxel_size_cm"}
)
"""Columns that scores are computed from."""
MEANS: Final = ("xray_pa", "xray_lat", "density", "apparent_density", "occupancy", "envelope")
"""Columns of which a mean is published, to tell by how much one differs."""

Progress = Callable[[Sequence[str]], Iterable[str]]


@dataclass(frozen=True, slots=True)
class Difference:
    """How a column of a dataset made here differs from the published one.

    Parameters
    ----------
    column
        Which.
    object_ids
        Of the objects in which it differs, ascending.
    largest
        Relative change of its mean in the object where that is largest; nan of columns without.
    """

    column: str
    object_ids: tuple[str, ...]
    largest: float

    @property
    def is_scored(self) -> bool:
        """Whether scores are computed from the column."""
        return self.column in SCORED

    def __str__(self) -> str:
        size = "" if np.isnan(self.largest) else f", a mean by up to {self.largest:.1g} of itself"
        more = f" and {len(self.object_ids) - 1} more" if len(self.object_ids) > 1 else ""
        return f"{self.column} differs in {self.object_ids[0]}{more}{size}"


def published(name: str) -> Path | None:
    """Find the published fingerprints of a dataset; None until there are any."""
    with resources.as_file(resources.files(__package__ or "") / f"{name}.parquet") as path:
        return Path(path) if path.is_file() else None


def write_fingerprints(folder: DatasetFolder, out: Path, progress: Progress = iter) -> None:
    """Write a checksum of each column of each object, and the means of the grids and images."""
    rows = [_fingerprint(folder.row(one)) for one in progress(sorted(folder.ids()))]
    pq.write_table(pa.Table.from_pylist(rows, _SCHEMA), out, compression="zstd")


def differences(
    folder: DatasetFolder, expected: Path, progress: Progress = iter
) -> tuple[Difference, ...]:
    """Compare the objects that a folder has with the fingerprints of all.

    Raises
    ------
    DataError
        If it has an object that is not in the published dataset.
    """
    known = {row["object_id"]: row for row in pq.read_table(expected).to_pylist()}
    if strange := sorted(set(folder.ids()) - known.keys()):
        raise DataError(f"{folder.root}: {strange[0]} is not in the published dataset")
    found: dict[str, list[tuple[str, float]]] = {}
    for object_id in progress(sorted(folder.ids())):
        for column, change in _changes(_fingerprint(folder.row(object_id)), known[object_id]):
            found.setdefault(column, []).append((object_id, change))
    return tuple(
        Difference(column, tuple(one for one, _ in pairs), _largest([size for _, size in pairs]))
        for column, pairs in sorted(found.items())
    )


def _largest(changes: Sequence[float]) -> float:
    known = [change for change in changes if not np.isnan(change)]
    return max(known, default=np.nan)


def _changes(here: Row, there: Row) -> Iterator[tuple[str, float]]:
    for name in DATA_SCHEMA.names:
        if here[name] != there[name]:
            mean = f"{name}_mean"
            yield name, abs(here[mean] / there[mean] - 1) if there.get(mean) else np.nan


_SCHEMA: Final = pa.schema(
    [("object_id", pa.string())]
    + [(name, pa.uint32()) for name in DATA_SCHEMA.names if name != "object_id"]
    + [(f"{name}_mean", pa.float64()) for name in MEANS]
)


def _fingerprint(row: Row) -> dict[str, Any]:
    sums = {name: _checksum(row[name]) for name in DATA_SCHEMA.names}
    means = {f"{name}_mean": _mean(row, name) for name in MEANS}
    return {**sums, **means, "object_id": row["object_id"]}


def _checksum(value: Any) -> int:
    """Checksum of a value: its bytes, or how it is written."""
    content = value if isinstance(value, bytes | pa.Buffer) else json.dumps(value).encode()
    return zlib.crc32(content)


def _mean(row: Row, name: str) -> float | None:
    """Mean of an array as it is stored; None where there is none."""
    assert name in ARRAY_COLUMNS
    return None if row[name] is None else float(decode_codes(row, name).mean(dtype=np.float64))
