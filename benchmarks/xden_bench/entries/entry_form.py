"""What an entry must hold: keys, types and forms, and a method that keeps to the rules."""

from __future__ import annotations

import datetime
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from xden1k.errors import DataError
from xden1k.predictions import CODES, SubmissionMeta
from xden1k.predictions.meta import SCHEMA as SCHEMA_OF_DENSITIES
from xden1k.predictions.meta import SEGMENTS_SCHEMA, SegmentsMeta, parse_meta
from xden1k.values.types import PRIVATE
from xden_bench.entries.archive import check_url
from xden_bench.entries.signing import is_public_key, is_signed
from xden_bench.entries.untrusted import read_json
from xden_bench.scoring.protocol import (
    PROTOCOLS,
    SEGMENT_PROTOCOLS,
    load_rules,
    load_segment_protocol,
)
from xden_bench.scoring.reference import BY_ORGANISER, SELF_REPORTED

__all__ = ["FIRST_SCHEMA", "KEYS", "MEASURED", "SCHEMA", "check_form", "read_form"]

SCHEMA: Final = "xden-result/2"
FIRST_SCHEMA: Final = "xden-result/1"
"""Of entries without the checksum of their arrays."""
OF_FIRST_SCHEMA: Final = ("v1", "paper")
"""The protocols that had entries of the first schema."""
MAX_COMMAND: Final = 1000
MEASURED: Final = frozenset({"processor_seconds_per_object", "peak_memory_gb"})
"""What an entry tells of its method where it was measured; older ones have none of it."""


def read_form(path: Path) -> dict[str, Any]:
    """Read an entry, but not the objects beside it.

    Parameters
    ----------
    path
        Its JSON file.

    Raises
    ------
    DataError
        See :func:`check_form`.
    OSError
        If there is no such file.
    """
    entry: dict[str, Any] = read_json(path)
    check_form(entry, path)
    return entry


def check_form(entry: Any, path: Path) -> None:
    """Refuse what is no entry.

    Parameters
    ----------
    entry
        Whatever lies, or is to lie, in the file.
    path
        The file, for the message.

    Raises
    ------
    DataError
        If a key is missing or of the wrong type or form, or the entry says what no submission can
        have given: a name that is refused, another track than its inputs lead to, a status of its
        own; or its signature is not its team's.
    """
    try:
        if (schema := entry["schema"]) not in (SCHEMA, FIRST_SCHEMA):
            raise ValueError(f"schema is {schema!r}")
        shape = _shape(entry, _FIRST_SHAPE if schema == FIRST_SCHEMA else _SHAPE)
        if wrong := list(_misfits(entry, shape)) or list(_contradictions(entry)):
            raise ValueError("; ".join(wrong))
    except (ValueError, TypeError, KeyError, AttributeError) as err:
        raise DataError(f"{path}: not a result of schema {SCHEMA}: {err!r}") from err


def _shape(entry: Mapping[str, Any], required: Mapping[str, Any]) -> dict[str, Any]:
    """Types of what must be there, and of what may be and is."""
    shape = {**required, **{key: one for key, one in _OPTIONAL.items() if key in entry}}
    if isinstance(method := entry["method"], Mapping):
        shape["method"] = shape["method"] | dict.fromkeys(MEASURED & method.keys(), _NUMBER)
    return shape


def _contradictions(entry: Mapping[str, Any]) -> Iterator[str]:
    """Whatever is said that a submission and its scoring cannot have given."""
    yield from _method_contradictions(entry)
    yield from _rule_contradictions(entry)
    yield from _form_contradictions(entry)
    yield from _team_contradictions(entry)
    status = BY_ORGANISER if entry["dataset"]["split"] == PRIVATE else SELF_REPORTED
    if entry["status"] != status:
        yield f"status must be {status!r}, got {entry['status']!r}"


def _method_contradictions(entry: Mapping[str, Any]) -> Iterator[str]:
    """Read the method as the meta data of a submission are read."""
    method, data = entry["method"], entry["dataset"]
    values = {key: value for key, value in method.items() if value is not None}
    values |= {"method": values.pop("name"), "manifest_sha256": data["manifest_sha256"]}
    values |= {"dataset_revision": data["revision"], "config": data["config"]}
    values |= {"split": data["split"], **_of_task(entry)}
    form = SegmentsMeta if _is_of_segments(entry) else SubmissionMeta
    meta, problems = parse_meta(json.dumps(values), form)
    yield from map(str, problems)
    if meta is not None and meta.track != entry["track"]:
        yield f"track is {entry['track']!r}, the inputs lead to {meta.track!r}"


def _of_task(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the meta data of densities, or of segments, say beside what all say."""
    if not _is_of_segments(entry):
        return {"schema": SCHEMA_OF_DENSITIES, "target": entry["target"]}
    seed = load_segment_protocol(entry["protocol"]).points_seed
    points = {"points_seed": seed, "points_sha256": entry["points_sha256"]}
    return {"schema": SEGMENTS_SCHEMA, **points}


def _is_of_segments(entry: Mapping[str, Any]) -> bool:
    return entry["protocol"] in SEGMENT_PROTOCOLS


def _rule_contradictions(entry: Mapping[str, Any]) -> Iterator[str]:
    """Compare what follows from the protocol; one that does not exist is told elsewhere."""
    if entry["protocol"] not in (*PROTOCOLS, *SEGMENT_PROTOCOLS):
        return
    rules = load_rules(entry["protocol"])
    if entry["schema"] == FIRST_SCHEMA and rules.name not in OF_FIRST_SCHEMA:
        yield f"entries of protocol {rules.name!r} are of schema {SCHEMA!r}"
    if not 1 <= entry["metric_version"] <= rules.metric_version:
        yield f"metric_version must be 1 to {rules.metric_version}, got {entry['metric_version']}"
    if entry["dataset"]["config"] != rules.config:
        yield f"config must be {rules.config!r}, got {entry['dataset']['config']!r}"
    if entry["target"] not in rules.targets:
        yield f"target must be one of {list(rules.targets)}, got {entry['target']!r}"


def _form_contradictions(entry: Mapping[str, Any]) -> Iterator[str]:
    """Look at what is written down and cannot be computed."""
    for name, form, value in (
        ("submission_sha256", _SHA256, entry["submission_sha256"]),
        ("arrays_sha256", _SHA256, entry.get("arrays_sha256", "0" * 64)),
        ("commit", r"[0-9a-f]{40}(-dirty)?", entry["commit"] or "0" * 40),
        ("xden_version", r"[0-9][0-9a-z.+!-]{0,40}", entry["xden_version"]),
        ("command", rf".{{0,{MAX_COMMAND}}}", entry["command"]),
        *(("warnings", rf"({'|'.join(CODES)}): .+", one) for one in entry["warnings"]),
    ):
        if not re.fullmatch(form, value):
            yield f"{name} must be {form}, got {value[:100]!r}"
    if entry["date"] != datetime.date.fromisoformat(entry["date"]).isoformat():
        yield f"date must be YYYY-MM-DD, got {entry['date']!r}"


def _team_contradictions(entry: Mapping[str, Any]) -> Iterator[str]:
    """Check whose word it is, and where its submission lies."""
    if ("team" in entry) != ("signature" in entry):
        yield "team and signature go together"
    elif "team" in entry and not is_public_key(entry["team"]["public_key"]):
        yield f"public_key must be 64 hexadecimal digits, got {entry['team']['public_key'][:100]!r}"
    elif "team" in entry and not is_signed(entry, entry["team"]["public_key"]):
        yield f"the signature is not that of the team {entry['team']['name']!r} under this entry"
    archive = entry.get("archive", {"sha256": entry["submission_sha256"], "url": ""})
    if archive["sha256"] != entry["submission_sha256"]:
        yield f"archive holds {archive['sha256'][:100]!r}, not the submission"
    if archive["url"]:
        check_url(archive["url"])


_SHA256: Final = "[0-9a-f]{64}"
_TEXT_OR_NULL: Final = (str, type(None))
_NUMBER: Final = (int, float)
_NUMBER_OR_NULL: Final = (*_NUMBER, type(None))
_FIRST_SHAPE: Final[dict[str, Any]] = {
    "schema": str,
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
_SHAPE: Final[dict[str, Any]] = {
    **_FIRST_SHAPE,
    "method": {**_FIRST_SHAPE["method"], "hardware": str},
    "arrays_sha256": str,
}
"""Types of what an entry must hold; the numbers are compared with the objects instead."""
_OPTIONAL: Final[dict[str, Any]] = {
    "team": {"name": str, "public_key": str},
    "signature": str,
    "archive": {"sha256": str, "url": str},
    "points_sha256": str,
}
KEYS: Final = frozenset({*_SHAPE, *_OPTIONAL})
"""All but the numbers."""


def _misfits(value: Any, shape: Any, key: str = "entry") -> Iterator[str]:
    """Every place where a value is not of its shape: a type, several, a list of one, or keys."""
    if isinstance(shape, Mapping) and isinstance(value, dict):
        for name, inner in shape.items():
            if name in value:
                yield from _misfits(value[name], inner, name)
            else:
                yield f"{name} is missing from {key}"
        if key != "entry" and (unknown := sorted(value.keys() - shape.keys())):
            yield f"{key} has unknown keys {unknown}"
    elif isinstance(shape, list) and isinstance(value, list):
        for one in value:
            yield from _misfits(one, shape[0], key)
    elif isinstance(shape, Mapping | list) or not _is_of(value, shape):
        yield f"{key} is of the wrong type, {type(value).__name__}"


def _is_of(value: Any, shape: Any) -> bool:
    """Whether a value is of a type; true and false are no numbers."""
    return shape is bool if isinstance(value, bool) else isinstance(value, shape)
