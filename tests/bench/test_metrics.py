"""Metrics against references written as loops, and against what must hold of any of them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from xden_bench.scoring.calibration import density_crps_g_cm3, score_sd
from xden_bench.scoring.metrics import (
    METRICS,
    Metric,
    density_mae_g_cm3,
    integrate,
    nonuniformity,
    score_object,
)

SD_METRICS = {"density_crps_g_cm3", "density_within_1sd", "density_within_2sd"}
IOU_METRICS = {"iou_a", "iou_b_material", "iou_b_part", "iou_c"}
SHAPE = (4, 5, 3)
ORIGIN = np.array([-1.0, 2.0, 30.0])
VOXEL = 0.5
EXTENT = 2.5

grids = npst.arrays(np.float64, SHAPE, elements=st.floats(0, 20).map(lambda x: round(x, 3)))
shares = npst.arrays(np.float64, SHAPE, elements=st.sampled_from([0.0, 0.25, 0.5, 1.0]))


def loop_reference(truth: np.ndarray, guess: np.ndarray, envelope: np.ndarray) -> dict[str, float]:
    """The definitions, voxel by voxel."""
    error = weight = held = 0.0
    bodies: list[list[tuple[float, list[float]]]] = [[], []]
    hull: list[tuple[float, list[float]]] = []
    for index in np.ndindex(truth.shape):
        share = float(envelope[index])
        if share == 0:
            continue
        error += share * abs(float(guess[index]) - float(truth[index]))
        weight += share
        held += share * float(truth[index])
        place = [float(ORIGIN[axis]) + VOXEL * index[axis] for axis in range(3)]
        hull.append((share, place))
        for body, grid in zip(bodies, (truth, guess), strict=True):
            body.append((float(grid[index]) * VOXEL**3, place))

    def mass_of(body: list[tuple[float, list[float]]]) -> float:
        return sum(mass for mass, _ in body)

    def com_of(body: list[tuple[float, list[float]]]) -> list[float]:
        body = body if mass_of(body) else hull
        return [sum(mass * place[i] for mass, place in body) / mass_of(body) for i in range(3)]

    def inertia_of(body: list[tuple[float, list[float]]]) -> list[list[float]]:
        com, tensor = com_of(body), [[0.0] * 3 for _ in range(3)]
        for mass, place in body:
            arm = [a - b for a, b in zip(place, com, strict=True)]
            for i in range(3):
                for j in range(3):
                    tensor[i][j] -= mass * arm[i] * arm[j]
                tensor[i][i] += mass * (sum(a * a for a in arm) + VOXEL**2 / 6)
        return tensor

    true_mass, mass = map(mass_of, bodies)
    steps = [b - a for a, b in zip(*map(com_of, bodies), strict=True)]
    true_tensor, tensor = map(inertia_of, bodies)
    pairs = [(true_tensor[i][j], tensor[i][j]) for i in range(3) for j in range(3)]
    ratio = mass / true_mass
    return {
        "density_mae_g_cm3": error / weight,
        "density_relative_error": error / held,
        "com_l1_share": sum(abs(step) for step in steps) / EXTENT,
        "com_l1_cm": sum(abs(step) for step in steps),
        "com_l2_cm": math.hypot(*steps),
        "mass_mape": abs(mass - true_mass) / true_mass,
        "mass_alde": min(abs(math.log(ratio)) if ratio else math.inf, math.log(1000)),
        "mass_mnre": min(ratio, 1 / ratio) if ratio else 0.0,
        "inertia_error": math.sqrt(sum((b - a) ** 2 for a, b in pairs))
        / math.sqrt(sum(a * a for a, _ in pairs)),
        "nonuniformity_error": abs(unevenness_of(bodies[1], hull) - unevenness_of(bodies[0], hull)),
    }


def unevenness_of(
    body: list[tuple[float, list[float]]], hull: list[tuple[float, list[float]]]
) -> float:
    """Mass in excess of an even filling, as a share of all mass."""
    mass, volume = (sum(amount for amount, _ in those) for those in (body, hull))
    excess = 0.0
    for (here, _), (share, _) in zip(body, hull, strict=True):
        excess += max(here - mass * share / volume, 0.0)
    return excess / mass if mass else 0.0


@given(truth=grids, guess=grids, envelope=shares)
@settings(deadline=None)
def test_metrics_agree_with_loops(
    truth: np.ndarray, guess: np.ndarray, envelope: np.ndarray
) -> None:
    truth[0, 0, 0], envelope[0, 0, 0] = 1.0, 1.0
    scores = score_object(truth, guess, envelope, ORIGIN, VOXEL, EXTENT)
    expected = loop_reference(truth, guess, envelope)
    assert scores.keys() == expected.keys() == METRICS.keys() - SD_METRICS - IOU_METRICS
    for name, value in expected.items():
        assert scores[name] == pytest.approx(value, rel=1e-9, abs=1e-9), name


@given(truth=grids, envelope=shares)
def test_the_truth_scores_exactly_zero(truth: np.ndarray, envelope: np.ndarray) -> None:
    truth[0, 0, 0], envelope[0, 0, 0] = 1.0, 1.0
    scores = score_object(truth, truth.copy(), envelope, ORIGIN, VOXEL, EXTENT)
    assert scores.pop("mass_mnre") == 1.0
    assert set(scores.values()) == {0.0}


@given(truth=grids, scale=st.floats(0.01, 30))
def test_k_times_the_truth_is_wrong_by_k_minus_1(truth: np.ndarray, scale: float) -> None:
    truth[1, 1, 1] = 1.0
    scores = score_object(truth, scale * truth, np.ones(SHAPE), ORIGIN, VOXEL, EXTENT)
    assert scores["mass_mape"] == pytest.approx(abs(scale - 1), abs=1e-12)
    assert scores["mass_alde"] == pytest.approx(abs(math.log(scale)), abs=1e-12)
    assert scores["mass_mnre"] == pytest.approx(min(scale, 1 / scale))
    assert scores["inertia_error"] == pytest.approx(abs(scale - 1), abs=1e-9)
    assert scores["com_l1_cm"] == pytest.approx(0, abs=1e-9)
    assert scores["density_mae_g_cm3"] == pytest.approx(abs(scale - 1) * truth.mean(), abs=1e-12)


@given(st.tuples(*[st.integers(-3, 3)] * 3))
def test_translation_moves_the_centre_of_mass_by_as_much(shift: tuple[int, int, int]) -> None:
    truth = np.zeros((12, 12, 12))
    truth[4:7, 5:8, 4:6] = np.arange(18).reshape(3, 3, 2)
    guess = np.roll(truth, shift, axis=(0, 1, 2))
    scores = score_object(truth, guess, np.ones_like(truth), ORIGIN, VOXEL, EXTENT)
    assert scores["com_l1_cm"] == pytest.approx(VOXEL * sum(map(abs, shift)), abs=1e-12)
    assert scores["com_l2_cm"] == pytest.approx(VOXEL * math.hypot(*shift), abs=1e-12)
    assert scores["mass_mape"] == pytest.approx(0, abs=1e-12)
    assert scores["inertia_error"] == pytest.approx(0, abs=1e-12)


def test_every_metric_ignores_the_air_around() -> None:
    truth = np.zeros((6, 6, 6))
    truth[1:4, 1:4, 1:4] = 2.0
    envelope = (truth > 0).astype(float)
    guess = 0.9 * truth
    alone = score_object(truth, guess, envelope, ORIGIN, VOXEL, EXTENT)
    guess[5, 5, 5] = 100.0
    assert score_object(truth, guess, envelope, ORIGIN, VOXEL, EXTENT) == alone


def test_filling_an_enclosed_cavity_is_an_error() -> None:
    truth = np.full((5, 5, 5), 1.0)
    truth[2, 2, 2] = 0.0
    error = density_mae_g_cm3(truth, np.ones((5, 5, 5)), np.ones((5, 5, 5)))
    assert error == pytest.approx(1 / 125)


def test_half_filled_voxels_count_half() -> None:
    truth, guess = np.array([[[1.0, 0.5]]]), np.array([[[2.0, 2.5]]])
    assert density_mae_g_cm3(truth, guess, np.array([[[1.0, 0.5]]])) == pytest.approx(2 / 1.5)


def test_no_mass_scores_finite_values() -> None:
    truth = np.zeros((4, 4, 4))
    truth[0, 0, 0] = truth[3, 3, 3] = 5.0
    scores = score_object(truth, 0 * truth, np.ones((4, 4, 4)), ORIGIN, VOXEL, EXTENT)
    assert scores["mass_mape"] == 1.0
    assert scores["mass_alde"] == pytest.approx(math.log(1000))
    assert scores["mass_mnre"] == 0.0
    assert scores["inertia_error"] == 1.0
    assert scores["com_l1_cm"] == pytest.approx(0.0)
    assert all(map(math.isfinite, scores.values()))


@given(envelope=shares, epsilon=st.sampled_from([1e-3, 1e-6]))
def test_the_centre_of_nothing_is_that_of_next_to_nothing(
    envelope: np.ndarray, epsilon: float
) -> None:
    envelope[0, 0, 0] = 1.0
    nothing = integrate(np.zeros(SHAPE), envelope, ORIGIN, VOXEL)
    thin = integrate(epsilon * envelope, envelope, ORIGIN, VOXEL)
    np.testing.assert_allclose(nothing.com_cm, thin.com_cm, atol=1e-9)


def test_alde_is_bounded_on_both_sides() -> None:
    truth = np.ones((2, 2, 2))
    for scale in (1e-9, 1e9):
        scores = score_object(
            truth, scale * truth, truth, ORIGIN, VOXEL, EXTENT, mass_ratio_limit=100.0
        )
        assert scores["mass_alde"] == pytest.approx(math.log(100))


@given(guess=grids, envelope=shares, scale=st.floats(0.01, 30))
def test_non_uniformity_has_no_unit_and_is_that_of_an_even_filling_only_at_zero(
    guess: np.ndarray, envelope: np.ndarray, scale: float
) -> None:
    guess[0, 0, 0], envelope[0, 0, 0] = 1.0, 1.0
    uneven = nonuniformity(guess, envelope)
    assert 0 <= uneven < 1
    assert nonuniformity(scale * guess, envelope) == pytest.approx(uneven, abs=1e-12)
    assert nonuniformity(scale * envelope, envelope) == pytest.approx(0, abs=1e-12)


def test_the_non_uniformity_of_two_halves_is_known() -> None:
    halves = np.ones((4, 4, 4))
    halves[:2] = 3.0
    assert nonuniformity(halves, np.ones((4, 4, 4))) == pytest.approx(0.25)
    grain = np.zeros((4, 4, 4))
    grain[0, 0, 0] = 7.0
    assert nonuniformity(grain, np.ones((4, 4, 4))) == pytest.approx(63 / 64)


def test_non_uniformity_asks_how_much_not_where() -> None:
    truth = np.ones((4, 4, 4))
    truth[:2] = 3.0
    scores = score_object(truth, truth[::-1].copy(), np.ones((4, 4, 4)), ORIGIN, VOXEL, EXTENT)
    assert scores["nonuniformity_error"] == 0.0
    assert scores["density_mae_g_cm3"] == 2.0


def crps_by_quadrature(truth: float, guess: float, sd: float) -> float:
    """Integral of ``(F(x) - [x >= truth])²``, the definition, by the rule of the midpoint."""
    low, high = min(truth, guess - 9 * sd), max(truth, guess + 9 * sd)
    steps = 4000
    width = (high - low) / steps
    total = 0.0
    for step in range(steps):
        x = low + (step + 0.5) * width
        below = 0.5 * (1 + math.erf((x - guess) / (sd * math.sqrt(2))))
        total += (below - (x >= truth)) ** 2 * width
    return total


@given(truth=st.floats(0, 5), guess=st.floats(0, 5), sd=st.floats(0.1, 3), share=st.floats(0.1, 1))
@settings(max_examples=25, deadline=None)
def test_crps_is_the_integral_that_defines_it(
    truth: float, guess: float, sd: float, share: float
) -> None:
    found = density_crps_g_cm3(*(np.full((1, 1, 1), value) for value in (truth, guess, sd, share)))
    assert found == pytest.approx(crps_by_quadrature(truth, guess, sd), abs=0.01)


@given(truth=grids, guess=grids, envelope=shares)
def test_crps_without_deviation_is_the_mean_error(
    truth: np.ndarray, guess: np.ndarray, envelope: np.ndarray
) -> None:
    envelope[0, 0, 0] = 1.0
    expected = density_mae_g_cm3(truth, guess, envelope)
    for tiny in (0.0, 1e-30):
        sd = np.full(SHAPE, tiny)
        assert density_crps_g_cm3(truth, guess, sd, envelope) == pytest.approx(expected, abs=1e-12)


def test_a_method_that_knows_its_errors_has_the_nominal_coverage_and_the_best_crps() -> None:
    rng = np.random.default_rng(0)
    truth, box = np.full((40, 40, 40), 5.0), np.ones((40, 40, 40))
    sd = rng.uniform(0.2, 1.0, truth.shape)
    guess = truth + sd * rng.standard_normal(truth.shape)
    scores = score_sd(truth, guess, sd, box)
    assert scores["density_within_1sd"] == pytest.approx(
        METRICS["density_within_1sd"].nominal, abs=0.005
    )
    assert scores["density_within_2sd"] == pytest.approx(
        METRICS["density_within_2sd"].nominal, abs=0.005
    )
    for wrong in (0.5, 0.8, 1.25, 2.0):
        worse = score_sd(truth, guess, wrong * sd, box)
        assert worse["density_crps_g_cm3"] > scores["density_crps_g_cm3"]


@given(truth=grids, guess=grids, sd=grids, envelope=shares)
@settings(deadline=None)
def test_coverage_agrees_with_a_loop_and_ignores_the_air_around(
    truth: np.ndarray, guess: np.ndarray, sd: np.ndarray, envelope: np.ndarray
) -> None:
    envelope[0, 0, 0] = 1.0
    found = score_sd(truth, guess, sd, envelope)
    for sds in (1, 2):
        held = sum(
            float(envelope[index])
            for index in np.ndindex(SHAPE)
            if abs(float(guess[index] - truth[index])) <= sds * float(sd[index])
        )
        assert found[f"density_within_{sds}sd"] == pytest.approx(held / envelope.sum())
    air = envelope == 0
    guess[air], sd[air] = 99.0, 0.0
    assert score_sd(truth, guess, sd, envelope) == found


def test_no_deviation_however_odd_breaks_a_score() -> None:
    truth, box = np.ones((2, 2, 2), np.float32), np.ones((2, 2, 2), np.float32)
    for value in (1e-45, 1e-30, 3.4e38):
        scores = score_sd(truth, 2 * truth, np.full((2, 2, 2), value, np.float32), box)
        assert all(map(math.isfinite, scores.values()))


def test_losses_are_lower_where_a_method_is_better() -> None:
    assert METRICS["mass_mape"].loss(np.array([0.1, 0.2])).tolist() == [0.1, 0.2]
    assert METRICS["mass_mnre"].loss(np.array([0.1, 0.2])).tolist() == [-0.1, -0.2]
    near, far = METRICS["density_within_1sd"].loss(np.array([0.7, 1.0]))
    assert near < far


def test_a_nominal_value_is_the_share_of_the_normal_law() -> None:
    for sds in (1, 2):
        metric = METRICS[f"density_within_{sds}sd"]
        assert metric.nominal == round(math.erf(sds / math.sqrt(2)), 3)
        assert metric.higher_is_better is None
        np.testing.assert_allclose(metric.loss(metric.nominal + np.array([-0.25, 0.25])), 0.25)


def test_only_the_ratio_of_masses_and_overlaps_are_better_the_higher() -> None:
    plain = {name: one for name, one in METRICS.items() if one.nominal is None}
    higher = {name for name, one in plain.items() if one.higher_is_better}
    assert higher == {"mass_mnre", *IOU_METRICS}
    assert {METRICS[name].best for name in IOU_METRICS} == {100.0}
    assert {one.higher_is_better for one in plain.values()} == {True, False}


@pytest.mark.parametrize(
    ("name", "heading"),
    [
        ("density_mae_g_cm3", "density MAE, g/cm³ ↓"),
        ("com_l1_cm", "CoM L1, cm ↓"),
        ("com_l2_cm", "CoM L2, cm ↓"),
        ("mass_mape", "mass MAPE ↓"),
        ("mass_alde", "mass ALDE ↓"),
        ("mass_mnre", "mass MnRE ↑"),
        ("inertia_error", "inertia error ↓"),
        ("nonuniformity_error", "non-uniformity error ↓"),
        ("density_crps_g_cm3", "density CRPS, g/cm³ ↓"),
        ("density_within_1sd", "within 1 sd (→ 0.683)"),
        ("density_within_2sd", "within 2 sd (→ 0.954)"),
        ("iou_a", "IoU A, % ↑"),
    ],
)
def test_a_heading_gives_the_unit_and_which_way_is_better(name: str, heading: str) -> None:
    assert METRICS[name].heading == heading


def test_a_metric_is_an_error_unless_it_says_otherwise_and_cannot_be_changed() -> None:
    metric = Metric("errors")
    assert (metric.higher_is_better, metric.nominal) == (False, None)
    assert metric == Metric("errors")
    assert not hasattr(metric, "__dict__")
    with pytest.raises(dataclasses.FrozenInstanceError):
        metric.title = "other"


def test_voxels_of_single_precision_are_summed_in_double() -> None:
    guess, share = np.random.default_rng(3).random((2, 31, 30, 29), dtype=np.float32)
    expected = math.fsum((guess * share).flat) / math.fsum(share.flat)
    assert density_mae_g_cm3(0 * guess, guess, share) == pytest.approx(expected, rel=1e-12)
