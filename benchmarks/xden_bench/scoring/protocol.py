"""The rules of scoring, read from a file that never changes once released."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Final, TypeVar

from xden1k.errors import DataError
from xden1k.predictions import Target
from xden1k.values.settings import load_settings
from xden_bench.scoring.metrics import METRICS
from xden_bench.scoring.names import skeleton

__all__ = [
    "PROTOCOLS",
    "SEGMENT_PROTOCOLS",
    "Protocol",
    "Rules",
    "SegmentProtocol",
    "is_trivial",
    "load_protocol",
    "load_rules",
    "load_segment_protocol",
]

PROTOCOLS: Final = ("v2", "v1", "paper")
"""Every protocol of densities, the default first."""
SEGMENT_PROTOCOLS: Final = ("segment-v1",)
"""Every protocol of segments, the default first."""

AnyRules = TypeVar("AnyRules", bound="Rules")


@dataclass(frozen=True, slots=True, kw_only=True)
class Rules:
    """What every protocol says, whatever it scores.

    Parameters
    ----------
    name
        Printed with every number.
    config
        Of the dataset.
    targets
        What a submission may predict.
    metric_version
        Of the code that computes the metrics: raised when it gives other values for the same
        files. The one key that may change after a release; rows of two versions are kept apart.
    metrics
        Names from :data:`xden_bench.scoring.metrics.METRICS`, in the order of the tables.
    sd_metrics
        More of them, of submissions that give a standard deviation.
    rank_by
        One of them.
    bootstrap_resamples, bootstrap_seed
        Of the intervals.
    size_edges_cm
        Ascending borders between the classes of the table by size.
    unranked
        Names of methods that are printed without a rank.
    dataset
        Name of the benchmark's dataset; empty where the protocol names none.
    unseen_categories
        Left out of training altogether: the objects of the split ``unseen``.
    interval_metrics
        Whose means get an interval by :mod:`xden_bench.scoring.intervals`, and a macro mean beside
        every mean; empty where intervals are percentiles over objects.
    min_interval_objects, min_interval_categories
        With fewer of either no interval is given.
    min_interval_stratum
        On the unseen categories, in place of their number: objects that each of them has.
    rank_error
        Probability that anywhere in a table of equal methods one is ranked below another.
    rank_methods
        Up to which number of methods in a table that holds; 0 where nothing is ranked.
    rank_scale
        Ranks are told apart by ``loss / (loss + rank_scale)``, in the unit of ``rank_by``; by the
        loss itself where it is 0, for metrics that have bounds.
    min_seeds
        A trained row of fewer says so.
    open_choices
        What a source that this protocol follows leaves open, and what is taken here.

    Raises
    ------
    DataError
        If a metric is unknown, the ranking is by none of them, or the borders do not ascend.
    """

    name: str
    config: str
    targets: Sequence[str]
    metric_version: int
    metrics: Sequence[str]
    sd_metrics: Sequence[str] = ()
    rank_by: str
    bootstrap_resamples: int
    bootstrap_seed: int
    size_edges_cm: Sequence[float]
    unranked: Sequence[str]
    dataset: str = ""
    unseen_categories: Sequence[str] = ()
    interval_metrics: Sequence[str] = ()
    min_interval_objects: int = 0
    min_interval_categories: int = 0
    min_interval_stratum: int = 2
    rank_error: float = 0.0
    rank_methods: int = 0
    rank_scale: float = 1.0
    min_seeds: int = 1
    open_choices: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if unknown := sorted({*self.metrics, *self.sd_metrics} - METRICS.keys()):
            raise DataError(
                f"protocol {self.name}: unknown metrics {unknown}; known: {list(METRICS)}"
            )
        if self.rank_by not in self.metrics:
            raise DataError(f"protocol {self.name}: rank_by {self.rank_by!r} is not in metrics")
        if outside := sorted({*self.interval_metrics} - {*self.metrics_of(has_sd=True)}):
            raise DataError(f"protocol {self.name}: interval_metrics {outside} are not in metrics")
        if list(self.size_edges_cm) != sorted(set(self.size_edges_cm)):
            raise DataError(f"protocol {self.name}: size_edges_cm must ascend")

    @property
    def is_ranked(self) -> bool:
        """Whether rows have ranks and intervals that cover what they say: so since v2."""
        return self.rank_methods > 0

    def metrics_of(self, *, has_sd: bool) -> tuple[str, ...]:
        """Names of the metrics of a submission, which depend on whether it gives deviations."""
        return (*self.metrics, *(self.sd_metrics if has_sd else ()))


@dataclass(frozen=True, slots=True, kw_only=True)
class Protocol(Rules):
    """How densities are scored.

    Parameters
    ----------
    mass_ratio_limit
        ``mass_alde`` ends at the logarithm of it.
    max_density_g_cm3
        By target: a higher value gets the footnote W501, or is refused as E407.
    max_outside_share
        More of the mass outside the object gets the footnote W503.
    max_identical_share
        Of the objects that are not homogeneous: more that equal the reference are the warning W504.
    copied_within
        An object equals the reference where its
        :func:`xden_bench.scoring.metrics.relative_error` is below this.
    refuse_above_limit
        Whether a value above ``max_density_g_cm3`` is refused.

    Raises
    ------
    DataError
        As :class:`Rules`, or if ``max_density_g_cm3`` does not name the targets.
    """

    targets: Sequence[Target]
    mass_ratio_limit: float
    max_density_g_cm3: Mapping[str, float]
    max_outside_share: float
    max_identical_share: float
    copied_within: float = 0.002
    refuse_above_limit: bool = False

    def __post_init__(self) -> None:
        Rules.__post_init__(self)
        if set(self.max_density_g_cm3) != set(self.targets):
            raise DataError(
                f"protocol {self.name}: max_density_g_cm3 must name the targets "
                f"{list(self.targets)}, got {list(self.max_density_g_cm3)}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentProtocol(Rules):
    """How segments are scored.

    Parameters
    ----------
    points_seed
        Of the points of each object.
    region_gap_g_cm3
        Two materials are of two regions if between their densities, in the order of all of the
        object, there is a larger gap.
    """

    points_seed: int
    region_gap_g_cm3: float


def load_protocol(name: str = PROTOCOLS[0]) -> Protocol:
    """Return a protocol of densities by name.

    Raises
    ------
    DataError
        If there is none of that name.

    Examples
    --------
    >>> load_protocol("v1").rank_by
    'density_mae_g_cm3'
    """
    return _load(Protocol, name, f"protocol-{name}.toml", PROTOCOLS)


def load_segment_protocol(name: str = SEGMENT_PROTOCOLS[0]) -> SegmentProtocol:
    """Return a protocol of segments by name.

    Raises
    ------
    DataError
        If there is none of that name.

    Examples
    --------
    >>> load_segment_protocol().rank_by
    'iou_a'
    """
    return _load(SegmentProtocol, name, f"{name}.toml", SEGMENT_PROTOCOLS)


def load_rules(name: str) -> Rules:
    """Return a protocol by name, whatever it scores.

    Raises
    ------
    DataError
        If there is none of that name.
    """
    return load_segment_protocol(name) if name in SEGMENT_PROTOCOLS else load_protocol(name)


def _load(kind: type[AnyRules], name: str, file: str, names: Sequence[str]) -> AnyRules:
    if name not in names:
        raise DataError(f"no protocol {name!r}; there are {list(names)}")
    with resources.as_file(resources.files("xden_bench.scoring") / file) as path:
        return load_settings(kind, Path(path))


def is_trivial(method: str, protocol: Rules) -> bool:
    """Whether a name is one of a trivial method, however it is written.

    Examples
    --------
    >>> [is_trivial(name, load_protocol("v1")) for name in ("water", " W-ater", "my water")]
    [True, True, False]
    """
    return skeleton(method) in map(skeleton, protocol.unranked)
