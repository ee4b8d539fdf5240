"""Standard deviations are as large as the errors, and flags go up where they should."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import trimesh

from tests.builder.fit_scenes import (
    FRAME,
    changed,
    ideal_view,
    random_lengths,
    random_views,
    solid_views,
    with_noise,
)
from xden1k.rays import PathLengths
from xden_builder.fit import PAPER_OBJECTIVE, FitSettings, diagnostics, fit_lac

PURE_NOISE = FitSettings(edge_error_px=0.0, model_error=0.0)
DRAWS = pytest.mark.parametrize("draws", [60, pytest.param(200, marks=pytest.mark.slow)])


@pytest.mark.parametrize(
    "choice",
    [
        pytest.param(PURE_NOISE, id="noise", marks=pytest.mark.slow),
        pytest.param(FitSettings(), id="edge"),
        pytest.param(FitSettings(weights="none"), id="none", marks=pytest.mark.slow),
    ],
)
@DRAWS
def test_reported_deviation_matches_the_spread_over_noise_draws(choice, draws):
    rng = np.random.default_rng(20)
    lac = np.array([0.3, 1.0, 2.5])
    ideal = random_views(rng, lac, gains=(1.02, 0.98), rays=4)
    fits = [fit_lac(with_noise(ideal, rng), choice) for _ in range(draws)]
    found = np.array([fit.lac_per_cm for fit in fits])
    reported = np.mean([fit.lac_sd_per_cm for fit in fits], axis=0)
    spread = found.std(axis=0, ddof=1)
    np.testing.assert_allclose(reported / spread, 1.0, atol=0.2)
    assert (np.abs(found.mean(axis=0) - lac) < 0.3 * spread).all()


@DRAWS
def test_reported_gain_deviation_matches_the_spread_over_noise_draws(draws):
    rng = np.random.default_rng(21)
    ideal = random_views(rng, [0.3, 1.0], gains=(1.02, 0.98))
    fits = [fit_lac(with_noise(ideal, rng), PURE_NOISE) for _ in range(draws)]
    spread = np.array([fit.gain for fit in fits]).std(axis=0, ddof=1)
    reported = [
        np.mean([fit.report["views"][name]["gain_sd"] for fit in fits]) for name in ("pa", "lat")
    ]
    np.testing.assert_allclose(reported / spread, 1.0, atol=0.2)


def test_errors_of_shape_widen_the_deviation():
    lac = np.array([1.5, 0.3])
    ball, box = trimesh.creation.icosphere(3, 1.0), trimesh.creation.box((3.0, 3.4, 4.0))
    ideal = solid_views([ball, box], lac)
    larger = solid_views([ball.copy().apply_scale(1.05), box], lac)
    misfit = [(lengths, view) for (lengths, _), (_, view) in zip(ideal, larger, strict=True)]
    noisy, wrong = (
        fit_lac(with_noise(views, np.random.default_rng(22))) for views in (ideal, misfit)
    )
    assert wrong.lac_sd_per_cm[0] > 3 * noisy.lac_sd_per_cm[0]


def test_measured_dark_noise_replaces_the_guess():
    views = with_noise(random_views(np.random.default_rng(23), [1.0]), np.random.default_rng(24))
    reports = fit_lac(views, dark_sd={"pa": 0.002}).report["views"]
    assert reports["pa"]["dark_sd"] == 0.002
    assert reports["lat"]["dark_sd"] == pytest.approx(0.02**0.5 * reports["lat"]["noise_sd"])


def test_report_is_made_of_json_types():
    views = with_noise(random_views(np.random.default_rng(32), [1.0]), np.random.default_rng(33))
    report = fit_lac(views).report
    assert json.loads(json.dumps(report, allow_nan=False)) == report


NOTHING = PathLengths(
    np.zeros(0, dtype=np.int64),
    np.zeros((0, 1, 2), dtype=np.float32),
    np.zeros(0, dtype=np.float32),
    np.zeros(0, dtype=bool),
    FRAME,
)


def _blind(pair, corner_only=False):
    """The view with nothing in its beam, or with nothing valid but one pixel of air."""
    lengths, view = pair
    if not corner_only:
        return NOTHING, ideal_view(view.name, NOTHING, [0.5, 1.0])
    valid = np.zeros(FRAME, dtype=bool)
    valid[0, 0] = True
    return lengths, replace(view, valid=valid)


def _filled(pair):
    """The view without any air."""
    _, view = pair
    pixels = np.arange(view.valid.size)
    lengths = replace(
        NOTHING,
        pixels=pixels,
        lengths_cm=np.ones((len(pixels), 1, 2), dtype=np.float32),
        shared_cm=np.zeros(len(pixels), dtype=np.float32),
        broken=np.zeros(len(pixels), dtype=bool),
    )
    return lengths, ideal_view(view.name, lengths, [0.5, 1.0])


@pytest.mark.parametrize(
    "choice",
    [FitSettings(), FitSettings(weights="none"), PAPER_OBJECTIVE],
    ids=["edge", "none", "paper"],
)
@pytest.mark.parametrize(
    "blind", [_blind, partial(_blind, corner_only=True), _filled], ids=["empty", "corner", "filled"]
)
@pytest.mark.parametrize("both", [False, True])
def test_report_of_views_that_tell_little_is_of_json_types(choice, blind, both):
    pa, lat = random_views(np.random.default_rng(34), [0.5, 1.0])
    report = fit_lac([blind(pa) if both else pa, blind(lat)], choice).report
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert report["views"]["lat"]["correlation"] is None


def test_deviations_without_end_are_none_in_the_report(monkeypatch):
    monkeypatch.setattr(
        diagnostics, "standard_deviations", lambda _, moving: np.full(len(moving), np.inf)
    )
    report = fit_lac(random_views(np.random.default_rng(35), [1.0])).report
    assert report["views"]["pa"]["gain_sd"] is None
    assert json.loads(json.dumps(report, allow_nan=False)) == report


def test_correlation_is_pearsons_over_the_object():
    views = with_noise(
        random_views(np.random.default_rng(36), [0.2, 1.0]), np.random.default_rng(37), quanta=50.0
    )
    fit = fit_lac(views)
    for lengths, view in views:
        model, measured = lengths.transmission(fit.lac_per_cm), view.transmission.flat
        expected = np.corrcoef(model, measured[lengths.pixels])[0, 1]
        assert fit.report["views"][view.name]["correlation"] == pytest.approx(expected, rel=1e-6)


def test_view_of_something_else_correlates_badly():
    rng = np.random.default_rng(38)
    (pa_lengths, pa), (_, lat) = random_views(rng, [0.5, 1.0])
    lengths = random_lengths(rng, 2)
    reports = fit_lac([(pa_lengths, pa), (lengths, lat)]).report["views"]
    assert reports["pa"]["correlation"] > 0.9
    assert reports["lat"]["correlation"] < 0.5


def test_noise_is_read_from_the_air():
    views = with_noise(random_views(np.random.default_rng(25), [1.0]), np.random.default_rng(26))
    noise_sd = fit_lac(views).report["views"]["pa"]["noise_sd"]
    assert noise_sd == pytest.approx(np.hypot(1 / np.sqrt(20_000), 20 / 20_000), rel=0.1)


def test_speck_in_the_noise_is_uncertain():
    speck = trimesh.creation.icosphere(2, 0.09)
    block = trimesh.creation.box((3.0, 3.0, 3.0))
    views = solid_views([speck, block], [0.5, 0.3], rays=3, true_rays=3)
    fit = fit_lac(with_noise(views, np.random.default_rng(27)))
    assert "uncertain" in fit.flags[0]
    assert fit.flags[1] == frozenset()
    assert abs(fit.lac_per_cm[0] - 0.5) < 3 * fit.lac_sd_per_cm[0]


def test_wire_thinner_than_a_pixel_lives_on_its_outline():
    wire = trimesh.creation.cylinder(0.05, 3.0, sections=24)
    ball = trimesh.creation.icosphere(3, 1.0).apply_translation((2.0, 2.0, 0.0))
    fit = fit_lac(solid_views([wire, ball], [3.0, 0.4], rays=3, true_rays=3))
    assert "edge_only" in fit.flags[0]
    assert "edge_only" not in fit.flags[1]


def test_plug_inside_thick_steel_is_starved_and_not_trusted():
    lac = np.array([0.2, 3.0, 0.2])
    meshes = [
        trimesh.creation.cylinder(0.75, 2.0, sections=48),
        trimesh.creation.cylinder(1.7, 6.0, sections=64),
        trimesh.creation.box((6.0, 6.0, 7.0)),
    ]
    views = solid_views(meshes, lac, size=96, width_cm=16.0, rays=3, true_rays=5)
    fit = fit_lac(with_noise(views, np.random.default_rng(28)))
    assert {"starved", "uncertain"} <= fit.flags[0]
    assert fit.flags[2] == frozenset()
    assert abs(fit.lac_per_cm[0] - 0.2) < 4 * fit.lac_sd_per_cm[0]


def test_opaque_block_does_not_run_away_unnoticed():
    views = [
        (lengths, changed(view, lambda image, at=lengths.pixels: image.flat.__setitem__(at, 0.0)))
        for lengths, view in random_views(np.random.default_rng(29), [1.0], met=1.1)
    ]
    fit = fit_lac(views)
    assert fit.lac_per_cm[0] <= FitSettings().upper_per_cm
    assert np.isfinite(fit.lac_sd_per_cm[0])
    assert {"starved", "uncertain"} & fit.flags[0]


def test_twins_no_view_can_tell_apart_are_uncertain():
    views = random_views(np.random.default_rng(30), [1.0, 2.0])
    for lengths, _ in views:
        lengths.lengths_cm[:, :, 1] = lengths.lengths_cm[:, :, 0]
    fit = fit_lac(with_noise(views, np.random.default_rng(31)))
    assert all("uncertain" in flags for flags in fit.flags)
