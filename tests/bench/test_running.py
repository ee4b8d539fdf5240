"""Runs that are interrupted, fits that are kept, and what a submission says of its run."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.bench.interrupted import Counting, Storing, Talking
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder, exclusive
from xden1k.predictions import MAX_TEXT, open_predictions
from xden1k.predictor import Budget, Prediction, SampleView
from xden1k.values.modality import Modality
from xden_bench.methods.baseline import find_predictor
from xden_bench.methods.fits import FIT_FILE, read_fit
from xden_bench.methods.partial import LOCK_NAME
from xden_bench.methods.running import Options, run_predictor
from xden_bench.methods.scope import Task

KINDS = [Counting, Storing]


def grids(path: Path) -> dict[str, bytes]:
    with np.load(path) as arrays:
        return {name: arrays[name].tobytes() for name in arrays if name != "__meta__"}


def interrupted(method: Any, folder: DatasetFolder, out: Path, **options: Any) -> None:
    with pytest.raises(KeyboardInterrupt):
        run_predictor(method, folder, "test", out, Options(**options))


@pytest.mark.parametrize("kind", KINDS)
def test_an_interrupted_run_goes_on_where_it_stopped(
    folder: DatasetFolder, tmp_path: Path, kind: type
) -> None:
    run_predictor(kind(), folder, "test", tmp_path / "whole.npz")
    out = tmp_path / "out.npz"
    interrupted(kind(dies_at=3), folder, out)
    assert not out.exists()
    again = kind()
    assert run_predictor(again, folder, "test", out).continued == 3
    assert again.asked == list(folder.ids("test")[3:])
    assert again.fits == (0 if kind is Storing else 1)
    assert grids(out) == grids(tmp_path / "whole.npz")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.npz", "whole.npz"]


@pytest.mark.slow
def test_a_killed_run_goes_on_where_it_stopped(folder: DatasetFolder, tmp_path: Path) -> None:
    out = tmp_path / "out.npz"
    call = f"interrupted.run_and_die({str(folder.root)!r}, {str(out)!r})"
    words = [sys.executable, "-c", f"from tests.bench import interrupted; {call}"]
    root = Path(__file__).parents[2]
    environment = {"PYTHONPATH": f"{root}:{root / 'benchmarks'}"}
    died = subprocess.run(words, cwd=root, env=environment, check=False)  # noqa: S603
    assert died.returncode == -signal.SIGKILL
    again = Storing()
    assert run_predictor(again, folder, "test", out).continued == 2
    assert again.fits == 0
    run_predictor(Storing(), folder, "test", tmp_path / "whole.npz")
    assert grids(out) == grids(tmp_path / "whole.npz")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.npz", "whole.npz"]


class Newer(Storing):
    version = "2"


class Weighted(Storing):
    fingerprint = "b"


class Wider(Storing):
    reads = Modality.GEOMETRY | Modality.CATEGORY


@pytest.mark.parametrize(
    ("method", "options"),
    [
        (Newer, {}),
        (Weighted, {}),
        (Wider, {}),
        (Storing, {"seed": 1}),
        (Storing, {"target": "apparent_density"}),
        (Storing, {"budget": Budget(epochs=2)}),
        (Storing, {"train_objects": 2}),
    ],
)
def test_two_runs_are_never_mixed(
    folder: DatasetFolder, tmp_path: Path, method: type, options: dict[str, Any]
) -> None:
    interrupted(Storing(dies_at=3), folder, tmp_path / "out.npz")
    again = method()
    report = run_predictor(again, folder, "test", tmp_path / "out.npz", Options(**options))
    assert (report.continued, again.fits, len(again.asked)) == (0, 1, 4)


def test_what_was_run_on_another_split_is_not_mixed_in(
    folder: DatasetFolder, tmp_path: Path
) -> None:
    interrupted(Storing(dies_at=3), folder, tmp_path / "out.npz")
    assert run_predictor(Storing(), folder, "train", tmp_path / "out.npz").continued == 0


def test_a_submission_is_written_by_one_process(folder: DatasetFolder, tmp_path: Path) -> None:
    (tmp_path / ".out.npz.partial").mkdir()
    with (
        exclusive(tmp_path / ".out.npz.partial" / LOCK_NAME),
        pytest.raises(DataError, match=r"out\.npz: another process is writing it"),
    ):
        run_predictor(Counting(), folder, "test", tmp_path / "out.npz")


def test_what_a_method_learned_is_kept_and_taken_up(folder: DatasetFolder, tmp_path: Path) -> None:
    save = tmp_path / "deep" / "fit"
    options = Options(seed=5, budget=Budget(epochs=3), save=save)
    method, again = Storing(), Storing()
    run_predictor(method, folder, "test", tmp_path / "one.npz", options)
    assert method.budget == Budget(epochs=3)
    assert read_fit(save).seed == 5
    meta = run_predictor(
        again, folder, "test", tmp_path / "two.npz", Options(seed=0, model=save)
    ).meta
    assert again.fits == 0
    assert grids(tmp_path / "one.npz") == grids(tmp_path / "two.npz")
    assert (meta.seed, meta.training_data, meta.notes) == (5, ("xden1k/train",), "")
    third = Storing()
    run_predictor(third, folder, "test", tmp_path / "three.npz", options)
    assert third.fits == 0


class Listing(DatasetFolder):
    """As much of a dataset folder as a task is made from."""

    manifest = SimpleNamespace(splits={"train": None}, version="1")
    manifest_sha256 = ""

    def __init__(self, train: tuple[str, ...]) -> None:
        self.train = train

    def ids(self, split: str | None = None) -> tuple[str, ...]:
        return self.train if split == "train" else ()


def drawn(ids: Iterable[str], count: int, seed: int) -> tuple[str, ...]:
    return Task.of(Listing(tuple(ids)), "test", count, seed).train_ids


TRAINING = [f"cup-{number:04d}" for number in range(40)]


@given(st.permutations(TRAINING), st.integers(1, 39), st.integers(0, 99))
def test_training_objects_are_drawn_by_the_seed_fewer_among_more(
    ids: list[str], count: int, seed: int
) -> None:
    some = drawn(ids, count, seed)
    assert len(some) == count
    assert list(some) == [one for one in ids if one in some]
    assert set(some) == set(drawn(TRAINING, count, seed))
    assert set(some) < set(drawn(ids, count + 1, seed))


def test_every_training_object_is_drawn_as_often_whatever_else_there_is() -> None:
    times = Counter(one for seed in range(400) for one in drawn(TRAINING, 10, seed))
    assert set(times) == set(TRAINING)
    assert min(times.values()) > 60  # 100 expected, standard deviation 9
    assert max(times.values()) < 140
    without = TRAINING[1:]
    kept = set(drawn(TRAINING, 10, 3)) - {TRAINING[0]}
    assert kept <= set(drawn(without, 10, 3))


def test_some_training_objects_arrive_and_the_row_and_the_fit_say_so(
    folder: DatasetFolder, tmp_path: Path
) -> None:
    method = Storing()
    options = Options(seed=1, train_objects=2, save=tmp_path / "fit")
    meta = run_predictor(method, folder, "test", tmp_path / "out.npz", options).meta
    assert method.learned_from == list(drawn(folder.ids("train"), 2, 1))
    assert (meta.method, meta.notes) == (
        "storing (2 objects)",
        "learned from 2 training objects, drawn by seed 1",
    )
    assert read_fit(tmp_path / "fit").train_objects == 2
    loaded = Options(model=tmp_path / "fit")
    again = run_predictor(Storing(), folder, "test", tmp_path / "again.npz", loaded).meta
    assert (again.method, again.notes) == (meta.method, meta.notes)


def test_a_fit_that_does_not_say_how_many_it_saw_saw_all(
    folder: DatasetFolder, tmp_path: Path
) -> None:
    options = Options(save=tmp_path / "fit")
    run_predictor(Storing(), folder, "test", tmp_path / "out.npz", options)
    path = tmp_path / "fit" / FIT_FILE
    values = json.loads(path.read_text())
    del values["train_objects"]
    path.write_text(json.dumps(values))
    assert read_fit(path.parent).train_objects is None


@pytest.mark.parametrize(
    ("text", "message"),
    [("{", "not JSON"), ("[]", "must be xden-fit"), ('{"schema": "xden-fit/1"}', "with the keys")],
)
def test_a_file_that_is_no_fit_is_refused_by_name(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / FIT_FILE).write_text(text)
    with pytest.raises(DataError, match=f"{FIT_FILE}: .*{message}"):
        read_fit(tmp_path)


@pytest.mark.parametrize(
    ("method", "options", "message"),
    [
        (Talking, {"budget": Budget(epochs=1)}, "talking learns nothing"),
        (Talking, {"save": Path("fit")}, "talking learns nothing"),
        (Talking, {"train_objects": 2}, "talking learns nothing"),
        (Storing, {"model": Path("fit"), "train_objects": 2}, "does not learn"),
        (Storing, {"train_objects": 0}, "must be from 1 to 3, all of the split 'train', got 0"),
        (Storing, {"train_objects": 4}, "must be from 1 to 3, all of the split 'train', got 4"),
        (Storing, {"save": Path("fit"), "train_objects": 2}, "train_objects None, here 2"),
        (Storing, {"model": Path("fit"), "save": Path("other")}, "does not learn"),
        (Storing, {"model": Path("nowhere")}, "nowhere: no fit there"),
        (Newer, {"model": Path("fit")}, r"fit holds the fit of \('storing', '1'"),
        (Newer, {"save": Path("fit")}, "fit holds another fit: version '1', here '2'"),
        (Storing, {"save": Path("fit"), "seed": 1}, "fit holds another fit: seed 0, here 1"),
        (Counting, {"model": Path("fit")}, "counting cannot load"),
        (Counting, {"save": Path("other")}, "counting cannot store"),
    ],
)
def test_a_method_is_not_asked_for_what_it_cannot_do(
    folder: DatasetFolder,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    method: type,
    options: dict[str, Any],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    run_predictor(Storing(), folder, "test", Path("out.npz"), Options(save=Path("fit")))
    before = sorted(path.name for path in tmp_path.iterdir())
    with pytest.raises(DataError, match=message):
        run_predictor(method(), folder, "test", Path("new.npz"), Options(**options))
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_a_method_without_budget_is_given_none(folder: DatasetFolder, tmp_path: Path) -> None:
    options = Options(budget=Budget(seconds=1.0))
    with pytest.raises(DataError, match="train-median takes no budget"):
        run_predictor(find_predictor("train-median"), folder, "test", tmp_path / "out.npz", options)


@pytest.mark.parametrize("text", ["", "20", "epochs", "-1s", "0s", "0epochs", "1e3s", "2 hours"])
def test_a_budget_is_a_positive_number_of_epochs_or_seconds(text: str) -> None:
    with pytest.raises(DataError, match="a budget must be"):
        Budget.parse(text)


@pytest.mark.parametrize("answers", [7, 0])
def test_a_row_that_is_mostly_the_fallbacks_is_refused_with_the_counts(
    folder: DatasetFolder, tmp_path: Path, answers: int
) -> None:
    counts = f"2 of {max(4 * answers, 2)} answers are the fallback's, over 5%"
    with pytest.raises(DataError, match=f"talking: {counts}"):
        run_predictor(Talking(answers), folder, "test", tmp_path / "out.npz")
    assert not (tmp_path / "out.npz").exists()


class Silent(Talking):
    """Its model is silent on some questions about each object."""

    def __init__(self, unanswered: int) -> None:
        super().__init__()
        self.unanswered = unanswered

    def predict(self, sample: SampleView) -> Prediction:
        return replace(super().predict(sample), unanswered=self.unanswered)


def test_a_row_of_a_model_that_is_mostly_silent_is_refused_with_the_counts(
    folder: DatasetFolder, tmp_path: Path
) -> None:
    with pytest.raises(DataError, match="talking: 44 of 80 answers are missing, over 50%"):
        run_predictor(Silent(11), folder, "test", tmp_path / "out.npz")
    assert not (tmp_path / "out.npz").exists()
    notes = run_predictor(Silent(10), folder, "test", tmp_path / "half.npz").meta.notes
    assert "40 of 80 answers missing, on 4 objects" in notes


def test_what_can_be_asked_ahead_is_asked_before_the_first_prediction(
    folder: DatasetFolder, tmp_path: Path
) -> None:
    method = Talking()
    ahead: list[str] = []

    def ask_ahead(samples: Iterator[SampleView]) -> None:
        assert not method.asked
        ahead.extend(one.object_id for one in samples)

    method.ask_ahead = ask_ahead
    run_predictor(method, folder, "test", tmp_path / "out.npz")
    assert ahead == method.asked == list(folder.ids("test"))


def test_the_file_says_what_the_predictions_said(folder: DatasetFolder, tmp_path: Path) -> None:
    report = run_predictor(Talking(), folder, "test", tmp_path / "out.npz")
    assert report.meta.notes == (
        "by heart; model replay:12ab (1 of 4 objects); model replay:34cd (3 of 4 objects); "
        "remembered; "
        "2 of 80 answers by the fallback, on 1 objects; computed on cuda"
    )
    assert report.meta.seconds_per_object is not None
    assert 0 < report.meta.seconds_per_object < 10
    assert report.meta.processor_seconds_per_object is not None
    assert 0 < report.meta.peak_memory_gb < 10
    assert report.mass_native_g == dict.fromkeys(folder.ids("test"), 7.0)
    with open_predictions(tmp_path / "out.npz") as found:
        assert found.meta == report.meta
        for one in found.ids:
            np.testing.assert_allclose(found.read_sd(one), 0.1 * found.read(one), rtol=1e-6)


class Wordy(Talking):
    """Has a long remark on every object, each time another."""

    def predict(self, sample: SampleView) -> Prediction:
        return replace(super().predict(sample), remark=f"{sample.object_id}: " + 300 * "x")


def test_remarks_too_long_for_the_file_do_not_cost_the_run(
    folder: DatasetFolder, tmp_path: Path
) -> None:
    notes = run_predictor(Wordy(), folder, "test", tmp_path / "out.npz").meta.notes
    assert len(notes) == MAX_TEXT
    assert notes.endswith("x…; 2 of 80 answers by the fallback, on 1 objects; computed on cuda")
    with open_predictions(tmp_path / "out.npz") as found:
        assert not found.problems


class Album:
    """Pictures that are words."""

    description = "pictures from an album"

    def __call__(self, folder: DatasetFolder, object_id: str) -> str:
        return object_id


class Looking(Storing):
    name, reads = "looking", Modality.RGB | Modality.GEOMETRY

    def fit(self, train: Any, *, seed: int) -> None:
        self.seen = [one.sample.pictures for one in train]
        super().fit(train, seed=seed)

    def predict(self, sample: Any) -> Any:
        assert sample.pictures == sample.object_id
        return super().predict(sample)


def test_pictures_reach_training_and_test_and_the_row(
    folder: DatasetFolder, tmp_path: Path
) -> None:
    method = Looking()
    options = Options(pictures=Album())
    meta = run_predictor(method, folder, "test", tmp_path / "out.npz", options).meta
    assert method.seen == list(folder.ids("train"))
    assert meta.notes == "pictures from an album"
    assert meta.track == "rgb"
