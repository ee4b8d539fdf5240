"""Scoring a ``segments.npz``: every problem is found before any number counts."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from xden1k.errors import DataError
from xden1k.predictions import Problem, raise_errors
from xden1k.segmentation import Segmentation, Segments, points_sha256
from xden1k.values.modality import Track
from xden_bench.scoring.overlap import score_segments
from xden_bench.scoring.protocol import SegmentProtocol
from xden_bench.scoring.regions import DrawnObject, SegmentReference
from xden_bench.scoring.score import ObjectScore, Score
from xden_bench.scoring.submission import Progress, id_problems, meta_problems

__all__ = ["SegmentCheck", "score_segment_file", "seed_problem", "validate_segments"]


@dataclass(eq=False)
class SegmentCheck:
    """The check of one submission, run by going through :meth:`answers`.

    Parameters
    ----------
    segments
        The open file.
    reference
        The truth.
    track
        The track it is meant for; None = the one its inputs lead to.
    progress
        Goes through the object ids.
    """

    segments: Segments
    reference: SegmentReference
    track: Track | None = None
    progress: Progress = iter
    _found: list[Problem] = field(default_factory=list, init=False)
    _voxels: dict[str, UInt8[np.ndarray, "points 3"]] = field(default_factory=dict, init=False)
    _labels: hashlib._Hash = field(default_factory=hashlib.sha256, init=False)

    def answers(self) -> Iterator[tuple[DrawnObject, Segmentation]]:
        """Check object by object, giving each sound one with its labels.

        :attr:`problems` is complete when the iteration has ended.
        """
        self._found = [*self.segments.problems]
        meta = self.segments.meta
        if meta is None:
            return
        self._found += meta_problems(meta, self.reference, self.reference.rules, self.track)
        self._found += id_problems(self.segments, self.reference)
        for object_id in self.progress(self.reference.ids):
            drawn = self.reference.drawn(object_id)
            self._voxels[object_id] = drawn.points.voxels
            if answer := self._answer(object_id, len(drawn.points)):
                yield drawn, answer
        self._found += self._point_problems(meta.points_seed, meta.points_sha256)

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Every error."""
        return tuple(self._found)

    @property
    def arrays_sha256(self) -> str:
        """Checksum of what was scored: of each object, sorted by id, its id, labels and free."""
        return self._labels.hexdigest()

    def _answer(self, object_id: str, points: int) -> Segmentation | None:
        """Return the labels of an object, or None if there is a problem, which is noted."""
        if object_id not in self.segments:
            return None
        answer, problems = self.segments.examine(object_id, points)
        self._found += problems
        if answer is not None:
            for part in (object_id.encode(), answer.labels.tobytes(), answer.free.tobytes()):
                self._labels.update(part)
        return answer

    def _point_problems(self, seed: int, sha256: str) -> Iterator[Problem]:
        """Tell of labels that are of other points."""
        if found := seed_problem(seed, self.reference.rules):
            yield found
        elif sha256 != (expected := points_sha256(self._voxels)):
            message = f"points_sha256 must be {expected!r} here, got {sha256!r}"
            yield Problem("E205", None, f"{message}: the labels are of other points")


def seed_problem(seed: int, rules: SegmentProtocol) -> Problem | None:
    """Tell of labels of another protocol's points."""
    if seed == rules.points_seed:
        return None
    message = f"points_seed must be {rules.points_seed} here, got {seed}"
    return Problem("E205", None, f"{message}: the labels are of another protocol's points")


def validate_segments(
    path: Path,
    reference: SegmentReference,
    track: Track | None = None,
    progress: Progress = iter,
) -> tuple[Problem, ...]:
    """Return everything that is wrong with a submission.

    Parameters
    ----------
    path
        The ``segments.npz``.
    reference, track, progress
        As in :class:`SegmentCheck`.

    Raises
    ------
    OSError
        If there is no such file.
    DataError
        If the points of an object cannot be drawn.
    """
    with Segments(path) as segments:
        check = SegmentCheck(segments, reference, track, progress)
        for _ in check.answers():
            pass
        return check.problems


def score_segment_file(
    path: Path,
    reference: SegmentReference,
    track: Track | None = None,
    progress: Progress = iter,
) -> Score:
    """Score a submission, one object in memory at a time.

    Parameters
    ----------
    path
        The ``segments.npz``.
    reference, track, progress
        As in :class:`SegmentCheck`.

    Raises
    ------
    SubmissionError
        With every problem of the submission.
    OSError
        If there is no such file.
    DataError
        If the truth cannot be read, or no object has two regions.
    """
    with Segments(path) as segments:
        check = SegmentCheck(segments, reference, track, progress)
        objects = tuple(_object_score(*one, reference.rules) for one in check.answers())
        raise_errors(check.problems, path)
        assert segments.meta is not None
        score = Score(segments.meta, segments.sha256, check.arrays_sha256, objects, reference.rules)
    if reference.rules.rank_by not in score.metrics:
        raise DataError(
            f"{reference.folder.root}: no object of the split {reference.split} has two material "
            "regions: there is nothing to tell apart"
        )
    return score


def _object_score(drawn: DrawnObject, answer: Segmentation, rules: SegmentProtocol) -> ObjectScore:
    truth = drawn.regions(rules.region_gap_g_cm3)
    metrics = score_segments(truth.materials, truth.parts, answer)
    return ObjectScore(
        drawn.row["object_id"],
        drawn.row["category"],
        drawn.row["source"],
        drawn.extent_cm,
        {name: metrics[name] for name in rules.metrics},
    )
