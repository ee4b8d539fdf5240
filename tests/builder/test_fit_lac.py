"""The Levenberg-Marquardt fit finds the truth, keeps its bounds and masks what is broken."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.builder.fit_scenes import (
    FRAME,
    changed,
    ideal_view,
    random_lengths,
    random_views,
    solid_views,
    with_noise,
)
from xden1k.errors import DataError
from xden1k.rays import PathLengths
from xden_builder.fit import PAPER_OBJECTIVE, FitSettings, fit_lac
from xden_builder.fit.problem import Problem
from xden_builder.fit.weighting import uniform

UNWEIGHTED = FitSettings(weights="none")
coefficients = st.lists(st.floats(0.2, 6.0), min_size=1, max_size=6)
seeds = st.integers(0, 2**32 - 1)


@settings(max_examples=40, deadline=None)
@given(
    coefficients,
    st.tuples(st.floats(0.8, 1.2), st.floats(0.8, 1.2)),
    st.sampled_from([1, 4]),
    st.sampled_from(["edge", "none"]),
    seeds,
)
def test_truth_is_found_on_ideal_images_with_gains(lac, gains, rays, weights, seed):
    views = random_views(np.random.default_rng(seed), lac, gains, rays)
    fit = fit_lac(views, FitSettings(weights=weights))
    np.testing.assert_allclose(fit.lac_per_cm, lac, rtol=1e-6)
    np.testing.assert_allclose(fit.gain, gains, rtol=1e-6)
    assert fit.report["converged"]


@settings(max_examples=20, deadline=None)
@given(coefficients, seeds)
def test_truth_is_found_on_ideal_images_without_gains(lac, seed):
    views = random_views(np.random.default_rng(seed), lac)
    fit = fit_lac(views, PAPER_OBJECTIVE)
    np.testing.assert_allclose(fit.lac_per_cm, lac, rtol=1e-6)
    assert fit.gain.tolist() == [1.0, 1.0]
    assert [view["gain_sd"] for view in fit.report["views"].values()] == [0.0, 0.0]


@settings(max_examples=20, deadline=None)
@given(st.lists(st.sampled_from([0.0, 0.3, 2.0, 4.0]), min_size=2, max_size=5), seeds)
def test_parts_without_attenuation_rest_at_the_bound(lac, seed):
    views = random_views(np.random.default_rng(seed), lac)
    fit = fit_lac(views)
    np.testing.assert_allclose(fit.lac_per_cm, lac, rtol=1e-6, atol=1e-6)
    assert (fit.lac_per_cm >= 0).all()


def test_negative_evidence_stops_at_zero_and_is_flagged():
    views = random_views(np.random.default_rng(0), [0.0, 1.0])
    for lengths, view in views:
        alone = (lengths.lengths_cm[:, 0, 0] > 0) & (lengths.lengths_cm[:, 0, 1] == 0)
        view.transmission.flat[lengths.pixels[alone]] += 0.05
    fit = fit_lac(views)
    assert fit.lac_per_cm[0] == 0.0
    assert {"at_bound", "uncertain"} <= fit.flags[0]
    assert "at_bound" not in fit.flags[1]


def test_upper_bound_holds_when_the_truth_lies_above():
    views = random_views(np.random.default_rng(1), [0.5, 6.0])
    fit = fit_lac(views, FitSettings(upper_per_cm=4.0))
    assert fit.lac_per_cm[1] == 4.0
    assert "at_bound" in fit.flags[1]


def test_part_seen_by_one_view_only_is_fitted():
    rng = np.random.default_rng(2)
    lac = np.array([0.7, 2.0, 1.1])
    hidden_in_lat = random_lengths(rng, 3)
    hidden_in_lat.lengths_cm[:, :, 1] = 0.0
    views = [
        (lengths, ideal_view(name, lengths, lac))
        for name, lengths in (("pa", random_lengths(rng, 3)), ("lat", hidden_in_lat))
    ]
    fit = fit_lac(views)
    np.testing.assert_allclose(fit.lac_per_cm, lac, rtol=1e-6)
    assert not any("hidden" in flags for flags in fit.flags)


def test_part_no_ray_meets_is_hidden_and_has_no_coefficient():
    views = random_views(np.random.default_rng(3), [0.7, 2.0])
    for lengths, _ in views:
        lengths.lengths_cm[:, :, 1] = 0.0
    views = [(lengths, ideal_view(view.name, lengths, [0.7, 2.0])) for lengths, view in views]
    fit = fit_lac(views)
    assert fit.flags[1] == {"hidden"}
    assert "hidden" not in fit.flags[0]
    assert np.isnan(fit.lac_per_cm[1])
    assert np.isnan(fit.lac_sd_per_cm[1])
    assert fit.lac_per_cm[0] == pytest.approx(0.7, rel=1e-6)


def test_object_outside_both_frames_hides_every_part():
    empty = PathLengths(
        np.zeros(0, dtype=np.int64),
        np.zeros((0, 1, 2), dtype=np.float32),
        np.zeros(0, dtype=np.float32),
        np.zeros(0, dtype=bool),
        FRAME,
    )
    views = [(empty, ideal_view(name, empty, [1.0, 1.0])) for name in ("pa", "lat")]
    for choice in (FitSettings(), PAPER_OBJECTIVE):
        assert fit_lac(views, choice).flags == (frozenset({"hidden"}),) * 2


def test_pixels_that_are_invalid_or_broken_have_no_say():
    lac = [0.4, 1.5]
    views = random_views(np.random.default_rng(4), lac)
    spoilt = []
    for lengths, view in views:
        bad, open_mesh = lengths.pixels[:7], lengths.broken.copy()
        open_mesh[10:14] = True
        image, valid = view.transmission.copy(), view.valid.copy()
        image.flat[bad] = np.nan
        valid.flat[bad] = False
        image.flat[lengths.pixels[open_mesh]] = 0.9
        image[0, :5] = np.nan
        valid[0, :5] = False
        spoilt.append(
            (replace(lengths, broken=open_mesh), replace(view, transmission=image, valid=valid))
        )
    fit = fit_lac(spoilt)
    np.testing.assert_allclose(fit.lac_per_cm, lac, rtol=1e-6)
    assert fit.report["views"]["pa"]["masked_pixels"] == 11


def test_air_that_is_no_air_does_not_move_the_gain():
    views = random_views(np.random.default_rng(5), [0.4, 1.5], gains=(1.05, 0.97))
    marked = [
        (lengths, changed(view, lambda image: image[:2].fill(0.1))) for lengths, view in views
    ]
    np.testing.assert_allclose(fit_lac(marked).gain, (1.05, 0.97), rtol=1e-6)


def test_gain_stays_one_where_no_air_tells_it():
    pixels = np.arange(FRAME[0] * FRAME[1])
    rng = np.random.default_rng(6)
    lengths = PathLengths(
        pixels,
        rng.uniform(0.1, 1.0, (len(pixels), 1, 2)).astype(np.float32),
        np.zeros(len(pixels), dtype=np.float32),
        np.zeros(len(pixels), dtype=bool),
        FRAME,
    )
    fit = fit_lac([(lengths, ideal_view(name, lengths, [0.5, 1.0])) for name in ("pa", "lat")])
    assert fit.gain.tolist() == [1.0, 1.0]
    assert fit.report["views"]["pa"]["air_pixels"] == 0
    np.testing.assert_allclose(fit.lac_per_cm, [0.5, 1.0], rtol=1e-6)


def test_collapsed_air_counts_like_every_pixel_of_the_frame():
    views = with_noise(random_views(np.random.default_rng(7), [0.4, 1.5]), np.random.default_rng(8))
    problem = Problem.of(views, PAPER_OBJECTIVE, {})
    lac, gains = np.array([0.5, 1.2]), np.array([1.02, 0.99])
    found = problem.evaluate(np.append(lac, gains), uniform(problem.views))
    expected = sum(
        ((lengths.image(lac, gain) - view.transmission.astype(np.float64)) ** 2).sum()
        for (lengths, view), gain in zip(views, gains, strict=True)
    )
    assert found.loss == pytest.approx(expected, rel=1e-6)


@settings(max_examples=20, deadline=None)
@given(seeds, st.sampled_from([1, 4]))
def test_jacobian_is_the_derivative_of_the_model(seed, rays):
    rng = np.random.default_rng(seed)
    views = with_noise(random_views(rng, [0.4, 1.5, 3.0], rays=rays), rng)
    problem = Problem.of(views, FitSettings(air_margin_px=0), {})
    point = np.append(rng.uniform(0.1, 3.0, 3), rng.uniform(0.9, 1.1, 2))
    weights = [(rng.uniform(0.5, 2.0, len(lengths.pixels)), 0.7) for lengths, _ in views]

    def loss(unknowns):
        return problem.evaluate(unknowns, weights).loss

    gradient = problem.evaluate(point, weights).gradient
    step = 1e-6
    for number, axis in enumerate(np.eye(5) * step):
        slope = (loss(point + axis) - loss(point - axis)) / (2 * step)
        assert 2 * gradient[number] == pytest.approx(slope, rel=1e-4, abs=1e-5)


def test_hessian_is_the_jacobian_times_itself():
    rng = np.random.default_rng(9)
    (lengths, view), _ = random_views(rng, [0.4, 1.5], rays=4)
    problem = Problem.of([(lengths, view)], FitSettings(air_margin_px=0), {})
    lac, gain = np.array([0.6, 1.1]), 1.1
    weights = rng.uniform(0.5, 2.0, len(lengths.pixels))
    shares = np.exp(-(lengths.lengths_cm @ lac))
    jacobian = np.column_stack(
        [
            *(-gain * (shares * lengths.lengths_cm[:, :, part]).mean(axis=1) for part in (0, 1)),
            shares.mean(axis=1),
        ]
    )
    expected = jacobian.T @ (weights[:, None] * jacobian)
    expected[2, 2] += 0.7 * problem.views[0].air.count
    found = problem.evaluate(np.append(lac, gain), [(weights, 0.7)]).hessian
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def _ball_in_a_box():
    ball = trimesh.creation.icosphere(3, 1.0)
    box = trimesh.creation.box((3.0, 3.4, 4.0))
    return [ball, box]


def test_edge_weights_bear_a_misplaced_object():
    lac = np.array([1.5, 0.3])
    views = solid_views(_ball_in_a_box(), lac, rays=3, true_rays=3)
    shifted = [
        (lengths, changed(view, lambda image: image.__setitem__(slice(1, None), image[:-1].copy())))
        for lengths, view in views
    ]
    plain, weighted = (
        np.abs(fit_lac(shifted, choice).lac_per_cm / lac - 1).max()
        for choice in (UNWEIGHTED, FitSettings())
    )
    assert weighted < 0.5 * plain


def test_averaged_intensities_and_edge_weights_together_bear_coarse_pixels():
    lac = np.array([1.5, 0.3])
    views = solid_views(_ball_in_a_box(), lac, size=48, rays=3, true_rays=6)
    one_ray = solid_views(_ball_in_a_box(), lac, size=48, rays=1, true_rays=6)
    fine, coarse = (np.abs(fit_lac(each).lac_per_cm / lac - 1).max() for each in (views, one_ray))
    assert fine < 1e-3
    assert fine < coarse


def test_cost_does_not_grow_with_the_frame():
    views = random_views(np.random.default_rng(10), [0.5, 1.0])
    problem = Problem.of(views, PAPER_OBJECTIVE, {})
    assert all(len(view.measured) == 100 for view in problem.views)
    assert all(view.air.count == FRAME[0] * FRAME[1] - 100 for view in problem.views)


def test_images_and_path_lengths_of_different_frames_are_refused():
    (lengths, view), lat = random_views(np.random.default_rng(11), [0.5])
    with pytest.raises(DataError, match=r"view pa: path lengths are for \(24, 20\)"):
        fit_lac([(replace(lengths, shape=(24, 20)), view), lat])


def test_dark_air_is_refused():
    views = [
        (lengths, changed(view, lambda image: image.__isub__(1.0)))
        for lengths, view in random_views(np.random.default_rng(13), [0.5])
    ]
    with pytest.raises(DataError, match="view pa: the air beside the object must be bright"):
        fit_lac(views)


def test_views_of_different_parts_are_refused():
    rng = np.random.default_rng(12)
    with pytest.raises(DataError, match=r"must be of the same parts, got \[1, 2\] parts"):
        fit_lac([random_views(rng, [0.5])[0], random_views(rng, [0.5, 1.0])[1]])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"edge_error_px": -1.0}, "edge_error_px must not be negative"),
        ({"upper_per_cm": 0.0}, "upper_per_cm must be positive"),
        ({"model_error": float("nan")}, "model_error must not be negative"),
    ],
)
def test_settings_out_of_range_are_refused(change, message):
    with pytest.raises(DataError, match=message):
        FitSettings(**change)
