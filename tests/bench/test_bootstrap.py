"""Intervals: the same for the same seed, the textbook's where there is one."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from xden_bench.scoring.bootstrap import SAME, Estimate, estimate, resampled_means


def test_means_agree_with_a_loop() -> None:
    values = np.random.default_rng(0).random((7, 2))
    means = resampled_means(values, resamples=2500, seed=3)
    rng = np.random.default_rng(3)
    expected = []
    for rows in (1000, 1000, 500):
        for drawn in rng.integers(7, size=(rows, 7)):
            expected.append([sum(values[i, metric] for i in drawn) / 7 for metric in (0, 1)])
    np.testing.assert_allclose(means, expected, rtol=1e-12)


def test_the_interval_is_that_of_the_normal_law_for_many_objects() -> None:
    values = np.random.default_rng(1).normal(5.0, 2.0, (1000, 1))
    (one,) = estimate(values, resamples=10_000, seed=0)
    half = 1.96 * values.std() / np.sqrt(1000)
    assert one.mean == pytest.approx(values.mean())
    assert one.interval == pytest.approx((one.mean - half, one.mean + half), abs=0.05 * half)


def test_two_methods_see_the_same_draws() -> None:
    values = np.random.default_rng(2).random((20, 1))
    difference = resampled_means(values + 1, 500, 0) - resampled_means(values, 500, 0)
    np.testing.assert_allclose(difference, 1.0)


def test_metrics_are_independent_of_their_neighbours() -> None:
    values = np.random.default_rng(2).random((20, 3))
    together = estimate(values, 500, 0)
    for column, one in enumerate(together):
        (alone,) = estimate(values[:, [column]], 500, 0)
        assert alone.interval == pytest.approx(one.interval, rel=1e-12)


def test_one_object_has_an_interval_of_no_width() -> None:
    (one,) = estimate(np.array([[2.0]]), 100, 0)
    assert (one.mean, one.interval) == (2.0, (2.0, 2.0))


def test_an_estimate_is_a_frozen_value_and_stored_as_its_mean_and_interval() -> None:
    one = Estimate(2.0, (1.0, 4.0))
    assert one.to_json() == {"mean": 2.0, "ci95": [1.0, 4.0]}
    assert Estimate(2.0, None, 3.0).to_json() == {"mean": 2.0, "macro_mean": 3.0, "ci95": None}
    assert one == Estimate(2.0, (1.0, 4.0))
    assert not hasattr(one, "__dict__")
    with pytest.raises(dataclasses.FrozenInstanceError):
        one.mean = 3.0


def test_what_float32_rounds_away_is_the_same_and_no_digit_that_is_printed() -> None:
    densities = np.geomspace(1e-3, 20, 1000)
    assert np.abs(densities.astype(np.float32) - densities).max() < SAME < 0.5e-4
