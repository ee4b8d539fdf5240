"""A run's objects, one after the other, into a submission."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Final

import numpy as np

from xden1k.access.samples import SampleView
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.predictions import PredictionsWriter, SubmissionMeta, raise_errors
from xden1k.predictions.meta import parse_meta
from xden1k.values.modality import Modality
from xden_baselines.adapters.cloud import Cloud
from xden_baselines.adapters.filling import Filled, fill
from xden_baselines.adapters.frames import Frames

__all__ = ["Adapted", "Read", "Report", "Row", "RunError", "adapt"]

READS: Final = Modality.GEOMETRY
"""What an adapter looks at of the dataset."""
Read = Callable[[str, SampleView], Cloud]
"""Reads what a run has of an object: by the name it has there, and as the dataset shows it."""


class RunError(DataError):
    """A run that cannot be adapted: a line for each object, after how many there are of how many.

    Parameters
    ----------
    refused
        What is wrong with each.
    objects
        How many there are in the split.
    """

    def __init__(self, refused: Sequence[str], objects: int) -> None:
        if objects == 1:
            super().__init__(refused[0])
        else:
            count = f"{len(refused)} of {objects} objects cannot be adapted:"
            super().__init__("\n  ".join([count, *refused]))


@dataclass(frozen=True, slots=True)
class Row:
    """What the submission says of the run.

    Parameters
    ----------
    method
        Display name.
    adapter
        Which one read it.
    inputs
        Everything the run looked at, as a submission names it.
    training_data
        What the method was trained on, as a submission names it.
    seconds_per_object
        Of the run; None if not told.
    command
        That adapts it again.
    """

    method: str
    adapter: str
    inputs: tuple[str, ...]
    training_data: tuple[str, ...] = ()
    seconds_per_object: float | None = None
    command: str = ""


@dataclass(frozen=True, slots=True)
class Adapted:
    """What is to be said of one object.

    Parameters
    ----------
    object_id
        Of the dataset.
    coverage, iou, floaters
        See :class:`.filling.Filled`.
    unread
        Answers or voxels that gave no density.
    seconds
        Of reading and filling.
    mass_native_g
        The mass by the method's own rule, where the run has it. Never scored.
    """

    object_id: str
    coverage: float
    iou: float
    floaters: int
    unread: int
    seconds: float
    mass_native_g: float | None


@dataclass(frozen=True, slots=True)
class Report:
    """What came of a run.

    Parameters
    ----------
    objects
        In the order of the dataset.
    run_sha256
        Checksum of all points and densities that were read.
    """

    objects: tuple[Adapted, ...]
    run_sha256: str

    def notes(self, adapter: str) -> str:
        """Return what a reader of the row must know, on one line."""
        covered = [one.coverage for one in self.objects]
        unread = sum(one.unread for one in self.objects)
        lost = sum(one.floaters for one in self.objects)
        said = [
            f"files of a real run, adapter {adapter}, run {self.run_sha256[:12]}",
            f"coverage {fmean(covered):.3f} (least {min(covered):.3f})",
            f"box IoU at least {min(one.iou for one in self.objects):.3f}",
            f"{unread} answers or voxels without density" if unread else "",
            f"{lost} points far off left out" if lost else "",
        ]
        return "; ".join(filter(None, said))


def adapt(
    read: Read,
    frames: Frames,
    folder: DatasetFolder,
    split: str,
    out: Path,
    row: Row,
    progress: Callable[[Sequence[str]], Iterable[str]] = iter,
) -> tuple[SubmissionMeta, Report]:
    """Make a submission of a run.

    Parameters
    ----------
    read
        The adapter.
    frames
        Where the objects of the run lie.
    folder, split
        The dataset, and what the run predicted of it.
    out
        The ``preds.npz`` to write: complete or not at all.
    row
        What it says of the run.
    progress
        Goes through the ids of the objects.

    Raises
    ------
    RunError
        With every object that the run lacks, whose files break their format, or of which it speaks
        in another frame, scale or unit.
    """
    stated = _meta(folder, split, row).to_json()
    raise_errors(parse_meta(stated, SubmissionMeta)[1])  # now, not after the work
    objects, refused, digest = [], [], hashlib.sha256()
    ids = folder.ids(split)
    with PredictionsWriter(out) as writer:
        for object_id in progress(ids):
            start = time.perf_counter()
            try:
                cloud, filled = _read(read, frames, SampleView(folder, object_id, READS))
            except DataError as err:
                refused.append(str(err))
                continue
            writer.add(object_id, filled.density_g_cm3)
            objects.append(_adapted(object_id, cloud, filled, time.perf_counter() - start))
            _digest(digest, object_id, (cloud.points, cloud.density))
        if refused:
            raise RunError(refused, len(ids))
        report = Report(tuple(objects), digest.hexdigest())
        meta = _meta(folder, split, row, report.notes(row.adapter))
        writer.finish(meta)
    return meta, report


def _read(read: Read, frames: Frames, sample: SampleView) -> tuple[Cloud, Filled]:
    cloud = read(frames.run_name(sample.object_id), sample)
    return cloud, fill(cloud, frames.similarity(cloud, sample), sample)


def _adapted(object_id: str, cloud: Cloud, filled: Filled, seconds: float) -> Adapted:
    return Adapted(
        object_id,
        coverage=filled.coverage,
        iou=filled.iou,
        floaters=filled.floaters,
        unread=cloud.unread,
        seconds=seconds,
        mass_native_g=cloud.mass_native_g,
    )


def _meta(folder: DatasetFolder, split: str, row: Row, notes: str = "") -> SubmissionMeta:
    return SubmissionMeta(
        method=row.method,
        dataset_revision=folder.manifest.version,
        config="default",
        split=split,
        inputs=row.inputs,
        training_data=row.training_data,
        external_data=True,
        command=row.command,
        notes=notes,
        seconds_per_object=row.seconds_per_object,
        manifest_sha256=folder.manifest_sha256,
    )


def _digest(digest: hashlib._Hash, object_id: str, arrays: Sequence[np.ndarray]) -> None:
    digest.update(object_id.encode())
    for values in arrays:
        digest.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
