"""Objects that stand tip, stay at an edge and slide in simulation as statics says they must."""

from __future__ import annotations

from dataclasses import replace
from math import atan2, degrees

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from xden1k.values.arrays import Vec3
from xden1k.values.mass import mass_of_meshes
from xden_bench.manip.mechanics import push_trials, tilt_deg
from xden_bench.manip.mechanics_protocol import load_mechanics_protocol
from xden_bench.manip.pose import Pose
from xden_bench.manip.protocol import load_manip_protocol
from xden_bench.manip.standing import Standing, standing_of, stays_at_edge, tipping_tilt_deg
from xden_bench.manip.support import Support, support_of

CONTACT = load_manip_protocol().solver
RULES = load_mechanics_protocol()
CORNERS = np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]])
SQUARE = Support(CORNERS, (CORNERS,))
INSIDE = st.tuples(st.floats(0.1, 3.9), st.floats(0.1, 3.9)).map(np.array)


def standing(size_cm: tuple[float, float, float], com_cm: tuple[float, float, float]) -> Standing:
    """A box of 1 g/cm³, its centre of mass moved away from its middle."""
    box = trimesh.creation.box(size_cm)
    mass = replace(mass_of_meshes([box], [1.0]), com_cm=np.array(com_cm))
    found = standing_of([box], mass, upright(size_cm[2]), CONTACT, RULES)
    assert found is not None
    return found


def upright(height_cm: float) -> Pose:
    return Pose(np.eye(3), np.array([0, 0, height_cm / 2]))


@given(INSIDE, st.floats(0, 6.28))
def test_a_step_as_long_as_the_reach_ends_on_the_rim(point: Vec3, azimuth: float) -> None:
    direction = np.array([np.cos(azimuth), np.sin(azimuth)])
    end = point + SQUARE.reach_cm(point, direction) * direction
    assert SQUARE.margin_cm(end) == pytest.approx(0, abs=1e-9)


@given(INSIDE)
def test_the_nearest_edge_is_as_far_as_the_margin(point: Vec3) -> None:
    reach = SQUARE.reach_cm(point, SQUARE.nearest_normal(point))
    assert reach == pytest.approx(SQUARE.margin_cm(point))


@given(st.floats(0.01, 3.99))
def test_what_is_left_behind_an_edge_has_its_share_of_the_area(at_cm: float) -> None:
    left = SQUARE.clipped(np.array([1.0, 0]), at_cm)
    assert left is not None
    x, y = left.corners_cm.T
    area = (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    assert area == pytest.approx(4 * at_cm)
    assert left.margin_cm(np.array([at_cm / 2, 2])) == pytest.approx(min(at_cm / 2, 2))


def test_four_legs_of_which_two_are_over_the_edge_leave_no_support() -> None:
    table = Support(CORNERS, tuple(corner[None] for corner in CORNERS))
    assert table.clipped(np.array([1.0, 0]), 3.9) is None
    assert table.clipped(np.array([1.0, 0]), 4.1) is not None


@given(INSIDE, st.floats(0.01, 0.09))
def test_an_edge_may_be_just_beyond_a_centre_on_a_flat_base(point: Vec3, inside_cm: float) -> None:
    normal = np.array([0.0, 1.0])
    edge_cm = SQUARE.edge_cm(point, normal, inside_cm)
    assert edge_cm == pytest.approx(point[1] + inside_cm, abs=0.002)
    assert SQUARE.edge_cm(point, normal, 4.1) is None


def test_an_edge_must_be_beyond_the_legs_that_are_needed() -> None:
    table = Support(CORNERS, tuple(corner[None] for corner in CORNERS))
    edge_cm = table.edge_cm(np.array([2.0, 1.0]), np.array([0.0, 1.0]), 0.5)
    assert edge_cm == pytest.approx(4, abs=0.002)


def test_nothing_is_left_where_all_is_over_the_edge() -> None:
    assert SQUARE.clipped(np.array([1.0, 0]), -0.1) is None


def test_a_ball_and_a_blade_on_edge_do_not_stand() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=3)
    mass = mass_of_meshes([ball], [1.0])
    assert standing_of([ball], mass, upright(6), CONTACT, RULES) is None
    blade = trimesh.Trimesh([[0, 0, 0], [9, 0, 0], [0, 0, 5]], [[0, 1, 2]], process=False)
    assert support_of([blade], Pose(np.eye(3), np.zeros(3)), 0.05) is None


BOXES = [
    ((4.0, 6.0, 8.0), (0.0, 0.0, 0.0)),
    ((10.0, 3.0, 3.0), (3.0, 0.2, 0.0)),
    ((3.0, 3.0, 12.0), (0.3, 0.0, 4.0)),
    ((8.0, 8.0, 2.0), (1.0, 2.0, 0.0)),
]


def test_the_closed_form_of_a_box_is_by_its_edges() -> None:
    one = standing(*BOXES[3])  # 2 cm from the edge at y = 4, 1 cm high
    assert tilt_deg(one, one.com_cm) == pytest.approx(degrees(atan2(2, 1)))


@pytest.mark.parametrize(("size_cm", "com_cm"), BOXES)
def test_a_box_tips_within_a_degree_of_the_closed_form(size_cm, com_cm) -> None:
    one = standing(size_cm, com_cm)
    simulated_deg = tipping_tilt_deg(one, RULES.tilt)
    assert simulated_deg == pytest.approx(tilt_deg(one, one.com_cm), abs=1)


@pytest.mark.parametrize(("inside_cm", "stays"), [(0.5, True), (-0.5, False)])
def test_a_box_stays_at_an_edge_if_its_centre_is_on_the_table(inside_cm, stays) -> None:
    one, normal = standing(*BOXES[1]), np.array([0.6, 0.8])
    edge_cm = float(one.com_cm[:2] @ normal) + inside_cm
    assert stays_at_edge(one, normal, edge_cm, RULES.edge) is stays


@pytest.mark.slow
@pytest.mark.parametrize(("size_cm", "com_cm"), BOXES)
def test_a_pushed_box_tips_where_the_table_would_have_to_bear_it_beside_it(size_cm, com_cm) -> None:
    more = replace(RULES, push=replace(RULES.push, draws=24))
    trials = list(push_trials(standing(size_cm, com_cm), more, "box"))
    clear = [one for one in trials if not one.is_near(RULES.push.band)]
    assert len(clear) > 16
    assert [one for one in clear if not one.agrees] == []
