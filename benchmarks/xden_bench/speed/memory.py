"""What memory reading takes, epoch after epoch."""

from __future__ import annotations

import gc
import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from torch.utils.data import DataLoader

from xden1k.access.dataset import Sample, XDen1K, collate
from xden1k.errors import DataError

__all__ = ["anonymous_mb", "epochs_mb"]


def epochs_mb(
    root: Path,
    split: str,
    epochs: int = 10,
    workers: int = 0,
    transform: Callable[[Sample], Any] | None = None,
) -> list[float]:
    """Anonymous memory after each epoch of full samples, in a process started for it.

    Parameters
    ----------
    root, split
        What to read.
    epochs
        How often.
    workers
        Of the loader; their memory counts, they live as long as it.
    transform
        Of the dataset; can be pickled.

    Returns
    -------
    list of float
        MB, one for each epoch.

    Raises
    ------
    DataError
        If the split cannot be read, or this is not Linux.
    """
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawn) as pool:
        return pool.submit(_epochs_mb, root, split, epochs, workers, transform).result()


def _epochs_mb(
    root: Path, split: str, epochs: int, workers: int, transform: Callable[[Sample], Any] | None
) -> list[float]:
    loader = DataLoader(
        XDen1K(root, split, transform=transform),
        num_workers=workers,
        collate_fn=collate,
        persistent_workers=workers > 0,
    )
    return [_epoch_mb(loader) for _ in range(epochs)]


def _epoch_mb(loader: DataLoader[Sample]) -> float:
    for _ in loader:
        pass
    gc.collect()
    children = [child.pid for child in multiprocessing.active_children()]
    return sum(anonymous_mb(process) for process in ("self", *children))


def anonymous_mb(process: int | str | None = "self") -> float:
    """Resident memory of a process that belongs to no file and is not shared, in MB.

    Raises
    ------
    DataError
        If there is no ``/proc``, which only Linux has.
    """
    path = Path(f"/proc/{process}/status")
    try:
        lines = dict(line.split(":", 1) for line in path.read_text().splitlines())
    except FileNotFoundError as err:
        raise DataError(f"{path} is not there: memory is measured on Linux only") from err
    return int(lines["RssAnon"].split()[0]) * 1024 / 1e6
