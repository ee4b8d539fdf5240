"""The check of a simulated set finds what it is there to find, and the command says so."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from tests.phantoms import objects
from xden1k.errors import DataError
from xden1k.folder import write_folder
from xden_builder.cli import cli
from xden_builder.phantoms import Phantom, Plan, make_phantom, write_captures
from xden_builder.phantoms.check import ObjectCheck, SetReport, check_set
from xden_builder.phantoms.grid import TruthGrid
from xden_builder.phantoms.realism import LIFELIKE, TIDY, Realism
from xden_builder.phantoms.scanner import Scanner


@pytest.fixture(scope="module")
def pristine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("set") / "captures"
    write_captures(
        root,
        3,
        4,
        scanner=Scanner.realistic(48),
        realism=LIFELIKE,
        categories=["mug", "hammer", "screwdriver"],
    )
    return root


@pytest.fixture
def captures(pristine: Path, tmp_path: Path) -> Path:
    """A set that a test may spoil."""
    return Path(shutil.copytree(pristine, tmp_path / "captures"))


def only_fault(root: Path, object_id: str) -> str:
    report = check_set(root)
    assert not report.good
    (failure,) = report.failures
    assert failure.object_id == object_id
    (fault,) = failure.faults
    return fault


def test_sound_set_is_good(pristine: Path) -> None:
    report = check_set(pristine)
    assert report.good
    assert len(report.checks) == 3
    assert 0 < report.median_mass_error <= report.worst_mass_error < 0.01


@pytest.mark.slow
def test_report_is_the_same_whatever_the_number_of_processes(pristine: Path) -> None:
    assert check_set(pristine, workers=2) == check_set(pristine)


def test_grid_that_weighs_something_else_is_found(captures: Path) -> None:
    path = captures / "mug-0000" / "truth.npz"
    grid = TruthGrid.load(path)
    heavier = type(grid.density)(
        1.02 * grid.density.density_g_cm3, grid.density.origin_cm, grid.density.voxel_size_cm
    )
    TruthGrid(heavier, grid.labels, grid.part_names).save(path)
    assert "truth.npz: its mass is 2.0" in only_fault(captures, "mug-0000")


def test_open_mesh_among_those_handed_over_is_found(captures: Path) -> None:
    path = captures / "hammer-0000" / "parts" / "head.ply"
    mesh = trimesh.load_mesh(path, process=False)
    trimesh.Trimesh(mesh.vertices, mesh.faces[1:], process=False).export(path)
    assert "head: the mesh is not closed: 3 open edges" in only_fault(captures, "hammer-0000")


@pytest.mark.slow
def test_truth_of_another_object_is_found(captures: Path) -> None:
    path = captures / "mug-0000" / "truth.json"
    truth = json.loads(path.read_text())
    path.write_text(json.dumps(truth | {"mass_g": truth["mass_g"] * 1.001}))
    assert "but the object made again has" in only_fault(captures, "mug-0000")


def spoiled(monkeypatch: pytest.MonkeyPatch, name: str, mesh: trimesh.Trimesh) -> None:
    """Let the screwdriver come out with another mesh for one of its parts."""

    def make(plan: Plan, realism: Realism) -> Phantom:
        phantom = make_phantom(plan, realism)
        for part in phantom.parts if plan.category.name == "screwdriver" else ():
            if part.name == name:
                part.mesh.vertices, part.mesh.faces = mesh.vertices, mesh.faces
        return phantom

    monkeypatch.setattr("xden_builder.phantoms.check.make_phantom", make)


def test_parts_that_share_space_are_found(pristine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parts = {part.name: part.mesh for part in make_phantom(Plan.of(4, "screwdriver-0000")).parts}
    within = parts["handle"].copy()
    within.vertices = within.centroid + 0.5 * (within.vertices - within.centroid)
    spoiled(monkeypatch, "shaft", within)
    (failure,) = check_set(pristine).failures
    assert any("shares space with another part, and no priority" in f for f in failure.faults)


@pytest.mark.slow
def test_part_that_is_not_closed_is_found(pristine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = trimesh.creation.box((1.0, 1.0, 1.0))
    mesh.update_faces(np.arange(1, 12))
    spoiled(monkeypatch, "shaft", mesh)
    (failure,) = check_set(pristine).failures
    assert any("part shaft: 3 open and 0 twisted edges" in fault for fault in failure.faults)


def test_file_that_cannot_be_read_is_a_fault_of_its_object(captures: Path) -> None:
    (captures / "mug-0000" / "truth.npz").write_bytes(b"nothing")
    (captures / "hammer-0000" / "pa.tif").write_bytes(b"nothing")
    (captures / "screwdriver-0000" / "truth.json").unlink()
    report = check_set(captures)
    assert [check.object_id for check in report.failures] == [
        check.object_id for check in report.checks
    ]
    assert not report.good
    assert np.isnan(report.median_mass_error)
    assert np.isnan(report.worst_mass_error)


def test_median_of_the_grids_has_a_limit_of_its_own() -> None:
    each = [ObjectCheck(f"mug-{n:04d}", error, ()) for n, error in enumerate((2e-3, 3e-3, 1e-4))]
    report = SetReport(tuple(each))
    assert report.median_mass_error == 2e-3
    assert not report.failures
    assert not report.good


def test_captures_of_a_scanner_cannot_be_checked(captures: Path) -> None:
    (captures / "simulation.json").unlink()
    with pytest.raises(DataError, match="only simulated captures can be checked"):
        check_set(captures)


# the command


def make(out: Path, *options: str) -> dict[str, object]:
    """Run ``xden-build phantoms`` and return the settings of the simulation."""
    arguments = ["phantoms", str(out), "--count", "1", "--seed", "4", "--size", "32"]
    result = CliRunner().invoke(cli, [*arguments, "--workers", "1", *options])
    assert result.exit_code == 0, result.output
    settings: dict[str, object] = json.loads((out / "simulation.json").read_text())
    return settings


def test_command_checks_what_it_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = ["phantoms", "--count", "1", "--seed", "4", "--size", "32", "--workers", "1"]
    arguments += ["--categories", "screwdriver", "--check"]
    result = CliRunner().invoke(cli, [*arguments, str(tmp_path / "good")])
    assert result.exit_code == 0
    assert "1 of 1 sound; mass of grids against parts: 0.0" in result.output
    spoiled(monkeypatch, "shaft", trimesh.creation.box((1.0, 1.0, 1.0)))
    result = CliRunner().invoke(cli, [*arguments, str(tmp_path / "bad"), "--json"])
    assert result.exit_code == 3
    kept = json.loads(result.stdout)["check"]
    assert kept["objects"] == 1
    assert [failure["object_id"] for failure in kept["failures"]] == ["screwdriver-0000"]
    result = CliRunner().invoke(cli, [*arguments, str(tmp_path / "bad text")])
    assert result.exit_code == 3
    assert "unsound: screwdriver-0000: " in result.stderr


def test_truth_as_a_dataset_is_not_for_the_check(tmp_path: Path) -> None:
    arguments = ["phantoms", str(tmp_path / "out"), "--count", "1", "--seed", "0"]
    result = CliRunner().invoke(cli, [*arguments, "--as-dataset", "--check"])
    assert result.exit_code == 2
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("damaged", [False, True])
def test_truth_as_a_dataset_is_verified_in_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, damaged: bool
) -> None:
    def write(out: Path, *_: object, **__: object) -> None:
        write_folder(objects()[:1], out, version="1.0.0", builder="test")
        if damaged:
            (out / "README.md").write_text("damaged")

    monkeypatch.setattr("xden_builder.phantoms.write_truth_dataset", write)
    truth = tmp_path / "truth"
    arguments = ["phantoms", str(truth), "--as-dataset", "--count", "1", "--seed", "1"]
    result = CliRunner().invoke(cli, arguments)
    if not damaged:
        assert (result.exit_code, result.stderr) == (0, "")
        return
    assert (result.exit_code, result.stdout) == (1, "")
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"Error: {truth} does not verify, 1 problems, the first: README.md: ")


def test_ideal_switches_everything_off(tmp_path: Path) -> None:
    make(tmp_path / "command", "--ideal")
    write_captures(tmp_path / "library", 1, 4, scanner=Scanner.monochromatic(32).ideal())
    for path in (tmp_path / "library").rglob("*"):
        if path.is_file():
            same = tmp_path / "command" / path.relative_to(tmp_path / "library")
            assert same.read_bytes() == path.read_bytes(), path.name


def test_scanner_is_realistic_and_labels_err_unless_told_otherwise(tmp_path: Path) -> None:
    usual = make(tmp_path / "usual")
    assert Scanner(**usual["scanner"]) == Scanner.realistic(32)  # type: ignore[arg-type]
    assert Realism(**usual["realism"]) == LIFELIKE  # type: ignore[arg-type]
    tidy = make(tmp_path / "tidy", "--tidy")
    assert (tidy["scanner"], Realism(**tidy["realism"])) == (usual["scanner"], TIDY)  # type: ignore[arg-type]


def test_scanner_file_made_ideal_keeps_its_source(tmp_path: Path) -> None:
    (tmp_path / "scanner.toml").write_text('preset = "realistic"\n')
    made = make(tmp_path / "out", "--ideal", "--scanner", str(tmp_path / "scanner.toml"))
    assert Scanner(**made["scanner"]) == Scanner.realistic(32).ideal()  # type: ignore[arg-type]
