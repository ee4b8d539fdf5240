"""Objects that are not learned from, but choose the epoch."""

from __future__ import annotations

from collections.abc import Sequence, Set
from typing import TypeVar

import numpy as np

from xden1k.errors import DataError

__all__ = ["held_out_numbers", "split_off"]

Object = TypeVar("Object")


def held_out_numbers(count: int, share: float, rng: np.random.Generator) -> Set[int]:
    """Draw which of so many objects are held out: their share, at least one.

    Raises
    ------
    DataError
        If there are fewer than two objects.
    """
    if count < 2:
        raise DataError(f"training needs at least 2 objects, one held out; got {count}")
    wanted = min(max(1, round(share * count)), count - 1)
    return frozenset(rng.permutation(count)[:wanted].tolist())


def split_off(
    objects: Sequence[Object], share: float, rng: np.random.Generator
) -> tuple[list[Object], list[Object]]:
    """Return the objects to learn from and those held out."""
    chosen = held_out_numbers(len(objects), share, rng)
    learned = [one for index, one in enumerate(objects) if index not in chosen]
    return learned, [one for index, one in enumerate(objects) if index in chosen]
