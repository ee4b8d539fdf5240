"""Objects that lie anyhow, meshes in frames of their own, one tube: the truth undoes all of it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from xden1k.errors import DataError
from xden1k.folder import open_folder
from xden1k.rays import path_lengths
from xden_builder.capture import Capture, CaptureFolder
from xden_builder.cli import cli
from xden_builder.phantoms import Phantom, PhantomPart, Plan, Scanner, make_phantom, write_captures
from xden_builder.phantoms.posing import Posing, draw_mesh_frame, posed
from xden_builder.phantoms.scanner.turning import draw_turn, seen_by_object

pytestmark = pytest.mark.usefixtures("in_this_process")
UNKNOWN = Posing("unknown", "unknown")
NOISELESS = Scanner(
    size_px=64,
    bits=None,
    exposure_sd=0.0,
    mesh_rotation_deg=1.0,
    mesh_shift_cm=0.1,
    mesh_scale_sd=0.005,
)
"""Its meshes err, but are not simplified: a pose and a scale undo that."""
ROD_CM = (1.0, 2.0, 20.0)


def rod(number: int, role: str = "body", size_cm: Sequence[float] = ROD_CM) -> Phantom:
    part = PhantomPart(
        "rod", role, trimesh.creation.box(size_cm), "aluminium", 2.7, (0.5, 0.5, 0.5)
    )
    return Phantom(Plan(0, 0, number), (part,))


def points(phantom: Phantom) -> np.ndarray:
    return np.concatenate([part.mesh.vertices for part in phantom.parts])


@pytest.fixture(scope="module")
def captures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hammer of unknown pose and scale, turned by hand before one tube."""
    out = tmp_path_factory.mktemp("posing") / "captures"
    scanner = replace(NOISELESS, one_tube=True)
    write_captures(out, 1, 2, scanner=scanner, posing=UNKNOWN, categories=["hammer"])
    return out


@pytest.fixture(scope="module")
def capture(captures: Path) -> Capture:
    return CaptureFolder(captures).read("hammer-0000")


@pytest.fixture(scope="module")
def truth(captures: Path) -> dict[str, Any]:
    values: dict[str, Any] = json.loads((captures / "hammer-0000" / "truth.json").read_text())
    return values


def moved(mesh: trimesh.Trimesh, pose: dict[str, Any]) -> trimesh.Trimesh:
    turned = Rotation.from_quat(pose["quaternion_xyzw"]).apply(mesh.vertices)
    places = pose["scale"] * turned + pose["translation_cm"]
    return trimesh.Trimesh(places, mesh.faces, process=False)


def test_meshes_of_the_files_in_the_true_poses_are_what_the_images_show(
    capture: Capture, truth: dict[str, Any]
) -> None:
    meshes = [moved(part.mesh, truth["mesh_pose"]) for part in capture.parts]
    lac_per_cm = np.array([part["lac_per_cm"] for part in truth["parts"]])
    stood = {"pa": meshes, "lat": [moved(mesh, truth["view_poses"]["lat"]) for mesh in meshes]}
    for view in capture.views:
        lengths = path_lengths(stood[view.name], range(len(meshes)), view.geometry, 6)
        np.testing.assert_allclose(lengths.image(lac_per_cm), view.transmission, atol=1e-5)
        assert view.transmission.min() < 0.9


def test_meshes_of_the_files_are_not_where_the_images_show_them(
    capture: Capture, truth: dict[str, Any]
) -> None:
    scale, turn = (truth["mesh_pose"]["scale"], truth["view_poses"]["lat"])
    assert abs(np.log(scale)) > 0.01
    assert Rotation.from_quat(truth["mesh_pose"]["quaternion_xyzw"]).magnitude() > 0.1
    assert Rotation.from_quat(turn["quaternion_xyzw"]).magnitude() > 0.01
    assert turn["scale"] == pytest.approx(1.0)


def test_a_capture_says_what_is_not_known_of_it(captures: Path, capture: Capture) -> None:
    assert (capture.pose, capture.mesh_scale, capture.turned) == ("unknown", "unknown", {"lat"})
    assert json.loads((captures / "simulation.json").read_text())["posing"] == {
        "pose": "unknown",
        "mesh_scale": "unknown",
    }


def test_masses_are_those_of_the_object_wherever_it_lies(truth: dict[str, Any]) -> None:
    mass = make_phantom(Plan.of(2, "hammer-0000")).mass_properties
    assert truth["mass_g"] == pytest.approx(mass.mass_g)
    assert not np.allclose(truth["inertia_g_cm2"], mass.inertia_g_cm2, rtol=1e-3)
    np.testing.assert_allclose(
        np.linalg.eigvalsh(truth["inertia_g_cm2"]), np.linalg.eigvalsh(mass.inertia_g_cm2)
    )


def test_without_a_word_of_poses_files_say_nothing_of_them(tmp_path: Path) -> None:
    write_captures(tmp_path / "out", 1, 2, size=16, ideal=True, categories=["eraser"])
    said = "object_id,category,split,source\neraser-0000,eraser,{},phantom\n"
    assert (tmp_path / "out" / "objects.csv").read_text() == said.format(
        Plan.of(2, "eraser-0000").split
    )
    assert set(json.loads((tmp_path / "out" / "simulation.json").read_text())) == {
        "seed", "scanner", "realism",
    }  # fmt: skip
    truth = json.loads((tmp_path / "out" / "eraser-0000" / "truth.json").read_text())
    assert not {"mesh_pose", "view_poses"} & set(truth)


def test_half_of_the_objects_lie_at_rest_and_rods_do_not_stand_on_end() -> None:
    heights = np.array([np.ptp(points(posed(rod(n), Scanner(), UNKNOWN))[:, 2]) for n in range(40)])
    at_rest = np.isclose(heights[:, None], ROD_CM, atol=1e-9)
    assert 0.3 < at_rest.any(axis=1).mean() < 0.7
    assert at_rest[:, 0].sum() > at_rest[:, 1].sum() > at_rest[:, 2].sum()


def test_what_holds_a_liquid_stays_upright() -> None:
    for number in range(8):
        places = points(posed(rod(number, "liquid"), Scanner(), UNKNOWN))
        assert np.ptp(places[:, 2]) == pytest.approx(20.0)


@pytest.mark.parametrize("length_cm", [8.0, 45.0, 66.0])
def test_images_hold_an_object_wherever_it_lies(length_cm: float) -> None:
    scanner = Scanner(one_tube=True)
    for number in range(10):
        phantom = posed(rod(number, size_cm=(4.0, 6.0, length_cm)), scanner, UNKNOWN)
        setting, _ = scanner.setting_for(phantom)
        middle = (points(phantom).min(axis=0) + points(phantom).max(axis=0)) / 2
        assert abs(middle).max() <= 2.0
        assert setting == "standard" or length_cm > 30


def test_an_object_too_long_for_any_pose_is_a_plain_error() -> None:
    with pytest.raises(DataError, match=r"-0000 reaches beyond the panels in 50 orientations"):
        posed(rod(0, size_cm=(70.0, 70.0, 70.0)), Scanner(), UNKNOWN)


def test_frames_of_meshes_are_even_over_rotations_and_scales() -> None:
    frames = [draw_mesh_frame(Plan(0, 0, number), UNKNOWN) for number in range(300)]
    scales = np.cbrt([np.linalg.det(frame.matrix[:3, :3]) for frame in frames])
    turns = np.array([frame.matrix[:3, :3] for frame in frames]) / scales[:, None, None]
    shifts_cm = np.array([frame.matrix[:3, 3] for frame in frames])
    assert {frame.units for frame in frames} == {"cm", "mm", "m", "in"}
    # entries of an even rotation have mean 0 and variance 1/3
    np.testing.assert_allclose(turns.mean(axis=0), 0.0, atol=5 / np.sqrt(3 * 300))
    np.testing.assert_allclose((turns**2).mean(axis=0), 1 / 3, atol=0.1)
    assert abs(np.log2(scales)).max() <= 1.0 + 1e-9
    assert np.log2(scales).std() == pytest.approx(2 / np.sqrt(12), rel=0.15)
    assert 9.0 < abs(shifts_cm).max() <= 10.0


def test_only_the_scale_differs_where_it_is_unknown() -> None:
    known, unknown = (
        draw_mesh_frame(Plan(0, 3, 1), Posing("unknown", s)) for s in ("known", "unknown")
    )
    scale = np.cbrt(np.linalg.det(unknown.matrix[:3, :3]))
    np.testing.assert_allclose(unknown.matrix[:3, :3], scale * known.matrix[:3, :3])
    assert known.units == unknown.units


def test_lat_of_one_tube_is_told_as_pa_of_an_object_turned_by_90_degrees() -> None:
    scanner = Scanner(one_tube=True)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    places = np.random.default_rng(0).uniform(-5.0, 5.0, (9, 3))
    np.testing.assert_allclose(
        scanner.geometry("lat").project(places), scanner.geometry("pa").project(places @ quarter.T)
    )


def test_turns_by_hand_are_about_a_quarter_about_the_vertical() -> None:
    rng, quarter = np.random.default_rng(1), Rotation.from_euler("z", 90, degrees=True)
    matrices = [draw_turn(rng) for _ in range(300)]
    turns = [quarter * Rotation.from_matrix(matrix[:3, :3]) for matrix in matrices]
    angles_deg = np.array([np.degrees(turn.magnitude()) for turn in turns])
    axes = np.array([turn.as_rotvec() / turn.magnitude() for turn in turns])
    assert 85.0 <= angles_deg.min() < 87.0 < 93.0 < angles_deg.max() <= 95.0
    np.testing.assert_allclose(np.degrees(axes[:, :2].std(axis=0)), 2.5, rtol=0.2)
    shifts_cm = [np.linalg.norm(matrix[:3, 3]) for matrix in matrices]
    assert 1.5 < max(shifts_cm) <= 2.0


def test_a_panel_sees_an_object_that_moved_as_it_would_if_it_had_moved_back() -> None:
    told, turn = Scanner().geometry("lat"), draw_turn(np.random.default_rng(3))
    places = np.random.default_rng(0).uniform(-5.0, 5.0, (9, 3))
    stood = places @ turn[:3, :3].T + turn[:3, 3]
    np.testing.assert_allclose(seen_by_object(told, turn).project(places), told.project(stood))


def test_one_tube_has_one_panel(tmp_path: Path) -> None:
    scanner = Scanner(size_px=16, one_tube=True)
    write_captures(tmp_path / "out", 1, 2, scanner=scanner, categories=["eraser"])
    assert sorted(path.name for path in (tmp_path / "out").glob("*.tif")) == [
        "dark_pa.tif",
        "flat_pa.tif",
    ]
    eraser = CaptureFolder(tmp_path / "out").read("eraser-0000")
    assert (eraser.pose, eraser.turned) == ("near", {"lat"})
    kept = json.loads((tmp_path / "out" / "simulation.json").read_text())["scanner"]
    assert Scanner(**kept) == scanner


def test_another_scale_of_meshes_in_the_scanners_frame_is_one_line(tmp_path: Path) -> None:
    asked = ["phantoms", str(tmp_path / "out"), "--count", "1", "--seed", "0"]
    result = CliRunner().invoke(cli, [*asked, "--mesh-scale", "unknown"])
    assert result.exit_code == 1
    assert result.output == "Error: mesh_scale unknown needs pose unknown, got near\n"
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_truth_as_a_dataset_is_in_the_scanners_frame_and_verified(tmp_path: Path) -> None:
    asked = "--count 3 --seed 1 --size 64 --pose unknown --turned --categories mug,hammer,eraser"
    for kind, options in (("truth", ["--as-dataset"]), ("captures", [])):
        result = CliRunner().invoke(
            cli, ["phantoms", str(tmp_path / kind), *asked.split(), *options]
        )
        assert result.exit_code == 0, result.output
    for obj in open_folder(tmp_path / "truth").objects():
        folder = tmp_path / "captures" / obj.object_id
        truth = json.loads((folder / "truth.json").read_text())
        np.testing.assert_allclose(obj.com_cm, truth["com_cm"], atol=1e-4)
        told = CaptureFolder(tmp_path / "captures").read(obj.object_id).views[1].geometry
        pose = truth["view_poses"]["lat"]
        places = obj.parts[0].mesh.vertices
        stood = Rotation.from_quat(pose["quaternion_xyzw"]).apply(places) + pose["translation_cm"]
        np.testing.assert_allclose(
            obj.views[1].geometry.project(places), told.project(stood), rtol=1e-5, atol=1e-3
        )


@pytest.mark.slow
def test_every_check_of_a_set_holds_for_objects_of_unknown_pose(tmp_path: Path) -> None:
    asked = "--count 4 --seed 3 --size 64 --pose unknown --mesh-scale unknown --turned --check"
    result = CliRunner().invoke(cli, ["phantoms", str(tmp_path / "out"), *asked.split()])
    assert result.exit_code == 0, result.output
    assert "4 of 4 sound" in result.output
