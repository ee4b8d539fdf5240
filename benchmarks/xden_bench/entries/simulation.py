"""Do the intervals cover, and are equal methods told apart? Simulations that answer it.

Populations are the normal and the log-normal distribution, and the scores of stored entries: their
categories are drawn with replacement, whole or one object each.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden_bench.entries.ranking import (
    Entry,
    dense_ranks,
    no_interval_because,
    row_losses,
    worse_rows,
)
from xden_bench.scoring.bootstrap import SAME
from xden_bench.scoring.clusters import category_sums
from xden_bench.scoring.protocol import Rules
from xden_bench.scoring.strata import strata
from xden_bench.scoring.studentised import studentised_intervals

__all__ = [
    "DESIGNS",
    "Coverage",
    "Design",
    "Population",
    "coverage",
    "drawn_populations",
    "stored_populations",
    "told_apart",
]

RESAMPLES: Final = 999
"""Of an interval; a protocol takes more, which moves its ends by little."""
DRAWN_CATEGORIES: Final = 4000
"""Categories of a population that is drawn from a distribution: as good as endless."""


@dataclass(frozen=True, slots=True)
class Design:
    """How many objects are scored.

    Parameters
    ----------
    categories
        How many are drawn.
    size
        Objects of each.
    is_fixed
        Whether the categories are given, and their objects alone are drawn.
    """

    categories: int
    size: int
    is_fixed: bool = False

    @property
    def objects(self) -> int:
        """How many there are in all."""
        return self.categories * self.size

    def is_printed(self, protocol: Rules) -> bool:
        """Whether the protocol gives an interval to so many."""
        if self.objects < protocol.min_interval_objects:
            return False
        if self.is_fixed:
            return self.size >= protocol.min_interval_stratum
        return self.categories >= protocol.min_interval_categories


DESIGNS: Final = (
    *(Design(objects, 1) for objects in (6, 20, 100, 400)),
    *(Design(categories, 3) for categories in (2, 7, 34, 134)),
    Design(30, 14),
    Design(30, 5, is_fixed=True),
    Design(30, 14, is_fixed=True),
)
"""Objects one by one, three to a category as in ``test``, and many as in ``unseen``."""


@dataclass(frozen=True, slots=True, eq=False)
class Population:
    """Scores that stand for all there could be.

    Parameters
    ----------
    name
        Of the method or the distribution.
    metric
        Name of the metric; empty for a distribution.
    scores
        Shape (categories, objects): each category of as many objects.
    is_fixed
        Whether these are all categories that matter: the unseen ones.
    is_trusted
        Whether a row of the method may have an interval.
    """

    name: str
    metric: str
    scores: Float64[np.ndarray, "categories objects"]
    is_fixed: bool = False
    is_trusted: bool = True

    def fits(self, design: Design) -> bool:
        """Whether objects are drawn so; those of a distribution may be in either way."""
        return self.is_fixed == design.is_fixed or not self.metric

    def sample(
        self, design: Design, trials: int, rng: np.random.Generator
    ) -> Float64[np.ndarray, "objects trials"]:
        """Draw for many trials at once.

        Categories with replacement, each of which gives all its objects if as many are asked for,
        else some with replacement. Of given categories, which are the first, always some.
        """
        shape, count = (trials, design.categories), self.scores.shape[1]
        drawn = rng.integers(len(self.scores), size=shape)
        chosen = self.scores[np.arange(design.categories) + 0 * drawn if design.is_fixed else drawn]
        if design.is_fixed or design.size != count:
            places = rng.integers(count, size=(*shape, design.size))
            chosen = np.take_along_axis(chosen, places, axis=2)
        scores: Float64[np.ndarray, "objects trials"] = chosen.reshape(trials, -1).T
        return scores


@dataclass(frozen=True, slots=True)
class Coverage:
    """How often the 95 % interval of one population and design holds the mean.

    Parameters
    ----------
    population, metric
        Of the population.
    design
        How many objects.
    is_printed
        Whether a row would have the interval.
    share
        Of the trials whose interval holds the population's mean.
    """

    population: str
    metric: str
    design: Design
    is_printed: bool
    share: float


def drawn_populations(seed: int = 0) -> tuple[Population, ...]:
    """Make a normal and a log-normal population, half of the (log) variance between categories.

    The log-normal has a standard deviation of the logarithm of 1: skewness 6.2, as the error of an
    exact method on easy and hard objects.
    """
    rng = np.random.default_rng(seed)
    scores = rng.normal(size=(DRAWN_CATEGORIES, 1)) + rng.normal(size=(DRAWN_CATEGORIES, 60))
    scores /= np.sqrt(2)
    return Population("normal", "", 5 + scores), Population("log-normal", "", np.exp(scores))


def stored_populations(entries: Iterable[Entry], protocol: Rules) -> Iterator[Population]:
    """Every metric of every entry that could have an interval, in categories of one size.

    Of three objects where categories are drawn, of all where they are given. Oracles are left out,
    and what is the same for every object; another method whose rows have no interval is simulated
    to show why. Objects that a metric leaves out do not count; where all of a given category are
    left out, there is no interval.
    """
    for entry in entries:
        columns, is_fixed = entry["object_scores"], _is_fixed(entry, protocol)
        names = [name for name in protocol.interval_metrics if name in columns]
        inputs = entry["method"]["inputs"]
        is_trusted = no_interval_because(inputs) is None
        for name in names if "truth" not in inputs else []:
            values = np.array(columns[name], dtype=np.float64)
            counts = ~np.isnan(values)
            categories = np.array(columns["category"])[counts].tolist()
            if is_fixed and {*categories} != {*protocol.unseen_categories}:
                continue
            scores = _even(values[counts], categories, is_fixed)
            if scores.size and np.ptp(scores) > SAME:
                yield Population(entry["method"]["name"], name, scores, is_fixed, is_trusted)


def coverage(
    population: Population, design: Design, protocol: Rules, trials: int, seed: int = 0
) -> Coverage:
    """How often the interval holds, over many trials.

    Parameters
    ----------
    population, design
        Where objects are drawn from, and how many.
    protocol
        The rules, which say whether the interval would be printed.
    trials
        How many; the share is known to ``sqrt(share (1 - share) / trials)``.
    seed
        Of the draws.
    """
    scores = population.sample(design, trials, np.random.default_rng(seed))
    categories = np.repeat(np.arange(design.categories), design.size).astype(str).tolist()
    drawn = (strata if design.is_fixed else category_sums)(scores, categories)
    low, high = studentised_intervals(drawn, RESAMPLES, seed)
    mean = population.scores[: design.categories if design.is_fixed else None].mean()
    share = float(((low <= mean) & (mean <= high)).mean())
    printed = population.is_trusted and design.is_printed(protocol)
    return Coverage(population.name, population.metric, design, printed, share)


def told_apart(
    rows: Sequence[Entry], protocol: Rules, methods: int, trials: int, seed: int = 0
) -> float:
    """Share of tables of equal methods in which any two are told apart.

    In every trial each method gets, of every category, the scores of one of the rows by lot: what
    it is better at is chance. Of given categories, of every object.

    Parameters
    ----------
    rows
        Of one table, as many as there are methods or more.
    protocol
        The rules of ranks.
    methods
        How many are compared.
    trials
        How many tables.
    seed
        Of the lots.
    """
    rng = np.random.default_rng(seed)
    losses, categories = row_losses(rows, protocol.rank_by)
    is_fixed = _is_fixed(rows[0], protocol)
    dealt = np.arange(len(losses)) if is_fixed else np.array(categories)
    names, places = np.unique(dealt, return_inverse=True)
    found = 0
    for _ in range(trials):
        lots = rng.permuted(np.tile(np.arange(len(rows)), (len(names), 1)), axis=1)[:, :methods]
        drawn = np.take_along_axis(losses, lots[places], axis=1)
        worse = worse_rows(drawn, categories, protocol)
        found += max(dense_ranks(drawn.mean(axis=0).tolist(), worse)) > 1
    return found / trials


def _is_fixed(row: Entry, protocol: Rules) -> bool:
    """Whether the categories of a row are given: all the unseen ones."""
    return {*row["object_scores"]["category"]} == {*protocol.unseen_categories}


def _even(
    scores: Float64[np.ndarray, "objects"], categories: Sequence[str], is_fixed: bool
) -> Float64[np.ndarray, "categories size"]:
    """Scores of the first objects of each category: as many as the least has, or three.

    Where categories are not given, those with fewer than three are left out.
    """
    places = [np.flatnonzero(np.array(categories) == name) for name in sorted(set(categories))]
    size = min(map(len, places)) if is_fixed else 3
    chosen = [scores[place[:size]] for place in places if len(place) >= size]
    return np.array(chosen, dtype=np.float64).reshape(-1, size)
