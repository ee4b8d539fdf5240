"""The desk from upload to entry, with real scoring processes, some of which die."""

from __future__ import annotations

import datetime
import json
import os
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.bench.desks import turned_away
from tests.disks import full_disk
from tests.waiting import until
from xden1k.errors import DataError
from xden_bench.entries.reading import read_entries
from xden_bench.entries.result import entry_of, write_entry
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import score
from xden_bench.serve.desk import Desk
from xden_bench.serve.limits import Limits
from xden_bench.serve.outcome import Outcome
from xden_bench.serve.tickets import Status, Ticket
from xden_bench.serve.worker import Setting, score_upload

RULES = load_protocol()
ADDRESS = "203.0.113.7"
Submit = Callable[..., Path]
Open = Callable[..., Desk]


@pytest.fixture
def open_desk(reference: Reference, tmp_path: Path) -> Iterator[Open]:
    """Open desks on one pair of folders; they are closed at the end."""
    opened = []

    def make(**limits: int) -> Desk:
        folders = {"results": tmp_path / "results", "state": tmp_path / "state"}
        opened.append(Desk(reference, RULES, **folders, limits=Limits(**limits)))
        return opened[-1]

    yield make
    for desk in opened:
        desk.close()


@pytest.fixture(scope="module")
def desk(reference: Reference, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    """A desk for tests that leave nothing waiting."""
    folder = tmp_path_factory.mktemp("desk")
    folders = {"results": folder / "results", "state": folder / "state"}
    with Desk(reference, RULES, **folders, limits=Limits(jobs_per_user_hour=100)) as opened:
        yield opened


def ended(desk: Desk, ticket: Ticket) -> Status:
    """Wait for how it ended."""
    until(lambda: desk.status(ticket.ticket_id).is_final)
    return desk.status(ticket.ticket_id)


def wait_for_uploads(desk: Desk, expected: list[Path]) -> None:
    """Wait until only these are kept: a file goes after its ticket says how it ended."""
    until(lambda: uploads(desk) == expected)


def scaled(factor: float) -> Callable[[str, np.ndarray], np.ndarray]:
    return lambda _, grid: factor * grid


def outside(_: str, grid: np.ndarray) -> np.ndarray:
    lump = np.zeros_like(grid)
    lump[0, 0, 0] = 1.0
    return lump


def process_of(desk: Desk) -> int:
    """Wait for the scoring process and return its id."""
    return int(until(lambda: desk._runner._process, every_s=0.005)._popen.pid)


def state_of(desk: Desk) -> Path:
    return desk._uploads.parent


def events(desk: Desk) -> list[dict[str, Any]]:
    text = (state_of(desk) / "audit.jsonl").read_text()
    return [json.loads(line) for line in text.splitlines()]


def uploads(desk: Desk) -> list[Path]:
    return sorted(desk._uploads.iterdir())


def test_good_files_are_entered_bad_ones_explained_and_the_log_knows_no_address(
    open_desk: Open, submission: Submit, reference: Reference
) -> None:
    desk = open_desk()
    good = submission(scaled(1.1), "good.npz", method="good")
    bad = submission(outside, "bad.npz")
    (bad.parent / "noise.npz").write_bytes(b"noise")
    tickets = [
        desk.submit(good, user=ADDRESS, filename="good.npz"),
        desk.submit(bad, user="b", filename="bad.npz"),
        desk.submit(bad.parent / "noise.npz", user="c", filename="noise.npz"),
    ]
    first, second, third = (ended(desk, ticket) for ticket in tickets)

    expected = score(good, reference, RULES)
    (entry,) = read_entries(desk.results)
    assert first.state == "scored"
    assert first.entry_path is not None
    assert json.loads(first.entry_path.read_text())["metrics"] == entry["metrics"] == first.metrics
    assert first.metrics == {key: one.to_json() for key, one in expected.metrics.items()}
    assert entry["submission_sha256"] == tickets[0].sha256
    assert entry["command"] == "xden-bench submit preds.npz"
    kept = desk.upload_of(tickets[0].sha256)
    assert kept is not None
    assert kept.read_bytes() == good.read_bytes()

    assert (second.state, third.state) == ("refused", "refused")
    assert {(one.code, one.object_id) for one in second.problems} == {
        ("E405", object_id) for object_id in reference.ids
    }
    assert [one.code for one in third.problems] == ["E101"]
    wait_for_uploads(desk, [kept])

    names = [one["event"] for one in events(desk)]
    assert sorted(names) == sorted(
        ["opened", *["queued", "started"] * 3, "scored", "refused", "refused"]
    )
    for path in state_of(desk).rglob("*"):
        assert path.is_dir() or ADDRESS.encode() not in path.read_bytes()


def test_warnings_come_with_the_score(desk: Desk, submission: Submit) -> None:
    copied = desk.submit(submission(method="copied"), user="a", filename="x")
    status = ended(desk, copied)
    assert (status.state, [one.code for one in status.problems]) == ("scored", ["W504"])
    assert status.problems[0].message.startswith("the values of the reference")


def test_the_name_of_a_trivial_method_is_refused_without_telling_of_the_servers_folders(
    desk: Desk, submission: Submit
) -> None:
    ticket = desk.submit(submission(scaled(1.1), method="water"), user="a", filename="x")
    status = ended(desk, ticket)
    assert status.state == "refused"
    assert status.message.startswith("the name 'water' is that of a trivial method")


def test_the_same_file_is_entered_once_whether_here_or_by_command(
    desk: Desk, submission: Submit, reference: Reference
) -> None:
    here, there = (submission(scaled(by), f"{by}.npz", method=f"m{by}") for by in (1.1, 1.2))
    ended(desk, desk.submit(here, user="a", filename="x"))
    scored = score(there, reference, RULES)
    today = datetime.date(2026, 1, 1)
    entry = entry_of(scored, reference, command="xden-bench submit f.npz", date=today)
    write_entry(entry, scored, desk.results)
    entries = len(read_entries(desk.results))
    for number, file in enumerate((here, there)):
        with turned_away("entered", r"this very file is entered already: v2/.*\.json"):
            desk.submit(file, user=f"other {number}", filename="x")
    assert len(read_entries(desk.results)) == entries
    assert desk.upload_of(entry["submission_sha256"]) is None


def test_a_strangers_filename_can_be_shown_and_kept(desk: Desk, submission: Submit) -> None:
    name = "../\u202e\ud800<b>\x1b[31m" + "x" * 500
    ticket = desk.submit(submission(outside), user="\ud800", filename=name)
    assert ticket.filename == "../??<b>?[31m" + "x" * 67
    assert ended(desk, ticket).ticket == ticket


def test_a_process_that_is_killed_fails_its_file_and_no_other(
    open_desk: Open, submission: Submit
) -> None:
    desk = open_desk()
    first, second = submission(scaled(1.1), "1.npz"), submission(scaled(1.2), "2.npz")
    killed = desk.submit(first, user="a", filename="x")
    spared = desk.submit(second, user="b", filename="y")
    os.kill(process_of(desk), signal.SIGKILL)
    status = ended(desk, killed)
    assert status.state == "failed"
    assert "was killed, perhaps because memory ran out" in status.message
    assert ended(desk, spared).state == "scored"
    again = desk.submit(first, user="a", filename="x")
    assert ended(desk, again).state == "scored"


@pytest.mark.slow
def test_a_file_that_takes_too_long_is_given_up(open_desk: Open, submission: Submit) -> None:
    desk = open_desk(job_seconds=1)
    ticket = desk.submit(submission(scaled(1.1)), user="a", filename="x")
    os.kill(process_of(desk), signal.SIGSTOP)
    status = ended(desk, ticket)
    assert status.state == "failed"
    assert status.message == "checking and scoring it takes more than 1 s"


@pytest.mark.slow
def test_a_process_that_cannot_even_load_is_a_failure_and_enters_nothing(
    open_desk: Open, submission: Submit, caplog: pytest.LogCaptureFixture
) -> None:
    desk = open_desk(job_memory_mb=50)
    status = ended(desk, desk.submit(submission(scaled(1.1)), user="a", filename="x"))
    assert status.state == "failed"
    assert "ended without a result; the server's log says more" in status.message
    assert "scoring process, exit" in caplog.text
    assert read_entries(desk.results) == ()
    wait_for_uploads(desk, [])


@contextmanager
def started(*command: str, setting: Setting) -> Iterator[subprocess.Popen[str]]:
    """Start a scoring process, and end it."""
    with subprocess.Popen(  # noqa: S603
        [sys.executable, *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "OPENBLAS_NUM_THREADS": "1"},
    ) as process:
        assert process.stdin is not None
        process.stdin.write(json.dumps(asdict(setting)) + "\n")
        process.stdin.flush()
        try:
            yield process
        finally:
            process.kill()


GREEDY = """
import numpy
import xden_bench.scoring.score
from xden_bench.serve import worker
xden_bench.scoring.score.score = lambda *_, **__: numpy.ones(1 << 30)  # 8 GB
worker._main()
"""


def test_memory_is_limited_and_running_out_of_it_is_said(dataset: Path, tmp_path: Path) -> None:
    setting = Setting(str(dataset), "test", RULES.name, str(tmp_path), memory_bytes=10**9)
    with started("-c", GREEDY, setting=setting) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write('{"path": "any.npz", "check_only": false}\n')
        process.stdin.flush()
        message = Outcome.from_json(process.stdout.readline()).message
    assert message == "scoring it takes more than 1000 MB of memory"


def test_an_entry_whose_process_died_before_it_could_say_so_is_found(
    open_desk: Open, submission: Submit, reference: Reference
) -> None:
    desk = open_desk()
    path = submission(scaled(1.1))
    ticket = desk.submit(path, user="a", filename="x")
    process = process_of(desk)
    os.kill(process, signal.SIGSTOP)
    entered = score_upload(path, reference, RULES, desk.results)
    os.kill(process, signal.SIGKILL)
    status = ended(desk, ticket)
    assert status.state == "scored"
    assert status.metrics == entered.metrics
    assert len(read_entries(desk.results)) == 1


@pytest.mark.slow
def test_an_outcome_that_a_full_disk_cannot_take_is_recorded_later(
    open_desk: Open, submission: Submit, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("xden_bench.serve.runner.RETRY_S", 0.05)
    desk = open_desk()
    finish, tries = desk._store.finish, []

    def fail_twice(*args: Any) -> None:
        tries.append(args)
        if len(tries) < 3:
            raise sqlite3.OperationalError("database or disk is full")
        finish(*args)

    monkeypatch.setattr(desk._store, "finish", fail_twice)
    ticket = desk.submit(submission(scaled(1.1)), user="a", filename="x")
    assert ended(desk, ticket).state == "scored"
    assert len(tries) == 3


def test_a_full_disk_turns_files_away_and_the_desk_works_on_when_there_is_room(
    desk: Desk, submission: Submit
) -> None:
    path, before = submission(scaled(1.4), method="patient"), uploads(desk)
    for size_bytes in (100, path.stat().st_size + 1):
        with full_disk(size_bytes), turned_away("no_room", "try later"):
            desk.submit(path, user="a", filename="x")
        assert uploads(desk) == before
    ticket = desk.submit(path, user="a", filename="x")
    assert ended(desk, ticket).state == "scored"


def test_an_entry_that_does_not_fit_on_the_disk_is_not_there_at_all(
    reference: Reference, submission: Submit, tmp_path: Path
) -> None:
    path, results = submission(scaled(1.1)), tmp_path / "results"
    results.mkdir()
    with full_disk(5000), pytest.raises(OSError, match="File too large"):
        score_upload(path, reference, RULES, results)
    assert read_entries(results) == ()
    assert score_upload(path, reference, RULES, results).state == "scored"
    assert len(read_entries(results)) == 1


def test_a_file_whose_desk_was_killed_after_it_was_entered_is_entered_once(
    reference: Reference, submission: Submit, tmp_path: Path
) -> None:
    path, results = submission(scaled(1.1)), tmp_path / "results"
    first = score_upload(path, reference, RULES, results)
    before = {one: one.read_bytes() for one in results.rglob("*.*") if one.is_file()}
    assert score_upload(path, reference, RULES, results) == first
    assert {one: one.read_bytes() for one in results.rglob("*.*") if one.is_file()} == before


def test_a_stranger_adds_no_seed_to_an_entry_that_nobody_signed(
    reference: Reference, submission: Submit, tmp_path: Path
) -> None:
    """Entries of one name are averaged: a bad one would spoil the row."""
    results = tmp_path / "results"
    first = score_upload(submission(scaled(1.1), method="net", seed=0), reference, RULES, results)
    assert first.state == "scored"
    before = read_entries(results)
    spoiler = submission(scaled(2.0), method="Net", seed=99)
    outcome = score_upload(spoiler, reference, RULES, results)
    assert outcome.state == "refused"
    assert outcome.message.startswith("'Net' is entered already, of seed 0 (")
    assert read_entries(results) == before
    again = score_upload(submission(scaled(1.2), method="net", seed=0), reference, RULES, results)
    assert again.state == "scored", "the better one of a seed counts"


@pytest.mark.slow
def test_the_scoring_process_ends_when_the_desk_is_gone(dataset: Path, tmp_path: Path) -> None:
    setting = Setting(str(dataset), "test", RULES.name, str(tmp_path), memory_bytes=10**9)
    with started("-m", "xden_bench.serve.worker", setting=setting) as process:
        assert process.stdin is not None
        process.stdin.close()
        assert process.wait() == 0


def test_what_a_killed_writer_left_beside_its_entry_is_removed(
    reference: Reference, submission: Submit, tmp_path: Path
) -> None:
    path, results = submission(scaled(1.1)), tmp_path / "results"
    outcome = score_upload(path, reference, RULES, results)
    assert outcome.entry is not None
    entry = results / outcome.entry
    left = entry.with_name(f".{entry.name}.1234.partial")
    left.write_text("half")
    entry.unlink()
    assert score_upload(path, reference, RULES, results) == outcome
    assert not left.exists()


def test_two_desks_never_share_a_state_folder(open_desk: Open) -> None:
    first = open_desk()
    with pytest.raises(DataError, match="another desk is open on this folder"):
        open_desk()
    first.close()
    open_desk()


@pytest.mark.slow
def test_closing_in_the_middle_puts_the_file_back_for_the_next_desk(
    open_desk: Open, submission: Submit
) -> None:
    desk = open_desk()
    ticket = desk.submit(submission(scaled(1.1)), user="a", filename="x")
    process = process_of(desk)
    desk.close()
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)
    desk = open_desk()
    assert ended(desk, ticket).state == "scored"
    assert [one["event"] for one in events(desk)] == [
        *["opened", "queued", "started", "put_back", "closed"],
        *["opened", "started", "scored"],
    ]


def test_uploads_without_a_ticket_are_cleared_away(open_desk: Open, tmp_path: Path) -> None:
    (tmp_path / "state" / "uploads").mkdir(parents=True)
    (tmp_path / "state" / "uploads" / "abc.partial").write_bytes(b"half a file")
    assert uploads(open_desk()) == []
