"""How far the poses of rebuilt objects are off."""

import json

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from xden_builder.cli import cli
from xden_builder.evaluate.poses import PoseError, PoseErrors, pose_error, poses_markdown
from xden_builder.phantoms import Scanner, write_captures
from xden_builder.phantoms.posing import Posing

pytestmark = pytest.mark.usefixtures("in_this_process")

SHIFT_CM = np.array([0.1, 0.0, 0.0])
HALF_TURN = Rotation.from_euler("z", 180, degrees=True)


def box(*middle_cm):
    return trimesh.creation.box((2.0, 4.0, 6.0)).apply_translation(middle_cm)


def still(points_cm):
    return points_cm


@pytest.fixture(autouse=True)
def _distances():
    pytest.importorskip("igl")


def turned(degrees):
    return Rotation.from_euler("x", degrees, degrees=True).apply


def test_a_shift_a_turn_and_a_size_are_told_apart():
    parts, materials = [box(-2, 0, 1), box(2, 1, 0)], ["oak", "steel"]
    error = pose_error(parts, materials, still, lambda points: 1.01 * turned(0.5)(points))
    assert error.turn_deg == pytest.approx(0.5, rel=0.02)
    assert error.size_share == pytest.approx(0.01, rel=0.03)
    shifted = pose_error(parts, materials, still, lambda points: points + SHIFT_CM)
    assert shifted.shift_mm == pytest.approx(1.0, rel=0.01)
    assert shifted.turn_deg == pytest.approx(0.0, abs=0.01)
    for each in (error, shifted):
        assert each.left_mm < 0.02
        assert not each.right


@pytest.mark.parametrize("degrees", [0.7, 90.0, 200.0])
def test_a_round_body_turned_about_its_axis_is_not_turned(degrees):
    bottle = trimesh.creation.cylinder(3.0, 20.0, sections=64)
    turn = Rotation.from_euler("z", degrees, degrees=True)
    error = pose_error([bottle], ["oak"], still, turn.apply)
    assert error.right
    assert error.turn_deg < 0.1


def test_a_body_turned_onto_itself_is_where_it_was():
    assert pose_error([box(0, 0, 0)], ["oak"], still, HALF_TURN.apply).right


@pytest.mark.parametrize(
    ("materials", "right"), [(["oak", "oak"], True), (["oak", "steel"], False)]
)
def test_parts_that_change_places_are_right_if_they_are_of_one_material(materials, right):
    parts = [box(-1, 0, 0), box(1, 0, 0)]
    assert pose_error(parts, materials, still, HALF_TURN.apply).right is right


def test_a_small_part_elsewhere_is_wrong_however_large_the_rest_of_its_kind():
    ear = trimesh.creation.icosphere(radius=0.2).apply_translation([1.5, 0, 0])
    parts = [box(0, 0, 0), ear]
    assert not pose_error(parts, ["oak", "oak"], still, HALF_TURN.apply).right


def test_a_turn_of_something_long_about_itself_hardly_counts_at_the_rim():
    pen = [trimesh.creation.box((0.8, 1.2, 15.0))]
    turn = Rotation.from_euler("z", 0.6, degrees=True)
    error = pose_error(pen, ["oak"], still, turn.apply)
    assert error.turn_deg == pytest.approx(0.6, rel=0.05)
    assert error.rim_deg == pytest.approx(error.turn_deg * np.hypot(0.4, 0.6) / 7.53, rel=0.02)
    assert error.right


def test_an_object_far_from_its_place_does_not_shrink_to_a_point_of_it():
    cup, away = trimesh.creation.annulus(3.0, 3.2, 8.0), np.array([40.0, -90.0, 120.0])
    error = pose_error([cup], ["oak"], still, lambda points: turned(70)(points) + away)
    assert abs(np.log1p(error.size_share)) <= np.log(2) + 1e-9
    assert not error.right


def test_only_flags_of_the_pose_are_kept():
    error = pose_error([box(0, 0, 0)], ["oak"], still, still, ["pose_ambiguous", "uncertain"])
    assert error.flags == ("pose_ambiguous",)


def test_objects_that_are_wrong_are_counted_by_flag_and_listed_the_worst_first():
    found = PoseErrors(
        {
            "ball-0000": PoseError(0.9, 0.1, 0.1, 0.001, 0.1, ()),
            "axe-0000": PoseError(0.2, 0.2, 0.3, -0.003, 0.1, ("pose_ambiguous",)),
            "pen-0000": PoseError(0.1, 0.1, 0.1, 0.0, 2.0, ("pose_not_found",)),
            "comb-0000": PoseError(0.1, 0.1, 3.0, 0.0, 0.1, ()),
            "pin-0000": PoseError(0.4, 0.4, 0.4, 0.0, 0.1, ()),
        },
        (),
    )
    text = poses_markdown({"set": found})
    row = next(line for line in text.splitlines() if line.startswith("| set  ") and "(" in line)
    cells = [cell.strip() for cell in row.split("|")[1:-1]]
    spread = ["0.55 (0.83)", "0.15 (0.19)", "0.20 (0.28)", "0.20 (0.28)"]
    assert cells == ["set", "5", "2 (40.0%)", "1", "2 (40.0%)", "1", "1", *spread]
    assert text.index("comb-0000") < text.index("pen-0000") < text.index("pin-0000")
    assert "axe-0000" not in text


def test_poses_of_nothing_rebuilt_are_refused(tmp_path):
    answer = CliRunner().invoke(cli, ["evaluate", str(tmp_path), "--poses"])
    assert answer.exit_code == 2
    assert "--poses: expected --rebuilt" in answer.output


@pytest.mark.slow
def test_meshes_that_err_a_little_stand_nearer_to_the_truth_once_they_are_rebuilt(tmp_path):
    captures, built = tmp_path / "captures", tmp_path / "built"
    write_captures(captures, 1, 5, scanner=Scanner.realistic(192), categories=["mug"])
    run = CliRunner().invoke(cli, ["run", str(captures), "--out", str(built), "--workers", "1"])
    assert run.exit_code == 0, run.output
    command = ["evaluate", str(captures), "--rebuilt", str(built), "--poses", "--json"]
    scored = CliRunner().invoke(cli, command)
    assert scored.exit_code == 0, scored.output
    (error,) = json.loads(scored.stdout)[str(captures)]["objects"].values()
    assert error["rim_deg"] < 0.3
    assert max(error["shift_mm"], error["left_mm"]) < 0.5


@pytest.mark.slow
def test_poses_of_meshes_that_were_put_in_place_before_are_not_compared(tmp_path):
    """The dataset does not say where the meshes had been: all of them would be wrong."""
    captures, aligned, built = (tmp_path / name for name in ("captures", "aligned", "built"))
    scanner, posing = Scanner.realistic(96), Posing("unknown", "known")
    write_captures(captures, 1, 5, scanner=scanner, categories=["wrench"], posing=posing)
    for command in (
        ["align", str(captures), "--out", str(aligned), "--workers", "1"],
        ["run", str(captures), "--out", str(built), "--parts", str(aligned), "--workers", "1"],
    ):
        answer = CliRunner().invoke(cli, command)
        assert answer.exit_code == 0, answer.output
    command = ["evaluate", str(captures), "--rebuilt", str(built), "--poses"]
    answer = CliRunner().invoke(cli, command)
    assert "got one of meshes put in place before it (run --parts)" in answer.output
    assert "0 poses" in answer.output
