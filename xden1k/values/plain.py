"""Values as JSON knows them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

__all__ = ["plain"]


def plain(value: Any) -> Any:
    """Replace what JSON cannot hold: nan and infinities become null, tuples and sets lists.

    Examples
    --------
    >>> plain({"sd": float("nan"), "gain": (1.0, 0.9)})
    {'sd': None, 'gain': [1.0, 0.9]}
    """
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, set | frozenset):
        return [plain(item) for item in sorted(value)]
    return value
