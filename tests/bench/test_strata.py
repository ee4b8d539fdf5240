"""Intervals over the objects of given categories, and where they stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t as student_t

from xden_bench.entries.ranking import worse_beyond_doubt
from xden_bench.scoring.clusters import category_sums
from xden_bench.scoring.intervals import protocol_intervals, sampled
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.strata import strata
from xden_bench.scoring.studentised import studentised_intervals

RULES = load_protocol()
SEEN = [f"kind-{number:03}" for number in range(120)]


def kinds(names: list[str], size: int) -> list[str]:
    return [name for name in names for _ in range(size)]


def test_of_one_category_of_many_normal_scores_the_interval_is_that_of_student() -> None:
    values = np.random.default_rng(1).normal(0.0, 2.0, (200, 1))
    made = strata(values, ["mug"] * 200)
    (low,), (high,) = studentised_intervals(made, 10_000, 0)
    half = student_t.isf(0.025, 199) * values.std(ddof=1) / np.sqrt(200)
    assert made.errors[0] == pytest.approx(values.std(ddof=1) / np.sqrt(200))
    assert (low, high) == pytest.approx(
        (values.mean() - half, values.mean() + half), abs=0.05 * half
    )


def test_what_differs_between_given_categories_is_no_doubt() -> None:
    rng = np.random.default_rng(2)
    values, categories = rng.normal(size=(300, 1)), kinds(SEEN[:30], 10)
    moved = values + np.repeat(rng.normal(0.0, 50.0, 30), 10)[:, None]
    apart, together = (strata(one, categories) for one in (moved, values))
    np.testing.assert_allclose(apart.errors, together.errors)
    np.testing.assert_allclose(
        np.diff(studentised_intervals(apart, 500, 0), axis=0),
        np.diff(studentised_intervals(together, 500, 0), axis=0),
    )
    assert apart.errors < category_sums(moved, categories).errors / 10


def test_resamples_agree_with_loops_where_categories_differ_in_size() -> None:
    rng = np.random.default_rng(3)
    values, categories = rng.random((12, 2)), ["a"] * 6 + ["b"] * 2 + ["c"] * 4
    made = strata(values, categories)
    means, errors = made.resampled(20_000, 0)
    np.testing.assert_allclose(means.mean(axis=0), values.mean(axis=0), atol=3e-3)
    shares = [(len(own) - 1) / len(own) * own.var(axis=0, ddof=1) for own in made.scores]
    spread = np.sqrt(sum(len(own) * one for own, one in zip(made.scores, shares, strict=True))) / 12
    np.testing.assert_allclose(means.std(axis=0), spread, rtol=0.03)
    # of a resample the variance is, in the mean, (n - 1) / n of that of the scores
    np.testing.assert_allclose(np.sqrt((errors**2).mean(axis=0)), spread, rtol=0.03)


def test_on_the_unseen_categories_objects_are_drawn_and_elsewhere_categories() -> None:
    rng = np.random.default_rng(4)
    unseen, seen = kinds(list(RULES.unseen_categories), 10), kinds(SEEN[:100], 3)
    offsets = np.repeat(rng.gamma(2.0, size=30), 10)
    values = (rng.gamma(2.0, size=300) + offsets)[:, None]
    names = [RULES.rank_by]
    of_objects = protocol_intervals(values, unseen, names, RULES)[RULES.rank_by]
    assert of_objects == pytest.approx(
        studentised_intervals(
            strata(values, unseen), RULES.bootstrap_resamples, RULES.bootstrap_seed
        )[:, 0]
    )
    of_kinds = protocol_intervals(values, seen, names, RULES)[RULES.rank_by]
    assert of_kinds == pytest.approx(
        studentised_intervals(
            category_sums(values, seen), RULES.bootstrap_resamples, RULES.bootstrap_seed
        )[:, 0]
    )


@pytest.mark.parametrize(
    "categories",
    [
        kinds(list(RULES.unseen_categories), 9),
        kinds(list(RULES.unseen_categories[1:]), 12),
        [*kinds(list(RULES.unseen_categories), 11)[5:], "mug"],
        [*kinds(list(RULES.unseen_categories), 11)[2:], "mug"],
    ],
    ids=["few objects", "a category lacks", "few of one category", "a category more"],
)
def test_an_unseen_split_that_is_not_whole_has_no_interval(categories: list[str]) -> None:
    values = np.random.default_rng(5).random((len(categories), 1))
    rules = replace(RULES, min_interval_objects=280)
    assert protocol_intervals(values, categories, [RULES.rank_by], rules) == {}


def test_on_unseen_kinds_ranks_are_told_apart_over_the_objects() -> None:
    rng = np.random.default_rng(6)
    unseen = kinds(list(RULES.unseen_categories), 12)
    # better by .2 within each category, however the categories differ
    difference = np.repeat(rng.normal(0.0, 0.5, 30), 12) + rng.normal(0.0, 0.3, 360)
    difference += 0.2 - difference.mean()
    losses = np.stack([np.full(360, 2.0), 2.0 + difference], axis=1)
    given = worse_beyond_doubt(sampled(losses, unseen, RULES), 0.05, 30)
    drawn = worse_beyond_doubt(category_sums(losses, unseen), 0.05, 30)
    assert given.tolist() == [[False, False], [True, False]]
    assert not drawn.any()
