"""What a method is asked for, and how its answers are written: densities, or segments."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar, runtime_checkable

import numpy as np

from xden1k.errors import DataError
from xden1k.predictions import MethodMeta, PredictionsWriter, SubmissionMeta, Target
from xden1k.predictions.writer import SubmissionWriter
from xden1k.predictor import Method, Prediction, Predictor, SampleView, Segmenter
from xden1k.segmentation import SegmentsMeta, SegmentsWriter
from xden1k.values.cost import Meter
from xden1k.values.modality import Modality
from xden_bench.methods.partial import Facts, Kept

__all__ = ["Answering", "answering"]

_SAID: Final = (
    *("mass_native_g", "model", "answers", "fallbacks", "unanswered"),
    *("device", "remark"),
)
"""What a prediction says of itself that is kept."""

Answer = TypeVar("Answer")


@runtime_checkable
class Answering(Protocol):
    """A way of asking."""

    @property
    def writer(self) -> SubmissionWriter:
        """What writes the submission; :meth:`add` is given the arrays that are kept."""
        ...

    def ask(self, sample: SampleView) -> Kept:
        """Ask the method about an object.

        Raises
        ------
        DataError
            If the answer is none.
        """
        ...

    def add(self, object_id: str, arrays: Mapping[str, Any]) -> None:
        """Append an answer to the submission."""
        ...

    def meta(self, said: Mapping[str, Any]) -> MethodMeta:
        """Return the meta data of the submission, with what every one says."""
        ...


def answering(method: Method, path: Path, target: Target, points_seed: int | None) -> Answering:
    """Return how a method is asked.

    Parameters
    ----------
    method
        That is asked.
    path
        The submission to write.
    target
        ``density`` or ``apparent_density``.
    points_seed
        Of the points, where segments are asked for; None = densities.

    Raises
    ------
    DataError
        If it is no method of that kind, or one of segments does not read the geometry.
    """
    if points_seed is None:
        if not isinstance(method, Predictor):
            raise DataError(f"the method {method.name} gives segments, no densities")
        return _Densities(method, target, PredictionsWriter(path))
    if not isinstance(method, Segmenter):
        raise DataError(f"the method {method.name} gives densities, no segments")
    if Modality.GEOMETRY not in method.reads:
        raise DataError(
            f"the method {method.name} must declare GEOMETRY: points lie inside the outer surface"
        )
    return _Segments(method, points_seed, SegmentsWriter(path))


@dataclass(frozen=True, slots=True)
class _Densities:
    """Asking for a density."""

    predictor: Predictor
    target: Target
    writer: PredictionsWriter

    def ask(self, sample: SampleView) -> Kept:
        found, facts = _measured(lambda: self.predictor.predict(sample))
        if not isinstance(found, Prediction):
            _check_parts(sample, found, self.predictor.reads)
            return Kept({"values": found}, facts)
        _check_parts(sample, found.density_g_cm3, self.predictor.reads)
        arrays = {"values": found.density_g_cm3, "sd": found.density_sd_g_cm3}
        said = {name: getattr(found, name) for name in _SAID}
        kept = {name: values for name, values in arrays.items() if values is not None}
        return Kept(kept, replace(facts, **said))

    def add(self, object_id: str, arrays: Mapping[str, Any]) -> None:
        self.writer.add(object_id, **arrays)

    def meta(self, said: Mapping[str, Any]) -> SubmissionMeta:
        return SubmissionMeta(**said, target=self.target)


@dataclass(frozen=True, slots=True)
class _Segments:
    """Asking which points belong together."""

    segmenter: Segmenter
    points_seed: int
    writer: SegmentsWriter

    def ask(self, sample: SampleView) -> Kept:
        from xden1k.segmentation.points import draw_points, segment_grid

        grid = segment_grid(sample.origin_cm, sample.voxel_size_cm)
        points = draw_points(sample.outer_mesh, grid, sample.object_id, self.points_seed)
        found, facts = _measured(lambda: self.segmenter.segment(sample, points))
        arrays = {"voxels": points.voxels, "labels": found.labels, "free": found.free}
        return Kept(arrays, facts)

    def add(self, object_id: str, arrays: Mapping[str, Any]) -> None:
        self.writer.add(object_id, **arrays)

    def meta(self, said: Mapping[str, Any]) -> SegmentsMeta:
        points_sha256 = self.writer.points_sha256
        return SegmentsMeta(**said, points_seed=self.points_seed, points_sha256=points_sha256)


def _measured(ask: Callable[[], Answer]) -> tuple[Answer, Facts]:
    """Return an answer, and what it cost."""
    meter = Meter()
    found = ask()
    return found, Facts(**asdict(meter.read()))


def _check_parts(sample: SampleView, values: object, reads: Modality) -> None:
    """Refuse part densities of the wrong number, or by a method that declares no parts."""
    if not isinstance(values, np.ndarray) or values.ndim != 1:
        return
    if Modality.PARTS not in reads:
        raise DataError(f"{sample.object_id}: part densities need the modality PARTS: give a grid")
    parts = len(sample.part_names)
    if len(values) != parts + 1:
        raise DataError(
            f"{sample.object_id}: shape must be ({parts + 1},), air and {parts} parts, "
            f"got {values.shape}"
        )
