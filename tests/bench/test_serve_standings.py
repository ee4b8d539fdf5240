"""The results as the web app reads them: verified once, swapped whole, kept by content."""

from __future__ import annotations

import datetime
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.waiting import until
from xden_bench.entries.ranking import ranks
from xden_bench.entries.reading import read_entries
from xden_bench.entries.result import entry_of, write_entry
from xden_bench.entries.standing import standing
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import score
from xden_bench.serve import standings
from xden_bench.serve.standings import Snapshot, Standings, place_of

Submit = Callable[..., Path]
Open = Callable[[], Standings]


@pytest.fixture
def enter(submission: Submit, reference: Reference, tmp_path: Path) -> Callable[[float], Path]:
    """Enter the truth times a factor."""

    def add(factor: float) -> Path:
        name = f"times-{factor}"
        file = submission(lambda _, grid: np.float32(factor) * grid, f"{name}.npz", method=name)
        scored = score(file, reference, load_protocol())
        entry = entry_of(scored, reference, command="", date=datetime.date(2026, 1, 2))
        return write_entry(entry, scored, tmp_path / "results", submission=file)

    return add


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Entries that are verified, as they are."""
    found: list[str] = []
    verify = standings._verified
    monkeypatch.setattr(
        standings, "_verified", lambda path, *more: found.append(path.stem) or verify(path, *more)
    )
    return found


@pytest.fixture
def opened(tmp_path: Path) -> Open:
    (tmp_path / "results").mkdir()
    return lambda: Standings(tmp_path / "results", tmp_path / "kept", workers=0)


def refreshed(one: Standings) -> Snapshot:
    one.refresh()
    return one.now


def test_only_what_is_new_is_verified_and_a_restart_verifies_nothing(
    opened: Open, enter: Callable[[float], Path], reads: list[str]
) -> None:
    first = opened()
    assert refreshed(first) == refreshed(first)
    one = enter(1.5)
    assert len(refreshed(first).entries) == 1
    other = enter(1.6)
    assert len(refreshed(first).entries) == 2
    assert refreshed(first) is first.now
    assert reads == [one.stem, other.stem]
    again = refreshed(opened())
    assert reads == [one.stem, other.stem]
    assert again.tables[0].ranks == first.now.tables[0].ranks


def test_ranks_and_rows_are_those_of_the_leaderboard(
    opened: Open, enter: Callable[[float], Path], tmp_path: Path
) -> None:
    for factor in (1.5, 3.0, 1.1):
        enter(factor)
    (table,) = refreshed(opened()).tables
    whole = {place_of(row): row for row in read_entries(tmp_path / "results")}
    rows = [whole[place_of(row)] for row in table.rows]
    assert list(table.ranks) == ranks(rows)
    assert [row["method"]["name"] for row in rows] == ["times-1.1", "times-1.5", "times-3.0"]
    said = standing(rows[2], table.rank_of(table.rows[2]), table.ranks)
    assert said == "rank 2 of 3 in track geometry"


def test_a_changed_entry_is_verified_again_and_a_spoilt_one_is_left_out_and_named(
    opened: Open, enter: Callable[[float], Path], reads: list[str], caplog: Any
) -> None:
    path = enter(1.5)
    one = opened()
    refreshed(one)
    entry = json.loads(path.read_text())
    path.write_text(json.dumps(entry))
    assert refreshed(one).is_current
    assert len(reads) == 2

    entry["metrics"]["mass_mape"]["mean"] = 0.0
    path.write_text(json.dumps(entry))
    other = enter(1.6)
    assert refreshed(one).is_current
    assert [place_of(row) for row in one.now.entries] == [
        other.relative_to(one.results).with_suffix("").as_posix()
    ]
    assert "left out: " in caplog.text
    assert "metrics is not what the objects" in caplog.text


@pytest.mark.slow
def test_what_is_not_needed_any_more_is_not_kept(
    opened: Open, enter: Callable[[float], Path], tmp_path: Path
) -> None:
    one, path = opened(), enter(1.5)
    refreshed(one)
    enter(1.6)
    refreshed(one)
    assert len(list((tmp_path / "kept").iterdir())) == 3
    shutil.rmtree(path.parent)
    assert refreshed(one).tables == ()
    assert list((tmp_path / "kept").iterdir()) == []


@pytest.mark.slow
def test_other_code_verifies_anew(
    opened: Open, enter: Callable[[float], Path], reads: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    enter(1.5)
    refreshed(opened())
    monkeypatch.setattr("xden_bench.serve.kept._code", lambda: b"changed")
    refreshed(opened())
    assert len(reads) == 2


@pytest.fixture
def slow_to_verify(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], None]]:
    """Hold verification back until it is let go."""
    from threading import Event

    go, verify = Event(), standings._verified
    monkeypatch.setattr(standings, "_verified", lambda *about: go.wait() and verify(*about))
    yield go.set
    go.set()


@pytest.mark.slow
def test_readers_do_not_wait_for_an_entry_that_is_being_verified(
    opened: Open, enter: Callable[[float], Path], slow_to_verify: Callable[[], None]
) -> None:
    with opened() as one:
        enter(1.5)
        assert one.now.entries == ()
        slow_to_verify()
        until(lambda: one.now.entries)


@pytest.mark.slow
def test_processes_verify_as_a_thread_does(
    opened: Open, enter: Callable[[float], Path], tmp_path: Path
) -> None:
    enter(1.5)
    inside = refreshed(opened())
    shutil.rmtree(tmp_path / "kept")
    beside = refreshed(Standings(tmp_path / "results", tmp_path / "kept", workers=1))
    assert beside.entries == inside.entries


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_processes_that_verify_end_with_a_server_that_is_killed(tmp_path: Path) -> None:
    program = (
        "import os, time; from pathlib import Path\n"
        "from xden_bench.serve.standings import Standings\n"
        "if __name__ == '__main__':\n"
        "    with Standings(Path('.'), Path('kept'), workers=1)._computing() as compute:\n"
        "        print(compute(os.getpid)(), flush=True); time.sleep(1000)\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        env=environment,
        cwd=tmp_path,
    ) as server:
        assert server.stdout is not None
        worker = int(server.stdout.readline())
        server.kill()
        until(lambda: not Path(f"/proc/{worker}").exists(), every_s=0.1)


def test_links_to_nothing_and_to_themselves_leave_the_entries_as_they_are(
    opened: Open, enter: Callable[[float], Path]
) -> None:
    one = opened()
    for name, to in (("gone", "nowhere"), ("loop", "loop")):
        (one.results / f"{name}.json").symlink_to(one.results / f"{to}.json")
    enter(1.5)
    now = refreshed(one)
    assert len(now.entries) == 1
    assert now.is_current


def test_a_failure_in_ranking_is_said_once_and_over_when_the_results_change(
    opened: Open, enter: Callable[[float], Path], monkeypatch: pytest.MonkeyPatch, caplog: Any
) -> None:
    one = opened()
    enter(1.5)
    with monkeypatch.context() as patch:
        patch.setattr(standings, "ranks", lambda _: 1 / 0)
        assert not refreshed(one).is_current
        assert not refreshed(one).is_current
    assert caplog.text.count("the results cannot be ranked") == 1
    enter(1.6)
    assert refreshed(one).is_current
    assert len(one.now.entries) == 2


def test_an_entry_whose_objects_take_more_memory_than_there_is_is_refused_by_name(
    opened: Open, enter: Callable[[float], Path], monkeypatch: pytest.MonkeyPatch, caplog: Any
) -> None:
    def too_much(*_: Any) -> None:
        raise MemoryError

    enter(1.5)
    monkeypatch.setattr(standings, "read_entry", too_much)
    assert refreshed(opened()).entries == ()
    assert "takes more memory than an entry may" in caplog.text
