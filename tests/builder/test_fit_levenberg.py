"""Levenberg-Marquardt ends at the least loss between its bounds, as slower solvers find it."""

from functools import partial

import numpy as np
import pytest
import trimesh
from scipy.optimize import least_squares, lsq_linear, nnls

from tests.builder.fit_scenes import random_views, solid_views, with_noise
from xden_builder.fit import FitSettings, fit_lac
from xden_builder.fit.box import box_minimum
from xden_builder.fit.levenberg import minimise
from xden_builder.fit.problem import Evaluation, Problem
from xden_builder.fit.weighting import uniform

UNWEIGHTED = FitSettings(weights="none")


def _linear_problems(count):
    """Noisy equations with correlated columns of very different size, and where to start."""
    rng = np.random.default_rng(50)
    for _ in range(count):
        columns = int(rng.integers(2, 9))
        rows = columns + int(rng.integers(1, 30))
        alike = rng.normal(size=(rows, 1)) * rng.uniform(0, 2)
        matrix = rng.normal(size=(rows, columns)) * rng.uniform(0.05, 1) + alike
        matrix *= 10 ** rng.uniform(-2, 2, columns)
        truth = rng.uniform(0, 3, columns) * (rng.random(columns) < 0.6)
        measured = matrix @ truth + rng.normal(size=rows) * 10 ** rng.uniform(-3, 1)
        yield matrix, measured, np.maximum(rng.normal(size=columns), 0) * rng.integers(0, 2)


def _linear(matrix, measured, unknowns):
    residuals = matrix @ unknowns - measured
    return Evaluation(
        float(residuals @ residuals), matrix.T @ residuals, matrix.T @ matrix, transmissions=()
    )


@pytest.mark.parametrize("count", [200, pytest.param(2000, marks=pytest.mark.slow)])
def test_linear_problems_end_where_non_negative_least_squares_does(count):
    for matrix, measured, start in _linear_problems(count):
        bounds = np.zeros(len(start)), np.full(len(start), np.inf)
        found = minimise(partial(_linear, matrix, measured), start, *bounds, 50)
        least, rounding = nnls(matrix, measured)[1] ** 2, 1e-14 * (measured @ measured)
        assert found.evaluation.loss <= least * (1 + 1e-8) + rounding
        assert found.converged


@pytest.mark.parametrize("count", [100, pytest.param(300, marks=pytest.mark.slow)])
def test_both_bounds_hold_and_the_least_loss_between_them_is_found(count):
    for matrix, measured, start in _linear_problems(count):
        bounds = np.zeros(len(start)), np.ones(len(start))
        found = minimise(partial(_linear, matrix, measured), start, *bounds, 50)
        exact = lsq_linear(matrix, measured, bounds, method="bvls", tol=1e-12, max_iter=500)
        assert ((found.unknowns >= 0) & (found.unknowns <= 1)).all()
        assert found.evaluation.loss <= 2 * exact.cost * (1 + 1e-8)


def test_a_cut_step_is_solved_for_again():
    # the plain solution (2, -1) cut to (2, 0) has a larger value than standing still
    curvature, slope = np.array([[1.0, 0.9], [0.9, 1.0]]), np.array([-1.1, -0.8])
    low, high = np.array([0.0, 0.0]), np.array([9.0, 9.0])
    np.testing.assert_allclose(np.linalg.solve(curvature, -slope), [2.0, -1.0])
    np.testing.assert_allclose(box_minimum(curvature, slope, low, high), [1.1, 0.0])


def test_a_way_next_to_none_is_no_overflow():
    slope, bound = np.array([1e-309, -1.0]), np.ones(2)
    step = box_minimum(np.eye(2), slope, -2 * bound, 2 * bound)
    np.testing.assert_allclose(step, [0.0, 1.0], atol=1e-300)


def test_a_step_never_promises_a_rise():
    rng = np.random.default_rng(51)
    for size in rng.integers(1, 12, 500):
        half = rng.normal(size=(size, size))
        curvature = half @ half.T + 1e-9 * np.eye(size)
        slope = rng.normal(size=size)
        low, high = -rng.exponential(size=size), rng.exponential(size=size)
        low[rng.random(size) < 0.3] = 0.0
        step = box_minimum(curvature, slope, low, high)
        assert ((step >= low) & (step <= high)).all()
        assert step @ (2 * slope + curvature @ step) <= 0


def _shells(seed):
    """Three to six thin-walled shells, some empty, each drawn 3 % too large or too small."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 7))
    radii = np.cumsum(rng.uniform(0.1, 0.4, count)) + 0.3
    lac = rng.uniform(0.1, 4.0, count) * (rng.random(count) < 0.5)
    balls = [trimesh.creation.icosphere(2, radius) for radius in radii]
    drawn = [ball.copy().apply_scale(1 + rng.choice([-0.03, 0.03])) for ball in balls]
    truth, model = (solid_views(meshes, lac, size=40) for meshes in (balls, drawn))
    return [(lengths, view) for (lengths, _), (_, view) in zip(model, truth, strict=True)]


def _residuals(problem, unknowns):
    """All residuals, those of the air of each view as two of the same sum of squares."""
    parts, collected = problem.parts, []
    for view, gain in zip(problem.views, unknowns[parts:], strict=True):
        model = gain * view.lengths.transmission(unknowns[:parts])
        air = np.array([gain - view.air.mean, view.air.sd]) * np.sqrt(view.air.count)
        collected += [model - view.measured, air]
    return np.concatenate(collected)


@pytest.mark.parametrize(
    "seed", [*range(8), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(8, 40))]
)
def test_nested_shells_of_wrong_shape_end_at_the_least_loss(seed):
    views = _shells(seed)
    fit = fit_lac(views, UNWEIGHTED)
    problem = Problem.of(views, UNWEIGHTED, {})
    lower, upper = problem.bounds(UNWEIGHTED)
    start = np.append(np.full(problem.parts, 0.5), np.ones(len(views)))
    exact = least_squares(
        partial(_residuals, problem), start, bounds=(lower - 1e-12, upper), xtol=1e-12, ftol=1e-14
    )
    assert fit.report["converged"]
    assert fit.loss <= 2 * exact.cost * (1 + 1e-6)


def test_convergence_means_that_no_unknown_alone_would_lower_the_loss():
    rng = np.random.default_rng(52)
    for _ in range(50):
        lac = rng.uniform(0.1, 5.0, 4) * (rng.random(4) < 0.6)
        views = with_noise(random_views(rng, lac), rng, quanta=200.0)
        fit = fit_lac(views, UNWEIGHTED)
        problem = Problem.of(views, UNWEIGHTED, {})
        end = problem.evaluate(np.append(fit.lac_per_cm, fit.gain), uniform(problem.views))
        gains = end.gradient**2 / np.diag(end.hessian)
        inwards = (np.append(fit.lac_per_cm, fit.gain) > 0) | (end.gradient < 0)
        assert fit.report["converged"]
        assert (gains[inwards] <= 1e-10 * end.loss).all()
