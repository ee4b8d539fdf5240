"""An image slides as its gradient says, and by all unknowns of a pose it changes as told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tests.builder.fit_scenes import FLAT
from tests.builder.poly_scenes import TUBE, box, composition, cylinder, geometries
from xden1k.values.views import XRayView
from xden_builder.physics.groups import energy_groups
from xden_builder.physics.source import Detector
from xden_builder.poly.model.beam import Heel, ViewBeam
from xden_builder.poly.model.frames import Pose
from xden_builder.poly.model.motion import Gradient, turning
from xden_builder.poly.model.poses import RIGID, Poses
from xden_builder.poly.pyramid import Level
from xden_builder.poly.target import Target

SIZE = 48
STEP_CM = 0.03
"""Of differences: rays stand 0.05 cm apart on the panel."""
PARALLEL = replace(
    FLAT,
    pixel00_cm=np.array([-2.35, -4.0, 2.35]),
    column_step_cm=np.array([0.1, 0.0, 0.0]),
    row_step_cm=np.array([0.0, 0.0, -0.1]),
    shape=(SIZE, SIZE),
)
CONE = geometries(size=SIZE, width_cm=4.7)["lat"]
VECTOR = np.array([0.2, -0.1, 0.15, 0.1, 0.15, -0.1])


def level(geometry, size_sd: float) -> Level:
    """A block beside a rod, the second view of two that share a pose."""
    every, groups = np.ones(geometry.shape, dtype=bool), energy_groups(TUBE, Detector("CsI"), 4)
    view = XRayView("lat", np.ones(geometry.shape, dtype=np.float32), every, geometry)
    target = Target(
        [view] * 2,
        [~every] * 2,
        [(1.0, 0.05)] * 2,
        [ViewBeam(groups, geometry, Heel())] * 2,
        [box((1.1, 1.5, 1.3)), cylinder(0.4, 1.9, (1.2, 0.9, 0.2))],
        np.tile(groups.mac_cm2_g(composition("pp")), (2, 1)),
    )
    poses = Poses((False, False), Pose(centre_cm=(0.3, -0.2, 0.1)), size_sd)
    return Level.of(target, poses, [(slice(None), slice(None))] * 2, 1)


@pytest.mark.parametrize("geometry", [CONE, PARALLEL], ids=["cone", "parallel"])
@pytest.mark.parametrize("size_sd", [0.0, 0.01])
@pytest.mark.parametrize(
    "by", [{}, {"forward": True}, {"slope_subrays": [4, 4]}], ids=["central", "forward", "few rays"]
)
def test_slopes_by_all_unknowns_are_differences_of_whole_images(geometry, size_sd, by):
    found = replace(level(geometry, size_sd), **by)
    poses = found.poses
    own = np.zeros(poses.count - RIGID)
    own[0] = 0.1  # by which the panel is displaced along its rows
    start = found.target.start(np.array([0.9, 1.1]), np.concatenate([VECTOR, own]))
    slopes = found.residuals_and_slopes(start)[1][1]
    first = len(start) - poses.count
    lengths_cm = np.ones(poses.count)
    lengths_cm[[*range(RIGID // 2), *poses.size_places]] = found.target.radius_cm
    most = STEP_CM * np.linalg.norm(slopes[:, first:] / lengths_cm, axis=0).max()
    for place in poses.places(1) + poses.size_places:
        step = np.zeros(len(start))
        step[first + place] = STEP_CM / lengths_cm[place]
        ahead, behind = (found.residuals(start + sign * step)[1] for sign in (1, -1))
        told = slopes @ step
        off = np.linalg.norm((ahead - behind) / 2 - told)
        assert off < 0.25 * np.linalg.norm(told) + 0.02 * most, place


@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 2, 3]))
def test_the_gradient_of_an_even_slope_is_that_slope_wherever_it_goes_on(seed, side):
    """Beside the pixels that are told the image is 1, but not beyond the edge of the panel."""
    by_row, by_column = np.random.default_rng(seed).uniform(-1, 1, 2)
    shape = (5, 7)
    ticks = [(np.arange(size * side) + 0.5) / side - 0.5 for size in shape]
    fine = by_row * ticks[0][:, None] + by_column * ticks[1]
    rays = fine.reshape(shape[0], side, shape[1], side).transpose(0, 2, 1, 3).reshape(-1, side**2)
    found = Gradient.of(np.arange(rays.shape[0]), rays, shape)
    np.testing.assert_allclose(found.by_row, by_row, atol=1e-9)
    np.testing.assert_allclose(found.by_column, by_column, atol=1e-9)
    assert len(found.rows) == rays.shape[0]


def test_nothing_has_no_gradient():
    assert not len(Gradient.of(np.zeros(0, dtype=np.int64), np.zeros((0, 4)), (5, 7)).rows)


@given(st.lists(st.floats(-2, 2), min_size=3, max_size=3).map(np.array))
def test_a_change_of_a_rotation_vector_turns_as_the_jacobian_says(rotation_rad):
    turned = Rotation.from_rotvec(rotation_rad)
    for axis, turn in zip(np.eye(3), turning(rotation_rad).T, strict=True):
        changed = Rotation.from_rotvec(rotation_rad + 1e-5 * axis) * turned.inv()
        np.testing.assert_allclose(changed.as_rotvec() / 1e-5, turn, atol=1e-4)


def test_path_lengths_that_are_kept_are_of_the_pose_and_of_the_rays_asked_for() -> None:
    shared = level(CONE, 0.0)
    poses = [np.zeros(shared.poses.count), np.full(shared.poses.count, 0.05)]
    starts = [shared.target.start(np.ones(2), pose) for pose in poses]
    meshes = [mesh.copy().apply_scale(1.1) for mesh in shared.target.regions]
    larger = replace(shared.target, regions=meshes)
    others = [{}, {"turned": False}, {"subrays": [3, 3]}, {"target": larger}, {"weighs": True}]
    for start in [*starts, *starts]:
        for by in others:
            anew = replace(shared, latest={}, **by).images(start)
            for kept, image in zip(replace(shared, **by).images(start), anew, strict=True):
                np.testing.assert_array_equal(kept, image)
    lengths = replace(shared, weighs=True).latest
    assert lengths is shared.latest
    assert 0 < len(lengths) <= 4
