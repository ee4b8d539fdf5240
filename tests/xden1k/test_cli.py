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
from xden1k.folder import open_folder, write_folder

MANUAL = hub.SAMPLE.parents[1] / "docs" / "manual" / "look.md"


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
    assert values["unpacked_bytes"] > 6 * 128**3 > values["bytes"]
    assert values["categories"] == {"bar": 2, "cube": 2, "filled": 1, "hollow": 1}


def test_info_finds_the_folder_by_the_environment(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDEN1K_ROOT", str(folder))
    assert f"{folder}\n" in run("info").stdout


def test_info_names_a_shard_that_is_cut_short_or_missing(folder: Path, tmp_path: Path) -> None:
    broken = Path(shutil.copytree(folder, tmp_path / "broken"))
    shard = broken / "data/train-00000-of-00002.parquet"
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


def test_show_gives_json_without_not_a_number_and_draws_only_what_is_asked_for(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = run("show", "cube-0002", "--root", folder, "--json").stdout
    values = json.loads(text, parse_constant=pytest.fail)
    assert values["mass_g"] is None
    assert values["parts"][0]["density_g_cm3"] is None
    assert values["parts"][0]["lac_per_cm"] == pytest.approx(1.25 * 0.34)
    assert (
        values["parts"][0]["label_voxels"] == open_folder(folder).object("cube-0002").labels.sum()
    )
    assert "picture" not in values
    assert list(tmp_path.iterdir()) == []
    text = run("show", "cube-0002", "--root", folder, "--json", "-o", "cube.png").stdout
    assert json.loads(text) == values | {"picture": "cube.png"}
    assert (tmp_path / "cube.png").is_file()


def test_list_says_what_there_is_and_takes_a_choice(folder: Path) -> None:
    lines = run("list", "--root", folder).stdout.splitlines()
    assert [line.split()[0] for line in lines] == [
        *("object_id", "-----------", "bar-0001", "cube-0001", "cube-0002"),
        *("bar-0002", "filled-0001", "hollow-0001"),
    ]
    for options, ids in {
        ("--split", "test"): ["bar-0002", "filled-0001", "hollow-0001"],
        ("--category", "bar", "--split", "train"): ["bar-0001"],
        ("--flag", "remark"): ["cube-0001"],
        ("--flag", "remark", "--split", "val"): [],
    }.items():
        values = json.loads(run("list", "--root", folder, "--json", *options).stdout)
        assert [row["object_id"] for row in values["objects"]] == ids
    row = json.loads(run("list", "--root", folder, "--json", "--split", "val").stdout)["objects"][0]
    assert row == {
        "object_id": "cube-0002",
        "category": "cube",
        "split": "val",
        "source": "phantom",
        "mass_g": None,
        "flags": [],
    }


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--category", "barr"], "no category 'barr' among 4; did you mean bar?"),
        (["--flag", "remarks"], "no flag 'remarks' among 1; did you mean remark?"),
        (["--split", "validation"], "there are ['train', 'val', 'test']: validation is called val"),
    ],
)
def test_list_names_what_is_nearest(folder: Path, options: list[str], said: str) -> None:
    result = run("list", "--root", folder, *options)
    assert (result.exit_code, result.stderr.count("\n")) == (1, 1)
    assert said in result.stderr


def test_gallery_draws_a_choice(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "sheet.png"
    result = run("gallery", "--root", folder, "--category", "bar", "-o", out, "--json")
    assert json.loads(result.stdout) == {"objects": ["bar-0001", "bar-0002"], "picture": str(out)}
    assert out.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_a_reader_who_stops_early_is_told_nothing(folder: Path) -> None:
    program = [sys.executable, "-c", "from xden1k.cli import cli; cli()", "list"]
    with subprocess.Popen(  # noqa: S603
        [*program, "--root", str(folder)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as ran:
        assert ran.stdout is not None
        assert ran.stderr is not None
        ran.stdout.close()
        assert ran.stderr.read() == b""


def test_a_folder_that_is_not_there_is_not_said_to_lack_a_manifest(tmp_path: Path) -> None:
    said = run("info", "--root", tmp_path / "nowhere").stderr
    assert said.endswith("is not a dataset folder: there is no such folder\n")
    with pytest.raises(DataError, match=r"nowhere: not a dataset folder: there is no such folder"):
        open_folder(tmp_path / "nowhere")


def test_show_of_a_missing_object_is_one_line_and_exit_code_1(folder: Path) -> None:
    result = run("show", "bar-9", "--root", folder)
    assert result.exit_code == 1
    assert result.stderr.startswith("Error: ")
    assert "did you mean bar-0002 or bar-0001?" in result.stderr
    assert result.stderr.count("\n") == 1


def test_verify_of_a_sound_folder_says_so(folder: Path) -> None:
    result = run("verify", folder)
    assert (result.exit_code, result.stderr) == (0, "")
    assert "6 objects in 9 files, all sound" in result.stdout


def test_verify_lists_every_problem_and_exits_with_1(folder: Path, tmp_path: Path) -> None:
    broken = Path(shutil.copytree(folder, tmp_path / "broken"))
    (broken / "eval.yaml").unlink()
    shard = broken / "data/train-00000-of-00002.parquet"
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
    nowhere = run("verify", tmp_path / "nowhere")
    assert (nowhere.exit_code, nowhere.stderr.partition(": not")[2]) == (
        1,
        " a dataset folder: there is no such folder\n",
    )


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
