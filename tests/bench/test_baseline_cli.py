"""xden-bench baseline: settings, budgets, fits, interruptions and oracles as a user meets them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from tests.bench.interrupted import Storing
from xden_bench.cli import cli
from xden_bench.methods import baseline

Run = Callable[..., Result]
METHODS = {
    "counting": "tests.bench.interrupted:Counting",
    "storing": "tests.bench.interrupted:Storing",
    "talking": "tests.bench.interrupted:Talking",
    "part-oracle": "xden_baselines.references:PartOracle",
    "water": "xden_baselines.constant:Water",
    "broken": "no_such_package:Method",
}


@pytest.fixture
def run(dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDEN1K_ROOT", str(dataset))

    def entries(group: str) -> dict[str, EntryPoint]:
        known = METHODS if group == baseline.PREDICTORS else {}
        return {name: EntryPoint(name, value, group) for name, value in known.items()}

    monkeypatch.setattr(baseline, "_entries", entries)
    return lambda *words: CliRunner().invoke(cli, ["baseline", *map(str, words)])


def meta(done: Result) -> dict[str, Any]:
    assert done.exit_code == 0, done.stderr
    return dict(json.loads(done.stdout)["meta"])


def test_a_list_tells_oracles_and_what_does_not_load(run: Run) -> None:
    listed = {one["name"]: one for one in json.loads(run("--list", "--json").stdout)}
    assert listed["part-oracle"]["summary"].startswith("oracle: each part's mean")
    assert listed["broken"]["track"] == "-"
    assert "does not load: No module named" in listed["broken"]["summary"]
    assert listed["water"] == {
        "name": "water",
        "track": "geometry",
        "gives": "densities",
        "summary": "1 g/cm³ in the envelope.",
    }


def test_settings_are_of_jsons_types_and_stand_in_the_command(run: Run) -> None:
    done = run("storing", "--set", "dies_at=9", "--set", "how=raise", "--json")
    assert meta(done)["command"] == ("xden-bench baseline storing --set dies_at=9 --set how=raise")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--set", "rule"), "--set takes KEY=VALUE, each key once, got 'rule'"),
        (("--set", "a=1", "--set", "a=2"), "each key once, got 'a=2'"),
        (("--set", "unknown=1"), "storing has no setting 'unknown'"),
        (("--train-objects", "4"), "must be from 1 to 3, all of the split 'train', got 4"),
        (("--budget", "long"), "a budget must be like 20epochs or 90s, got 'long'"),
        (("--model", "nowhere"), "nowhere: no fit there"),
    ],
)
def test_wrong_options_are_one_line(run: Run, words: tuple[str, ...], message: str) -> None:
    done = run("storing", *words)
    assert done.exit_code == 1
    (line,) = done.stderr.splitlines()
    assert re.search(message, line)


def test_what_was_learned_is_saved_and_loaded(run: Run, tmp_path: Path) -> None:
    made = meta(run("storing", "--seed", 4, "--budget", "2epochs", "--save", "fit", "--json"))
    again = meta(run("storing", "--model", "fit", "--out", "again.npz", "--json"))
    assert (made["seed"], again["seed"]) == (4, 4)
    assert (tmp_path / "fit" / "fit.json").is_file()
    assert again["command"] == "xden-bench baseline storing --model fit --out again.npz"


def test_what_learned_from_some_objects_has_a_row_of_its_own(run: Run) -> None:
    some = meta(run("storing", "--train-objects", 2, "--json"))
    assert some["method"] == "storing (2 objects)"
    assert some["command"] == "xden-bench baseline storing --train-objects 2"


def test_an_interrupted_command_goes_on_when_it_is_given_again(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(Storing.__init__, "__defaults__", (2, "raise"))
        assert run("storing").exit_code == 1
    assert Path(".storing.npz.partial").is_dir()
    assert "continued: 2 objects were predicted before" in run("storing").stdout
    assert not Path(".storing.npz.partial").exists()


def test_the_mass_by_its_own_rule_is_printed(run: Run) -> None:
    assert "mass by its own rule, never scored: median 7 g" in run("talking").stdout
    found = json.loads(run("talking", "--json").stdout)
    assert set(found["mass_native_g"].values()) == {7.0}


@pytest.mark.slow
def test_an_oracle_is_entered_without_a_rank_and_the_row_says_why(run: Run, tmp_path: Path) -> None:
    for name in ("water", "part-oracle"):
        assert run(name).exit_code == 0
        submitted = CliRunner().invoke(cli, ["submit", f"{name}.npz"])
        assert submitted.exit_code == 0, submitted.stderr
    assert CliRunner().invoke(cli, ["leaderboard"]).exit_code == 0
    text = (tmp_path / "LEADERBOARD.md").read_text()
    assert re.search(r"^\|        \| part-oracle \| 0\.000 ", text, re.MULTILINE)
    assert "parts, truth" in text
    assert "not ranked: oracle: it is told what only the truth tells" in text
