"""``xden`` on the command line."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from tests import phantoms
from xden1k.access import hub
from xden1k.cli import cli
from xden1k.errors import DataError
from xden1k.folder import write_folder

MANUAL = hub.SAMPLE.parent / "README.md"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("dataset") / "folder"
    write_folder(phantoms.objects(), out, version="1.0.0", builder="test 1")
    return out


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


def test_info_says_how_much_of_what_from_where(folder: Path) -> None:
    text = run("info", "--root", folder).stdout
    for words in ("train 2, val 1, test 3", "phantom 6", "none 1, truth 8", "cube 2", "test 1"):
        assert words in text
    values = json.loads(run("info", "--root", folder, "--json").stdout)
    assert values["splits"] == {"train": 2, "val": 1, "test": 3}
    assert values["categories"] == {"bar": 2, "cube": 2, "filled": 1, "hollow": 1}


def test_info_finds_the_folder_by_the_environment(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDEN1K_ROOT", str(folder))
    assert f"{folder}\n" in run("info").stdout


def test_info_names_a_shard_that_is_cut_short_or_missing(folder: Path, tmp_path: Path) -> None:
    broken = Path(shutil.copytree(folder, tmp_path / "broken"))
    shard = broken / "data/train-00000-of-00001.parquet"
    shard.write_bytes(shard.read_bytes()[:99])
    assert f"Error: {shard}: 99 bytes, the manifest says " in run("info", "--root", broken).stderr
    shard.unlink()
    result = run("info", "--root", broken)
    assert (result.exit_code, result.stderr.count("\n")) == (1, 1)
    assert f"Error: {shard} is missing" in result.stderr


def test_show_writes_a_picture_and_prints_the_parts(folder: Path, tmp_path: Path) -> None:
    picture = tmp_path / "bar.png"
    result = run("show", "bar-0002", "--root", folder, "-o", picture)
    assert result.exit_code == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "bar-0002: bar, 72 g, phantom, test split" in result.stdout
    assert "polypropylene" in result.stdout


def test_show_gives_json_without_not_a_number(folder: Path, tmp_path: Path) -> None:
    result = run("show", "cube-0002", "--root", folder, "-o", tmp_path / "cube.png", "--json")
    values = json.loads(result.stdout, parse_constant=pytest.fail)
    assert values["mass_g"] is None
    assert values["parts"][0]["density_g_cm3"] is None
    assert values["parts"][0]["lac_per_cm"] == pytest.approx(1.25 * 0.34)


def test_show_of_a_missing_object_is_one_line_and_exit_code_1(folder: Path) -> None:
    result = run("show", "bar-9", "--root", folder)
    assert result.exit_code == 1
    assert result.stderr.startswith("Error: ")
    assert "did you mean bar-0002 or bar-0001?" in result.stderr
    assert result.stderr.count("\n") == 1


def test_verify_of_a_sound_folder_says_so(folder: Path) -> None:
    result = run("verify", folder)
    assert (result.exit_code, result.stderr) == (0, "")
    assert "6 objects in 6 files, all sound" in result.stdout


def test_verify_lists_every_problem_and_exits_with_1(folder: Path, tmp_path: Path) -> None:
    broken = Path(shutil.copytree(folder, tmp_path / "broken"))
    (broken / "eval.yaml").unlink()
    shard = broken / "data/train-00000-of-00001.parquet"
    shard.write_bytes(shard.read_bytes()[:-1])
    result = run("verify", broken)
    assert result.exit_code == 1
    assert "eval.yaml: missing" in result.stdout
    assert "not a whole Parquet file" in result.stdout
    values = json.loads(run("verify", broken, "--json").stdout)
    assert len(values["problems"]) == 3


def test_verify_of_something_else_is_one_line(tmp_path: Path) -> None:
    result = run("verify", tmp_path)
    assert result.exit_code == 1
    assert result.stderr == f"Error: {tmp_path}: not a dataset folder: no manifest.json\n"
    assert run("verify", tmp_path / "nowhere").exit_code == 2


def test_download_passes_its_options_and_prints_the_folder(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    monkeypatch.setattr(hub, "download", lambda *args: asked.append(args) or folder)
    assert run("download", "--repo-id", "me/mine", "--revision", "v2").stdout == f"{folder}\n"
    values = json.loads(run("download", "--json").stdout)
    assert values == {"root": str(folder), "version": "1.0.0"}
    assert asked == [("me/mine", "v2"), (hub.REPO_ID, None)]


def test_download_that_fails_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> Path:
        raise DataError("cannot reach the Hub")

    monkeypatch.setattr(hub, "download", fail)
    result = run("download")
    assert (result.exit_code, result.stderr) == (1, "Error: cannot reach the Hub\n")


@pytest.mark.parametrize("name", sorted(cli.commands))
def test_every_command_has_help_an_example_and_a_place_in_the_manual(name: str) -> None:
    text = run(name, "--help").stdout
    assert f"Example: xden {name}" in text
    assert "--json" in text
    assert f"xden {name}" in MANUAL.read_text(encoding="utf-8")


def test_help_does_not_wait_for_heavy_libraries() -> None:
    code = (
        "import sys; from xden1k.cli import cli; "
        "print([n for n in ('torch', 'datasets', 'numpy', 'pyarrow', 'trimesh', 'matplotlib') "
        "if n in sys.modules])"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)  # noqa: S603
    assert ran.stdout == "[]\n"
