"""The trivial methods: their names are theirs, and their values are told under any name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from xden1k.errors import DataError
from xden1k.predictions import CODES, Problem, SubmissionMeta, Target, open_predictions
from xden1k.predictor import Prediction
from xden1k.values.modality import Track
from xden_bench.methods.baseline import find_predictor
from xden_bench.methods.running import Options
from xden_bench.methods.scope import FolderScope, Task
from xden_bench.scoring.names import skeleton
from xden_bench.scoring.protocol import Protocol, is_trivial
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import Score, score
from xden_bench.scoring.submission import Progress, even_fill_g_cm3

__all__ = ["check_trivial", "score_told", "trivial_twin"]

WITHIN: Final = 0.02
"""Relative: two densities of an even filling that are no further apart are the same."""
SHARE: Final = 0.5
"""Of the objects: more of them filled as a trivial method does are that method."""


def score_told(
    path: Path,
    reference: Reference,
    protocol: Protocol,
    track: Track | None = None,
    progress: Progress = iter,
) -> Score:
    """Score a submission, with the warning W505 if its values are a trivial method's.

    Parameters
    ----------
    path, reference, protocol, track, progress
        See :func:`xden_bench.scoring.score.score`, which also says what is raised.
    """
    scored = score(path, reference, protocol, track, progress)
    if (twin := trivial_twin(scored, reference)) is None:
        return scored
    told = Problem("W505", None, f"{CODES['W505']}, {twin}")
    return replace(scored, warnings=(*scored.warnings, told))


def trivial_twin(scored: Score, reference: Reference) -> str | None:
    """Return which trivial method a submission of another name is, by its values; None if none.

    Parameters
    ----------
    scored
        The submission. More than half of its objects must be filled evenly, and within 2 % as the
        method fills them: a voxel changed, a factor near 1 or noise hides nothing.
    reference
        What it predicts; the trivial methods learn from its training split.
    """
    assert isinstance(scored.meta, SubmissionMeta)  # segments have no densities to fill with
    fills = scored.even_fills_g_cm3
    enough = SHARE * len(scored.objects)
    if len(fills) <= enough or is_trivial(scored.meta.method, scored.protocol):
        return None
    for name in scored.protocol.unranked:
        own = _asked(name, reference, scored.meta.target)
        same = 0
        for seen, (object_id, fill) in enumerate(fills.items()):
            if not same <= enough < same + len(fills) - seen:
                break  # decided
            even = even_fill_g_cm3(own(object_id), reference.truth(object_id).envelope)
            same += _is_same_fill(fill, even)
        if same > enough:
            return name
    return None


def check_trivial(path: Path, reference: Reference, protocol: Protocol) -> None:
    """Refuse a submission under the name of a trivial method that is not its prediction.

    The installed method runs again on the dataset and each value is compared. It guards what
    enters by ``xden-bench submit``; an entry written by hand is a matter for whoever reviews it.

    Parameters
    ----------
    path
        A valid submission.
    reference
        What it predicts.
    protocol
        Which names are those of trivial methods.

    Raises
    ------
    DataError
        If a value differs.
    """
    with open_predictions(path) as found:
        meta = found.meta
        if meta is None or not is_trivial(meta.method, protocol):
            return
        name = next(one for one in protocol.unranked if skeleton(one) == skeleton(meta.method))
        own = _asked(name, reference, meta.target)
        for object_id in reference.ids:
            if not _is_equal(found.read(object_id), own(object_id)):
                raise DataError(
                    f"{path}: the name {name!r} is that of a trivial method, and its value of "
                    f"{object_id} is another: give the method a name of its own"
                )


def _asked(name: str, reference: Reference, target: Target) -> Callable[[str], np.ndarray]:
    """Let an installed method learn, and return how it is asked for an object's values."""
    method = find_predictor(name)
    task = Task.of(reference.folder, reference.split)
    scope = FolderScope(reference.folder, task, method.reads, target)
    if method.trainable:
        method.fit(scope.train(), seed=Options().seed)

    def ask(object_id: str) -> np.ndarray:
        found = method.predict(scope.sample(object_id))
        return found.density_g_cm3 if isinstance(found, Prediction) else found

    return ask


def _is_same_fill(one: float, other: float | None) -> bool:
    return other is not None and abs(one - other) <= WITHIN * other


def _is_equal(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two grids are the same, whichever of the two dtypes they were stored as."""
    return one.shape == other.shape and np.allclose(one, other, rtol=2**-10, atol=2**-24)
