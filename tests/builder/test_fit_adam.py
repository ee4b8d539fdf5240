"""The paper's solver and the fast one minimise the same thing."""

from dataclasses import replace

import numpy as np
import pytest

from tests.builder.fit_scenes import random_views, with_noise
from xden1k.errors import DataError
from xden_builder.fit import (
    PAPER_OBJECTIVE,
    AdamSettings,
    compare_solvers,
    fit_lac,
    fit_lac_adam,
)


@pytest.mark.parametrize(
    ("lac", "gain"),
    [
        ([0.3, 1.0], False),
        pytest.param([0.3, 1.0], True, marks=pytest.mark.slow),
        pytest.param([0.15, 0.2, 4.0, 0.9], False, marks=pytest.mark.slow),
        ([0.15, 0.2, 4.0, 0.9], True),
    ],
)
def test_both_solvers_reach_the_same_loss(lac, gain):
    rng = np.random.default_rng(40)
    views = with_noise(random_views(rng, lac, gains=(1.01, 0.99)), rng)
    objective = replace(PAPER_OBJECTIVE, gain="free" if gain else "fixed")
    fast, slow = fit_lac(views, objective), fit_lac_adam(views, AdamSettings(gain=gain))
    assert slow.loss == pytest.approx(fast.loss, rel=1e-4)
    assert slow.loss >= fast.loss * (1 - 1e-9)
    np.testing.assert_allclose(slow.lac_per_cm, fast.lac_per_cm, rtol=0.02)
    np.testing.assert_allclose(slow.gain, fast.gain, rtol=1e-3)
    assert slow.report["converged"]


def test_the_loss_is_the_papers_sum_over_both_frames():
    rng = np.random.default_rng(41)
    views = with_noise(random_views(rng, [0.3, 1.0]), rng)
    fit = fit_lac_adam(views)
    expected = sum(
        ((lengths.image(fit.lac_per_cm) - view.transmission.astype(np.float64)) ** 2).sum()
        for lengths, view in views
    )
    assert fit.loss == pytest.approx(expected, rel=1e-6)
    assert fit.gain.tolist() == [1.0, 1.0]


def test_masked_pixels_have_no_say_in_adam_either():
    rng = np.random.default_rng(42)
    views = with_noise(random_views(rng, [0.3, 1.0]), rng)
    spoilt = []
    for lengths, view in views:
        image, valid = view.transmission.copy(), view.valid.copy()
        image.flat[lengths.pixels[:5]] = np.nan
        valid.flat[lengths.pixels[:5]] = False
        image[0, 0], valid[0, 0] = np.nan, False
        broken = lengths.broken.copy()
        broken[20:23] = True
        image.flat[lengths.pixels[20:23]] = 5.0
        spoilt.append(
            (replace(lengths, broken=broken), replace(view, transmission=image, valid=valid))
        )
    fast, slow = fit_lac(spoilt, PAPER_OBJECTIVE), fit_lac_adam(spoilt)
    assert slow.loss == pytest.approx(fast.loss, rel=1e-4)


def test_several_rays_a_pixel_become_one_mean_length():
    rng = np.random.default_rng(43)
    views = with_noise(random_views(rng, [0.3, 1.0], rays=4), rng)
    averaged = [
        (replace(lengths, lengths_cm=lengths.lengths_cm.mean(axis=1, keepdims=True)), view)
        for lengths, view in views
    ]
    assert fit_lac_adam(views).lac_per_cm.tolist() == fit_lac_adam(averaged).lac_per_cm.tolist()


def test_adam_stops_at_its_budget_and_says_so():
    views = random_views(np.random.default_rng(44), [0.3, 1.0])
    fit = fit_lac_adam(views, AdamSettings(max_steps=3))
    assert fit.iterations == 3
    assert not fit.report["converged"]


def test_comparison_is_to_an_equal_loss():
    rng = np.random.default_rng(45)
    views = with_noise(random_views(rng, [0.3, 1.0]), rng)
    comparison = compare_solvers(views, repeats=2)
    assert 0 <= comparison.lm_excess < 1e-9
    assert 0 <= comparison.adam_excess < 1.1e-4
    assert comparison.least_loss <= min(comparison.lm_loss, comparison.adam_loss)
    assert comparison.ratio > 1
    assert comparison.adam_steps > comparison.lm_iterations


def test_settings_out_of_range_are_refused():
    with pytest.raises(DataError, match="learning_rate_per_cm must be positive, got 0"):
        AdamSettings(learning_rate_per_cm=0.0)
