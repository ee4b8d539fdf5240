"""Running a method on a split and writing its submission, in as many goes as it takes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

from xden1k.errors import DataError, about, of_dataset
from xden1k.folder import DatasetFolder
from xden1k.predictions import MethodMeta, Target
from xden1k.predictor import (
    AsksAhead,
    Budget,
    Fingerprinted,
    Method,
    PictureSource,
    SampleView,
    Storable,
)
from xden1k.values.cost import Cost
from xden1k.values.modality import Modality
from xden_bench.methods.answering import Answering, answering
from xden_bench.methods.fits import Fit, fit_or_take_up, load_fit
from xden_bench.methods.notes import counted, counts, refuse_silence, short
from xden_bench.methods.partial import (
    Facts,
    PartialRun,
    code_sha256,
    folder_sha256,
    partial_run,
)
from xden_bench.methods.rebuilt import Rebuilt
from xden_bench.methods.scope import TRAIN, FolderScope, Scope, Task
from xden_bench.scoring.reference import private_refusal, xray_refusal
from xden_bench.scoring.submission import Progress

__all__ = ["Options", "Report", "refuse_without_radiographs", "run_predictor", "run_within"]


@dataclass(frozen=True, slots=True)
class Options:
    """How a method is run.

    Parameters
    ----------
    target
        ``density`` or ``apparent_density``.
    seed
        Of the method.
    budget
        Of its training; None = its own.
    model
        A folder with what it learned before, in place of learning.
    save
        The folder to keep what it learns in.
    pictures
        Where colour pictures come from.
    command
        That runs this again.
    hardware
        What it runs on; empty if not told.
    points_seed
        Of the points, where segments are asked for; None asks for densities.
    train_objects
        How many objects of the training split it learns from, drawn by the seed; None for all.
    """

    target: Target = "density"
    seed: int = 0
    budget: Budget | None = None
    model: Path | None = None
    save: Path | None = None
    pictures: PictureSource | None = None
    command: str = ""
    hardware: str = ""
    points_seed: int | None = None
    train_objects: int | None = None

    def check(self, predictor: Method) -> None:
        """Refuse what asks a method for something it cannot do.

        Raises
        ------
        DataError
            If it is told how to learn but learns nothing, is to learn and not to learn, or cannot
            store what it learned.
        """
        told = self.budget or self.save or self.train_objects is not None
        if not predictor.trainable and (told or self.model):
            raise DataError(
                f"the method {predictor.name} learns nothing: "
                "no budget, number of training objects, model or save"
            )
        if self.model and told:
            raise DataError(
                "a method that is loaded does not learn: "
                "model without budget, number of training objects and save"
            )
        if (self.model or self.save) and not isinstance(predictor, Storable):
            verb = "load" if self.model else "store"
            raise DataError(f"the method {predictor.name} cannot {verb} what it learned")


@dataclass(frozen=True, slots=True)
class Report:
    """What came of a run.

    Parameters
    ----------
    meta
        What the file says about itself.
    continued
        How many objects an interrupted run had left.
    mass_native_g
        By object: the mass by the method's own rule, where it has one. Never scored.
    """

    meta: MethodMeta
    continued: int
    mass_native_g: Mapping[str, float]


def run_predictor(
    predictor: Method,
    folder: DatasetFolder,
    split: str,
    out: Path,
    options: Options = Options(),
    progress: Progress = iter,
) -> Report:
    """Let a method learn from the training split, answer for objects, and write its submission.

    It runs in this process, which is for trying: code beside the dataset can read all of it.
    :func:`xden_bench.methods.apart.run_apart` is for rows.

    Parameters
    ----------
    predictor
        The method.
    folder
        The dataset.
    split
        What to predict.
    out
        The submission to write.
    options
        How it is run, and what it is asked for.
    progress
        Goes through the ids of the objects that are left to do.

    Raises
    ------
    DataError
        If a training object lacks the target, there are not as many as asked for, a prediction
        breaks the format, the options ask for what the method cannot do, it reads radiographs and
        objects have none, another process is writing the same submission, or over 5 % of a model's
        answers are a substitute's.
    ModalityError
        If the method touches what it did not declare.
    """
    options.check(predictor)
    refuse_without_radiographs(predictor, folder, split, options)
    seen = (predictor.reads, options.target, options.pictures, options.command)
    task = Task.of(folder, split, options.train_objects, options.seed)
    scope = FolderScope(folder, task, *seen)
    with of_dataset(folder.root):
        return run_within(scope, predictor, out, options, progress)


def refuse_without_radiographs(
    predictor: Method, folder: DatasetFolder, split: str, options: Options
) -> None:
    """Check that every object that is looked at has what an X-ray method reads.

    Raises
    ------
    DataError
        With the count of those that do not; or if segments of a split are asked for that cannot
        be scored.
    """
    if options.points_seed is not None and (refusal := private_refusal(split)):
        raise DataError(f"{folder.root}: {refusal}")
    if Modality.XRAY not in predictor.reads:
        return
    learns = predictor.trainable and not options.model
    for one in dict.fromkeys([*([TRAIN] * learns), split]):
        if refusal := xray_refusal(folder, one):
            raise DataError(f"{folder.root}: {refusal}")


def run_within(
    scope: Scope, predictor: Method, out: Path, options: Options, progress: Progress = iter
) -> Report:
    """Let a method learn, predict and write its submission from what a scope shows.

    What is done is kept beside the submission until that is complete: the same run again, after
    an error or a kill, goes on from there (:mod:`xden_bench.methods.partial`).

    Parameters
    ----------
    scope
        What the method is shown.
    predictor
        The method.
    out
        The submission to write.
    options
        How it is run; its pictures and command are those of the scope.
    progress
        Goes through the ids of the objects that are left to do.

    Raises
    ------
    DataError, ModalityError
        As :func:`run_predictor`.
    """
    run = _Run(predictor, scope, options)
    with partial_run(out, run.identity) as partial:
        fit = run.made_ready(partial.fit_folder)
        continued = partial.count
        way = answering(predictor, partial.submission, options.target, options.points_seed)
        with way.writer:
            facts = dict(run.answers(way, partial, progress))
            refuse_silence(predictor.name, tuple(facts.values()))
            meta = way.meta(run.said(fit, tuple(facts.values())))
            way.writer.finish(meta)
        partial.submission.replace(out)
    masses = {one: found.mass_native_g for one, found in facts.items()}
    native = {one: mass for one, mass in masses.items() if mass is not None}
    return Report(meta, continued, native)


@dataclass(frozen=True, slots=True)
class _Run:
    """A method on a split."""

    predictor: Method
    scope: Scope
    options: Options

    @property
    def fit(self) -> Fit:
        """What a fit depends on that is made here and now."""
        method, options = self.predictor, self.options
        return Fit(
            method=method.name,
            version=method.version,
            inputs=method.reads.inputs,
            target=options.target,
            seed=options.seed,
            budget=asdict(options.budget) if options.budget else None,
            manifest_sha256=self.scope.task.manifest_sha256,
            code_sha256=code_sha256(type(method)),
            fingerprint=_fingerprint(method),
            pictures=f"{options.pictures.description} {_fingerprint(options.pictures)}".strip()
            if options.pictures
            else "",
            train_objects=options.train_objects,
        )

    @property
    def identity(self) -> dict[str, Any]:
        """All that the predictions depend on."""
        model = self.options.model
        return asdict(self.fit) | {
            "split": self.scope.task.split,
            "points_seed": self.options.points_seed,
            "model": folder_sha256(model) if model else "",
        }

    def made_ready(self, folder: Path) -> Fit | None:
        """Let the method learn, or take up what it learned; None if it learns nothing."""
        options = self.options
        if not self.predictor.trainable:
            return None
        if options.model and isinstance(self.predictor, Storable):
            return load_fit(self.predictor, self.fit, options.model)
        kept = options.save or folder
        fit_or_take_up(self.predictor, self.scope.train(), self.fit, options.budget, kept)
        return self.fit

    def answers(
        self, way: Answering, partial: PartialRun, progress: Progress
    ) -> Iterator[tuple[str, Facts]]:
        """Write every object: first those that are kept, then the others."""
        ids, done = self.scope.task.ids, partial.count
        if isinstance(self.predictor, AsksAhead) and done < len(ids):
            self.predictor.ask_ahead(self._samples(ids[done:], progress))
        for place, object_id in enumerate(ids[:done]):
            kept = partial.read(place)
            way.add(object_id, kept.arrays)
            yield object_id, kept.facts
        for place, object_id in enumerate(progress(ids[done:]), start=done):
            with about(object_id):
                kept = way.ask(self.scope.sample(object_id))
            way.add(object_id, kept.arrays)
            partial.keep(place, kept)
            yield object_id, kept.facts

    def _samples(self, ids: Sequence[str], progress: Progress) -> Iterator[SampleView]:
        """Make samples as they are taken: who takes none draws no bar."""
        for object_id in progress(ids):
            yield self.scope.sample(object_id)

    def said(self, fit: Fit | None, facts: Sequence[Facts]) -> dict[str, Any]:
        """Return what every file says about itself."""
        seconds, processor_seconds, memory_gb = self._cost(facts)
        return {
            "method": _row_name(self.predictor.name, fit),
            "dataset_revision": self.scope.task.version,
            "config": "default",
            "split": self.scope.task.split,
            "inputs": self.predictor.reads.inputs,
            "training_data": ("xden1k/train",) if fit else (),
            "external_data": self.predictor.external_data,
            "command": self.scope.command(),
            "notes": short([self.predictor.notes, *self._notes(fit, facts)], counts(facts)),
            "seconds_per_object": seconds,
            "processor_seconds_per_object": processor_seconds,
            "peak_memory_gb": memory_gb,
            "hardware": self.options.hardware,
            "seed": fit.seed if fit else None,
            "manifest_sha256": self.scope.task.manifest_sha256,
        }

    def _cost(self, facts: Sequence[Facts]) -> tuple[float | None, float | None, float | None]:
        """Wall and processor seconds of an object, and memory; a rebuild's were spent elsewhere."""
        told: Sequence[Facts | Cost] = facts
        if isinstance(self.predictor, Rebuilt):
            cost = self.predictor.cost()
            told = [] if cost is None else [cost]
        return (
            _rounded(fmean, [one.seconds for one in told]),
            _rounded(fmean, [one.processor_s for one in told]),
            _rounded(max, [one.peak_memory_gb for one in told]),
        )

    def _notes(self, fit: Fit | None, facts: Sequence[Facts]) -> Iterator[str]:
        """Tell what the run knows and a reader of the row must."""
        if fit and fit.manifest_sha256 != self.scope.task.manifest_sha256:
            yield f"trained on the dataset of manifest {fit.manifest_sha256[:12]}"
        if fit and fit.train_objects is not None:
            yield f"learned from {fit.train_objects} training objects, drawn by seed {fit.seed}"
        if self.options.pictures:
            yield self.options.pictures.description
        yield from counted([f"model {one.model}" if one.model else "" for one in facts])
        yield from counted([one.remark for one in facts])


def _row_name(method: str, fit: Fit | None) -> str:
    """Name of a row: what learned from some of the objects is no other seed of what saw all."""
    some = fit and fit.train_objects
    return f"{method} ({some} objects)" if some else method


def _rounded(
    of: Callable[[Sequence[float]], float], values: Sequence[float | None]
) -> float | None:
    """Two digits of a figure of all objects; None if one of them, or nobody, tells it."""
    told = [one for one in values if one is not None]
    return float(f"{of(told):.2g}") if told and len(told) == len(values) else None


def _fingerprint(value: object) -> str:
    return value.fingerprint if isinstance(value, Fingerprinted) else ""
