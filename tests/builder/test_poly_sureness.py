"""How sure a pose is: what moves surfaces counts, what moves nothing does not."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from xden_builder.poly.sureness import Sureness, how_sure

BRICK = trimesh.creation.box((6.0, 2.0, 1.0))
PEN = trimesh.creation.cylinder(0.4, 14.0, sections=64)


def covariance(**sds: float) -> np.ndarray:
    """Of one unknown alone: a turn, a shift or a growth."""
    names = ("turn_x", "turn_y", "turn_z", "shift_x", "shift_y", "shift_z", "growth")
    return np.diag([sds.get(name, 0.0) ** 2 for name in names])


def test_a_turn_of_a_brick_counts_by_how_far_its_rim_moves() -> None:
    found = how_sure([BRICK], np.zeros(3), covariance(turn_x=0.01))
    share = np.hypot(2, 1) / np.linalg.norm([6, 2, 1])
    assert found.rim_deg == pytest.approx(np.degrees(0.01) * share, rel=0.05)
    assert found.shift_cm < 1e-3


def test_a_turn_of_a_pen_about_its_length_moves_nothing() -> None:
    along = how_sure([PEN], np.zeros(3), covariance(turn_z=0.5))
    across = how_sure([PEN], np.zeros(3), covariance(turn_x=0.01))
    assert along.rim_deg < 0.01
    assert across.rim_deg == pytest.approx(np.degrees(0.01), rel=0.02)


def test_a_turn_about_a_point_beside_a_brick_shifts_its_middle() -> None:
    beside = how_sure([BRICK], np.array([0.0, 5.0, 0.0]), covariance(turn_x=0.01))
    assert beside.shift_cm == pytest.approx(0.05, rel=0.02)
    grown = how_sure([BRICK], np.array([0.0, 5.0, 0.0]), covariance(growth=0.01))
    assert grown.shift_cm == pytest.approx(0.05, rel=0.02)


@pytest.mark.parametrize(
    ("rim_deg", "shift_cm", "uncertain"),
    [(0.055, 0.012, False), (0.065, 0.0, True), (0.0, 0.013, True)],
)
def test_a_pose_of_which_one_in_twenty_is_beyond_what_is_right_is_said(
    rim_deg: float, shift_cm: float, uncertain: bool
) -> None:
    assert Sureness(rim_deg, shift_cm).uncertain == uncertain
