"""How a job ended, as the scoring process tells it and the tickets keep it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from xden1k.predictions import Problem
from xden_bench.entries.ranking import trusted_metrics

__all__ = ["Outcome", "find_entered"]


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a job ended.

    Parameters
    ----------
    state
        See :data:`xden_bench.serve.tickets.State`.
    problems, message, metrics
        As in :class:`xden_bench.serve.tickets.Status`.
    entry
        ``scored``: where the entry lies among the results, with ``/``; else None.
    """

    state: Literal["refused", "sound", "scored", "failed"]
    problems: tuple[Problem, ...] = ()
    message: str = ""
    entry: str | None = None
    metrics: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def to_json(self) -> str:
        """Return it as one line of JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Outcome:
        """Read what :meth:`to_json` wrote."""
        values = json.loads(text)
        problems = tuple(Problem(**one) for one in values.pop("problems"))
        return cls(problems=problems, **values)


def find_entered(
    results: Path, sha256: str, *, protocol: str, manifest_sha256: str, split: str
) -> Outcome | None:
    """Return what the entry of a submission says, whoever made it; None if there is no entry.

    Parameters
    ----------
    results
        Folder of all entries.
    sha256
        Of the submission.
    protocol, manifest_sha256, split
        What it was scored by and on.
    """
    wanted = (sha256, protocol, manifest_sha256, split)
    for path in results.rglob(f"*-{sha256[:8]}.json"):
        try:
            entry = json.loads(path.read_text(encoding="utf-8"))
            data = entry["dataset"]
            found = (entry["submission_sha256"], entry["protocol"], data["manifest_sha256"])
            if (*found, data["split"]) == wanted:
                return _scored(entry, path.relative_to(results))
        except (ValueError, TypeError, KeyError):
            continue  # no entry: read_entries tells of it
    return None


def _scored(entry: Mapping[str, Any], place: Path) -> Outcome:
    pairs = (warning.partition(": ") for warning in entry["warnings"])
    warnings = tuple(Problem(code, None, message) for code, _, message in pairs)
    return Outcome("scored", warnings, entry=place.as_posix(), metrics=trusted_metrics(entry))
