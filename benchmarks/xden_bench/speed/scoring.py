"""How long scoring takes, as a ratio to reading the same arrays, in one run."""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from pathlib import Path

from xden1k.folder import open_folder
from xden1k.predictions import open_predictions
from xden_bench.scoring.protocol import Protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import score
from xden_bench.speed.rounds import seconds

__all__ = ["Speed", "measure_speed"]


@dataclass(frozen=True, slots=True)
class Speed:
    """Seconds for one submission.

    Parameters
    ----------
    objects
        In the submission.
    read_seconds
        To read truth and prediction of every object.
    score_seconds
        To check and score it, reading included.
    """

    objects: int
    read_seconds: float
    score_seconds: float

    @property
    def ratio(self) -> float:
        """Scoring over reading."""
        return self.score_seconds / self.read_seconds


def measure_speed(
    path: Path, root: Path, split: str, protocol: Protocol, repeats: int = 5
) -> Speed:
    """Measure the median of interleaved runs, after one to warm the file cache.

    Parameters
    ----------
    path
        A valid ``preds.npz``.
    root, split
        What it predicts.
    protocol
        The rules.
    repeats
        Runs of each kind.

    Raises
    ------
    SubmissionError
        If the submission is not valid.
    """

    def read() -> None:
        reference = Reference(open_folder(root), split)
        with open_predictions(path) as predictions:
            assert predictions.meta is not None
            for object_id in reference.ids:
                reference.truth(object_id, predictions.meta.target)
                predictions.read(object_id)
                if predictions.has_sd:
                    predictions.read_sd(object_id)

    def evaluate() -> None:
        score(path, Reference(open_folder(root), split), protocol)

    evaluate()
    times = [(seconds(read), seconds(evaluate)) for _ in range(repeats)]
    reading, scoring = (statistics.median(column) for column in zip(*times, strict=True))
    return Speed(len(Reference(open_folder(root), split).ids), reading, scoring)
