"""The split of an object whose capture names none."""

from __future__ import annotations

import hashlib
from typing import Final

import numpy as np

from xden1k.values.types import SPLITS, Split

__all__ = ["default_split"]

SPLIT_SHARES: Final = (0.7, 0.1, 0.2)
"""Of train, val and test."""


def default_split(object_id: str) -> Split:
    """Split of an object whose capture names none: by its id alone, 70 : 10 : 20.

    Examples
    --------
    >>> default_split("tooth"), default_split("tetra")
    ('train', 'test')
    """
    draw = int.from_bytes(hashlib.sha256(object_id.encode()).digest()[:8]) / 2**64
    edges = np.cumsum(SPLIT_SHARES)[:-1]
    return SPLITS[int(np.searchsorted(edges, draw, side="right"))]
