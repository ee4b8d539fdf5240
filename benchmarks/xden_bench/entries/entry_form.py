"""What an entry must hold: keys and types, and a method that keeps to the rules of submissions."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from xden1k.errors import DataError
from xden1k.predictions.meta import SCHEMA as SUBMISSION_SCHEMA
from xden1k.predictions.meta import parse_meta
from xden1k.values.types import PRIVATE
from xden_bench.entries.untrusted import read_json
from xden_bench.scoring.reference import BY_ORGANISER, SELF_REPORTED

__all__ = ["SCHEMA", "read_form"]

SCHEMA: Final = "xden-result/1"


def read_form(path: Path) -> dict[str, Any]:
    """Read an entry, but not the objects beside it.

    Parameters
    ----------
    path
        Its JSON file.

    Raises
    ------
    DataError
        If a key is missing or of the wrong type, or the entry says what no submission can have
        given: a name that is refused, another track than its inputs lead to, a status of its own.
    OSError
        If there is no such file.
    """
    entry: dict[str, Any] = read_json(path)
    try:
        if entry["schema"] != SCHEMA:
            raise ValueError(f"schema is {entry['schema']!r}")
        if wrong := list(_misfits(entry, _SHAPE)) or list(_contradictions(entry)):
            raise ValueError("; ".join(wrong))
    except (ValueError, TypeError, KeyError) as err:
        raise DataError(f"{path}: not a result of schema {SCHEMA}: {err!r}") from err
    return entry


def _contradictions(entry: Mapping[str, Any]) -> Iterator[str]:
    """Whatever is said that a submission and its scoring cannot have given."""
    method, data = entry["method"], entry["dataset"]
    values = {key: value for key, value in method.items() if value is not None}
    values |= {"method": values.pop("name"), "target": entry["target"]}
    values |= {"schema": SUBMISSION_SCHEMA, "manifest_sha256": data["manifest_sha256"]}
    values |= {"dataset_revision": data["revision"], "config": data["config"]}
    meta, problems = parse_meta(json.dumps({**values, "split": data["split"]}))
    yield from map(str, problems)
    if meta is not None and meta.track != entry["track"]:
        yield f"track is {entry['track']!r}, the inputs lead to {meta.track!r}"
    status = BY_ORGANISER if data["split"] == PRIVATE else SELF_REPORTED
    if entry["status"] != status:
        yield f"status must be {status!r}, got {entry['status']!r}"


_TEXT_OR_NULL: Final = (str, type(None))
_NUMBER_OR_NULL: Final = (int, float, type(None))
_SHAPE: Final[Mapping[str, Any]] = {
    "method": {
        **dict.fromkeys(("name", "command", "code", "paper", "notes"), str),
        **{"inputs": [str], "training_data": [str], "external_data": bool},
        **dict.fromkeys(("seed", "seconds_per_object"), _NUMBER_OR_NULL),
    },
    **dict.fromkeys(("protocol", "track", "target", "submission_sha256", "xden_version"), str),
    **dict.fromkeys(("command", "date", "status"), str),
    "metric_version": int,
    "dataset": dict.fromkeys(("revision", "config", "split", "source", "manifest_sha256"), str),
    "commit": _TEXT_OR_NULL,
    "warnings": [str],
    "objects": {"file": str, "sha256": str},
}
"""Types of what an entry must hold; the numbers are compared with the objects instead."""


def _misfits(value: Any, shape: Any, key: str = "entry") -> Iterator[str]:
    """Every place where a value is not of its shape: a type, several, a list of one, or keys."""
    if isinstance(shape, Mapping) and isinstance(value, dict):
        for name, inner in shape.items():
            if name in value:
                yield from _misfits(value[name], inner, name)
            else:
                yield f"{name} is missing from {key}"
    elif isinstance(shape, list) and isinstance(value, list):
        for one in value:
            yield from _misfits(one, shape[0], key)
    elif isinstance(shape, Mapping | list) or not isinstance(value, shape):
        yield f"{key} is of the wrong type, {type(value).__name__}"
