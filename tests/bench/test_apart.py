"""Methods in a process of their own: what they cannot reach, and what becomes of their ends."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.bench.attacks import ATTACKS, ROOT_NAME
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder, open_folder
from xden1k.predictions import open_predictions
from xden1k.values.modality import Modality, ModalityError
from xden_bench.methods.apart.answers import SHOWN, Answers
from xden_bench.methods.apart.channel import write_pickle
from xden_bench.methods.apart.process import INTERRUPTED, Job
from xden_bench.methods.apart.runner import CALL, Method, run_apart
from xden_bench.methods.running import Options, Report, run_predictor
from xden_bench.methods.scope import Task

Run = Callable[[str, Path], Report]


@pytest.fixture
def run(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[str, Path], Report]:
    """Run an installed method of tests/bench/attacks.py by the name of its class."""
    root = tmp_path / ROOT_NAME
    shutil.copytree(dataset, root)
    site = tmp_path / "site"
    metadata = site / "spies-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: spies\nVersion: 1.0\n")
    names = ("Spy", "Crashing", "Dying", "Understating")
    lines = (f"{name} = tests.bench.attacks:{name}" for name in names)
    (metadata / "entry_points.txt").write_text("\n".join(["[xden1k.predictors]", *lines]))
    monkeypatch.syspath_prepend(site)
    monkeypatch.syspath_prepend(Path(__file__).parents[2])
    monkeypatch.setenv("XDEN1K_ROOT", str(root))

    def call(name: str, told: Path) -> Report:
        method = Method(name, {"told": str(told)})
        options = Options(command=f"xden-bench baseline {name} --root {root}")
        out = tmp_path / "out.npz"
        return run_apart(method, method.load(), open_folder(root), "test", out, options)

    return call


@pytest.fixture(autouse=True)
def methods_looked_for_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Undo what keeps other tests fast: what is installed changes here."""
    from importlib.metadata import entry_points

    from xden_bench.methods import baseline

    monkeypatch.setattr(baseline, "entry_points", entry_points)


def test_a_method_finds_no_answer_in_its_process_whatever_it_tries(
    run: Run, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    report = run("Spy", tmp_path / "told.json")
    outcomes = json.loads((tmp_path / "told.json").read_text())
    assert outcomes.pop("learned") == "3"
    assert outcomes.keys() == ATTACKS.keys()
    found = {name: said for name, said in outcomes.items() if said.startswith("found")}
    assert not found
    assert report.meta.inputs == ("mesh",)
    assert ROOT_NAME in report.meta.command
    said = capfd.readouterr()
    assert said.out == ""
    assert "this line must not end in the pipe" in said.err


@pytest.mark.slow
def test_a_method_apart_predicts_what_it_predicts_here(
    run: Run, folder: DatasetFolder, tmp_path: Path
) -> None:
    run("Spy", tmp_path / "told.json")
    method = Method("Spy", {"told": str(tmp_path / "told.json")})
    run_predictor(method.load(), folder, "test", tmp_path / "here.npz")
    with (
        open_predictions(tmp_path / "out.npz") as one,
        open_predictions(tmp_path / "here.npz") as other,
    ):
        assert one.ids == other.ids
        assert all((one.read(name) == other.read(name)).all() for name in one.ids)


@pytest.mark.slow
def test_a_fault_of_a_method_is_shown_and_told_in_one_line(
    run: Run, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(DataError, match="of the method Crashing ended with exit code 1"):
        run("Crashing", tmp_path / "told")
    assert "ZeroDivisionError: a fault of the method" in capfd.readouterr().err
    assert not (tmp_path / "out.npz").exists()


@pytest.mark.slow
def test_a_killed_method_goes_on_where_it_stopped(run: Run, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="of the method Dying ended by signal 9"):
        run("Dying", tmp_path / "told")
    assert run("Dying", tmp_path / "told").continued == 2


@pytest.mark.slow
def test_a_method_whose_caller_was_killed_ends_without_a_word(
    folder: DatasetFolder, tmp_path: Path
) -> None:
    task = Task.of(folder, "test", None, 0)
    job = Job("water", {}, task, Options(), tmp_path / "out.npz", iter)
    words = (sys.executable, "-c", CALL)
    streams = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(words, **streams) as process:  # noqa: S603
        process.stdout.close()
        write_pickle(process.stdin, sys.path)
        write_pickle(process.stdin, job)
        assert process.stderr.read() == b""
    assert process.returncode == INTERRUPTED


def test_a_file_that_declares_less_than_was_shown_is_refused(run: Run, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"was shown \['mesh', 'parts'\], and its file says"):
        run("Understating", tmp_path / "told")
    assert not (tmp_path / "out.npz").exists()


@pytest.fixture
def answers(folder: DatasetFolder) -> Answers:
    task = Task.of(folder, "test")
    return Answers(folder, task, Modality.GEOMETRY, Options(command="again"))


def test_what_was_declared_is_answered(answers: Answers, folder: DatasetFolder) -> None:
    assert answers("sample", "bar-0002", "envelope").shape == (64, 64, 64)
    assert answers("sample", "bar-0001", "envelope").shape == (64, 64, 64)
    assert answers("density", "bar-0001").shape == (64, 64, 64)
    assert answers("truth", "bar-0001").mass_g == folder.object("bar-0001").mass_g
    assert answers("command") == "again"


def test_training_objects_that_were_not_drawn_are_not_shown(folder: DatasetFolder) -> None:
    task = Task.of(folder, "test", train_objects=1)
    answers = Answers(folder, task, Modality.GEOMETRY, Options())
    assert answers("truth", *task.train_ids).category
    for object_id in set(folder.ids("train")) - set(task.train_ids):
        with pytest.raises(DataError, match="the method asked for what it is not shown"):
            answers("truth", object_id)


@pytest.mark.parametrize("name", sorted({*SHOWN} - {"envelope", "outer_mesh", "origin_cm"}))
def test_what_was_not_declared_is_not_answered(answers: Answers, name: str) -> None:
    if name == "voxel_size_cm":
        assert answers("sample", "bar-0002", name) > 0
        return
    with pytest.raises(ModalityError, match=f"bar-0002: {name} needs the modality"):
        answers("sample", "bar-0002", name)


@pytest.mark.parametrize(
    "words",
    [
        ("truth", "bar-0002"),
        ("density", "bar-0002"),
        ("truth", "cube-0002"),
        ("sample", "cube-0002", "envelope"),
        ("sample", "bar-0002", "folder"),
        ("sample", "bar-0002", "_object"),
        ("sample", "../bar", "envelope"),
        ("row", "bar-0001"),
    ],
)
def test_what_a_forged_question_asks_for_is_refused(
    answers: Answers, words: tuple[str, ...]
) -> None:
    with pytest.raises(DataError, match="the method asked for what it is not shown"):
        answers(*words)
