"""Meshes in any frame before one tube: the object was turned by hand before the other view."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from tests.builder.poly_scenes import capture_of, geometries, radiograph, tool
from xden_builder.capture import Capture
from xden_builder.capture.pose import MeshScale
from xden_builder.capture.space import Space, divide
from xden_builder.poly.model.frames import Pose, posed
from xden_builder.poly.pose import find_pose
from xden_builder.poly.scene import set_scene
from xden_builder.poly.settings import PolySettings
from xden_builder.poly.start import first_guess
from xden_builder.registration.around import Around
from xden_builder.registration.body import Body
from xden_builder.registration.exact import Judge
from xden_builder.registration.likeness import Likeness
from xden_builder.registration.placement import RigidPlacement
from xden_builder.registration.search import register
from xden_builder.registration.shadow import shadow_of
from xden_builder.registration.shortlist import Poses, Search
from xden_builder.registration.steps import settled

BY_HAND = Pose((0.06, -0.04, 0.07), (0.5, -0.8, 0.6))
"""By which lat is off its word."""
HERE = RigidPlacement(np.eye(3), np.zeros(3))
BESIDE = RigidPlacement(Rotation.from_rotvec([0.05, 0.1, -0.04]).as_matrix(), np.full(3, 0.1))


def turned_tool(size: int) -> Capture:
    """Give a tool in its place that was turned by hand before lat, and not quite as told."""
    scanner = geometries(size)
    lat = radiograph(tool(), "lat", posed(scanner["lat"], BY_HAND, shifted_rows=False))
    views = [radiograph(tool(), "pa", scanner["pa"]), replace(lat, geometry=scanner["lat"])]
    return replace(capture_of(tool(), views), turned=frozenset({"lat"}))


@pytest.fixture(scope="module")
def judge() -> Judge:
    capture = turned_tool(192)
    space = divide(capture.parts)
    shadows = [shadow_of(view, turned=view.name == "lat") for view in capture.fitted_views]
    return Judge.of(capture, shadows, Body.of(space, np.ones(3)), 80, HERE, sized=True)


@pytest.mark.parametrize("seed", range(3))
def test_a_motion_leads_from_where_a_mesh_stood_to_where_it_stands(seed: int) -> None:
    rng = np.random.default_rng(seed)
    before, after = (
        RigidPlacement(Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3), 0.7)
        for _ in range(2)
    )
    points, centre = rng.normal(size=(5, 3)), rng.normal(size=3)
    moved = after.since(before)
    assert moved.apply(before.apply(points)) == pytest.approx(after.apply(points))
    assert before.carried(moved).apply(points) == pytest.approx(after.apply(points))
    turn, shift = np.split(moved.about(centre), 2)
    about = Rotation.from_rotvec(turn).apply(before.apply(points) - centre) + centre + shift
    assert about == pytest.approx(after.apply(points))


def test_how_an_object_was_turned_by_hand_is_found_with_its_pose_and_kept(judge: Judge) -> None:
    there = settled(judge, judge.fixed(BESIDE))
    found, _ = np.split(there.moves[1].about(np.zeros(3)), 2)
    assert found == pytest.approx(np.array(BY_HAND.rotation_rad), abs=0.02)
    points = judge.body.space.meshes[0].vertices
    in_lat = Rotation.from_rotvec(BY_HAND.rotation_rad).apply(points) + BY_HAND.shift_cm
    assert there.before(1).apply(points)[:, 1:] == pytest.approx(in_lat[:, 1:], abs=0.05)
    assert there.before(0) is there.placement
    assert judge.anew(there).loss < 1.2 * there.loss
    assert judge.fixed(there.placement).loss > 3 * there.loss


def test_another_pose_is_judged_after_the_same_turn_by_hand(judge: Judge) -> None:
    there = settled(judge, judge.fixed(HERE))
    slid = RigidPlacement(there.placement.rotation, there.placement.translation_cm + 0.05)
    beside = judge.elsewhere(there, slid)
    assert beside.moves == there.moves
    wrong = replace(there, moves={1: BESIDE})
    assert judge.elsewhere(wrong, there.placement).loss < 0.5 * judge.anew(wrong).loss
    followed = Around.of(judge, there).fixed(slid)
    assert followed.loss < 0.2 * beside.loss
    point = np.array([[0.5, -1.0, 2.0]])
    moved, kept = (each.moves[1].apply(point)[0] for each in (followed, there))
    assert moved[1:] == pytest.approx(kept[1:], abs=0.1)  # along the beam hardly anything tells


@pytest.mark.parametrize("turned", [True, False])
def test_coarse_images_leave_depth_before_a_lone_view_where_both_shadows_put_it(
    turned: bool,
) -> None:
    capture = turned_tool(192)
    shadows = [shadow_of(each, turned=turned and each.name == "lat") for each in capture.views]
    body = Body.of(divide(capture.parts), np.ones(3))
    linear = Rotation.from_rotvec([[0.1, -0.2, 0.1]]).as_matrix()
    start = Poses(linear, body.middle_cm[None] + [0.5, 3.0, -0.5], np.full(1, np.inf))
    moved = Search(shadows, body, 16, 16).descended(start, 3, scaled=False).shifts - start.shifts
    assert (abs(moved[0, 1]) < 0.02 * np.linalg.norm(moved)) == turned
    assert abs(moved[0, 0]) > 0.1


def test_poses_that_differ_along_a_lone_beam_alone_are_one(judge: Judge) -> None:
    body, along = judge.body, np.array([0.0, 1.0, 0.0])
    here = body.placed(HERE)
    deeper, aside = (
        replace(here, translation_cm=here.translation_cm + 2 * way) for way in np.eye(3)[[1, 0]]
    )
    told, hardly = Likeness(body), Likeness(body, along)
    assert [told.apart(here, each, 0.05) for each in (deeper, aside)] == [True, True]
    assert [hardly.apart(here, each, 0.05) for each in (deeper, aside)] == [False, True]
    assert hardly.listing.distance_cm(here, deeper) < 1e-6 + told.distance_cm(here, here)
    assert hardly.apart(here, replace(BESIDE, translation_cm=deeper.translation_cm), 0.05)
    farther = RigidPlacement(np.eye(3), here.translation_cm + 2 * along, 1.02)
    assert not hardly.apart(here, farther, 0.05)


def test_a_symmetry_before_a_lone_beam_is_one_though_it_moves_the_middle_of_the_box() -> None:
    prism = trimesh.creation.cylinder(2.0, 3.0, sections=3)
    body = Body.of(Space.of([prism], [0]), np.ones(1))
    middle, axes = body.spin
    about = Rotation.from_rotvec(2 * np.pi / 3 * axes[np.abs(axes @ [0, 0, 1]).argmax()])
    turned = RigidPlacement(about.as_matrix(), middle - about.apply(middle))
    assert np.linalg.norm(turned.translation_cm) > 0.5
    for sight in np.eye(3):
        assert not Likeness(body, sight).apart(HERE, turned, 0.03)


@pytest.mark.parametrize(
    ("scale", "turned", "sd"),
    [("unknown", {"lat"}, 0.02 / np.sqrt(2)), ("unknown", set(), 0.0), ("known", {"lat"}, 0.0)],
)
def test_a_scale_that_one_tube_told_is_as_unsure_as_the_distance(
    scale: MeshScale, turned: set[str], sd: float
) -> None:
    capture = replace(turned_tool(192), mesh_scale=scale, turned=frozenset(turned))
    there = HERE.of_capture(replace(capture, pose="unknown"))
    scene = set_scene(there, divide(there.parts), PolySettings())
    away_cm = np.linalg.norm(capture.views[0].geometry.source_cm)
    assert scene.scale_sd == pytest.approx(sd * 100 / away_cm, rel=0.05)
    sds = [
        find_pose(first_guess(replace(scene, scale_sd=each)), PolySettings(pose=False)).size.sd
        for each in (0.0, scene.scale_sd)
    ]
    assert sds[1] == pytest.approx(np.hypot(sds[0], scene.scale_sd))


@pytest.mark.slow
def test_an_object_turned_by_hand_is_found_from_a_frame_of_its_own() -> None:
    capture = turned_tool(192)
    away = RigidPlacement(Rotation.from_rotvec([2.0, -1.1, 0.7]).as_matrix(), np.full(3, 6.0))
    parts = away.of_parts(capture.parts)
    registration = register(replace(capture, parts=parts, pose="unknown"), divide(parts))
    turn = Rotation.from_matrix(registration.placement.rotation @ away.rotation)
    assert np.degrees(turn.magnitude()) < 1
    assert registration.candidates[0].loss < 0.1
    assert not registration.flags


@pytest.mark.slow
def test_a_scale_is_found_before_one_tube_as_well_as_the_distance_is_known() -> None:
    capture = turned_tool(192)
    small = RigidPlacement(Rotation.from_rotvec([2.0, -1.1, 0.7]).as_matrix(), np.full(3, 6.0), 0.7)
    parts = small.of_parts(capture.parts)
    asked = replace(capture, parts=parts, pose="unknown", mesh_scale="unknown")
    registration = register(asked, divide(parts))
    assert registration.placement.scale == pytest.approx(1 / 0.7, rel=0.03)
    assert registration.candidates[0].loss < 0.1
    assert not registration.flags
