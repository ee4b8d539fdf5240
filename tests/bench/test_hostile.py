"""Hostile submissions: never a crash, a hang, a full memory or a file where none belongs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.bench.crafting import two_bars
from tests.bench.hostile import CASES, LANDMINE, Sound
from tests.bench.watched import judge_apart
from xden1k.folder import open_folder
from xden_bench.entries.durable import LOCK_NAME
from xden_bench.entries.leaderboard import render
from xden_bench.entries.reading import read_entries
from xden_bench.scoring.reference import Reference

NAMES = [
    pytest.param(name, marks=[pytest.mark.slow] * case.is_variant) for name, case in CASES.items()
]
MOST_SECONDS = 5.0
MOST_MIB = 500.0


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return two_bars(tmp_path_factory.mktemp("hostile") / "dataset")


@pytest.fixture(scope="module")
def sound(dataset: Path) -> Sound:
    reference = Reference(open_folder(dataset), "test")
    meta = {
        "schema": "xden-submission/1",
        "method": "hostile",
        "dataset_revision": "0.1.0",
        "config": "default",
        "split": "test",
        "inputs": ["mesh"],
        "training_data": [],
        "external_data": False,
    }
    grids = {
        key: (np.float32(1.1) * reference.truth(key).density_g_cm3).astype(np.float16)
        for key in reference.ids
    }
    return Sound(meta, grids)


@pytest.fixture(scope="module")
def workplace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the judge runs: its results and its temporary files are in here."""
    return tmp_path_factory.mktemp("judge")


@pytest.fixture(scope="module")
def verdicts(
    sound: Sound,
    workplace: Path,
    dataset: Path,
    tmp_path_factory: pytest.TempPathFactory,
    request: pytest.FixtureRequest,
) -> Mapping[str, dict[str, Any]]:
    """What came of each case, all of them judged by one other process; variants are slow."""
    crafted = tmp_path_factory.mktemp("crafted")
    slow_too = any(one.get_closest_marker("slow") for one in request.session.items)
    names = [name for name, case in CASES.items() if slow_too or not case.is_variant]
    paths = {name: crafted / f"{index:03}.npz" for index, name in enumerate(names)}
    for name, path in paths.items():
        CASES[name].write(sound, path)
    return dict(zip(paths, judge_apart(paths.values(), dataset, workplace), strict=True))


def test_there_are_hundreds() -> None:
    assert len(CASES) > 200


@pytest.mark.parametrize("name", NAMES)
def test_each_is_told_what_is_wrong_with_it(
    verdicts: Mapping[str, dict[str, Any]], name: str
) -> None:
    verdict = verdicts[name]
    assert verdict["crashes"] == []
    assert set(verdict["codes"]) == CASES[name].codes
    assert verdict["seconds"] < MOST_SECONDS
    assert all(len(line) < 500 and line.isprintable() for line in verdict["messages"])


@pytest.mark.parametrize("name", [one for one in NAMES if CASES[one.values[0]].is_refused])
def test_what_is_refused_changes_no_file_and_unpickles_nothing(
    verdicts: Mapping[str, dict[str, Any]], name: str
) -> None:
    verdict = verdicts[name]
    assert verdict["exits"] == [1, 1]
    assert set(verdict["submit"]) == {code for code in verdict["codes"] if code[0] == "E"}
    assert verdict["touched"] == []


@pytest.mark.parametrize("name", [one for one in NAMES if not CASES[one.values[0]].is_refused])
def test_what_only_looks_strange_is_entered_and_changes_nothing_else(
    verdicts: Mapping[str, dict[str, Any]], workplace: Path, name: str
) -> None:
    verdict = verdicts[name]
    assert verdict["exits"] == [0, 0]
    own = (str(workplace / "results"), str(workplace / "scratch"))
    assert verdict["touched"]
    assert [one for one in verdict["touched"] if not one.split(" ", 1)[1].startswith(own)] == []


def test_memory_stays_low(verdicts: Mapping[str, dict[str, Any]]) -> None:
    assert max(one["peak_mib"] for one in verdicts.values()) < MOST_MIB


def every_entry(workplace: Path) -> list[Mapping[str, Any]]:
    """What was entered, each among results of its own."""
    return [one for path in (workplace / "results").iterdir() for one in read_entries(path)]


def test_nothing_that_is_refused_is_entered_and_no_trap_goes_off(
    verdicts: Mapping[str, dict[str, Any]], workplace: Path
) -> None:
    places = (path for path in workplace.rglob("*") if path.name != LOCK_NAME)
    files = [path for path in places if path.is_file()]
    assert not [path for path in files if path.name == LANDMINE]
    assert {path.suffix for path in files} == {".json", ".npz", ".parquet"}
    entered = sum(not CASES[name].is_refused for name in verdicts)
    assert len(files) == 3 * entered == 3 * len(every_entry(workplace))


def test_markup_in_an_entry_stays_text_on_the_leaderboard(
    verdicts: Mapping[str, dict[str, Any]], workplace: Path
) -> None:
    page = render(every_entry(workplace))
    assert "alert(1)" in page
    assert not re.search(r"(?<!\\)<", page)
    assert not re.search(r"(?<!\\)\]\(javascript:", page)
