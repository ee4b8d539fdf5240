"""Metrics against references written as loops, and against what must hold of any of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from xden_bench.metrics import METRICS, density_mae_g_cm3, integrate, score_object

SHAPE = (4, 5, 3)
ORIGIN = np.array([-1.0, 2.0, 30.0])
VOXEL = 0.5

grids = npst.arrays(np.float64, SHAPE, elements=st.floats(0, 20).map(lambda x: round(x, 3)))
shares = npst.arrays(np.float64, SHAPE, elements=st.sampled_from([0.0, 0.25, 0.5, 1.0]))


def loop_reference(truth: np.ndarray, guess: np.ndarray, envelope: np.ndarray) -> dict[str, float]:
    """The definitions, voxel by voxel."""
    error = weight = 0.0
    bodies: list[list[tuple[float, list[float]]]] = [[], []]
    hull: list[tuple[float, list[float]]] = []
    for index in np.ndindex(truth.shape):
        share = float(envelope[index])
        if share == 0:
            continue
        error += share * abs(float(guess[index]) - float(truth[index]))
        weight += share
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
        "com_l1_cm": sum(abs(step) for step in steps),
        "com_l2_cm": math.hypot(*steps),
        "mass_mape": abs(mass - true_mass) / true_mass,
        "mass_alde": min(abs(math.log(ratio)) if ratio else math.inf, math.log(1000)),
        "mass_mnre": min(ratio, 1 / ratio) if ratio else 0.0,
        "inertia_error": math.sqrt(sum((b - a) ** 2 for a, b in pairs))
        / math.sqrt(sum(a * a for a, _ in pairs)),
    }


@given(truth=grids, guess=grids, envelope=shares)
def test_metrics_agree_with_loops(
    truth: np.ndarray, guess: np.ndarray, envelope: np.ndarray
) -> None:
    truth[0, 0, 0], envelope[0, 0, 0] = 1.0, 1.0
    scores = score_object(truth, guess, envelope, ORIGIN, VOXEL)
    expected = loop_reference(truth, guess, envelope)
    assert scores.keys() == expected.keys() == METRICS.keys()
    for name, value in expected.items():
        assert scores[name] == pytest.approx(value, rel=1e-9, abs=1e-9), name


@given(truth=grids, envelope=shares)
def test_the_truth_scores_exactly_zero(truth: np.ndarray, envelope: np.ndarray) -> None:
    truth[0, 0, 0], envelope[0, 0, 0] = 1.0, 1.0
    scores = score_object(truth, truth.copy(), envelope, ORIGIN, VOXEL)
    assert scores.pop("mass_mnre") == 1.0
    assert set(scores.values()) == {0.0}


@given(truth=grids, scale=st.floats(0.01, 30))
def test_k_times_the_truth_is_wrong_by_k_minus_1(truth: np.ndarray, scale: float) -> None:
    truth[1, 1, 1] = 1.0
    scores = score_object(truth, scale * truth, np.ones(SHAPE), ORIGIN, VOXEL)
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
    scores = score_object(truth, guess, np.ones_like(truth), ORIGIN, VOXEL)
    assert scores["com_l1_cm"] == pytest.approx(VOXEL * sum(map(abs, shift)), abs=1e-12)
    assert scores["com_l2_cm"] == pytest.approx(VOXEL * math.hypot(*shift), abs=1e-12)
    assert scores["mass_mape"] == pytest.approx(0, abs=1e-12)
    assert scores["inertia_error"] == pytest.approx(0, abs=1e-12)


def test_every_metric_ignores_the_air_around() -> None:
    truth = np.zeros((6, 6, 6))
    truth[1:4, 1:4, 1:4] = 2.0
    envelope = (truth > 0).astype(float)
    guess = 0.9 * truth
    alone = score_object(truth, guess, envelope, ORIGIN, VOXEL)
    guess[5, 5, 5] = 100.0
    assert score_object(truth, guess, envelope, ORIGIN, VOXEL) == alone


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
    scores = score_object(truth, 0 * truth, np.ones((4, 4, 4)), ORIGIN, VOXEL)
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
        scores = score_object(truth, scale * truth, truth, ORIGIN, VOXEL, mass_ratio_limit=100.0)
        assert scores["mass_alde"] == pytest.approx(math.log(100))
