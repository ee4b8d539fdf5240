"""Which test objects become private: drawn by the key, evenly over the categories."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping

from xden1k.errors import DataError
from xden_bench.sealed.key import Key

__all__ = ["private_ids"]


def private_ids(categories: Mapping[str, str], share: float, key: Key) -> frozenset[str]:
    """Choose the objects whose answers are kept back.

    Each category gives its share, rounded down or up (largest remainders first), so that the
    total is the share of all. Within a category, and between equal remainders, the key decides:
    without it the choice cannot be foretold, with it anyone can make it again.

    Parameters
    ----------
    categories
        Category of each object.
    share
        Of the objects, more than 0 and less than 1.
    key
        The organiser's.

    Raises
    ------
    DataError
        If the share is not of that range, or there are fewer than two objects.

    Examples
    --------
    >>> len(private_ids({"a": "mug", "b": "mug", "c": "pen", "d": "pen"}, 0.5, Key(bytes(32))))
    2
    """
    if not 0 < share < 1:
        raise DataError(f"the share must be more than 0 and less than 1, got {share:g}")
    if len(categories) < 2:
        raise DataError(f"two objects are the least to divide, got {len(categories)}")
    members: dict[str, list[str]] = defaultdict(list)
    for object_id in sorted(categories, key=lambda one: key.derive("object", one)):
        members[categories[object_id]].append(object_id)
    counts = _counts({name: len(ids) for name, ids in members.items()}, share, key)
    return frozenset(one for name, ids in members.items() for one in ids[: counts[name]])


def _counts(sizes: Mapping[str, int], share: float, key: Key) -> dict[str, int]:
    """Private objects of each category: largest remainders."""
    objects = sum(sizes.values())
    total = min(max(math.floor(share * objects + 0.5), 1), objects - 1)
    counts = {name: math.floor(share * size) for name, size in sizes.items()}
    by_remainder = sorted(
        sizes, key=lambda name: (counts[name] - share * sizes[name], key.derive("category", name))
    )
    for name in by_remainder[: total - sum(counts.values())]:
        counts[name] += 1
    return counts
