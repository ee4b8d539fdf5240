"""Objects whose shapes are others' models, told by the notes in their ``meta_json``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

__all__ = ["ON_PARTNEXT", "is_on_partnext"]

ON_PARTNEXT: Final = "simulated materials on PartNeXt shapes"
"""How the notes of an object begin, and of its capture, if its shape is one of PartNeXt's."""


def is_on_partnext(row: Mapping[str, Any]) -> bool:
    """Whether the shape of an encoded row's object is one of PartNeXt's.

    Examples
    --------
    >>> is_on_partnext({"meta_json": '{"notes": "simulated materials on PartNeXt shapes"}'})
    True
    >>> is_on_partnext({"meta_json": '{"notes": "lid taped shut"}'})
    False
    """
    meta = row["meta_json"]
    if not meta or ON_PARTNEXT not in meta:
        return False
    return str(json.loads(meta).get("notes", "")).startswith(ON_PARTNEXT)
