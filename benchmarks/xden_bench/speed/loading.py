"""How fast torch samples are read, against ``np.memmap`` of the same decoded bytes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset

from xden1k.access.dataset import FIELDS, Sample, XDen1K, collate
from xden1k.access.geometry import GEOMETRY_PARTS, VIEWS
from xden_bench.speed.raw import RawCopy
from xden_bench.speed.rounds import compared, seconds

__all__ = ["FIELD_GROUPS", "Pair", "access", "fields", "loaders", "one_thread"]

BATCH_SIZE = 4
SAMPLES = 64
"""Read in one round of a loader."""
ACCESSES = 200

_SHARED_OUT = {
    "radiographs, masks": (
        *(f"xray_{view}" for view in VIEWS),
        *(f"xray_{view}_valid" for view in VIEWS),
    ),
    "their geometry": tuple(f"xray_{view}_{part}" for view in VIEWS for part in GEOMETRY_PARTS),
    "densities": ("density", "apparent_density"),
    "occupancy, envelope": ("occupancy", "envelope"),
    "labels": ("labels",),
    "meshes": ("mesh_vertices", "mesh_faces", "face_part"),
}
FIELD_GROUPS = {
    "all": FIELDS,
    **_SHARED_OUT,
    "figures, texts": tuple(
        name for name in FIELDS if name not in {n for names in _SHARED_OUT.values() for n in names}
    ),
    "object_id alone": ("object_id",),
}
"""Fields that are measured together. The last is what any row costs, whatever is read of it."""


@dataclass(frozen=True)
class Pair:
    """A split, and the copy to compare it with.

    Parameters
    ----------
    root, split
        What to read.
    raw
        The samples of all its objects, every field.
    """

    root: Path
    split: str
    raw: RawCopy

    @classmethod
    def of(cls, root: Path, split: str, scratch: Path) -> Pair:
        """Copy a split into a scratch folder.

        Raises
        ------
        DataError
            If there is no such split, or a row cannot be read.
        """
        return cls(root, split, RawCopy(XDen1K(root, split), scratch / "samples.raw"))


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep torch to one thread meanwhile, as it does in a loader's worker."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def loaders(pair: Pair, workers: int, rounds: int) -> dict[str, float]:
    """Compare loaders of full samples, with the same collate and number of workers.

    Parameters
    ----------
    pair
        What to read.
    workers
        Processes of each loader; 0 = this one. They are started before the first round.
    rounds
        Of :data:`SAMPLES` samples each, in batches of :data:`BATCH_SIZE`.

    Returns
    -------
    dict of str to float
        As :meth:`Comparison.to_dict`, of one sample.
    """
    ours, raw = (_loader(one, workers) for one in (XDen1K(pair.root, pair.split), pair.raw))
    with one_thread():
        return compared(lambda: _exhaust(ours), lambda: _exhaust(raw), rounds).to_dict(SAMPLES)


def _loader(dataset: Dataset[Sample], workers: int) -> DataLoader[Sample]:
    count = len(dataset)  # type: ignore[arg-type]  # both kinds have one
    return DataLoader(
        dataset,
        batch_size=BATCH_SIZE,
        sampler=[number % count for number in range(SAMPLES)],
        num_workers=workers,
        collate_fn=collate,
        persistent_workers=workers > 0,
    )


def _exhaust(loader: DataLoader[Sample]) -> None:
    for _ in loader:
        pass


def fields(pair: Pair, rounds: int) -> list[dict[str, Any]]:
    """Compare groups of fields, each read alone, in this process and one thread.

    Returns
    -------
    list of dict
        For each of :data:`FIELD_GROUPS`: its name, MB of a sample, :meth:`Comparison.to_dict` of
        one sample, and ``share``, its time over that of all fields. Shares add up to more than 1:
        each holds what any row costs.
    """
    with one_thread():
        rows = [_group(pair, name, names, rounds) for name, names in FIELD_GROUPS.items()]
    return [row | {"share": row["ours_ms"] / rows[0]["ours_ms"]} for row in rows]


def _group(pair: Pair, name: str, names: Sequence[str], rounds: int) -> dict[str, Any]:
    dataset, raw = XDen1K(pair.root, pair.split, fields=names), pair.raw
    numbers = range(len(dataset))

    def ours() -> None:
        for number in numbers:
            dataset[number]

    def other() -> None:
        for number in numbers:
            raw.read(number, names)

    measured = compared(ours, other, rounds).to_dict(len(numbers))
    return {"fields": name, "mb": raw.sample_bytes(names) / 1e6, **measured}


def access(pair: Pair, seed: int = 0) -> dict[str, dict[str, float]]:
    """Time single objects in random order: a torch sample of every field, a ``DensityObject``.

    Returns
    -------
    dict of str to dict
        For each, and the map: ``median_ms`` and ``worst_ms`` of :data:`ACCESSES` on the wall, and
        ``worst_cpu_ms``, the most processor time, without what other programs took.
    """
    dataset, raw = XDen1K(pair.root, pair.split), pair.raw
    ways: dict[str, Callable[[int], object]] = {
        "torch sample": dataset.__getitem__,
        "DensityObject": lambda number: dataset.object(dataset.ids[number]),
        "np.memmap": raw.__getitem__,
    }
    numbers = np.random.default_rng(seed).integers(len(dataset), size=ACCESSES).tolist()
    with one_thread():
        rounds = [
            [_wall_and_cpu_ms(partial(way, number)) for way in ways.values()] for number in numbers
        ]
    return {
        name: _summary(times) for name, times in zip(ways, zip(*rounds, strict=True), strict=True)
    }


def _wall_and_cpu_ms(work: Callable[[], object]) -> tuple[float, float]:
    start = time.process_time()
    wall_s = seconds(work)
    return 1e3 * wall_s, 1e3 * (time.process_time() - start)


def _summary(times: Sequence[tuple[float, float]]) -> dict[str, float]:
    wall_ms, cpu_ms = zip(*times, strict=True)
    return {"median_ms": median(wall_ms), "worst_ms": max(wall_ms), "worst_cpu_ms": max(cpu_ms)}
