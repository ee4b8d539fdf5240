"""Writing ``segments.npz``: complete or not at all, and the same bytes for the same values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from xden1k.errors import DataError
from xden1k.predictions.writer import SubmissionWriter
from xden1k.segmentation.values import Segmentation, points_sha256

__all__ = ["SegmentsWriter"]


class SegmentsWriter(SubmissionWriter):
    """Writes a ``segments.npz``.

    Parameters
    ----------
    path
        As in :class:`xden1k.predictions.PredictionsWriter`.

    Examples
    --------
    ::

        with SegmentsWriter(Path("segments.npz")) as writer:
            for object_id in ids:
                writer.add(object_id, points.voxels, labels, free)
            writer.finish(SegmentsMeta(..., points_sha256=writer.points_sha256))
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._voxels: dict[str, UInt8[np.ndarray, "points 3"]] = {}

    @property
    def points_sha256(self) -> str:
        """Checksum of the points of the objects so far."""
        return points_sha256(self._voxels)

    def add(
        self,
        object_id: str,
        voxels: UInt8[np.ndarray, "points 3"],
        labels: UInt8[np.ndarray, "counts labelled"],
        free: UInt8[np.ndarray, "labelled"],
    ) -> None:
        """Append one object.

        Parameters
        ----------
        object_id
            As in the dataset.
        voxels
            Of its points.
        labels, free
            As in :class:`Segmentation`.

        Raises
        ------
        DataError
            If the labels break the format or are of other points, the object came before, or its
            id has characters other than letters, digits, ``._-``.
        """
        self._check_id(object_id)
        try:
            found = Segmentation(labels, free).points
        except DataError as err:
            raise DataError(f"{object_id}: {err}") from err
        if found != len(voxels):
            raise DataError(f"{object_id}: {len(voxels)} points need as many labels, got {found}")
        self._voxels[object_id] = voxels
        self._append(object_id, {"labels": labels, "free": free})
