"""Entries whose numbers come out again, and such whose do not."""

from __future__ import annotations

import copy
import datetime
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest

from xden1k.errors import DataError
from xden_bench.commands.methods import baseline, run_again
from xden_bench.commands.shared import parse_command
from xden_bench.entries.result import entry_of, object_columns
from xden_bench.entries.verification import check_reference, verify
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import Score, score


@pytest.fixture
def scored(submission: Callable[..., Path], reference: Reference) -> Score:
    return score(submission(lambda _, grid: 1.25 * grid), reference, load_protocol())


@pytest.fixture
def entry(scored: Score, reference: Reference) -> dict[str, Any]:
    made = entry_of(scored, reference, command="", date=datetime.date(2025, 12, 10))
    return made | {"object_scores": object_columns(scored)}


def test_the_same_submission_gives_every_number_again(
    entry: dict[str, Any], scored: Score, reference: Reference
) -> None:
    found = verify(entry, scored, reference)
    assert found.deviations == ()
    assert found.same_file
    assert found.largest_relative_difference == 0.0
    # 10 metrics by both means, over all, four categories and one size; and by object
    assert found.numbers > 10 * 2 * 6 + 10 * 4


def moved(entry: dict[str, Any], share: float) -> dict[str, Any]:
    made = copy.deepcopy(entry)
    made["metrics"]["mass_mape"]["mean"] *= 1 + share
    return made


def test_what_another_machine_may_change_is_no_deviation(
    entry: dict[str, Any], scored: Score, reference: Reference
) -> None:
    found = verify(moved(entry, 8e-6), scored, reference)
    assert found.deviations == ()
    assert found.largest_relative_difference == pytest.approx(8e-6, rel=0.01)
    (one,) = verify(moved(entry, 8e-6), scored, reference, tolerance=1e-6).deviations
    assert one.where == "metrics.mass_mape.mean"


def edit(entry: dict[str, Any], *path: str | int, to: Any) -> dict[str, Any]:
    made = copy.deepcopy(entry)
    place = made
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = to
    return made


@pytest.mark.parametrize(
    ("path", "to", "where"),
    [
        (("metrics", "com_l1_cm", "macro_mean"), 9.0, "metrics.com_l1_cm.macro_mean"),
        (("object_scores", "object_id", 0), "x", "object_scores.object_id[0]"),
        (("metrics", "better"), {"mean": 0.0}, "metrics.better.mean"),
        *(
            pytest.param(*one, marks=pytest.mark.slow)
            for one in (
                (("by_size", "under 8 cm", "n_objects"), 5, "by_size.under 8 cm.n_objects"),
                (("object_scores", "mass_mape", 2), 0.1, "object_scores.mass_mape[2]"),
                (("track",), "xray", "track"),
            )
        ),
    ],
)
def test_each_number_and_text_is_compared(
    entry: dict[str, Any],
    scored: Score,
    reference: Reference,
    path: tuple[str | int, ...],
    to: Any,
    where: str,
) -> None:
    (one,) = verify(edit(entry, *path, to=to), scored, reference).deviations
    assert one.where == where


@pytest.mark.parametrize(
    ("path", "to", "message"),
    [
        (("dataset", "manifest_sha256"), "0" * 64, "the entry is of manifest '0000"),
        (("dataset", "split"), "val", "the entry is of split 'val', here is 'test'"),
        (("metric_version",), 0, "the entry is of metric version 0, here is 1"),
    ],
)
def test_an_entry_of_other_data_or_code_is_not_verified(
    entry: dict[str, Any], reference: Reference, path: tuple[str, ...], to: Any, message: str
) -> None:
    check_reference(entry, reference)
    with pytest.raises(DataError, match=message):
        check_reference(edit(entry, *path, to=to), reference)


def test_a_row_is_made_again_to_the_bit_by_its_printed_command(
    reference: Reference, tmp_path: Path
) -> None:
    command = "xden-bench baseline train-median --seed 3 --out elsewhere/x.npz --root nowhere"
    command += " --save elsewhere/fit"
    files = [tmp_path / name for name in ("a.npz", "b.npz")]
    for path in files:
        meta = run_again(command, reference.folder, path)
        assert (meta.method, meta.seed, meta.command) == ("train-median", 3, command)
    one, other = (dict(np.load(path)) for path in files)
    assert one.keys() == other.keys()
    for name in one.keys() - {"__meta__"}:  # which tells how long it took
        assert one[name].tobytes() == other[name].tobytes(), name
    assert not (tmp_path / "elsewhere").exists()


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("", "the command must be `xden-bench baseline"),
        ("python predict.py", "the command must be `xden-bench baseline ...`, got 'python"),
        ("xden-bench submit x.npz", "the command must be `xden-bench baseline"),
        ("xden-bench baseline water; touch hacked", "Got unexpected extra argument"),
        ("xden-bench baseline water && touch hacked", "Got unexpected extra argument"),
        ("xden-bench baseline $(touch hacked)", "Got unexpected extra argument"),
        ("xden-bench baseline `touch`", "no method '`touch`' is installed"),
        ("xden-bench baseline water --exec x", "No such option"),
        ("xden-bench baseline 'water", "no command can be read from"),
        ("xden-bench baseline --help", "the command must be"),
        ("xden-bench baseline --list", "Give the NAME of a method"),
        ("xden-bench baseline root", "The name root and the option --from go together"),
        ("xden-bench baseline root --from nowhere", "nowhere: not a dataset folder"),
    ],
)
def test_no_other_command_is_run(
    reference: Reference,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DataError, match=re.escape(message)):
        run_again(command, reference.folder, tmp_path / "x.npz")
    assert list(tmp_path.iterdir()) == []


def test_a_printed_command_is_parsed_as_the_command_itself_does() -> None:
    assert isinstance(baseline, click.Command)
    found = parse_command("xden-bench baseline water --target apparent_density", baseline)
    assert (found["name"], found["target"], found["seed"]) == ("water", "apparent_density", 0)
