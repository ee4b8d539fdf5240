"""Intervals over categories: the textbook's where there is one, and what they do not depend on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import t as student_t

from xden_bench.scoring.clusters import category_sums
from xden_bench.scoring.studentised import studentised_intervals


def kinds(count: int, size: int) -> list[str]:
    return [f"kind-{i // size:03}" for i in range(count * size)]


def test_of_many_normal_scores_the_interval_is_that_of_student() -> None:
    values = np.random.default_rng(1).normal(0.0, 2.0, (200, 1))
    sums = category_sums(values, kinds(200, 1))
    (low,), (high,) = studentised_intervals(sums, 10_000, 0)
    half = student_t.isf(0.025, 199) * values.std(ddof=1) / np.sqrt(200)
    assert sums.errors[0] == pytest.approx(values.std(ddof=1) / np.sqrt(200))
    assert (low, high) == pytest.approx(
        (values.mean() - half, values.mean() + half), abs=0.05 * half
    )


def test_objects_that_repeat_their_category_add_nothing() -> None:
    values = np.random.default_rng(2).normal(0.0, 1.0, (100, 2))
    alone = studentised_intervals(category_sums(values, kinds(100, 1)), 500, 0)
    repeated = category_sums(np.repeat(values, 4, axis=0), kinds(100, 4))
    np.testing.assert_allclose(studentised_intervals(repeated, 500, 0), alone, rtol=1e-9)


def test_errors_agree_with_loops_where_categories_differ_in_size() -> None:
    rng = np.random.default_rng(3)
    values, categories = rng.random(12), ["a"] * 5 + ["b"] + ["c"] * 4 + ["d"] * 2
    sums = category_sums(values[:, None], categories)
    mean = values.mean()
    squares = 0.0
    for name in "abcd":
        own = [value for value, kind in zip(values, categories, strict=True) if kind == name]
        squares += (sum(own) - len(own) * mean) ** 2
    assert sums.means[0] == pytest.approx(mean)
    assert sums.errors[0] == pytest.approx(np.sqrt(4 / 3 * squares) / 12)
    by_kind = [np.mean(values[np.array(categories) == name]) for name in "abcd"]
    assert sums.macro_means[0] == pytest.approx(np.mean(by_kind))


@given(st.permutations(range(12)))
@settings(deadline=None, max_examples=20)
def test_the_order_of_the_objects_does_not_matter(order: list[int]) -> None:
    values, categories = np.random.default_rng(4).random((12, 1)), np.array(kinds(4, 3))
    there = studentised_intervals(category_sums(values, categories.tolist()), 99, 0)
    turned = category_sums(values[order], categories[order].tolist())
    np.testing.assert_allclose(studentised_intervals(turned, 99, 0), there, rtol=1e-9)


@pytest.mark.parametrize("factor", [1e-3, 40.0])
def test_intervals_scale_with_their_values(factor: float) -> None:
    values = np.random.default_rng(5).lognormal(size=(60, 1))
    ends, scaled = (
        studentised_intervals(category_sums(one, kinds(60, 1)), 300, 0)
        for one in (values, factor * values)
    )
    np.testing.assert_allclose(scaled, factor * ends, rtol=1e-9)
    assert ends[0, 0] > 0


def test_columns_are_independent_of_their_neighbours() -> None:
    values = np.random.default_rng(6).normal([0.0, 9.0, 0.5], size=(40, 3))
    together = studentised_intervals(category_sums(values, kinds(20, 2)), 200, 0)
    for place in range(3):
        alone = studentised_intervals(category_sums(values[:, [place]], kinds(20, 2)), 200, 0)
        np.testing.assert_allclose(together[:, [place]], alone, rtol=1e-9)


def test_equal_scores_have_an_interval_of_no_width() -> None:
    ends = studentised_intervals(category_sums(np.full((30, 1), 0.7), kinds(10, 3)), 100, 0)
    np.testing.assert_allclose(ends, 0.7)
