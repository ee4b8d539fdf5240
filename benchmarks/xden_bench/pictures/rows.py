"""What methods say of single objects, and how well: protocol A."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Integer, UInt8

from xden1k.errors import MissingObjectError
from xden1k.predictions import Problem, raise_errors
from xden1k.segmentation import Segments, open_segments
from xden_bench.scoring.overlap import assignment, iou_matrix, oracle_clusters, score_segments
from xden_bench.scoring.regions import DrawnObject, Regions, SegmentReference
from xden_bench.scoring.segments import seed_problem
from xden_bench.scoring.submission import meta_problems

__all__ = ["Answer", "Row", "matched", "rows_of"]


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What a method says of one object.

    Parameters
    ----------
    method
        Its name.
    clusters
        Shape (points,): as many as the object has regions.
    iou_a
        Percent; not a number where the object has one region.
    """

    method: str
    clusters: UInt8[np.ndarray, "points"]
    iou_a: float


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """An object and what each method says of it.

    Parameters
    ----------
    drawn
        The object and its points.
    truth
        Shape (points,): material region of each point.
    answers
        One for each method.
    """

    drawn: DrawnObject
    truth: UInt8[np.ndarray, "points"]
    answers: Sequence[Answer]

    @property
    def object_id(self) -> str:
        """Its name."""
        return str(self.drawn.row["object_id"])

    @property
    def regions(self) -> int:
        """Number of regions that have points."""
        return len(np.unique(self.truth))

    def to_json(self) -> dict[str, Any]:
        """Return what there is to print, of JSON's types."""
        found = [
            {"method": one.method, "iou_a": None if isnan(one.iou_a) else one.iou_a}
            for one in self.answers
        ]
        return {"object_id": self.object_id, "regions": self.regions, "answers": found}


def matched(
    regions: Integer[np.ndarray, "points"], clusters: Integer[np.ndarray, "points"]
) -> dict[int, int]:
    """Region of each cluster that has one, by the assignment by which they are scored.

    Parameters
    ----------
    regions, clusters
        Shape (points,): of each point.

    Examples
    --------
    >>> matched(np.array([0, 0, 0, 4]), np.array([7, 7, 2, 2]))
    {7: 0, 2: 4}
    """
    rows, columns = assignment(iou_matrix(regions, clusters))
    there, found = np.unique(regions), np.unique(clusters)
    return dict(zip(found[columns].tolist(), there[rows].tolist(), strict=True))


def rows_of(
    reference: SegmentReference, object_ids: Sequence[str], submissions: Sequence[Path]
) -> list[Row]:
    """Read what submissions say of some objects; of others nothing is read.

    Parameters
    ----------
    reference
        The truth.
    object_ids
        Objects of its split.
    submissions
        Files ``segments.npz``.

    Raises
    ------
    SubmissionError
        If a file is of another dataset, split or points, lacks an object, or is damaged.
    MissingObjectError
        If there is no such object.
    OSError
        If there is no such file.
    """
    with ExitStack() as stack:
        files = [stack.enter_context(open_segments(path)) for path in submissions]
        for file in files:
            raise_errors(tuple(_file_problems(file, reference)), file.path)
        return [_row(reference, object_id, files) for object_id in object_ids]


def _file_problems(file: Segments, reference: SegmentReference) -> Iterator[Problem]:
    assert file.meta is not None  # or it would not be flawless
    yield from meta_problems(file.meta, reference, reference.rules, None)
    if found := seed_problem(file.meta.points_seed, reference.rules):
        yield found


def _row(reference: SegmentReference, object_id: str, files: Sequence[Segments]) -> Row:
    if object_id not in reference.ids:
        raise MissingObjectError(
            f"{reference.folder.root}: no object {object_id!r} in the split {reference.split}"
        )
    drawn = reference.drawn(object_id)
    truth = drawn.regions(reference.rules.region_gap_g_cm3)
    return Row(drawn, truth.materials, [_answer(drawn, truth, file) for file in files])


def _answer(drawn: DrawnObject, truth: Regions, file: Segments) -> Answer:
    found, problems = file.examine(drawn.row["object_id"], len(drawn.points))
    raise_errors(tuple(problems), file.path)
    assert found is not None
    assert file.meta is not None
    iou = score_segments(truth.materials, truth.parts, found)["iou_a"]
    regions = len(np.unique(truth.materials))
    return Answer(file.meta.method, oracle_clusters(regions, found), iou)
