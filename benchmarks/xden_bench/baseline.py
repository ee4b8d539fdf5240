"""Running an installed method on a split and writing its submission."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.modality import track_of
from xden1k.predictions import PredictionsWriter, SubmissionMeta, Target
from xden1k.predictor import Examples, Predictor, SampleView
from xden_bench.submission import Progress

__all__ = ["Listed", "find_predictor", "list_predictors", "run_predictor"]

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
        If there is none of that name, it cannot be imported, or it is no predictor.
    """
    entries = _entries()
    if name not in entries:
        raise DataError(f"no method {name!r} is installed; there are {sorted(entries)}")
    try:
        predictor = entries[name].load()()
    except (ImportError, AttributeError) as err:
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
            writer.add(object_id, predictor.predict(SampleView(folder, object_id, predictor.reads)))
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
        )
        writer.finish(meta)
    return meta


def _entries() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=GROUP)}
