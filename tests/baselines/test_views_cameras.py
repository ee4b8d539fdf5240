"""Cameras: projections computed by hand, and rings that show the whole object."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.baselines.painted import camera_at
from xden1k.errors import DataError
from xden_baselines.features.encoder import half_px
from xden_baselines.views.cameras import Camera, Rig, look_at

INTRINSICS = {"focal_px": (200.0, 100.0), "centre_px": (30.0, 20.0), "shape": (40, 60)}


def test_a_camera_looks_along_its_minus_z_with_y_up() -> None:
    """The pose of the identity, as transforms.json means it."""
    camera = Camera(np.eye(4), **INTRINSICS)
    points = np.array([[0, 0, -4], [1, 0, -4], [0, 1, -4], [0, 0, 4]], dtype=float)
    found = camera.project(points)
    # straight ahead; 200 * 1 / 4 to the right; 100 * 1 / 4 upwards, where rows are smaller
    np.testing.assert_allclose(found[:3], [[30, 20, 4], [80, 20, 4], [30, -5, 4]])
    assert np.isnan(found[3, :2]).all()
    assert found[3, 2] == -4


def test_the_object_z_axis_is_up_in_a_picture() -> None:
    camera = camera_at((10, 0, 0))
    # seen from +x, +y is to the right
    found = camera.project(np.array([[0, 0, 1.0], [0, 1.0, 0]]))
    np.testing.assert_allclose(found, [[64, 38, 10], [74, 48, 10]])


def test_pixel_00_has_its_centre_half_a_pixel_from_the_corner() -> None:
    camera = Camera(np.eye(4), **INTRINSICS)
    ray = camera.rays()[0, 0]
    expected = np.array([(0.5 - 30) / 200, -(0.5 - 20) / 100, -1])
    np.testing.assert_allclose(ray, expected / np.linalg.norm(expected))


@given(
    position=st.tuples(*[st.floats(-50, 50)] * 3),
    pixel=st.tuples(st.integers(0, 95), st.integers(0, 127)),
    distance=st.floats(0.1, 100),
)
def test_a_point_on_a_pixels_ray_projects_to_its_centre(
    position: tuple[float, float, float], pixel: tuple[int, int], distance: float
) -> None:
    target = np.add(position, [3.0, -4.0, 1.0])
    camera = camera_at(position, target)
    point = camera.position_cm + distance * camera.rays()[pixel]
    column, row, depth = camera.project(point[None])[0]
    assert (row, column) == pytest.approx((pixel[0] + 0.5, pixel[1] + 0.5), abs=1e-6)
    assert depth == pytest.approx(distance * camera.depth_per_distance()[pixel], rel=1e-9)


def test_depth_is_shorter_than_distance_off_the_axis() -> None:
    ratio = camera_at((0, 9, 0)).depth_per_distance()
    # the ray of the corner leaves at 63.5 px across and 47.5 px down of 100 px ahead
    assert ratio[0, 0] == pytest.approx(1 / np.sqrt(1 + 0.635**2 + 0.475**2))
    assert ratio.max() <= 1


@pytest.mark.parametrize(
    ("pose", "focal"),
    [
        (np.diag([1.0, 1, -1, 1]), 1.0),
        (np.diag([2.0, 2, 2, 1]), 1.0),
        (np.full((4, 4), np.nan), 1.0),
        (np.eye(4), 0.0),
    ],
)
def test_a_camera_that_is_none_is_refused(pose: np.ndarray, focal: float) -> None:
    with pytest.raises(DataError, match="must be"):
        Camera(pose, focal_px=(focal, 1.0), centre_px=(0.0, 0.0), shape=(2, 2))


def test_looking_straight_down_is_refused() -> None:
    with pytest.raises(DataError, match="would look along z"):
        look_at(np.array([0, 0, 5.0]), np.zeros(3))


@given(
    size=st.floats(0.1, 100),
    shift=st.tuples(*[st.floats(-100, 100)] * 3),
    shape=st.tuples(*[st.floats(0.05, 1)] * 3),
)
def test_every_view_of_a_rig_holds_every_patch(
    size: float, shift: tuple[float, float, float], shape: tuple[float, float, float]
) -> None:
    corners = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T
    points = np.array(shift) + size * np.array(shape) * corners
    rig = Rig()
    cameras = rig.cameras(points)
    assert len(cameras) == 12
    half = half_px(cameras[0].shape)
    for camera in cameras:
        place = camera.project(points)
        assert (place[:, :2] >= half).all()
        assert (place[:, :2] <= rig.size_px - half).all()


def test_a_bounding_sphere_fills_the_share_of_the_picture_it_should() -> None:
    rig = Rig(elevations_deg=(0.0,), per_ring=1, fill=0.5)
    (camera,) = rig.cameras(np.array([[-1.0, 0, 0], [1.0, 0, 0], [0, 1, 0], [0, -1, 0]]))
    # the ray that touches a unit sphere from 3 away leaves at asin(1 / 3)
    touch = np.tan(np.arcsin(1 / 3)) * camera.focal_px[0]
    assert 2 * touch == pytest.approx(0.5 * rig.size_px)
