"""The private split as the benchmark sees it: with the key, or without."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from xden1k.folder.withheld import ANSWER_COLUMNS
from xden1k.format.codec import to_planes
from xden1k.format.shards import Row
from xden1k.values.types import FIELD_SIZE
from xden_bench.scoring.reference import BY_ORGANISER, Reference
from xden_bench.sealed.container import SealedTruth

__all__ = ["InputsReference", "SealedReference"]


@dataclass(frozen=True, eq=False)
class SealedReference(Reference):
    """The private split of a public folder, its answers opened object by object.

    It gives the very numbers that the folder gave before it was sealed.

    Parameters
    ----------
    sealed
        The answers, of the same folder.
    """

    sealed: SealedTruth

    can_be_private = True
    status = BY_ORGANISER

    def _row(self, object_id: str, columns: Sequence[str]) -> Row:
        answers = [name for name in columns if name in ANSWER_COLUMNS]
        row = super()._row(object_id, [name for name in columns if name not in answers])
        opened = self.sealed.answers(object_id) if answers else {}
        return row | {name: opened[name] for name in answers}


@dataclass(frozen=True, eq=False)
class InputsReference(Reference):
    """The private split without its answers: enough to check a submission, not to score it.

    Every density is not a number.
    """

    can_be_private = True

    def _row(self, object_id: str, columns: Sequence[str]) -> Row:
        row = super()._row(object_id, columns)
        return row | {name: _unknown_field() for name in columns if row[name] is None}


@cache
def _unknown_field() -> bytes:
    """Return a stored field of which no value is known."""
    return to_planes(np.full((FIELD_SIZE,) * 3, np.nan, dtype="<f2"))
