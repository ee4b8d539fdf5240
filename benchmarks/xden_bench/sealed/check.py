"""Check sealed answers against what was published, once the key is at hand."""

from __future__ import annotations

from xden1k.errors import DataError
from xden_bench.scoring.submission import Progress
from xden_bench.sealed.container import SealedTruth

__all__ = ["check_sealed"]


def check_sealed(sealed: SealedTruth, progress: Progress = iter) -> list[str]:
    """Open the answers of every object and compare each with its published commitment.

    Parameters
    ----------
    sealed
        The answers.
    progress
        Goes through the object ids.

    Returns
    -------
    list of str
        Every problem found, one line each; none if the answers are those committed to.
    """
    problems = []
    for object_id in progress(sorted(sealed.commitments)):
        try:
            sealed.answers(object_id)
        except DataError as err:
            problems.append(str(err))
    return problems
