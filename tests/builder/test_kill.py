"""What a rebuild survives: being killed at any moment, a full disk, a second run beside it."""

import gc
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from tests.builder.folders import contents
from tests.disks import full_disk
from tests.waiting import until
from xden1k.errors import DataError
from xden1k.folder import exclusive, place
from xden1k.folder.place import publish, staging
from xden_builder.cli import cli
from xden_builder.phantoms import write_captures
from xden_builder.phantoms.scanner import Scanner
from xden_builder.pipeline.beam import BEAM_NAME
from xden_builder.pipeline.run import build, work_folder
from xden_builder.reconstruct.settings import BuildSettings
from xden_builder.workers import run_each

WRITER = """
import sys, time
from pathlib import Path
from xden1k.folder.place import staging
with staging(Path(sys.argv[1])) as beside:
    (beside / "folder").mkdir()
    print(beside, flush=True)
    time.sleep(1000)
"""
REPLACER = """
import sys
from pathlib import Path
from xden1k.folder.place import publish, staging
out = Path(sys.argv[1])
for number in range(40):
    with staging(out) as beside:
        (beside / "folder").mkdir()
        (beside / "folder" / "number").write_text(str(number))
        publish(beside / "folder", out)
"""

CATEGORIES = ["bolt", "hammer", "mug"]
"""The first two have the smaller files."""
pytestmark = pytest.mark.usefixtures("in_this_process")


@pytest.fixture(scope="module")
def captures(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("captures") / "captures"
    write_captures(root, len(CATEGORIES), 3, size=64, ideal=True, categories=CATEGORIES)
    return root


@pytest.fixture(scope="module")
def built(captures, in_this_process) -> Path:
    """What an undisturbed run makes of them."""
    out = captures.with_name("dataset")
    build(captures, out, BuildSettings(), workers=2)
    return out


def start(*command: object) -> subprocess.Popen[str]:
    return subprocess.Popen(  # noqa: S603
        [sys.executable, *map(str, command)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )


def start_run(captures: Path, out: Path) -> subprocess.Popen[str]:
    cli = "from xden_builder.cli import cli; cli()"
    return start("-c", cli, "run", captures, "--out", out, "--workers", 2)


def wrong_files(root: Path) -> list[str]:
    """Files of a dataset folder that do not match its checksums, or that it lacks."""
    lines = (root / "SHA256SUMS").read_text().splitlines()
    sums = dict(reversed(line.split("  ")) for line in lines)
    found = {name: hashlib.sha256(data).hexdigest() for name, data in contents(root).items()}
    del found["SHA256SUMS"]
    return sorted(name for name, _ in found.items() ^ sums.items())


def assert_whole_or_absent(out: Path) -> None:
    before = None
    try:
        before = out.stat().st_ino
        wrong = wrong_files(out)
        assert out.stat().st_ino != before or not wrong
    except FileNotFoundError:  # absent, or replaced while it was read
        assert not out.exists() or out.stat().st_ino != before


@pytest.mark.slow
def test_twenty_kills_lose_nothing_and_show_nothing_half_written(captures, built, tmp_path):
    out, chance = tmp_path / "dataset", np.random.default_rng(20)
    began = time.monotonic()
    start_run(captures, out).communicate()
    whole_run_s = time.monotonic() - began
    killed = 0
    for round_ in count():
        if killed == 20:
            break
        for path in chance.permutation(sorted(work_folder(out).glob("*.h5")))[:2]:
            path.unlink()
        if chance.random() < 0.5:
            shutil.rmtree(out, ignore_errors=True)
        with start_run(captures, out) as run:
            if round_ % 4 == 0:  # while the folder is being put together
                moment = time.monotonic() + 3 * whole_run_s
                while time.monotonic() < moment and run.poll() is None:
                    if any(tmp_path.glob(".dataset.*/folder")):
                        moment = min(moment, time.monotonic() + chance.uniform(0, 0.2))
            else:
                moment = time.monotonic() + chance.uniform(0, whole_run_s)
                while time.monotonic() < moment and run.poll() is None:
                    assert_whole_or_absent(out)
            killed += run.poll() is None
            run.kill()
        assert_whole_or_absent(out)
    with start_run(captures, out) as run:
        stdout, stderr = run.communicate()
    assert run.returncode == 0, stderr
    assert " 0 failed" in stdout.splitlines()[-1]
    assert contents(out) == contents(built)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["dataset", "dataset.work"]
    left = {path.name for path in work_folder(out).iterdir()}
    assert left == {path.name for path in work_folder(built).iterdir()}


@pytest.mark.slow
def test_kills_while_the_filter_of_the_folder_is_sought_change_no_byte_of_it(tmp_path):
    captures, whole, out = (tmp_path / name for name in ("captures", "whole", "dataset"))
    tube = Scanner.realistic()
    write_captures(captures, len(CATEGORIES), 3, size=64, categories=CATEGORIES, scanner=tube)
    build(captures, whole, BuildSettings(), workers=2)
    found = (work_folder(whole) / BEAM_NAME).read_bytes()
    assert any(each["clues"] for each in json.loads(found)["objects"].values())
    chance, killed = np.random.default_rng(14), 0
    for round_ in range(5):
        (work_folder(out) / BEAM_NAME).unlink(missing_ok=True)
        with start_run(captures, out) as run:
            until(lambda: work_folder(out).is_dir() or run.poll() is not None)
            time.sleep(round_ * chance.uniform(0, 0.75))  # the first right at the beginning
            killed += run.poll() is None and not (work_folder(out) / BEAM_NAME).exists()
            run.kill()
        left = work_folder(out) / BEAM_NAME
        assert not left.exists() or left.read_bytes() == found
    assert killed, "no run was killed before its filter was found"
    build(captures, out, BuildSettings(), workers=2)
    assert (work_folder(out) / BEAM_NAME).read_bytes() == found
    assert contents(out) == contents(whole)


@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # a full disk takes no close
@pytest.mark.parametrize(
    "what", [pytest.param("a_work_file", marks=pytest.mark.slow), "the_dataset"]
)
@pytest.mark.parametrize("pool", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_full_disk_is_one_line_and_a_rerun_completes(
    captures, built, tmp_path, monkeypatch, what, pool
):
    if pool:
        monkeypatch.setattr("xden_builder.pipeline.run.run_each", run_each)
    out = tmp_path / "dataset"
    largest = max(path.stat().st_size for path in work_folder(built).glob("*.h5"))
    limit = largest // 2 if what == "a_work_file" else largest + 1000
    with full_disk(limit):
        ran = CliRunner().invoke(cli, ["run", str(captures), "--out", str(out), "--workers", "1"])
    gc.collect()
    assert ran.exit_code == 1
    (line,) = [text for text in ran.stderr.splitlines() if text]
    told = "h5 takes about" if what == "a_work_file" else "the dataset dataset takes about"
    assert told in line
    assert " MB are free; make room and run again, finished objects are kept" in line
    assert not out.exists()
    kept = len(list(work_folder(out).glob("*.seal")))
    most = len(CATEGORIES)
    assert 0 < kept < most if what == "a_work_file" else kept == most
    report = build(captures, out, BuildSettings(), workers=2)
    assert (report.count("kept"), report.count("failed")) == (kept, 0)
    assert contents(out) == contents(built)


def test_a_second_run_of_the_same_dataset_is_refused(captures, tmp_path):
    work = work_folder(tmp_path / "out")
    work.mkdir()
    with exclusive(work / "run.lock"), pytest.raises(DataError, match="another run is making it"):
        build(captures, tmp_path / "out", BuildSettings(), workers=1)


def test_unfinished_work_files_of_killed_runs_are_cleared_away(captures, built, tmp_path):
    shutil.copytree(work_folder(built), work_folder(tmp_path / "dataset"))
    (work_folder(tmp_path / "dataset") / "mug-0001.h5.1234.partial").write_bytes(b"half")
    build(captures, tmp_path / "dataset", BuildSettings(), workers=1)
    assert not list(work_folder(tmp_path / "dataset").glob("*.partial"))


@pytest.fixture
def writer(tmp_path):
    """A process that stages a folder for ``tmp_path / "out"``, and the folder."""
    with start("-c", WRITER, tmp_path / "out") as process:
        yield process, Path(process.stdout.readline().strip())
        process.kill()


@pytest.mark.slow
def test_what_a_writer_left_is_removed_by_the_next_once_it_is_killed(writer, tmp_path):
    process, beside = writer
    with staging(tmp_path / "out") as other:
        assert beside.exists()
        assert other != beside
    process.kill()
    process.wait()
    assert beside.exists()
    with staging(tmp_path / "out"):
        assert not beside.exists()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_a_killed_writer_had_put_aside_comes_back(writer, tmp_path):
    process, beside = writer
    (beside / "old").mkdir()
    (beside / "old" / "data").write_text("precious")
    process.kill()
    process.wait()
    with staging(tmp_path / "out"):
        assert (tmp_path / "out" / "data").read_text() == "precious"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize(
    "name", [".out.backup", ".out.2024abcd.partial", ".out.old", "out.partial"]
)
def test_hidden_folders_of_others_are_left_alone(tmp_path, name):
    (tmp_path / name).mkdir()
    (tmp_path / name / "thesis.tex").write_text("years of work")
    with staging(tmp_path / "out"):
        pass
    assert (tmp_path / name / "thesis.tex").exists()


def replace(out: Path, text: str) -> None:
    with staging(out) as beside:
        (beside / "folder").mkdir()
        (beside / "folder" / "text").write_text(text)
        publish(beside / "folder", out)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux exchanges two folders in one step")
def test_a_folder_that_is_replaced_is_never_absent(tmp_path):
    replace(tmp_path / "out", "first")
    looks = 0
    with start("-c", REPLACER, tmp_path / "out") as process:
        while process.poll() is None:
            assert (tmp_path / "out").exists()
            looks += 1
    assert looks > 100
    assert (tmp_path / "out" / "number").read_text() == "39"


def test_where_folders_cannot_be_exchanged_two_renames_replace_one(tmp_path, monkeypatch):
    monkeypatch.setattr(place, "_exchange", lambda *_: False)
    replace(tmp_path / "out", "first")
    replace(tmp_path / "out", "second")
    assert (tmp_path / "out" / "text").read_text() == "second"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_replacement_that_fails_brings_the_older_folder_back(tmp_path, monkeypatch):
    monkeypatch.setattr(place, "_exchange", lambda *_: False)
    replace(tmp_path / "out", "first")
    with staging(tmp_path / "out") as beside, pytest.raises(FileNotFoundError):
        publish(beside / "no such folder", tmp_path / "out")
    assert (tmp_path / "out" / "text").read_text() == "first"
