"""All that is measured of loading, in one run."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

from xden1k.access.dataset import FIELDS
from xden1k.folder import open_folder
from xden_bench.speed.loading import Pair, access, fields, loaders
from xden_bench.speed.memory import epochs_mb
from xden_bench.speed.starting import importing, opening, write_many

__all__ = ["MANY", "measure_loading"]

MANY = 1000
"""Objects of the folder whose opening is timed."""


def measure_loading(root: Path, split: str, rounds: int, objects: int = MANY) -> dict[str, Any]:
    """Measure loading against ``np.memmap`` of the same decoded bytes.

    Parameters
    ----------
    root, split
        What to read.
    rounds
        Of each comparison, one run of each way in turns.
    objects
        Of the folder whose opening is timed, which is written for it.

    Returns
    -------
    dict of str to Any
        ``machine`` and ``data``; ``loaders``, ``fields``, ``opening`` and ``importing`` as
        ratios; ``access`` in milliseconds; ``memory`` in MB, after each epoch.

    Raises
    ------
    DataError
        If the split cannot be read, or this is not Linux.
    """
    machine = {"cores": os.cpu_count(), "load_before": os.getloadavg()[0]}
    with tempfile.TemporaryDirectory() as scratch:
        pair = Pair.of(root, split, Path(scratch))
        write_many(root, Path(scratch) / "many", objects)
        return {
            "machine": machine,
            "data": _data(root, split, pair),
            "loaders": [{"workers": n, **loaders(pair, n, rounds)} for n in (2, 0)],
            "fields": fields(pair, rounds),
            "access": access(pair),
            "memory": [{"workers": n, "mb": epochs_mb(root, split, workers=n)} for n in (0, 2)],
            "opening": opening(Path(scratch) / "many", rounds),
            "importing": importing(rounds),
        }


def _data(root: Path, split: str, pair: Pair) -> dict[str, Any]:
    manifest = open_folder(root).manifest
    stored = sum(file.bytes for file in manifest.shards(split=split))
    return {
        "root": str(root),
        "split": split,
        "objects": len(pair.raw),
        "sample_mb": pair.raw.sample_bytes(FIELDS) / 1e6,
        "stored_mb": stored / len(pair.raw) / 1e6,
    }
