"""Grasps are where geometry says they are, whoever's rows they come from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from xden1k.errors import DataError
from xden_bench.manip.clearance import above_table, clear_of_object
from xden_bench.manip.draws import keyed_generator
from xden_bench.manip.graspnet import CAMERA, ROWS, graspnet_rows, read_graspnet
from xden_bench.manip.grasps import Grasps, nearest
from xden_bench.manip.pose import Pose
from xden_bench.manip.protocol import load_manip_protocol
from xden_bench.manip.sampler import antipodal_grasps

RULES = load_manip_protocol()
DOWN = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
"""Tool frame that looks straight down and closes along y."""


def on_table(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    return mesh.apply_translation([0, 0, -mesh.bounds[0, 2]])


def box(*extents: float) -> trimesh.Trimesh:
    return on_table(trimesh.creation.box(extents))


def sampled(mesh: trimesh.Trimesh, **changed: float) -> Grasps:
    rules = replace(RULES.grasps, surface_points=500, collision_points=1000, **changed)
    return antipodal_grasps(mesh, rules, RULES.gripper, keyed_generator("test"))


def looking_down(*centres_cm: tuple[float, float, float], width_cm: float = 2.0) -> Grasps:
    count = len(centres_cm)
    return Grasps(
        np.ones(count),
        np.full(count, width_cm),
        np.tile(DOWN, (count, 1, 1)),
        np.array(centres_cm, dtype=np.float64),
    )


def test_both_contacts_lie_on_opposite_sides_of_a_box() -> None:
    found = sampled(box(20, 3, 4))
    assert len(found) > 20
    np.testing.assert_allclose(
        np.sort(found.tips_cm[:, :, 1], axis=0).T, [[-1.5, 1.5]] * len(found), atol=1e-4
    )
    assert np.abs(found.centre_cm[:, 0]).max() < 10
    assert (found.width_cm < 3 / np.cos(np.arctan(0.4)) + 1e-6).all()


def test_the_frame_of_a_grasp_is_right_handed_closes_across_and_comes_from_above() -> None:
    found = sampled(box(20, 3, 4))
    np.testing.assert_allclose(np.linalg.det(found.rotation), 1)
    np.testing.assert_allclose(
        np.cross(found.closing, found.approach), found.rotation[:, :, 0], atol=1e-12
    )
    assert (found.approach[:, 2] <= -np.cos(np.radians(30)) + 1e-9).all()


def test_a_rod_is_grasped_through_its_axis() -> None:
    rod = trimesh.creation.cylinder(radius=1.5, height=20, sections=64)
    found = sampled(
        on_table(rod.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0])))
    )
    assert len(found) > 20
    # a chord within the cone of friction passes the axis by no more than r sin(arctan μ)
    away = np.linalg.norm((found.centre_cm - [0, 0, 1.5])[:, 1:], axis=1)
    assert away.max() < 1.5 * np.sin(np.arctan(0.4)) + 0.01


def test_what_is_wider_than_the_gripper_has_no_grasp() -> None:
    assert len(sampled(box(20, 8, 8))) == 0


def test_a_score_is_the_cosine_with_which_the_pads_meet_the_surface() -> None:
    found = sampled(box(20, 3, 4))
    np.testing.assert_allclose(found.score, np.abs(found.closing[:, 1]), atol=1e-6)


def test_the_same_draw_samples_the_same_candidates() -> None:
    one, other = sampled(box(20, 3, 4)), sampled(box(20, 3, 4))
    np.testing.assert_array_equal(one.rotation, other.rotation)


@pytest.mark.parametrize(("height_cm", "free"), [(1.34, False), (1.36, True)])
def test_fingertips_stay_half_a_centimetre_above_the_table(height_cm: float, free: bool) -> None:
    grasp = looking_down((0, 0, height_cm))
    assert above_table(grasp, RULES.grasps, RULES.gripper).tolist() == [free]


@pytest.mark.parametrize(
    ("point_cm", "clear"),
    [
        ((0, 1.39, 3), True),  # between pad and contact
        ((0, 1.41, 3), False),  # in a finger: from 1 + 0.4 to 1.5 further
        ((0, -2.89, 3), False),
        ((0, 2.91, 3), True),
        ((1.06, 2, 3), True),  # beside it
        ((0, 2, 2.14), True),  # below it: 0.85 under the origin
        ((0, 8, 7.46), False),  # in the palm, 4.45 above it
        ((0, 10.3, 7.46), True),
    ],
)
def test_a_point_of_the_object_is_in_the_gripper_or_beside_it(point_cm, clear) -> None:
    between = np.tile([0, 0, 3.0], (8, 1))
    points = np.vstack([between, point_cm])
    grasp = looking_down((0, 0, 3))
    assert clear_of_object(grasp, points, RULES.grasps, RULES.gripper).tolist() == [clear]


def test_a_grasp_of_nearly_nothing_is_none() -> None:
    points = np.tile([0, 0, 3.0], (7, 1))
    assert not clear_of_object(looking_down((0, 0, 3)), points, RULES.grasps, RULES.gripper).any()


def test_the_nearest_grasp_is_by_its_contacts_then_by_score_then_the_first() -> None:
    grasps = looking_down((4, 0, 2), (-1, 0, 2), (1, 0, 2), (1, 0, 2))
    assert nearest(grasps, np.array([3.0, 0, 2])) == 0
    assert nearest(grasps, np.array([0.9, 0, 2])) == 2
    scored = replace(grasps, score=np.array([1.0, 1, 1, 2]))
    assert nearest(scored, np.array([0.9, 0, 2])) == 3


POSES = st.builds(
    lambda turn, shift: Pose(Rotation.from_rotvec(turn).as_matrix(), np.array(shift)),
    st.tuples(*[st.floats(-2, 2)] * 3),
    st.tuples(*[st.floats(-50, 50)] * 3),
)


def matrix(pose: Pose) -> np.ndarray:
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = pose.rotation, 0.01 * pose.origin_cm
    return made


@given(POSES, POSES, st.floats(0, 4))
def test_rows_of_graspnet_lead_there_and_back(tmp_path_factory, place, camera, depth_cm) -> None:
    grasps = looking_down((0, 0, 3), (1, 2, 3), width_cm=3.0).moved(place)
    surface = box(20, 20, 20)
    surface.vertices = place.to_world(np.asarray(surface.vertices))
    path = tmp_path_factory.mktemp("rows") / "grasps.npz"
    rows = graspnet_rows(grasps, matrix(camera), depth_cm)
    np.savez(path, **{ROWS: rows, CAMERA: matrix(camera)})
    for name, values in read_graspnet(path, surface).arrays.items():
        np.testing.assert_allclose(values, grasps.arrays[name], atol=1e-9, err_msg=name)


def test_tips_of_a_row_are_where_graspnet_puts_them() -> None:
    grasps = looking_down((1, 2, 3), width_cm=3.0)
    (row,) = graspnet_rows(grasps, np.eye(4), 2.0)
    tips = [
        row[13:16] + row[4:13].reshape(3, 3) @ [row[3], side * row[1] / 2, 0] for side in (-1, 1)
    ]
    np.testing.assert_allclose(tips, 0.01 * grasps.tips_cm[:, 0], atol=1e-12)


def damaged(rows: np.ndarray, camera: np.ndarray, fault: str) -> dict[str, np.ndarray]:
    if fault == "columns":
        rows = rows[:, :16]
    elif fault == "nan":
        rows[1, 3] = np.nan
    elif fault == "rotation":
        rows[1, 4] += 0.1
    elif fault == "millimetres":
        rows[:, 13:16] *= 1000
    return {ROWS: rows} | ({} if fault == "camera" else {CAMERA: camera})


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("columns", r"g.npz: rows: expected \(n, 17\), got \(2, 16\)"),
        ("nan", r"g.npz: rows: row 1 is not finite"),
        ("rotation", r"g.npz: rows: rotation 1 is none: \[\["),
        ("camera", r"g.npz: expected 'object_from_camera', the camera matrix"),
        ("millimetres", r"g.npz: no grasp meets the object.*row 0 is at"),
    ],
)
def test_bad_rows_are_refused_by_the_first(tmp_path: Path, fault: str, said: str) -> None:
    rows = graspnet_rows(looking_down((0, 0, 3), (1, 2, 3)), np.eye(4), 2.0)
    np.savez(tmp_path / "g.npz", **damaged(rows, np.eye(4), fault))
    with pytest.raises(DataError, match=said):
        read_graspnet(tmp_path / "g.npz", box(20, 20, 20))


def test_what_is_no_archive_is_refused(tmp_path: Path) -> None:
    (tmp_path / "g.npz").write_text("score width")
    with pytest.raises(DataError, match=r"g.npz: expected an .npz of grasps"):
        read_graspnet(tmp_path / "g.npz", box(2, 2, 2))
