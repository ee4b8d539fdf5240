"""The posterior: derivatives, a scale's word, and unknowns that are switched off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.builder.poly_scenes import captured, solved, tool, true_mass_g
from xden_builder.capture import Capture
from xden_builder.capture.space import divide
from xden_builder.poly.estimate import Solution
from xden_builder.poly.judgement import PolyFit, judge
from xden_builder.poly.posterior.problem import NUISANCES, Mass, solve
from xden_builder.poly.settings import PolySettings

SIZE = 64


@pytest.fixture(scope="module")
def capture() -> Capture:
    """A small object."""
    return captured(tool(), size=SIZE)


@pytest.fixture(scope="module")
def solution(capture) -> Solution:
    """What the fit finds where its place is known."""
    return solved(capture, pose=False)


def ended_at(solution: Solution, place: int, value: float) -> PolyFit:
    """Judge a solution one of whose unknowns is another."""
    unknowns = solution.minimum.unknowns.copy()
    unknowns[place] = value
    there = solution.problem.evaluate(unknowns)
    return judge(
        replace(solution, minimum=replace(solution.minimum, unknowns=unknowns, evaluation=there))
    )


@pytest.mark.parametrize("end", ["low", "high"])
def test_a_density_at_the_end_of_its_range_is_flagged_and_no_other(solution, end):
    for part in (1, 2):
        fit = ended_at(solution, part, getattr(solution.problem.prior, end)[part])
        flagged = ["at_bound" in each.flags for each in fit.parts]
        assert flagged == [number == part for number in range(3)]
        assert fit.views_at_bound == ()


def test_an_end_of_a_range_that_holds_nothing_off_needs_nobody(solution):
    stand_ins = solution.problem.stand_ins
    high = stand_ins.high_g_cm3.copy()
    high[2] = solution.density_g_cm3[2]
    problem = replace(solution.problem, stand_ins=replace(stand_ins, high_g_cm3=high))
    fit = judge(replace(solution, problem=problem))
    assert [set(each.flags) & {"at_bound", "at_range_end"} for each in fit.parts] == [
        set(),
        set(),
        {"at_range_end"},
    ]


def test_what_is_lighter_than_its_material_can_be_is_porous(solution):
    blade, level = 0, 2
    assert not any("porous" in part.flags for part in judge(solution).parts)
    for light in (blade, level):
        fit = ended_at(solution, light, 0.5 * solution.density_g_cm3[light])
        assert ["porous" in part.flags for part in fit.parts] == [
            number == light for number in range(3)
        ]


def test_a_gain_or_stray_light_at_the_end_of_its_range_is_told_by_its_view(solution):
    prior, lat = solution.problem.prior, solution.problem.nuisances(1)
    for place in range(lat.start, lat.stop):
        assert ended_at(solution, place, prior.high[place]).views_at_bound == ("lat",)
    assert ended_at(solution, lat.start, prior.low[lat.start]).views_at_bound == ("lat",)


def test_no_stray_light_at_all_is_no_bound(solution):
    lat = solution.problem.nuisances(1)
    for place in range(NUISANCES - 1):
        assert ended_at(solution, lat.stop - 1 - place, 0.0).views_at_bound == ()
    without = solved(captured(tool(), size=SIZE), pose=False, stray=False)
    assert judge(without).views_at_bound == ()


def between_bounds(solution: Solution, rng: np.random.Generator) -> np.ndarray:
    """Some unknowns, none at a bound."""
    prior = solution.problem.prior
    drawn = rng.normal(solution.minimum.unknowns, 0.3 * prior.sd)
    return np.asarray(drawn.clip(prior.low + 1e-3, prior.high - 1e-3))


@settings(max_examples=5)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_gradient_is_the_derivative_of_the_loss(solution, seed, weighed):
    problem = solution.problem
    if weighed:
        problem = replace(problem, mass=Mass(60.0, np.array([1.2, 36.0, 7.6])))
    point = between_bounds(solution, np.random.default_rng(seed))
    gradient = problem.evaluate(point).gradient
    for index, axis in enumerate(np.eye(len(point)) * 1e-6):
        slope = (problem.evaluate(point + axis).loss - problem.evaluate(point - axis).loss) / 2e-6
        assert 2 * gradient[index] == pytest.approx(slope, rel=1e-3, abs=1e-3), index


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_curvature_is_positive_everywhere(solution, seed):
    point = between_bounds(solution, np.random.default_rng(seed))
    hessian = solution.problem.evaluate(point).hessian
    np.testing.assert_allclose(hessian, hessian.T)
    scale = np.sqrt(hessian.diagonal())
    assert np.linalg.eigvalsh(hessian / np.outer(scale, scale)).min() > 1e-6


def test_there_is_one_density_a_part_four_unknowns_a_view_one_a_batch_and_two_widths(solution):
    problem, count = solution.problem, 3 + 2 * NUISANCES + 3 + 2
    assert len(solution.minimum.unknowns) == count
    assert problem.parts == 3
    views = np.r_[problem.nuisances(0), problem.nuisances(1)]
    shared = (*range(count)[problem.off], *range(count)[problem.widths])
    assert [*range(3), *views, *shared] == list(range(count))


def test_the_solution_is_a_minimum_within_bounds(solution):
    problem, found = solution.problem, solution.minimum
    assert found.converged
    free = (found.unknowns > problem.prior.low) & (found.unknowns < problem.prior.high)
    pull = found.evaluation.gradient / np.sqrt(found.evaluation.hessian.diagonal())
    assert np.abs(pull[free]).max() < 1e-3
    assert (found.evaluation.gradient[found.unknowns <= problem.prior.low] >= 0).all()


def test_images_of_the_model_itself_give_its_unknowns_back(solution):
    problem = solution.problem
    lights, widths = [1.03, 0.06, 0.05, 0.03, 0.97, 0.09, 0.02, 0.03], [0.2, -0.2]
    truth = np.array([7.85, 0.905, 1.0, *lights, 0, 0, 0, *widths])
    views = [
        replace(view, measured=problem.image(truth, number)[0])
        for number, view in enumerate(problem.views)
    ]
    found = solve(replace(problem, views=views), problem.prior.mean).unknowns
    assert found[:3] == pytest.approx(truth[:3], rel=0.006)  # what is expected of steel
    assert found[[3, 7]] == pytest.approx(truth[[3, 7]], rel=0.002)
    for number, strays in enumerate(problem.strays):  # near and far scatter are alike
        amplitudes = slice(4 + 4 * number, 7 + 4 * number)
        veils = [strays.at(each[problem.widths]) @ each[amplitudes] for each in (found, truth)]
        assert np.abs(veils[0] - veils[1]).max() < PolySettings().floor


@pytest.mark.parametrize(
    "factor", [0.97, *(pytest.param(one, marks=pytest.mark.slow) for one in (1.0, 1.04))]
)
def test_a_weighed_mass_pulls_the_mass_as_far_as_images_and_materials_bear(
    capture, solution, factor
):
    weighed_g, volumes_cm3 = factor * true_mass_g(tool()), divide(capture.parts).volumes_cm3
    weighed = solved(replace(capture, weighed_mass_g=weighed_g), pose=False)
    free, pulled = (float(volumes_cm3 @ each.density_g_cm3) for each in (solution, weighed))
    assert abs(pulled - weighed_g) < max(0.75 * abs(free - weighed_g), 0.005 * weighed_g)


@pytest.fixture(scope="module")
def exposed() -> Capture:
    """The object, one view of it taken too long and one too short."""
    return captured(tool(), size=SIZE, exposures=(1.06, 0.95))


@pytest.mark.parametrize(
    ("gain", "stray"),
    [
        (False, True),
        *(pytest.param(*one, marks=pytest.mark.slow) for one in ((True, False), (False, False))),
    ],
)
def test_what_is_not_modelled_stays_where_it_is(exposed, gain, stray):
    found = solved(exposed, pose=False, gain=gain, stray=stray)
    for number in (0, 1):
        seen_gain, *amplitudes = found.nuisances(number)
        assert (abs(seen_gain - 1) < 1e-4) == (not gain)
        assert (np.abs(amplitudes).max() < 1e-5) == (not stray)


def test_settings_switch_the_pose_off():
    assert solved(captured(tool(), size=32), pose=False).samples.pose is None


def test_prior_of_a_view_allows_for_several_percent_of_exposure(exposed):
    (gain, sd), prior = (1.0, 0.05), PolySettings()
    assert prior.gain
    found = solved(exposed, pose=False)
    assert found.problem.prior.mean[3] == gain
    assert found.problem.prior.sd[3] == sd
    assert [found.nuisances(number)[0] for number in (0, 1)] == pytest.approx(
        [1.06, 0.95], abs=0.005
    )
