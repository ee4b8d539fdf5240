"""``.eval_results/*.yaml``: an entry as the Hub reads it from a model's repository."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

import yaml  # type: ignore[import-untyped]
from huggingface_hub import EvalResultEntry, eval_result_entries_to_yaml

from xden1k.errors import DataError
from xden_bench.entries.durable import write_text
from xden_bench.entries.ranking import Entry, trusted_interval, unranked_because
from xden_bench.entries.result import entry_path
from xden_bench.scoring.protocol import load_protocol

__all__ = ["TASKS", "eval_results", "left_out_because", "write_eval_results"]

TASKS: Final[Mapping[str, str]] = {
    "density-mae": "density_mae_g_cm3",
    "com-l1": "com_l1_cm",
    "mass-mape": "mass_mape",
}
"""Metric of each task of the dataset's ``eval.yaml``."""


SOURCES: Final = {
    "scan": "real scans",
    "phantom": "simulated phantoms",
    "ct": "views of CTs",
    "published": "the authors' release with densities estimated anew",
}


def left_out_because(entry: Entry) -> str | None:
    """Why an entry belongs to none of the Hub's tasks, or None if it belongs to them.

    Parameters
    ----------
    entry
        From :func:`xden_bench.entries.reading.read_entries`.
    """
    if reason := unranked_because(entry):
        return f"not ranked: {reason}"
    rules = load_protocol()
    asked = {
        "protocol": (rules.name, entry["protocol"]),
        "metric version": (rules.metric_version, entry["metric_version"]),
        "target": ("density", entry["target"]),
        "split": ("test", entry["dataset"]["split"]),
    }
    for name, (expected, found) in asked.items():
        if found != expected:
            return f"{name} must be {expected!r}, got {found!r}"
    return None


def eval_results(entry: Entry, repo_id: str) -> list[EvalResultEntry]:
    """One value for each task, with all that a reader must know of it in the notes.

    Parameters
    ----------
    entry
        From :func:`xden_bench.entries.reading.read_entries`.
    repo_id
        Of the dataset on the Hub.

    Raises
    ------
    DataError
        If :func:`left_out_because` gives a reason.
    """
    if reason := left_out_because(entry):
        raise DataError(f"{entry['method']['name']} is none of the Hub's tasks: {reason}")
    return [
        EvalResultEntry(
            dataset_id=repo_id,
            task_id=task,
            value=entry["metrics"][metric]["mean"],
            date=entry["date"],
            notes=_notes(entry, metric),
        )
        for task, metric in TASKS.items()
    ]


def write_eval_results(entries: Iterable[Entry], folder: Path, repo_id: str) -> tuple[Path, ...]:
    """Write ``METHOD-CHECKSUM.yaml`` for each entry.

    Parameters
    ----------
    entries
        Of the Hub's tasks.
    folder
        Of the files; in a model's repository ``.eval_results``.
    repo_id
        Of the dataset on the Hub.

    Raises
    ------
    DataError
        If :func:`left_out_because` gives a reason for one; those before it are written.
    """
    written = []
    for entry in entries:
        values = eval_result_entries_to_yaml(eval_results(entry, repo_id))
        path = folder / entry_path(entry).with_suffix(".yaml").name
        write_text(path, yaml.safe_dump(values, sort_keys=False, allow_unicode=True))
        written.append(path)
    return tuple(written)


def _notes(entry: Entry, metric: str) -> str:
    data, ends = entry["dataset"], trusted_interval(entry, metric)
    sources = " and ".join(SOURCES.get(one, one) for one in data["source"].split("+"))
    sure = f"95 % interval {ends[0]:.4g} to {ends[1]:.4g}" if ends else "no interval"
    return (
        f"{entry['method']['name']}: {metric}, {sure}, over "
        f"{entry['n_objects']} objects, {sources}; track {entry['track']}, protocol "
        f"{entry['protocol']}, dataset {data['revision']} "
        f"(manifest {data['manifest_sha256'][:12]}), {entry['status']}"
    )
