"""JSON whose fields may be spelt in any case."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from typing import Any, TypeGuard

from xden1k.errors import DataError

__all__ = ["field_named", "is_number", "parse_object"]


def parse_object(content: bytes, where: object) -> Mapping[str, Any]:
    """Read a JSON object.

    Raises
    ------
    DataError
        If it is something else.
    """
    try:
        values = json.loads(content)
    except ValueError as err:
        raise DataError(f"{where}: expected JSON, got {err}") from err
    if not isinstance(values, dict):
        raise DataError(f"{where}: expected a JSON object, got {type(values).__name__}")
    return values


def field_named(values: object, names: Iterable[str]) -> Any:
    """Return the first field of one of some names, in any case; None where there is none.

    Examples
    --------
    >>> field_named({"LAC": 0.2}, ["lac"]), field_named({"mu": 0.2}, ["lac"])
    (0.2, None)
    """
    if not isinstance(values, dict):
        return None
    spelt = {str(key).lower(): value for key, value in values.items()}
    return next((spelt[name] for name in names if name in spelt), None)


def is_number(value: object) -> TypeGuard[float]:
    """Whether a JSON value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
