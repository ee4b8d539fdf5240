"""A pose that a person told coarsely: the search stays around it."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from xden_builder.capture.pose import CoarsePose
from xden_builder.capture.space import Space
from xden_builder.registration.body import Body
from xden_builder.registration.coarse_pose import (
    FAR_RAD,
    NEAR_RAD,
    around_told,
    told_one,
    told_rotations,
)
from xden_builder.registration.placement import Found, RigidPlacement

TOLD = Rotation.from_rotvec([0.4, -0.3, 1.0])
POSE = CoarsePose(tuple(TOLD.as_quat().tolist()), (0.0, 0.0, 0.0))


def turned(degrees: float) -> Found:
    """A pose turned from the told one."""
    rotation = Rotation.from_rotvec([0, np.radians(degrees), 0]) * TOLD
    placement = RigidPlacement(rotation.as_matrix(), np.zeros(3), 1.0)
    return Found(placement, 1.0, np.ones(1), 1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("off_deg", "kept"),
    [((180, 20, 90, 5), (20, 5)), ((180, 120), (180, 120)), ((), ())],
)
def test_poses_far_from_the_told_one_are_left_out_where_there_is_a_near_one(off_deg, kept) -> None:
    found = [turned(each) for each in off_deg]
    assert around_told(POSE, found) == [found[off_deg.index(each)] for each in kept]


def test_nothing_is_left_out_where_no_pose_is_told() -> None:
    found = [turned(180), turned(0)]
    assert around_told("unknown", found) == found
    assert told_rotations("unknown") is None


def test_the_search_begins_well_within_what_it_may_come_back_with() -> None:
    begun = told_rotations(POSE)
    assert begun is not None
    off_rad = (begun * TOLD.inv()).magnitude()
    assert off_rad.max() == pytest.approx(NEAR_RAD, rel=0.01)
    assert NEAR_RAD < FAR_RAD < np.radians(60)  # a nut's next like pose


@pytest.mark.parametrize(
    ("off_deg", "one"), [((1.5, 0.0, 3.0), 1), ((0.1, 1.5), 0), ((3.0, 5.0), None)]
)
def test_the_pose_of_another_candidate_is_that_candidate_and_not_the_best_around_it(
    off_deg: tuple[float, ...], one: int | None
) -> None:
    body = Body.of(Space.of([trimesh.creation.box((1, 2, 3))], [0]), np.ones(1))
    found = [turned(each) for each in off_deg]
    assert told_one(POSE, found, body) == one
    assert told_one("unknown", found, body) is None
