"""Closed forms, draws and statistics of manipulation agree with those by hand and in print."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from xden_bench.manip.closed_forms import (
    edge_margin_cm,
    push,
    slip_ratio,
    tipping_angle_deg,
    toppling_energy_j,
)
from xden_bench.manip.draws import Regime, draw_of, keyed_generator
from xden_bench.manip.statistics import decided, wilson_interval

POSITIVE = st.floats(0.01, 100)
HARD = Regime((0.2, 0.5), (10.0, 20.0))
SHAKE_RAD = (0.03, 0.05)


def test_a_grasp_at_the_centre_slips_when_the_weight_is_twice_the_friction_of_a_pad() -> None:
    mass_g = 2 * 0.5 * 10 / 9.81 * 1000
    assert slip_ratio(mass_g, 10, 0.5, lever_cm=0, patch_radius_cm=1) == pytest.approx(1)


def test_a_long_lever_slips_when_its_moment_is_that_of_two_patches() -> None:
    # 2 · 0.4 · 20 N on a radius of 1.5 cm: 0.24 N·m, which 0.1 kg has at 24.46 cm
    lever_cm = 100 * 0.24 / (0.1 * 9.81)
    force_share = 0.1 * 9.81 / 16
    assert slip_ratio(100, 20, 0.4, lever_cm, 1.5) == pytest.approx(math.hypot(1, force_share))


@given(POSITIVE, POSITIVE, POSITIVE)
def test_more_load_slips_sooner_and_a_larger_patch_later(lever: float, radius: float, more: float):
    one = slip_ratio(300, 15, 0.4, lever, radius)
    assert slip_ratio(300, 15, 0.4, lever + more, radius) > one
    assert slip_ratio(300, 15, 0.4, lever, radius + more) < one
    assert slip_ratio(600, 15, 0.4, lever, radius) == pytest.approx(2 * one)


def test_a_box_tips_where_its_diagonal_is_upright() -> None:
    assert tipping_angle_deg(3.0, math.sqrt(3)) == pytest.approx(30)


@given(POSITIVE, POSITIVE)
def test_toppling_costs_the_work_against_gravity_on_the_way_to_the_tipping_angle(height, distance):
    turned = np.radians(np.linspace(0, tipping_angle_deg(height, distance), 4001))
    moment_n_m = 9.81 * 1e-2 * (distance * np.cos(turned) - height * np.sin(turned))  # of 1 kg
    work_j = np.trapezoid(moment_n_m, turned)
    assert toppling_energy_j(1000, height, distance) == pytest.approx(work_j, rel=1e-4, abs=1e-9)


def test_an_object_stays_on_an_edge_as_far_as_its_centre_is_inside() -> None:
    assert edge_margin_cm(true_cm=-7.0, assumed_cm=-7.0, inside_cm=0.5) == 0.5
    assert edge_margin_cm(true_cm=-0.5, assumed_cm=-7.4, inside_cm=0.5) == pytest.approx(-6.4)


@pytest.mark.parametrize(
    ("force_n", "friction", "push_height_cm", "tips", "slides"),
    [
        (4.0, 0.5, 5.0, False, False),  # moment 0.20 N·m of 9.81 N · 3 cm = 0.294 N·m
        (4.0, 0.5, 8.0, True, False),  # 0.32 N·m
        (6.0, 0.5, 5.0, False, True),  # over 4.905 N of friction, borne 2.5 cm ahead
        (6.0, 0.5, 6.0, True, True),  # 3.1 cm ahead
        (2.0, 0.1, 0.0, False, True),  # 0.52 cm behind
    ],
)
def test_a_push_tips_and_slides_as_by_hand(force_n, friction, push_height_cm, tips, slides) -> None:
    found = push(1000, force_n, friction, (push_height_cm, 5.0), (3.0, 3.0))
    assert (found.tips, found.slides) == (tips, slides)


@given(POSITIVE, POSITIVE, st.floats(0.05, 1), POSITIVE)
def test_a_push_that_does_not_slide_is_borne_where_its_moment_says(force, height, friction, com):
    found = push(1000, force, friction, (height, com), (3.0, 3.0))
    if not found.slides:  # moments about a point on the table: that of the weight, and of the push
        assert found.normal_force_at_cm == pytest.approx(force * height / 9.81)


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    # Newcombe, 1998, doi:10.1002/(SICI)1097-0258(19980430)17:8<857::AID-SIM777>3.0.CO;2-E, table I
    [
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_wilson_intervals_are_the_published_ones(successes, trials, low, high) -> None:
    assert wilson_interval(successes, trials) == pytest.approx((low, high), abs=5e-5)


def test_the_sign_test_counts_objects_and_not_their_trials() -> None:
    differences = np.array([0.1] * 11 + [-0.6] * 6 + [0.0] * 5)
    found = decided(differences)
    assert (found.better, found.worse) == (11, 6)
    tail = sum(math.comb(17, k) for k in range(7)) / 2**17
    assert found.p_equal == pytest.approx(2 * tail)
    assert decided(0 * differences).p_equal == 1
    assert decided(np.repeat(1.0, 4)).p_equal == pytest.approx(0.125)


def test_a_draw_depends_on_its_key_alone() -> None:
    keys = [(1, one, "hard", place) for one in ("axe-1", "axe-2") for place in range(3)]
    forward = {key: draw_of(HARD, SHAKE_RAD, 300, 0.8, key) for key in keys}
    backward = {key: draw_of(HARD, SHAKE_RAD, 300, 0.8, key) for key in reversed(keys)}
    assert forward == backward
    assert len(set(forward.values())) == len(keys)


def test_names_that_join_to_the_same_letters_draw_apart() -> None:
    one, other = (keyed_generator("a", "bc").random(), keyed_generator("ab", "c").random())
    assert one != other


@given(st.integers(0, 1000))
def test_no_draw_is_lost_by_weight_alone(place: int) -> None:
    heavy_g = 1000 * 0.64 * HARD.most_friction_n / 9.81
    draw = draw_of(HARD, SHAKE_RAD, heavy_g, 0.8, (place,))
    assert heavy_g * 9.81e-3 <= 0.8 * 2 * draw.friction * draw.grip_force_n
    assert 0.2 <= draw.friction <= 0.5
    assert 10 <= draw.grip_force_n <= 20


def test_a_light_object_is_never_drawn_anew() -> None:
    assert draw_of(HARD, SHAKE_RAD, 10, 0.8, (1,)).redrawn == 0
