"""What comes before the first sample: importing the package, opening a large folder."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from xden1k.access.dataset import XDen1K
from xden1k.folder import open_folder, write_rows
from xden1k.format.schema import ARRAY_COLUMNS
from xden1k.format.shards import Row
from xden_bench.speed.rounds import Comparison, compared

__all__ = ["importing", "opening", "write_many"]

SPLITS = (*("train",) * 7, "val", "test", "test")
"""Of ten objects of a large folder."""
IMPORT = "import time; start = time.perf_counter(); import {}; print(time.perf_counter() - start)"


def importing(rounds: int) -> dict[str, float]:
    """Compare ``import xden1k`` with ``import numpy``, each in a new process.

    Returns
    -------
    dict of str to float
        As :meth:`Comparison.to_dict`.
    """
    times = [(_import_s("xden1k"), _import_s("numpy")) for _ in range(rounds + 1)]
    return Comparison(*zip(*times[1:], strict=True)).to_dict()


def _import_s(module: str) -> float:
    command = [sys.executable, "-c", IMPORT.format(module)]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)  # noqa: S603


def write_many(root: Path, out: Path, objects: int) -> None:
    """Write a folder whose directory is that of so many objects, without arrays but for labels.

    Parameters
    ----------
    root
        The folder whose first object to repeat.
    out
        The folder to make. Its objects can be listed, not read.
    objects
        How many.
    """
    folder = open_folder(root)
    row = folder.row(folder.ids()[0])
    write_rows(_many(row, objects), out, version="0.0.0", builder="xden-bench speed")


def _many(row: Row, objects: int) -> Iterator[Row]:
    for number in range(objects):
        yield {
            **row,
            **dict.fromkeys(ARRAY_COLUMNS.keys() - {"labels"}, b""),  # which the manifest counts
            "object_id": f"object-{number:06d}",
            "split": SPLITS[number % len(SPLITS)],
        }


def opening(root: Path, rounds: int) -> dict[str, Any]:
    """Compare opening a folder as a dataset with pyarrow's opening of its shards.

    Returns
    -------
    dict of str to Any
        Numbers of objects and shards, and :meth:`Comparison.to_dict`.
    """
    shards = sorted(root.glob("data/*.parquet"))

    def bare() -> None:
        for path in shards:
            pq.ParquetFile(path).read(columns=["object_id"])

    measured = compared(lambda: XDen1K(root, "train"), bare, rounds).to_dict()
    return {"objects": open_folder(root).manifest.objects, "shards": len(shards), **measured}
