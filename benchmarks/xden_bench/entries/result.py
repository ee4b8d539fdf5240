"""Results: one JSON file for each entry of the leaderboard, its objects beside it as Parquet."""

from __future__ import annotations

import datetime
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from xden1k.errors import DataError
from xden1k.segmentation import SegmentsMeta
from xden_bench.entries.admission import (
    EnteredError,
    check_admission,
    light_entries,
)
from xden_bench.entries.amendments import KINDS
from xden_bench.entries.archive import keep
from xden_bench.entries.copies import refuse_earlier_copy
from xden_bench.entries.durable import results_lock, sync_folder, write_whole
from xden_bench.entries.entry_form import MEASURED, SCHEMA, check_form
from xden_bench.entries.provenance import code_commit, package_version
from xden_bench.entries.recomputed import SUFFIX
from xden_bench.entries.signing import SigningKey
from xden_bench.scoring.bootstrap import Estimate
from xden_bench.scoring.metrics import METRICS
from xden_bench.scoring.protocol import Rules
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import (
    ObjectScore,
    Score,
    by_category,
    by_size,
    left_out,
    summary,
)

__all__ = [
    "EnteredError",
    "entry_of",
    "entry_path",
    "entry_paths",
    "figures",
    "object_columns",
    "objects_of",
    "slug",
    "write_entry",
]

NOTES: Final = (SUFFIX, *(f".{kind}.json" for kind in KINDS))
"""Endings of what may lie beside an entry."""
_NAMES: Final = ("object_id", "category", "source")
_OBJECT_COLUMNS: Final = (*_NAMES, "extent_cm")


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
    points = {"points_sha256": meta.points_sha256} if isinstance(meta, SegmentsMeta) else {}
    return {
        "schema": SCHEMA,
        "method": {
            "name": meta.method,
            "inputs": list(meta.inputs),
            "training_data": list(meta.training_data),
            "external_data": meta.external_data,
            "seed": meta.seed,
            "seconds_per_object": meta.seconds_per_object,
            "hardware": meta.hardware,
            "command": meta.command,
            "code": meta.code,
            "paper": meta.paper,
            "notes": meta.notes,
            **{key: value for key in sorted(MEASURED) if (value := getattr(meta, key)) is not None},
        },
        "protocol": rules.name,
        "metric_version": rules.metric_version,
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
        "arrays_sha256": score.arrays_sha256,
        **points,
        "xden_version": package_version(),
        "commit": code_commit(),
        "command": command,
        "date": date.isoformat(),
        **figures(score.objects, rules),
        "status": reference.status,
        "warnings": [str(problem) for problem in score.warnings],
    }


def write_entry(
    entry: Mapping[str, Any],
    score: Score,
    results: Path,
    *,
    submission: Path | None = None,
    archive_url: str = "",
    key: SigningKey | None = None,
    by_anyone: bool = False,
) -> Path:
    """Add an entry, under the lock of the results: the objects, then the JSON file that counts.

    It is on the disk when this returns; after an error neither file is there.

    Parameters
    ----------
    entry
        From :func:`entry_of`.
    score
        Whose objects go into the Parquet file of the same name.
    results
        Folder of all entries.
    submission
        The file that was scored, which is copied into the archive of the results.
    archive_url
        Where it can be fetched instead: then it is not copied.
    key
        Of the team that enters it, which signs it; None enters it for nobody.
    by_anyone
        Whether nobody looks who sends it: :func:`xden_bench.entries.admission.check_admission`.

    Returns
    -------
    Path
        The JSON file, ``PROTOCOL/DATASET/TRACK/METHOD-CHECKSUM.json`` in ``results``.

    Raises
    ------
    EnteredError
        If this submission is entered already, or its arrays are; or if it is a copy that would
        come before what it copies.
    DataError
        If the entry could not be read again, or its name or its team may not be entered.
    OSError
        If the disk does not take it.
    """
    path = results / entry_path(entry)
    objects, table = path.with_suffix(".parquet"), _parquet(object_columns(score))
    digest = hashlib.sha256(table).hexdigest()
    stored = {**entry, "objects": {"file": objects.name, "sha256": digest}}
    if submission is not None or archive_url:
        stored["archive"] = {"sha256": score.submission_sha256, "url": archive_url}
    if key is not None:
        stored = key.signed({**stored, "team": key.team})
    text = json.dumps(stored, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    check_form(stored, path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with results_lock(results):
        if path.exists():
            raise EnteredError(
                f"this submission is entered already: {path}; entries are never changed"
            )
        others = light_entries(results)
        check_admission(stored, others, by_anyone=by_anyone)
        scored = {**stored, "object_scores": object_columns(score)}
        refuse_earlier_copy(scored, others, results)
        if submission is not None and not archive_url:
            keep(submission, score.submission_sha256, results)
        _write_both(path, text, objects, table)
        for folder in path.parents[: len(path.parents) - len(results.parents)]:
            sync_folder(folder)
    return path


def _write_both(path: Path, text: str, objects: Path, table: bytes) -> None:
    """Write the objects, then the entry; after an error neither is there."""
    for left in path.parent.glob(f".{path.stem}.*.partial"):  # by one that was killed
        left.unlink()
    try:
        write_whole(objects, table)
        write_whole(path, text.encode("utf-8"))
    except BaseException:
        for one in (path, objects):
            one.unlink(missing_ok=True)
        raise


def _parquet(columns: Mapping[str, Sequence[Any]]) -> bytes:
    stream = pa.BufferOutputStream()
    pq.write_table(pa.table(columns), stream, compression="zstd")
    data: bytes = stream.getvalue().to_pybytes()
    return data


def entry_path(entry: Mapping[str, Any]) -> Path:
    """Where an entry lies among the results; two entries of one submission collide."""
    data = entry["dataset"]
    version = f"{data['revision']}-{data['manifest_sha256'][:8]}"
    table = f"{version}-{data['split']}-{data['source']}-{entry['target']}"
    name = f"{slug(entry['method']['name'])}-{entry['submission_sha256'][:8]}.json"
    return Path(slug(entry["protocol"]), slug(table), entry["track"], name)


def entry_paths(results: Path, *, strict: bool = True) -> list[Path]:
    """JSON files of every entry below a folder, sorted.

    Parameters
    ----------
    results
        The folder.
    strict
        Whether a note must lie beside an entry.

    Raises
    ------
    DataError
        If there is no such folder, or a note in it has no entry beside it.
    """
    if not results.is_dir():
        raise DataError(f"there is no folder of results at {results}")
    paths = sorted(results.rglob("*.json"))
    entries = [path for path in paths if not path.name.endswith(NOTES)]
    beside = {path.with_suffix(suffix) for path in entries for suffix in NOTES}
    if strict and (alone := set(paths) - {*entries, *beside}):
        raise DataError(f"{min(alone)}: there is no entry beside it")
    return entries


def objects_of(columns: Mapping[str, Sequence[Any]], rules: Rules) -> tuple[ObjectScore, ...]:
    """Scores of the objects, from the columns of :func:`object_columns`.

    Raises
    ------
    KeyError
        If a column is missing.
    TypeError
        If one holds something else than numbers, or names.
    """
    names = rules.metrics_of(has_sd=not set(rules.sd_metrics).isdisjoint(columns))
    for name in (*_OBJECT_COLUMNS, *names):
        kind = str if name in _NAMES else float
        if not all(isinstance(value, kind) for value in columns[name]):
            raise TypeError(f"expected {kind.__name__} in column {name}")
    rows = zip(*(columns[name] for name in (*_OBJECT_COLUMNS, *names)), strict=True)
    return tuple(
        ObjectScore(one, category, source, extent_cm, dict(zip(names, values, strict=True)))
        for one, category, source, extent_cm, *values in rows
    )


def figures(objects: Sequence[ObjectScore], rules: Rules) -> dict[str, Any]:
    """Every number of an entry that follows from its objects.

    Parameters
    ----------
    objects
        Of the split, sorted by id.
    rules
        The protocol.
    """
    metrics, without = summary(objects, rules), left_out(objects)
    return {
        "bootstrap": {"seed": rules.bootstrap_seed, "resamples": rules.bootstrap_resamples},
        "n_objects": len(objects),
        **({"left_out": dict(without)} if without else {}),
        "metrics": _metrics(metrics),
        "higher_is_better": {name: METRICS[name].higher_is_better for name in metrics},
        "by_category": _groups(by_category(objects, rules)),
        "by_size": _groups(by_size(objects, rules)),
    }


def object_columns(score: Score) -> dict[str, list[Any]]:
    """Scores of the objects, sorted by id, by column: what lies beside an entry as Parquet."""
    columns: dict[str, list[Any]] = {
        name: [getattr(one, name) for one in score.objects] for name in _OBJECT_COLUMNS
    }
    for name in score.metrics:
        columns[name] = [one.metrics[name] for one in score.objects]
    return columns


def _metrics(estimates: Mapping[str, Estimate]) -> dict[str, Any]:
    return {name: one.to_json() for name, one in estimates.items()}


def _groups(groups: Mapping[str, tuple[int, Mapping[str, Estimate]]]) -> dict[str, Any]:
    return {
        name: {"n_objects": count, "metrics": _metrics(estimates)}
        for name, (count, estimates) in groups.items()
    }


def slug(text: str) -> str:
    """Letters and digits of a name, for a file.

    Examples
    --------
    >>> slug("../My Net (v2)")
    'my-net-v2'
    """
    return re.sub(r"[^a-z0-9.]+", "-", text.lower()).strip("-.")[:60] or "unnamed"
