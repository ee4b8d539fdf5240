"""Reading results: what an entry says is made again and compared before it counts."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa

from xden1k.errors import DataError
from xden_bench.entries.admission import Owners
from xden_bench.entries.amendments import read_amendments
from xden_bench.entries.entry_form import KEYS, OF_FIRST_SCHEMA, read_form
from xden_bench.entries.identities import contradictions
from xden_bench.entries.recomputed import read_recomputed
from xden_bench.entries.result import entry_path, entry_paths, figures, objects_of
from xden_bench.entries.signing import read_maintainers
from xden_bench.entries.untrusted import read_limited, read_table
from xden_bench.scoring.metrics import METRICS
from xden_bench.scoring.protocol import load_rules
from xden_bench.scoring.reference import RECOMPUTED

__all__ = [
    "keep_best_of_teams",
    "read_entries",
    "read_entry",
    "read_sound_entries",
    "results_of",
]


def read_entries(
    results: Path, read: Callable[[Path, Path], dict[str, Any]] | None = None
) -> tuple[dict[str, Any], ...]:
    """Every entry below a folder, sorted by path; of a team one row of a table keeps its rank.

    Parameters
    ----------
    results
        The folder.
    read
        Gives an entry by its JSON file and the folder; None = :func:`read_entry`.

    Returns
    -------
    tuple of dict
        See :func:`read_entry`.

    Raises
    ------
    DataError
        If there is no such folder, or a JSON file in it is neither an entry nor a note beside one,
        or two entries that are not of one team have one name.
    """
    entry_paths(results)  # a note alone is refused too
    entries, problems = read_sound_entries(results, read)
    if problems:
        raise DataError(problems[0])
    return entries


def read_sound_entries(
    results: Path, read: Callable[[Path, Path], dict[str, Any]] | None = None
) -> tuple[tuple[dict[str, Any], ...], tuple[str, ...]]:
    """Every entry below a folder that can be read, and what is wrong with the others.

    For tables that must not go down with one bad file; what checks the results, such as
    ``xden-bench leaderboard --check``, uses :func:`read_entries`.

    Parameters
    ----------
    results
        The folder.
    read
        In place of :func:`read_entry`, for who keeps what was read.

    Returns
    -------
    entries, problems
        The entries as :func:`read_entries` gives them, and a line for each file that was left out.

    Raises
    ------
    DataError
        If there is no such folder.
    """
    sound: list[tuple[Path, dict[str, Any]]] = []
    problems = []
    for path in entry_paths(results, strict=False):
        try:
            sound.append((path, (read or read_entry)(path, results)))
        except (DataError, OSError) as err:
            problems.append(str(err))
    kept, owners = [], Owners()
    for path, entry in _by_age(sound):
        try:
            owners.admit(path, entry)
            kept.append((path, entry))
        except DataError as err:
            problems.append(str(err))
    entries = tuple(entry for _, entry in sorted(kept, key=lambda one: one[0]))
    keep_best_of_teams(entries)
    return entries, tuple(problems)


def _by_age(
    entries: Iterable[tuple[Path, dict[str, Any]]],
) -> list[tuple[Path, dict[str, Any]]]:
    return sorted(entries, key=lambda one: (one[1]["date"], str(one[0])))


def read_entry(path: Path, results: Path | None = None) -> dict[str, Any]:
    """One entry. Its numbers are made again from the objects beside it.

    Parameters
    ----------
    path
        Its JSON file.
    results
        The folder of all entries; None = the one that the file's place gives.

    Returns
    -------
    dict
        As stored, and ``object_scores``: every column of the Parquet file, as lists. What lies
        beside it is there too: a maintainer's note that counts
        (:mod:`xden_bench.entries.recomputed`) as ``recomputed``, and ``status`` says so;
        ``withdrawn`` and ``erratum`` (:mod:`xden_bench.entries.amendments`); under ``remarks``
        lines on notes that count nothing, if there are some; under ``disqualified`` why it has no
        rank whatever its scores, if there is a reason.

    Raises
    ------
    DataError
        If the file is no entry of this schema, contradicts itself, lies where another belongs, or
        does not agree with its objects, or these are missing or changed.
    OSError
        If there is no such file.
    """
    entry = read_form(path)
    root = results_of(path, entry, results)
    entry["object_scores"] = _checked_objects(path, entry)
    maintainers = read_maintainers(root)
    note, remark = read_recomputed(path, maintainers)
    amendments, remarks = read_amendments(path, entry, maintainers)
    if note is not None:
        entry |= {"status": RECOMPUTED, "recomputed": note}
    entry |= amendments
    if told := [*([remark] if remark else []), *remarks]:
        entry["remarks"] = told
    if reason := _disqualified_because(entry):
        entry["disqualified"] = reason
    return entry


def results_of(path: Path, entry: Mapping[str, Any], results: Path | None = None) -> Path:
    """Return the folder of all entries that an entry lies in.

    Raises
    ------
    DataError
        If it lies where another belongs.
    """
    place = entry_path(entry)
    here = path.absolute()
    root = results.absolute() if results else Path(*here.parts[: -len(place.parts)])
    if root / place != here:
        raise DataError(f"{path}: its content belongs to {place}")
    return root


def _disqualified_because(entry: Mapping[str, Any]) -> str | None:
    if "withdrawn" in entry:
        return f"withdrawn: {entry['withdrawn']['text']}"
    if entry["protocol"] not in OF_FIRST_SCHEMA and "archive" not in entry:
        return "its predictions are archived nowhere"
    return None


def keep_best_of_teams(entries: Iterable[dict[str, Any]]) -> None:
    """Disqualify, in each table, all methods of a team but its best, which may have many seeds.

    Parameters
    ----------
    entries
        From :func:`read_entry`; changed in place.
    """
    best: dict[tuple[Any, ...], dict[str, Any]] = {}
    rows = [one for one in entries if "team" in one and "disqualified" not in one]
    for row in sorted(rows, key=_loss):
        table = (entry_path(row).parent, row["metric_version"], row["team"]["public_key"])
        if best.setdefault(table, row)["method"]["name"] != row["method"]["name"]:
            row["disqualified"] = f"another row of {row['team']['name']} is better"


def _loss(entry: Mapping[str, Any]) -> tuple[float, str]:
    """Sort by the mean that ranks, the best first."""
    name = load_rules(entry["protocol"]).rank_by
    mean = float(entry["metrics"][name]["mean"])
    loss = -mean if METRICS[name].higher_is_better else mean
    return loss, entry["submission_sha256"]


def _checked_objects(path: Path, entry: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Make the numbers again from the objects beside the entry, compare, and return the objects."""
    objects = path.with_suffix(".parquet")
    if entry["objects"]["file"] != objects.name or not objects.is_file():
        raise DataError(f"{path}: its objects must lie beside it, in {objects.name}")
    data = read_limited(objects)
    if (found := hashlib.sha256(data).hexdigest()) != (stored := entry["objects"]["sha256"]):
        raise DataError(f"{objects}: sha256 is {found}, {path.name} says {stored}")
    try:
        rules = load_rules(entry["protocol"])
        table = read_table(data)
        columns: dict[str, list[Any]] = table.to_pydict()
        scores = objects_of(columns, rules)
        made = figures(scores, rules)
    except (DataError, pa.ArrowException, ValueError, TypeError, KeyError) as err:
        raise DataError(f"{path}: its objects cannot be summed up: {err!r}") from err
    if unknown := sorted(entry.keys() - KEYS - made.keys()):
        raise DataError(f"{path}: unknown keys {unknown}")
    for key, value in made.items():
        if not _agree(entry.get(key), json.loads(json.dumps(value))):
            raise DataError(f"{path}: {key} is not what the objects in {objects.name} give")
    for one in scores:
        for rule in contradictions(one.metrics, rules):
            raise DataError(f"{objects}: {one.object_id} cannot have scored so: {rule} must hold")
    if (source := "+".join(sorted(set(columns["source"])))) != entry["dataset"]["source"]:
        raise DataError(f"{path}: source is not that of the objects, {source}")
    return columns


def _agree(one: Any, other: Any) -> bool:
    """Whether two values of JSON are the same, numbers up to the rounding of another machine."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_agree(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_agree, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-12)
    return type(one) is type(other) and bool(one == other)
