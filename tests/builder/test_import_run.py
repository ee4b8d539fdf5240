"""An import is whole or not at all, goes past bad objects, and can be stopped and started again."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path, PurePosixPath
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner, Result

import xden1k
from tests import phantoms
from tests.builder import releases
from tests.builder.conftest import one_by_one
from tests.builder.folders import contents
from tests.builder.releases import TWIN, VOLUME, copied
from tests.hub_server import HubServer
from xden1k.cli import cli as xden
from xden1k.errors import DataError
from xden1k.folder import open_folder
from xden1k.folder.verify import verify_folder
from xden1k.values.types import DensityObject, Split
from xden_bench.serve.explorer import Explorer
from xden_builder.capture import write_scanner
from xden_builder.capture.writing import write_image
from xden_builder.cli import cli as xden_build
from xden_builder.phantoms.scanner import Scanner, scanner_file
from xden_builder.pipeline.outcomes import REPORT_NAME
from xden_builder.pipeline.resumable import work_folder
from xden_builder.pipeline.splits import read_splits
from xden_builder.published import run
from xden_builder.published.given import PublishedObject
from xden_builder.published.judge import judge, judged_table
from xden_builder.published.reading import HubSource, find_source
from xden_builder.published.release_fit import ReleaseFit
from xden_builder.published.survey import PartSeen, Survey

REPO = "owner/release"


@pytest.fixture
def release(tmp_path: Path) -> Path:
    return copied(tmp_path)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Make boxes of the objects, in this process: registration has tests of its own."""
    done = SimpleNamespace(surveyed=[], made=[])

    def survey(given: PublishedObject) -> Survey:
        done.surveyed.append(given.object_id)
        part = PartSeen("body", "mug", 1.0, 10.0, *[[[1.0]] * 3] * 2, [[1.0, 1.0]] * 3, [1] * 3)
        sides = (1.0, 2.0, 3.0)
        return Survey(given.object_id, [[0.5]], sides, sides, sides, sides, sides, (part,))

    def fit(surveys: list[Survey]) -> Any:
        ids = [survey.object_id for survey in surveys]
        return Mock(spec=ReleaseFit, to_json=lambda: {"objects": ids})

    def make(given: PublishedObject, fit: Any, split: Split) -> DensityObject:
        done.made.append(given.object_id)
        return phantoms.published_object(
            given.object_id, phantoms.BAR, category=given.category, split=split
        )

    for name, fake in (("survey_object", survey), ("fit_release", fit), ("import_object", make)):
        monkeypatch.setattr(run, name, fake)
    monkeypatch.setattr(run, "run_each", one_by_one)
    return done


def imported(source: object, out: Path | None, *options: object) -> Result:
    told = ["--out", out] if out else []
    arguments = map(str, ["import", source, *told, *options])
    return CliRunner().invoke(xden_build, list(arguments), catch_exceptions=False)


def refusal(result: Result) -> str:
    assert result.exit_code == 1, result.output
    *_, line = result.stderr.splitlines()
    return line.removeprefix("Error: ")


def test_every_object_is_imported_without_radiographs(
    release: Path, tmp_path: Path, quick: SimpleNamespace
) -> None:
    out = tmp_path / "out"
    result = imported(release, out, "--objects", "1-2")
    assert result.exit_code == 0, result.output
    folder = open_folder(out)
    assert folder.manifest.sources == {"published": 2}
    assert "2 built, 0 kept, 0 failed" in result.stdout
    assert "published / ours" in result.stdout
    left = {path.name for path in (tmp_path / "out.work").iterdir()}
    assert left <= {"build_report.json", "release_fit.json", "run.lock"}


def test_one_bad_object_is_told_and_the_others_are_written(
    release: Path, tmp_path: Path, quick: SimpleNamespace
) -> None:
    releases.cut_off(release, 3)
    result = imported(release, tmp_path / "out", "--json", "--objects", "2-3")
    assert result.exit_code == 3
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("failed")]
    assert line.startswith("failed: xden1k-0003: ")
    assert VOLUME in line
    report = json.loads(result.stdout)
    assert (report["built"], report["failed"]) == (1, 1)
    assert "xden1k-0003" not in open_folder(tmp_path / "out").ids()


def test_what_sound_files_do_not_show_names_their_folder(
    release: Path, tmp_path: Path, quick: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    def survey(_: PublishedObject) -> Survey:
        raise DataError("volume: no part is left")

    monkeypatch.setattr(run, "survey_object", survey)
    said = refusal(imported(release, tmp_path / "out", "--objects", "1"))
    assert f"xden1k-0001: {release / 'dataset' / '1'}: volume: no part is left" in said


@pytest.mark.slow
def test_a_rerun_makes_only_what_failed(
    release: Path, tmp_path: Path, quick: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = release / "dataset" / "3" / VOLUME
    content = whole.read_bytes()
    releases.cut_off(release, 3)
    monkeypatch.setattr(run, "fit_release", lambda _: Mock(spec=ReleaseFit, to_json=dict))
    assert imported(release, tmp_path / "out").exit_code == 3
    whole.write_bytes(content)
    quick.surveyed.clear()
    quick.made.clear()
    assert imported(release, tmp_path / "out").exit_code == 0
    assert quick.surveyed == quick.made == ["xden1k-0003"]


@pytest.mark.slow
def test_another_fit_of_the_release_makes_all_objects_anew(
    release: Path, tmp_path: Path, quick: SimpleNamespace
) -> None:
    assert imported(release, tmp_path / "out", "--objects", "0-3", "--keep-work").exit_code == 0
    quick.made.clear()
    quick.surveyed.clear()
    assert imported(release, tmp_path / "out", "--objects", "0-4", "--keep-work").exit_code == 0
    assert len(quick.made) == 5
    assert quick.surveyed == ["xden1k-0004"]


@pytest.mark.slow
def test_a_run_that_is_cut_off_ends_in_the_same_bytes(
    release: Path, tmp_path: Path, quick: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert imported(release, tmp_path / "whole", "--objects", "0-2").exit_code == 0

    def killed(*told: Any, workers: int) -> Iterator[Any]:
        answers = one_by_one(*told, workers)
        yield next(answers)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(run, "run_each", killed)
        imported(release, tmp_path / "cut", "--objects", "0-2")
    assert not (tmp_path / "cut").exists()
    assert imported(release, tmp_path / "cut", "--objects", "0-2").exit_code == 0
    for path in (tmp_path / "whole").rglob("*"):
        if path.is_file():
            inside = path.relative_to(tmp_path / "whole")
            assert (tmp_path / "cut" / inside).read_bytes() == path.read_bytes(), inside


def test_when_no_object_can_be_made_nothing_is_written(
    release: Path, tmp_path: Path, quick: SimpleNamespace
) -> None:
    for number in (0, 1):
        releases.without_faces(release, number)
    said = refusal(imported(release, tmp_path / "out", "--objects", "0-1"))
    assert "no object could be built" in said
    assert "mesh.glb: expected a mesh with faces, got none" in said
    assert not (tmp_path / "out").exists()


def test_a_release_without_metadata_is_refused_as_a_whole(release: Path, tmp_path: Path) -> None:
    (release / "dataset" / "metadata.json").unlink()
    assert "expected metadata.json" in refusal(imported(release, tmp_path / "out"))
    assert not (tmp_path / "out.work").exists()


@pytest.mark.slow
def test_splits_are_those_of_the_whole_release_whichever_objects_are_imported(
    release: Path, tmp_path: Path, quick: SimpleNamespace
) -> None:
    def splits(name: str, *options: object) -> dict[str, str]:
        imported(release, tmp_path / name, *options)
        folder = open_folder(tmp_path / name)
        ids, told = folder.light_column("object_id"), folder.light_column("split")
        return dict(zip(ids, told, strict=True))

    whole = splits("whole")
    assert splits("some", "--objects", "2,4").items() <= whole.items()
    table = tmp_path / "splits.csv"
    table.write_text("object_id,split\nxden1k-0002,val\n")
    assert read_splits(table) == {"xden1k-0002": "val"}
    assert splits("told", "--splits", table)["xden1k-0002"] == "val"


@pytest.mark.parametrize(
    ("source", "options", "message"),
    [
        (TWIN, ("--revision", "v1"), "is a folder, which has no revision v1"),
        (TWIN, ("--objects", "7"), "no object 7 among 6, 0 to 5"),
        ("nowhere", (), "expected a folder, or a repository of the Hub as owner/name"),
        (TWIN.parents[1] / "golden", (), "not laid out as the release"),
    ],
)
def test_what_is_typed_wrong_is_one_line(
    source: object, options: tuple[str, ...], message: str, tmp_path: Path
) -> None:
    assert message in refusal(imported(source, tmp_path / "out", *options))
    assert message in refusal(imported(source, None, "--dry-run", *options))


def test_ids_of_a_split_table_must_be_of_the_release(tmp_path: Path) -> None:
    (tmp_path / "splits.csv").write_text("object_id,split\nmug-1,val\n")
    result = imported(TWIN, tmp_path / "out", "--splits", tmp_path / "splits.csv")
    assert "expected ids of the release, got mug-1" in refusal(result)


def test_out_or_a_dry_run_must_be_asked_for() -> None:
    result = imported(TWIN, None)
    assert result.exit_code == 2
    assert "give --out ROOT, or --dry-run" in result.stderr


def test_a_dry_run_ends_with_0_or_3_and_says_the_same_as_json(release: Path) -> None:
    assert imported(release, None, "--dry-run", "--objects", "1").exit_code == 0
    releases.compressed(release, 1, "KHR_draco_mesh_compression")
    text = imported(release, None, "--dry-run", "--objects", "1")
    values = json.loads(imported(release, None, "--dry-run", "--objects", "1", "--json").stdout)
    assert text.exit_code == 3
    assert values["mismatches"][0] in text.stdout
    assert values["mesh"]["names"] == {"mesh.glb": 1}


def test_xden_finds_the_command() -> None:
    result = CliRunner().invoke(xden, ["import", str(TWIN), "--dry-run", "--objects", "1"])
    assert result.exit_code == 0, result.output
    assert "first mismatch none" in result.stdout


# From the Hub


@pytest.fixture
def repository(hub: HubServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> HubServer:
    """The tiny twin as a repository, and an empty cache."""
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    files = {p.relative_to(TWIN).as_posix(): p.read_bytes() for p in TWIN.rglob("*") if p.is_file()}
    hub.make(REPO, files | {"dataset/1/teaser.png": b"x" * 1000, "dataset/1/huge.bin": b"?" * 5000})
    return hub


def test_a_dry_run_of_a_repository_downloads_the_metadata_alone(repository: HubServer) -> None:
    result = imported(REPO, None, "--dry-run", "--json")
    assert result.exit_code == 0, result.output
    values = json.loads(result.stdout)
    assert values["mesh"] == {"objects": 6, "of": 6, "names": {"mesh.glb": 6}}
    assert values["image"]["names"] == {"teaser.png": 1}
    assert values["metadata"]["objects found"] == 6
    assert values["source"]["commit"] == repository.repos[REPO].find("main")
    assert {"MB to download", "MB free"} <= values["source"].keys()
    fetched = {line.path for line in repository.log if "/resolve/" in line.path}
    assert {path.rpartition("/")[2] for path in fetched} == {"metadata.json"}


def test_only_the_files_of_the_chosen_objects_are_fetched_and_only_once(
    repository: HubServer, tmp_path: Path, quick: SimpleNamespace
) -> None:
    result = imported(REPO, tmp_path / "out", "--objects", "1")
    assert result.exit_code == 0, result.output
    assert "MB to download" in result.stderr
    fetched = {
        line.path.partition("/dataset/")[2] for line in repository.log if "/resolve/" in line.path
    }
    assert {path.split("/")[0] for path in fetched} == {"1", "metadata.json"}
    assert not any("teaser" in path or "huge" in path for path in fetched)
    before = repository.sent("resolve")
    source = find_source(REPO, None)
    assert source.fetch([PurePosixPath("dataset/1/mesh.glb")]).is_dir()
    assert repository.sent("resolve") == before


def test_a_branch_that_moves_meanwhile_does_not_mix_two_commits(repository: HubServer) -> None:
    source = find_source(REPO, "main")
    assert isinstance(source, HubSource)
    repository.make(REPO, {"dataset/0/mesh.glb": b"later"})
    assert source.commit != repository.repos[REPO].find("main")


def test_a_repository_that_is_not_there_is_one_line(hub: HubServer, tmp_path: Path) -> None:
    said = refusal(imported("owner/nothing", tmp_path / "out"))
    assert said.startswith("owner/nothing: the Hub does not give it: ")


# The real thing


@pytest.fixture(scope="module")
def twin_imported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tiny twin, imported by two processes without any disturbance."""
    out = tmp_path_factory.mktemp("twin") / "imported"
    result = imported(TWIN, out, "--workers", 2)
    assert result.exit_code == 0, result.output
    return out


@pytest.mark.slow
def test_the_tiny_twin_becomes_a_sound_dataset(twin_imported: Path) -> None:
    assert verify_folder(twin_imported) == []
    truth = json.loads((TWIN.parent / f"{TWIN.name}.truth.json").read_text())
    folder = open_folder(twin_imported)
    masses = [folder.object(object_id).mass_g for object_id in folder.ids()]
    true = [truth["objects"][str(number)]["mass_g"] for number in range(6)]
    assert np.all(np.isfinite(masses))
    assert np.median(np.abs(np.log(np.array(masses) / true))) < 1.0
    report = json.loads(Path(work_folder(twin_imported), REPORT_NAME).read_text())
    assert all(0 < one["mass_sd_g"] < 2 * one["mass_g"] for one in report["objects"])


@pytest.mark.slow
def test_an_imported_twin_is_judged_by_its_truth(twin_imported: Path) -> None:
    judged = judge(TWIN, twin_imported)
    assert [one.object_id for one in judged] == [f"xden1k-000{number}" for number in range(6)]
    assert np.median([one.placed for one in judged]) < 0.01
    assert np.median([abs(one.own_mass) for one in judged]) < 0.1
    assert sum(len(one.parts) for one in judged) > 6
    assert judged_table(judged).startswith("6 objects\n")


def kill_at(out: Path, pattern: str, fewest: int) -> None:
    """Start an import of the tiny twin, and kill it once there are so many work files."""
    command = "from xden_builder.cli import cli; cli()"
    told = [command, "import", str(TWIN), "--out", str(out), "--workers", "2"]
    path = {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen([sys.executable, "-c", *told], env=os.environ | path) as run:  # noqa: S603
        while run.poll() is None and len(list(work_folder(out).glob(pattern))) < fewest:
            time.sleep(0.02)
        run.kill()
    assert run.returncode == -signal.SIGKILL


@pytest.mark.slow
def test_an_import_that_is_killed_twice_and_run_again_gives_the_same_bytes(
    twin_imported: Path, tmp_path: Path
) -> None:
    out = tmp_path / "imported"
    for pattern in ("*.survey.json", "*.h5"):
        kill_at(out, pattern, fewest=2)
        assert not out.exists()
    result = imported(TWIN, out, "--workers", 2)
    assert result.exit_code == 0, result.output
    assert contents(out) == contents(twin_imported)


@pytest.mark.slow
def test_an_import_is_loaded_drawn_and_exported_as_any_dataset(
    twin_imported: Path, tmp_path: Path
) -> None:
    rows = xden1k.load_dataset(root=twin_imported)["train"]
    sample = xden1k.XDen1K(twin_imported, split="train")[0]
    assert rows[0]["object_id"] == sample["object_id"]
    drawn = tmp_path / "drawn.png"
    ran = CliRunner().invoke(
        xden, ["show", "xden1k-0001", "--root", str(twin_imported), "-o", str(drawn)]
    )
    assert ran.exit_code == 0, ran.output
    assert drawn.stat().st_size > 0
    for format_ in ("mjcf", "glb", "nifti", "npz"):
        told = ["export", "xden1k-0001", "--format", format_, "-o", str(tmp_path / format_)]
        ran = CliRunner().invoke(xden, [*told, "--root", str(twin_imported)])
        assert ran.exit_code == 0, ran.output
        assert any((tmp_path / format_).rglob("*.*"))


@pytest.mark.slow
def test_an_import_is_explored_in_the_web_app_as_any_dataset(
    twin_imported: Path, tmp_path: Path
) -> None:
    explorer = Explorer(open_folder(twin_imported), lambda _: None, tmp_path)
    (object_id, *_) = explorer.folder.ids()
    fields = explorer.fields(object_id, None)
    truth, prediction, error = explorer.slices(fields, axis=1, index=32)
    assert truth.startswith("<svg")
    assert prediction is error is None
    model, _ = explorer.model(fields, "density sd", cut=False)
    assert set(trimesh.load_scene(model).geometry) == {row[0] for row in explorer.parts(object_id)}
    assert explorer.radiographs(object_id) == ()


# Radiographs, where a mapping file says so


@pytest.fixture
def mapped(release: Path, tmp_path: Path) -> Path:
    """A mapping file by which two images of object 1 are its views."""
    scanner = replace(Scanner.monochromatic().ideal(), size_px=16)
    write_scanner(scanner_file(scanner), tmp_path / "scanner.toml")
    rows = np.linspace(0.5, 1.0, 16 * 16, dtype=np.float32).reshape(16, 16)
    for view in ("pa", "lat"):
        write_image(release / "dataset" / "1" / f"{view}.tif", rows)
    (tmp_path / "map.toml").write_text('scanner = "scanner.toml"\n')
    return tmp_path / "map.toml"


def test_images_become_radiographs_only_where_a_mapping_file_says_so(
    release: Path, tmp_path: Path, mapped: Path, quick: SimpleNamespace
) -> None:
    imported(release, tmp_path / "without", "--objects", "1")
    result = imported(release, tmp_path / "with", "--objects", "1-2", "--map", mapped)
    assert result.exit_code == 0, result.output
    without, folder = open_folder(tmp_path / "without"), open_folder(tmp_path / "with")
    assert without.object("xden1k-0001").views == ()
    seen, unseen = folder.object("xden1k-0001"), folder.object("xden1k-0002")
    assert [view.name for view in seen.views] == ["pa", "lat"]
    assert "no_radiographs" not in seen.flags
    assert unseen.views == ()


def test_a_view_that_is_missing_fails_the_object_alone(
    release: Path, tmp_path: Path, mapped: Path, quick: SimpleNamespace
) -> None:
    (release / "dataset" / "1" / "lat.tif").unlink()
    result = imported(release, tmp_path / "out", "--objects", "1-2", "--map", mapped)
    assert result.exit_code == 3
    assert "failed: xden1k-0001: " in result.stderr
    assert "lat.tif" in result.stderr
