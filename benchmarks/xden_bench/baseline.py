"""Running an installed method on a split and writing its submission."""

from __future__ import annotations

import inspect
import tempfile
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

import numpy as np

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.modality import Modality, track_of
from xden1k.predictions import PredictionsWriter, SubmissionMeta, Target, open_predictions
from xden1k.predictor import Examples, Prediction, Predictor, SampleView
from xden_bench.protocol import Protocol, is_trivial
from xden_bench.reference import Reference
from xden_bench.submission import Progress

__all__ = ["Listed", "check_trivial", "find_predictor", "list_predictors", "run_predictor"]

GROUP = "xden1k.predictors"
"""Entry points of this group name methods."""


@dataclass(frozen=True, slots=True)
class Listed:
    """A method that is installed.

    Parameters
    ----------
    name
        What ``xden-bench baseline`` calls it.
    track
        Where it runs.
    summary
        First line of its docstring.
    """

    name: str
    track: str
    summary: str


def list_predictors() -> tuple[Listed, ...]:
    """Every installed method, by name."""
    return tuple(
        Listed(name, track_of(predictor.reads), (inspect.getdoc(predictor) or "").split("\n")[0])
        for name, predictor in ((name, find_predictor(name)) for name in sorted(_entries()))
    )


def find_predictor(name: str) -> Predictor:
    """Return an installed method by the name of its entry point.

    Raises
    ------
    DataError
        If there is none of that name, it cannot be imported or made, or it is no predictor.
    """
    entries = _entries()
    if name not in entries:
        raise DataError(f"no method {name!r} is installed; there are {sorted(entries)}")
    try:
        predictor = entries[name].load()()
    except (ImportError, AttributeError, TypeError, ValueError) as err:
        raise DataError(f"the method {name} ({entries[name].value}) does not load: {err}") from err
    if not isinstance(predictor, Predictor):
        raise DataError(f"the method {name} ({entries[name].value}) is no xden1k Predictor")
    return predictor


def run_predictor(
    predictor: Predictor,
    folder: DatasetFolder,
    split: str,
    out: Path,
    *,
    target: Target = "density",
    seed: int = 0,
    command: str = "",
    progress: Progress = iter,
) -> SubmissionMeta:
    """Let a method learn from the training split, predict objects, and write its submission.

    Parameters
    ----------
    predictor
        The method.
    folder
        The dataset.
    split
        What to predict.
    out
        The ``preds.npz`` to write.
    target
        ``density`` or ``apparent_density``.
    seed
        Of the method.
    command
        That runs this again.
    progress
        Goes through the object ids.

    Returns
    -------
    SubmissionMeta
        What the file says about itself.

    Raises
    ------
    DataError
        If a training object lacks the target, or a prediction breaks the format.
    ModalityError
        If the method touches what it did not declare.
    """
    if predictor.trainable:
        predictor.fit(Examples(folder, "train", predictor.reads, target), seed=seed)
    with PredictionsWriter(out) as writer:
        for object_id in progress(folder.ids(split)):
            found = predictor.predict(SampleView(folder, object_id, predictor.reads))
            values, sd = (
                (found.density_g_cm3, found.density_sd_g_cm3)
                if isinstance(found, Prediction)
                else (found, None)
            )
            writer.add(object_id, values, sd)
            _check_parts(folder, object_id, values, predictor.reads)
        meta = SubmissionMeta(
            method=predictor.name,
            dataset_revision=folder.manifest.version,
            config="default",
            split=split,
            inputs=predictor.reads.inputs,
            training_data=("xden1k/train",) if predictor.trainable else (),
            external_data=predictor.external_data,
            target=target,
            command=command,
            notes=predictor.notes,
            seed=seed if predictor.trainable else None,
            manifest_sha256=folder.manifest_sha256,
        )
        writer.finish(meta)
    return meta


def _check_parts(
    folder: DatasetFolder, object_id: str, values: np.ndarray, reads: Modality
) -> None:
    """Refuse part densities of the wrong number, or by a method that declares no parts."""
    if values.ndim != 1:
        return
    if Modality.PARTS not in reads:
        raise DataError(f"{object_id}: part densities need the modality PARTS: give a grid")
    parts = len(folder.row(object_id, ["part_names"])["part_names"])
    if len(values) != parts + 1:
        raise DataError(
            f"{object_id}: shape must be ({parts + 1},), air and {parts} parts, got {values.shape}"
        )


def check_trivial(path: Path, reference: Reference, protocol: Protocol) -> None:
    """Refuse a submission under the name of a trivial method that is not its prediction.

    The installed method runs again on the dataset and each value is compared. It guards what
    enters by ``xden-bench submit``; an entry written by hand is a matter for whoever reviews it.

    Parameters
    ----------
    path
        A valid submission.
    reference
        What it predicts.
    protocol
        Which names are those of trivial methods.

    Raises
    ------
    DataError
        If a value differs.
    """
    with open_predictions(path) as found, tempfile.TemporaryDirectory() as scratch:
        meta = found.meta
        if meta is None or not is_trivial(meta.method, protocol):
            return
        own, name = Path(scratch) / "own.npz", meta.method.strip().casefold()
        predictor = find_predictor(name)
        run_predictor(predictor, reference.folder, reference.split, own, target=meta.target)
        with open_predictions(own) as expected:
            for object_id in reference.ids:
                if not _equal(found.read(object_id), expected.read(object_id)):
                    raise DataError(
                        f"{path}: the name {name!r} is that of a trivial method, and its value of "
                        f"{object_id} is another: give the method a name of its own"
                    )


def _equal(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two grids are the same, whichever of the two dtypes they were stored as."""
    return one.shape == other.shape and np.allclose(one, other, rtol=2**-10, atol=2**-24)


def _entries() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=GROUP)}
