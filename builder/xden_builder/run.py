"""Rebuild a folder of captures: a process per core, resumable, one bad object never stops the rest.

Finished objects are kept as work files beside the result (``OUT.work/``). A rerun makes only what
is missing or changed; the dataset folder itself appears complete or not at all.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

from xden1k import __version__
from xden1k.errors import DataError
from xden1k.folder import refuse_to_replace_others, write_rows
from xden1k.records import object_row
from xden_builder.capture import CaptureFolder
from xden_builder.reconstruct import reconstruct
from xden_builder.settings import BuildSettings
from xden_builder.work import load_row, save_row
from xden_builder.workers import explain, run_each

__all__ = [
    "REPORT_NAME",
    "BuildReport",
    "Outcome",
    "build",
    "work_folder",
]

BUILDER = f"xden-build {__version__}"
REPORT_NAME = "build_report.json"
DATA_VERSION = "0.1.0"
"""Of the data a rebuild makes; a release sets its own tag."""

Status = Literal["built", "kept", "failed"]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one object.

    Parameters
    ----------
    object_id
        Which.
    status
        ``built`` now, ``kept`` from an earlier run, or ``failed``.
    message
        Why it failed; empty otherwise.
    flags
        The object's flags and, as ``part:flag``, its parts'.
    seconds
        Wall time in the worker.
    """

    object_id: str
    status: Status
    message: str = ""
    flags: tuple[str, ...] = ()
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class BuildReport:
    """What became of every object of a rebuild, sorted by id."""

    outcomes: tuple[Outcome, ...]

    def count(self, status: Status) -> int:
        """How many objects ended so."""
        return sum(outcome.status == status for outcome in self.outcomes)

    @property
    def failures(self) -> tuple[Outcome, ...]:
        """The objects that failed."""
        return tuple(outcome for outcome in self.outcomes if outcome.status == "failed")

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        counts = {status: self.count(status) for status in ("built", "kept", "failed")}
        return {
            "schema": "xden-build-report/1",
            "builder": BUILDER,
            **counts,
            "objects": [asdict(outcome) for outcome in self.outcomes],
        }


def build(
    captures: Path,
    out: Path,
    settings: BuildSettings,
    *,
    workers: int,
    parts: Path | None = None,
    on_done: Callable[[Outcome], None] = lambda _: None,
) -> BuildReport:
    """Rebuild every object of a capture folder into a dataset folder.

    Parameters
    ----------
    captures
        The capture folder.
    out
        The dataset folder to write; an older one is replaced as a whole. ``build_report.json``
        and the work files go to ``OUT.work`` beside it.
    settings
        How to rebuild.
    workers
        Number of processes.
    parts
        Other part meshes, ``PARTS/OBJECT_ID/parts``, in place of the annotated ones.
    on_done
        Called with each outcome as it comes.

    Raises
    ------
    DataError
        If the capture folder as a whole is not readable, ``out`` is something else than a dataset
        folder, or not one object could be built; then nothing is written to ``out``.
    """
    folder = CaptureFolder(captures, parts)
    refuse_to_replace_others(out)
    work = work_folder(out)
    work.mkdir(parents=True, exist_ok=True)
    made_by = _made_by(settings)
    task = partial(_build_object, captures, parts, settings, made_by, work)
    outcomes = []
    for object_id, answer in run_each(task, folder.object_ids, workers):
        outcomes.append(_outcome(object_id, answer))
        on_done(outcomes[-1])
    report = BuildReport(tuple(sorted(outcomes, key=lambda outcome: outcome.object_id)))
    _write_report(work / REPORT_NAME, report)
    if report.count("failed") == len(report.outcomes):
        first = report.failures[0]
        raise DataError(
            f"{captures}: no object could be built, {out} is not written; the first, "
            f"{first.object_id}: {first.message}; all in {work / REPORT_NAME}"
        )
    write_rows(
        _rows(folder, made_by, work, report),
        out,
        version=DATA_VERSION,
        builder=BUILDER,
        config_sha256=settings.digest,
    )
    return report


def work_folder(out: Path) -> Path:
    """Where the work files and the report of a dataset folder are kept."""
    return out.with_name(f"{out.name}.work")


def _build_object(
    captures: Path,
    parts: Path | None,
    settings: BuildSettings,
    made_by: str,
    work: Path,
    object_id: str,
) -> Outcome:
    """Build one object in a worker process, unless it is kept from before."""
    start = time.perf_counter()
    folder = CaptureFolder(captures, parts)
    digest, path = _digest(folder, made_by, object_id), work / f"{object_id}.h5"
    row = load_row(path, digest)
    status: Status = "kept"
    if row is None:
        status = "built"
        row = object_row(reconstruct(folder.read(object_id), settings))
        save_row(path, digest, row)
    return Outcome(object_id, status, "", _flags(row), time.perf_counter() - start)


def _digest(folder: CaptureFolder, made_by: str, object_id: str) -> str:
    """Checksum of everything a work file depends on."""
    return hashlib.sha256(f"{made_by}\n{folder.digest(object_id)}".encode()).hexdigest()


def _made_by(settings: BuildSettings) -> str:
    """Checksum of settings and code, so that a corrected builder makes its objects anew."""
    digest = hashlib.sha256(f"{BUILDER}\n{settings.digest}\n".encode())
    for package, folder in ((name, Path(str(files(name)))) for name in ("xden1k", "xden_builder")):
        for path in sorted(folder.rglob("*")):
            if path.suffix in (".py", ".csv") and "phantoms" not in path.parts:
                digest.update(f"{package}/{path.relative_to(folder).as_posix()}\n".encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()


def _flags(row: Mapping[str, Any]) -> tuple[str, ...]:
    parts = zip(row["part_names"], row["part_flags"], strict=True)
    return (*row["flags"], *(f"{name}:{flag}" for name, flags in parts for flag in flags))


def _outcome(object_id: str, answer: Outcome | BaseException) -> Outcome:
    if isinstance(answer, Outcome):
        return answer
    return Outcome(object_id, "failed", explain(object_id, answer))


def _rows(
    folder: CaptureFolder, made_by: str, work: Path, report: BuildReport
) -> Iterator[Mapping[str, Any]]:
    """Rows of the objects that are there, sorted by id."""
    for outcome in report.outcomes:
        if outcome.status != "failed":
            digest = _digest(folder, made_by, outcome.object_id)
            row = load_row(work / f"{outcome.object_id}.h5", digest)
            if row is None:
                raise DataError(f"{outcome.object_id}: its capture changed during the rebuild")
            yield row


def _write_report(path: Path, report: BuildReport) -> None:
    partial_path = path.with_suffix(".partial")
    text = json.dumps(report.to_dict(), indent=2, ensure_ascii=False) + "\n"
    partial_path.write_text(text, encoding="utf-8")
    os.replace(partial_path, path)
