"""Where an entry stands, in words."""

from __future__ import annotations

from collections.abc import Sequence

from xden_bench.entries.merging import entries_of
from xden_bench.entries.ranking import Entry, unranked_because
from xden_bench.entries.result import entry_path

__all__ = ["rank_label", "standing"]


def rank_label(rank: int, ranks: Sequence[int | None]) -> str:
    """Return a rank as it is printed: with ``=`` where rows share it.

    Examples
    --------
    >>> rank_label(1, [1, 1, None]), rank_label(3, [1, 1, 3])
    ('1=', '3')
    """
    return f"{rank}{'=' if ranks.count(rank) > 1 else ''}"


def standing(entry: Entry, rows: Sequence[Entry], ranks: Sequence[int | None]) -> str:
    """Say where an entry stands in its table, such as "rank 3 of 14 in track rgb".

    Parameters
    ----------
    entry
        One of the rows.
    rows
        Of the table.
    ranks
        Of the rows, as :func:`xden_bench.entries.ranking.ranks` gives them.
    """
    own = entry_path(entry)
    held = [own in map(entry_path, entries_of(row)) for row in rows]
    rank = ranks[held.index(True)]
    if rank is None:
        reason = unranked_because(rows[held.index(True)])
        return f"no rank in track {entry['track']}: {reason}"
    count = sum(one is not None for one in ranks)
    return f"rank {rank_label(rank, ranks)} of {count} in track {entry['track']}"
