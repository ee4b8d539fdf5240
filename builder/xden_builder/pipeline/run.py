"""Rebuild a folder of captures: resumable, on one machine or many, stopped by no bad object.

Finished objects are kept as work files beside the result (``OUT.work/``). A rerun makes only what
is missing or changed; the dataset folder itself appears complete or not at all.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import partial
from pathlib import Path

from xden1k.documents.maintainer import ANSWERS_NAME
from xden1k.errors import DataError
from xden1k.format.records import object_row
from xden1k.values.cost import Meter
from xden_builder.capture import ObjectRow
from xden_builder.pipeline.beam import SharedBeam, shared_beam, with_beam
from xden_builder.pipeline.cluster import run_on_cluster
from xden_builder.pipeline.outcomes import REPORT_NAME, BuildReport, Outcome, Status
from xden_builder.pipeline.resumable import (
    assemble,
    gather,
    maintainers_answers,
    only_run,
    refuse_nothing,
    work_folder,
    write_report,
)
from xden_builder.pipeline.splits import with_splits
from xden_builder.pipeline.storage import (
    Place,
    absolute,
    inside,
    object_capture,
    object_rows,
    refuse_other_folders,
)
from xden_builder.pipeline.version import made_by_checksum, refuse_other_code
from xden_builder.pipeline.work import load_row, save_row
from xden_builder.reconstruct.object import reconstruct
from xden_builder.reconstruct.settings import BuildSettings
from xden_builder.triage.findings import find
from xden_builder.workers import run_each

__all__ = ["REPORT_NAME", "BuildReport", "Outcome", "build", "work_folder"]


def build(
    captures: Place,
    out: Place,
    settings: BuildSettings,
    *,
    workers: int,
    cluster: str = "",
    parts: Place | None = None,
    on_start: Callable[[int], None] = lambda _: None,
    on_done: Callable[[Outcome], None] = lambda _: None,
    on_asked: Callable[[int, int], None] = lambda *_: None,
) -> BuildReport:
    """Rebuild every object of a capture folder into a dataset folder.

    Parameters
    ----------
    captures
        The capture folder.
    out
        The dataset folder to write; an older one is replaced as a whole, but keeps its maintainer's
        answers where there are none beside the captures. ``build_report.json``
        and the work files go to ``OUT.work`` beside it.
    settings
        How to rebuild.
    workers
        Number of processes.
    cluster
        Address of a Ray cluster, which then does the work in place of processes here. It must see
        the paths given; what it does not see can be URLs.
    parts
        Other part meshes, ``PARTS/OBJECT_ID/parts``, in place of the annotated ones.
    on_start
        Called with the number of objects.
    on_done
        Called with each outcome as it comes.
    on_asked
        Called before, while some objects are asked for the beam they share: how many have answered,
        of how many.

    Raises
    ------
    DataError
        If the capture folder as a whole is not readable, ``out`` is something else than a dataset
        folder, another run is making it, or not one object could be built; then nothing is written
        to ``out``.
    OtherVersionError
        If a machine of the cluster has other code than this one.
    OSError
        If a disk is full: at once, with what is finished kept for a rerun.
    """
    stated = object_rows(captures)
    if isinstance(parts, Path) and not parts.is_dir():
        raise DataError(f"{parts}: no such folder of part meshes")
    refuse_other_folders(out)
    work = work_folder(out)
    made_by = made_by_checksum(settings)
    seen = absolute(captures), None if parts is None else absolute(parts), absolute(work)
    here, there = partial(run_each, workers=workers), partial(run_on_cluster, address=cluster)
    run = there if cluster else here
    asked, beam = settings, SharedBeam(None, 0.0)
    with only_run(work, out):
        said = maintainers_answers(inside(captures, ANSWERS_NAME), inside(out, ANSWERS_NAME))
        rows = with_splits(captures, stated)
        on_start(len(rows))
        if settings.model == "poly" and settings.filtration == "fitted":
            beam = shared_beam(rows, settings, made_by, seen, run, on_asked)
            settings = with_beam(settings, beam.found)
        task = partial(_build_object, settings, made_by_checksum(settings), *seen)
        outcomes = gather(run(task, rows.values()), on_done)
        report = BuildReport(outcomes, *beam)
        write_report(work, report)
        refuse_nothing(report, captures, out)
        assemble(report, work, out, asked.digest, said)
    return report


def _build_object(
    settings: BuildSettings,
    made_by: str,
    captures: Place,
    parts: Place | None,
    work: Place,
    asked: ObjectRow,
) -> Outcome:
    """Build one object in a worker process, unless it is kept from before."""
    refuse_other_code(settings, made_by)
    meter = Meter()
    object_id = asked.object_id
    with object_capture(captures, parts, asked) as folder:
        digest = hashlib.sha256(f"{made_by}\n{folder.digest(object_id)}".encode()).hexdigest()
        row = load_row(work, object_id, digest)
        status: Status = "kept"
        if row is None:
            status = "built"
            row = object_row(reconstruct(folder.read(object_id), settings))
            save_row(work, object_id, digest, row)
    return Outcome(object_id, status, "", find(row), meter.read(), digest)
