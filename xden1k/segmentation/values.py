"""The points of an object that are labelled, and the labels that a method gives them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import UInt8

from xden1k.errors import DataError
from xden1k.values.arrays import Points

__all__ = [
    "CLUSTER_COUNTS",
    "GRID_SIZE",
    "MAX_POINTS",
    "SegmentPoints",
    "Segmentation",
    "faults",
    "points_sha256",
    "shape_message",
]

GRID_SIZE: Final = 256
"""Voxels along each edge of the object's cube, at whose centres points lie."""
MAX_POINTS: Final = 8192
"""Points of an object; fewer where fewer voxels lie inside it."""
CLUSTER_COUNTS: Final = range(2, 20)
"""Numbers of clusters k: one row of the labels for each."""


@dataclass(frozen=True, slots=True, eq=False)
class SegmentPoints:
    """The points of one object.

    Parameters
    ----------
    voxels
        Shape (points, 3): indices in the grid of ``GRID_SIZE`` along x, y, z, in C order.
    points_cm
        Shape (points, 3): their centres, object frame.
    """

    voxels: UInt8[np.ndarray, "points 3"]
    points_cm: Points

    def __len__(self) -> int:
        return len(self.voxels)


@dataclass(frozen=True, slots=True, eq=False)
class Segmentation:
    """What a method says of the points of one object. Names of clusters mean nothing.

    Parameters
    ----------
    labels
        Shape (18, points): cluster of each point, a row for each k in ``CLUSTER_COUNTS`` with at
        most k different values.
    free
        Shape (points,): the same with as many clusters as the method finds.

    Raises
    ------
    DataError
        If a shape or a dtype is another, or a row has more clusters than k.

    Examples
    --------
    >>> Segmentation(np.zeros((18, 5), np.uint8), np.array([0, 0, 1, 1, 1], np.uint8)).points
    5
    """

    labels: UInt8[np.ndarray, "counts points"]
    free: UInt8[np.ndarray, "points"]

    def __post_init__(self) -> None:
        for _, message in faults(self.labels, self.free, np.size(self.free)):
            raise DataError(message)

    @property
    def points(self) -> int:
        """How many points are labelled."""
        return len(self.free)

    def of(self, count: int) -> UInt8[np.ndarray, "points"]:
        """Labels of at most so many clusters, a number in ``CLUSTER_COUNTS``."""
        row: UInt8[np.ndarray, "points"] = self.labels[CLUSTER_COUNTS.index(count)]
        return row


def faults(labels: Any, free: Any, points: int) -> Iterator[tuple[str, str]]:
    """Code and message of whatever is wrong with the labels of an object.

    Parameters
    ----------
    labels, free
        As a :class:`Segmentation` has them, perhaps.
    points
        How many points the object has.
    """
    wrong = [
        *_shape_faults("labels", labels, (len(CLUSTER_COUNTS), points)),
        *_shape_faults("free", free, (points,)),
    ]
    yield from wrong
    if wrong:
        return
    for count, row in zip(CLUSTER_COUNTS, labels, strict=True):
        if (found := len(np.unique(row))) > count:
            yield "E408", f"labels of k = {count} must have at most {count} clusters, got {found}"


def _shape_faults(name: str, values: Any, shape: tuple[int, ...]) -> Iterator[tuple[str, str]]:
    if not isinstance(values, np.ndarray) or values.dtype != np.uint8:
        found = values.dtype if isinstance(values, np.ndarray) else type(values).__name__
        yield "E401", f"{name} must be an array of uint8, got {found}"
    elif values.shape != shape:
        yield "E402", f"{name}: {shape_message(shape, values.shape)}"


def shape_message(expected: tuple[int | str, ...], found: tuple[int, ...]) -> str:
    """Say which shape an array must have; of rows that are missing, which there must be.

    What is not known yet, such as the number of points, is given by its name.

    Examples
    --------
    >>> shape_message((18, 9), (17, 9))
    'shape must be (18, 9), a row for each k from 2 to 19, got (17, 9)'
    """
    shape = str(expected).replace("'", "")
    rows = f", a row for each k from {CLUSTER_COUNTS[0]} to {CLUSTER_COUNTS[-1]}"
    return f"shape must be {shape}{rows if len(expected) > 1 else ''}, got {found}"


def points_sha256(voxels: Mapping[str, UInt8[np.ndarray, "points 3"]]) -> str:
    """Checksum of the points of objects: of each, sorted by id, its id and its voxels in C order.

    Parameters
    ----------
    voxels
        By object id, as :class:`SegmentPoints` has them.
    """
    digest = hashlib.sha256()
    for object_id, indices in sorted(voxels.items()):
        digest.update(object_id.encode())
        digest.update(np.ascontiguousarray(indices).tobytes())
    return digest.hexdigest()
