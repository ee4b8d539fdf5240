"""Results: one JSON file for each entry of the leaderboard, its objects beside it as Parquet."""

from __future__ import annotations

import datetime
import hashlib
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from xden1k.errors import DataError
from xden_bench.bootstrap import Estimate
from xden_bench.metrics import METRICS
from xden_bench.provenance import code_commit, package_version
from xden_bench.reference import Reference
from xden_bench.scoring import Score

__all__ = ["RESULTS", "SCHEMA", "entry_of", "read_entries", "write_entry", "write_text"]

SCHEMA: Final = "xden-result/1"
RESULTS: Final = Path("benchmarks/results")
"""Where entries lie in the repository."""


def entry_of(
    score: Score, reference: Reference, *, command: str, date: datetime.date
) -> dict[str, Any]:
    """Return what is kept of a score, of JSON's types.

    Parameters
    ----------
    score, reference
        The score and the truth it was made with.
    command
        That scored it.
    date
        When.
    """
    meta, rules = score.meta, score.protocol
    return {
        "schema": SCHEMA,
        "method": {
            "name": meta.method,
            "inputs": list(meta.inputs),
            "training_data": list(meta.training_data),
            "external_data": meta.external_data,
            "seed": meta.seed,
            "seconds_per_object": meta.seconds_per_object,
            "command": meta.command,
            "code": meta.code,
            "paper": meta.paper,
            "notes": meta.notes,
        },
        "protocol": rules.name,
        "track": meta.track,
        "target": meta.target,
        "dataset": {
            "revision": reference.revision,
            "config": rules.config,
            "split": reference.split,
            "source": "+".join(score.sources),
            "manifest_sha256": reference.manifest_sha256,
        },
        "submission_sha256": score.submission_sha256,
        "xden_version": package_version(),
        "commit": code_commit(),
        "command": command,
        "date": date.isoformat(),
        "bootstrap": {"seed": rules.bootstrap_seed, "resamples": rules.bootstrap_resamples},
        "n_objects": len(score.objects),
        "metrics": _metrics(score.metrics),
        "higher_is_better": {name: METRICS[name].higher_is_better for name in rules.metrics},
        "by_category": _groups(score.by_category()),
        "by_size": _groups(score.by_size()),
        "status": "self-reported",
        "warnings": [str(problem) for problem in score.warnings],
    }


def write_entry(entry: Mapping[str, Any], score: Score, results: Path) -> Path:
    """Add an entry: the objects first, then, all at once, the JSON file that makes it count.

    Parameters
    ----------
    entry
        From :func:`entry_of`.
    score
        Whose objects go into the Parquet file of the same name.
    results
        Folder of all entries.

    Returns
    -------
    Path
        The JSON file, ``PROTOCOL/DATASET/TRACK/METHOD-CHECKSUM.json`` in ``results``.

    Raises
    ------
    DataError
        If this submission is entered already.
    """
    path = results / entry_path(entry)
    taken = DataError(f"this submission is entered already: {path}; entries are never changed")
    if path.exists():
        raise taken
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    objects = path.with_suffix(".parquet")
    try:
        pq.write_table(_object_table(score), partial, compression="zstd")
        digest = hashlib.sha256(partial.read_bytes()).hexdigest()
        partial.replace(objects)
        stored = {**entry, "objects": {"file": objects.name, "sha256": digest}}
        text = json.dumps(stored, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        partial.write_text(text, encoding="utf-8", newline="\n")
        path.hardlink_to(partial)  # unlike a rename, it fails if another process was faster
    except FileExistsError as err:
        raise taken from err
    finally:
        partial.unlink(missing_ok=True)
    return path


def write_text(path: Path, text: str) -> None:
    """Write a text file, all at once."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        partial.write_text(text, encoding="utf-8", newline="\n")
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def entry_path(entry: Mapping[str, Any]) -> Path:
    """Where an entry lies among the results; two entries of one submission collide."""
    data = entry["dataset"]
    version = f"{data['revision']}-{data['manifest_sha256'][:8]}"
    table = f"{version}-{data['split']}-{data['source']}-{entry['target']}"
    name = f"{_slug(entry['method']['name'])}-{entry['submission_sha256'][:8]}.json"
    return Path(_slug(entry["protocol"]), _slug(table), entry["track"], name)


def read_entries(results: Path) -> tuple[dict[str, Any], ...]:
    """Every entry below a folder, sorted by path.

    Raises
    ------
    DataError
        If there is no such folder, or a JSON file in it is no entry of this schema or lies where
        another belongs.
    """
    if not results.is_dir():
        raise DataError(f"there is no folder of results at {results}")
    return tuple(_read_entry(path, results) for path in sorted(results.rglob("*.json")))


def _read_entry(path: Path, results: Path) -> dict[str, Any]:
    try:
        entry: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if entry["schema"] != SCHEMA:
            raise ValueError(f"schema is {entry['schema']!r}")
        place = entry_path(entry)
    except (ValueError, TypeError, KeyError) as err:
        raise DataError(f"{path}: not a result of schema {SCHEMA}: {err!r}") from err
    if results / place != path:
        raise DataError(f"{path}: its content belongs to {place}")
    return entry


def _object_table(score: Score) -> pa.Table:
    columns: dict[str, list[Any]] = {
        name: [getattr(one, name) for one in score.objects]
        for name in ("object_id", "category", "source", "extent_cm")
    }
    for name in score.protocol.metrics:
        columns[name] = [one.metrics[name] for one in score.objects]
    return pa.table(columns)


def _metrics(estimates: Mapping[str, Estimate]) -> dict[str, Any]:
    return {name: one.to_json() for name, one in estimates.items()}


def _groups(groups: Mapping[str, tuple[int, Mapping[str, Estimate]]]) -> dict[str, Any]:
    return {
        name: {"n_objects": count, "metrics": _metrics(estimates)}
        for name, (count, estimates) in groups.items()
    }


def _slug(text: str) -> str:
    """Letters and digits of a name, for a file.

    Examples
    --------
    >>> _slug("../My Net (v2)")
    'my-net-v2'
    """
    return re.sub(r"[^a-z0-9.]+", "-", text.lower()).strip("-.")[:60] or "unnamed"
