"""Scoring a submission: check, measure each object, then mean and interval over objects."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import isnan
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from xden1k.predictions import Predictions, Problem, SubmissionMeta, raise_errors
from xden1k.segmentation import SegmentsMeta
from xden1k.values.arrays import Grid
from xden1k.values.modality import Track
from xden_bench.scoring.bootstrap import Estimate, estimate
from xden_bench.scoring.calibration import score_sd
from xden_bench.scoring.clusters import category_sums
from xden_bench.scoring.intervals import protocol_intervals
from xden_bench.scoring.metrics import score_object
from xden_bench.scoring.protocol import Protocol, Rules
from xden_bench.scoring.reference import Reference, Truth
from xden_bench.scoring.submission import Check, Progress

__all__ = [
    "ObjectScore",
    "Score",
    "by_category",
    "by_size",
    "left_out",
    "score",
    "summary",
]


@dataclass(frozen=True, slots=True)
class ObjectScore:
    """The metrics of one object.

    Parameters
    ----------
    object_id, category, source
        As in the dataset.
    extent_cm
        Longest edge of its bounding box.
    metrics
        Value by name.
    """

    object_id: str
    category: str
    source: str
    extent_cm: float
    metrics: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Score:
    """The scores of one submission.

    Parameters
    ----------
    meta
        What the submission says about itself.
    submission_sha256
        Checksum of the file.
    arrays_sha256
        Of what was scored: see :attr:`xden_bench.scoring.submission.Check.arrays_sha256`.
    objects
        One for each object of the split, sorted by id.
    protocol
        The rules it was scored by.
    warnings
        Footnotes.
    even_fills_g_cm3
        Density of each object that it fills evenly, by id.
    """

    meta: SubmissionMeta | SegmentsMeta
    submission_sha256: str
    arrays_sha256: str
    objects: tuple[ObjectScore, ...]
    protocol: Rules
    warnings: tuple[Problem, ...] = ()
    even_fills_g_cm3: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def metrics(self) -> Mapping[str, Estimate]:
        """Mean over objects and interval, by metric."""
        return summary(self.objects, self.protocol)

    @property
    def sources(self) -> tuple[str, ...]:
        """Where the objects come from: ``scan``, ``phantom``, ``ct``."""
        return tuple(sorted({one.source for one in self.objects}))

    def by_category(self) -> Mapping[str, tuple[int, Mapping[str, Estimate]]]:
        """Objects and metrics of each category."""
        return by_category(self.objects, self.protocol)

    def by_size(self) -> Mapping[str, tuple[int, Mapping[str, Estimate]]]:
        """Objects and metrics of each class of size."""
        return by_size(self.objects, self.protocol)


def summary(objects: Sequence[ObjectScore], protocol: Rules) -> Mapping[str, Estimate]:
    """Mean over objects and interval, by metric.

    An object for which a metric is not a number is left out of its mean; a metric that is none for
    every object has no mean.
    """
    names = tuple(objects[0].metrics)
    values: Float64[np.ndarray, "objects metrics"] = np.array(
        [[one.metrics[name] for name in names] for one in objects]
    )
    if not protocol.interval_metrics:
        estimates = estimate(values, protocol.bootstrap_resamples, protocol.bootstrap_seed)
        return dict(zip(names, estimates, strict=True))
    categories = np.array([one.category for one in objects])
    counts = ~np.isnan(values)
    found: dict[str, Estimate] = {}
    for kept in np.unique(counts[:, counts.any(axis=0)], axis=1).T:  # most metrics keep the same
        places = np.flatnonzero((counts == kept[:, None]).all(axis=0))
        some = [names[place] for place in places]
        found |= _estimates(values[kept][:, places], categories[kept].tolist(), some, protocol)
    return {name: found[name] for name in names if name in found}


def _estimates(
    values: Float64[np.ndarray, "objects metrics"],
    categories: Sequence[str],
    names: Sequence[str],
    protocol: Rules,
) -> Mapping[str, Estimate]:
    """Means and intervals of metrics that are numbers for every object."""
    sums = category_sums(values, categories)
    intervals = protocol_intervals(values, categories, names, protocol)
    means = zip(names, sums.means.tolist(), sums.macro_means.tolist(), strict=True)
    return {name: Estimate(micro, intervals.get(name), macro) for name, micro, macro in means}


def left_out(objects: Sequence[ObjectScore]) -> Mapping[str, int]:
    """How many objects are left out of the mean of a metric, by metric; none where all count."""
    counts = Counter(name for one in objects for name, it in one.metrics.items() if isnan(it))
    return dict(sorted(counts.items()))


def by_category(
    objects: Sequence[ObjectScore], protocol: Rules
) -> Mapping[str, tuple[int, Mapping[str, Estimate]]]:
    """Objects and metrics of each category."""
    return _groups(objects, protocol, lambda one: one.category)


def by_size(
    objects: Sequence[ObjectScore], protocol: Rules
) -> Mapping[str, tuple[int, Mapping[str, Estimate]]]:
    """Objects and metrics of each class of size, smallest first."""
    edges = protocol.size_edges_cm
    groups = _groups(objects, protocol, lambda one: _size_name(one.extent_cm, edges))
    order = [_size_name(extent, edges) for extent in (0.0, *edges)]
    return {name: groups[name] for name in order if name in groups}


def _groups(
    objects: Sequence[ObjectScore], protocol: Rules, key: Callable[[ObjectScore], str]
) -> Mapping[str, tuple[int, Mapping[str, Estimate]]]:
    groups: dict[str, list[ObjectScore]] = {}
    for one in objects:
        groups.setdefault(key(one), []).append(one)
    return {
        name: (len(members), summary(members, protocol)) for name, members in sorted(groups.items())
    }


def score(
    path: Path,
    reference: Reference,
    protocol: Protocol,
    track: Track | None = None,
    progress: Progress = iter,
) -> Score:
    """Score a submission, one object in memory at a time.

    Parameters
    ----------
    path
        The ``preds.npz``.
    reference
        The truth.
    protocol
        The rules.
    track
        The track it is meant for; None = the one its inputs lead to.
    progress
        Goes through the object ids.

    Raises
    ------
    SubmissionError
        With every problem of the submission.
    OSError
        If there is no such file.
    DataError
        If the truth cannot be read.
    """
    with Predictions(path) as predictions:
        check = Check(predictions, reference, protocol, track, progress)
        objects = tuple(_object_score(*one, protocol) for one in check.fields())
        raise_errors(check.problems)
        assert predictions.meta is not None
        return Score(
            predictions.meta,
            predictions.sha256,
            check.arrays_sha256,
            objects,
            protocol,
            check.problems,
            check.even_fills_g_cm3,
        )


def _object_score(truth: Truth, grid: Grid, sd: Grid | None, protocol: Protocol) -> ObjectScore:
    """Every metric of the protocol for one object."""
    metrics = score_object(
        truth.density_g_cm3,
        grid,
        truth.envelope,
        truth.origin_cm,
        truth.voxel_size_cm,
        truth.extent_cm,
        protocol.mass_ratio_limit,
    )
    if sd is not None:
        metrics |= score_sd(truth.density_g_cm3, grid, sd, truth.envelope)
    names = protocol.metrics_of(has_sd=sd is not None)
    return ObjectScore(
        truth.object_id,
        truth.category,
        truth.source,
        truth.extent_cm,
        {name: metrics[name] for name in names},
    )


def _size_name(extent_cm: float, edges_cm: Sequence[float]) -> str:
    """Name the class of size an extent falls into.

    Examples
    --------
    >>> [_size_name(extent, [8.0, 16.0]) for extent in (3.0, 8.0, 20.0)]
    ['under 8 cm', '8 to 16 cm', '16 cm and more']
    """
    place = bisect_right(edges_cm, extent_cm)
    if place == 0:
        return f"under {edges_cm[0]:g} cm"
    if place == len(edges_cm):
        return f"{edges_cm[-1]:g} cm and more"
    return f"{edges_cm[place - 1]:g} to {edges_cm[place]:g} cm"
