"""Where an entry stands, in words."""

from __future__ import annotations

from collections.abc import Sequence

from xden_bench.entries.ranking import Entry, rank_label, unranked_because

__all__ = ["no_rank_because", "standing"]


def no_rank_because(row: Entry) -> str:
    """Say why a row that has no rank has none."""
    return unranked_because(row) or f"protocol {row['protocol']} has no ranks"


def standing(row: Entry, rank: int | None, ranks: Sequence[int | None]) -> str:
    """Say where a row stands in its table, such as "rank 3 of 14 in track rgb".

    Parameters
    ----------
    row, rank
        The row, and its rank.
    ranks
        Of every row of the table, as :func:`xden_bench.entries.ranking.ranks` gives them.
    """
    if rank is None:
        return f"no rank in track {row['track']}: {no_rank_because(row)}"
    count = sum(one is not None for one in ranks)
    return f"rank {rank_label(rank, ranks)} of {count} in track {row['track']}"
