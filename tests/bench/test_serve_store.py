"""The tickets and the audit log of the desk, without scoring anything."""

from __future__ import annotations

import datetime
import json
import os
import sqlite3
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.bench.desks import turned_away
from tests.disks import full_disk
from xden1k.errors import DataError, MissingObjectError
from xden1k.predictions import Problem
from xden1k.values.settings import load_settings
from xden_bench.serve.audit_log import AuditLog, Pseudonyms
from xden_bench.serve.disk import copy_upload
from xden_bench.serve.limits import Limits
from xden_bench.serve.outcome import Outcome
from xden_bench.serve.store import MOST_STARTS, Store
from xden_bench.serve.tickets import Status, Ticket, TurnedAwayError

LIMITS = Limits(jobs_per_user_hour=3, queue_length=4)
REFUSED = Outcome("refused", problems=(Problem("E403", "mug-1", "not finite"),))
SCORED = Outcome("scored", entry="v1/a.json", metrics={"mae": {"mean": 1.0, "ci95": [0.5, 2.0]}})


class Clock:
    """A clock that stands until it is set."""

    def __init__(self) -> None:
        self.now = 1.8e9

    def __call__(self) -> float:
        return self.now


class Counter:
    """A store in a folder, with files and users made up on the way."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.clock, self.sent = folder, Clock(), 0
        self.store = self.open()

    def open(self) -> Store:
        log = AuditLog(self.folder / "audit.jsonl")
        try:
            return Store(self.folder / "tickets.db", log, self.clock)
        except BaseException:
            log.close()
            raise

    def reopen(self) -> None:
        self.store.close()
        self.store = self.open()

    def send(self, user: str, sha256: str = "", keep: Callable[[], object] = lambda: None) -> str:
        self.sent += 1
        sent = datetime.datetime.fromtimestamp(self.clock.now, tz=datetime.UTC)
        ticket = Ticket(f"ticket{self.sent}", "a.npz", sha256 or f"sum{self.sent}", 10, sent)
        self.store.admit(ticket, user, LIMITS, keep)
        return ticket.ticket_id

    def finish(self, outcome: Outcome = REFUSED) -> None:
        job = self.store.start_next()
        assert job is not None
        self.store.finish(job, outcome)

    def status(self, ticket_id: str) -> Status:
        return self.store.status(ticket_id, self.folder)[1]

    def events(self) -> list[dict[str, Any]]:
        text = (self.folder / "audit.jsonl").read_text()
        return [json.loads(line) for line in text.splitlines()]


@pytest.fixture
def counter(tmp_path: Path) -> Iterator[Counter]:
    made = Counter(tmp_path)
    yield made
    made.store.close()


def test_a_user_has_one_file_at_a_time_and_others_are_not_held_up(counter: Counter) -> None:
    counter.send("ann")
    with turned_away("one_at_a_time"):
        counter.send("ann")
    counter.send("bob")
    counter.finish()
    counter.send("ann")


def test_refused_files_count_towards_the_rate_and_an_hour_ends_it(counter: Counter) -> None:
    for _ in range(3):
        counter.send("ann")
        counter.finish()
    with turned_away("too_often"):
        counter.send("ann")
    counter.send("bob")
    counter.clock.now += 3599
    with turned_away("too_often"):
        counter.send("ann")
    counter.clock.now += 1
    counter.send("ann")


def test_the_rate_outlives_a_restart(counter: Counter) -> None:
    for _ in range(3):
        counter.send("ann")
        counter.finish()
    counter.reopen()
    with turned_away("too_often"):
        counter.send("ann")


@pytest.mark.parametrize("years", [1, 10])
def test_a_clock_that_was_ahead_and_is_set_back_locks_nobody_out(
    counter: Counter, years: int
) -> None:
    now, counter.clock.now = counter.clock.now, counter.clock.now + years * 3.15e7
    for _ in range(3):
        counter.send("ann")
        counter.finish()
    counter.clock.now = now
    assert counter.status(counter.send("ann")).state == "queued"


@settings(max_examples=15, deadline=None)
@given(st.lists(st.floats(0, 4e9), min_size=1, max_size=4))
def test_whatever_the_clock_says_files_are_scored_in_the_order_of_sending(
    tmp_path_factory: pytest.TempPathFactory, times: list[float]
) -> None:
    counter = Counter(tmp_path_factory.mktemp("store"))
    sent = []
    for number, now in enumerate(times):
        counter.clock.now = now
        sent.append(counter.send(f"user {number}"))
    assert [counter.status(one).ahead for one in sent] == list(range(len(sent)))
    started = [counter.store.start_next() for _ in sent]
    assert [job.ticket_id for job in started if job] == sent
    counter.store.close()


def test_a_full_queue_takes_nobody(counter: Counter) -> None:
    for number in range(4):
        counter.send(f"user {number}")
    counter.store.start_next()
    with turned_away("queue_full"):
        counter.send("ann")


def test_a_file_waits_once_whoever_sends_it(counter: Counter) -> None:
    counter.send("ann", sha256="same")
    with turned_away("entered"):
        counter.send("bob", sha256="same")
    counter.finish(REFUSED)
    counter.send("bob", sha256="same")


def test_of_many_at_the_same_time_one_is_taken(counter: Counter) -> None:
    start = threading.Barrier(8)

    def send(_: int) -> str:
        start.wait()
        try:
            return counter.send("ann", sha256="same")
        except TurnedAwayError as away:
            return away.reason

    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(send, range(8)))
    assert sorted(answers)[:-1] == ["one_at_a_time"] * 7
    assert counter.status(max(answers)).state == "queued"


def test_a_file_that_cannot_be_kept_leaves_neither_job_nor_event(counter: Counter) -> None:
    def fail() -> None:
        raise OSError("gone")

    with pytest.raises(OSError, match="gone"):
        counter.send("ann", keep=fail)
    assert counter.store.start_next() is None
    assert counter.events() == []


def test_what_was_under_way_goes_back_to_its_place_in_line(counter: Counter) -> None:
    first, second = counter.send("ann"), counter.send("bob")
    counter.store.start_next()
    counter.reopen()
    counter.store.take_up()
    assert [counter.status(one).ahead for one in (first, second)] == [0, 1]
    job = counter.store.start_next()
    assert job is not None
    assert job.ticket_id == first


def test_a_job_that_is_there_at_every_death_of_the_desk_is_given_up(counter: Counter) -> None:
    ticket_id = counter.send("ann")
    for _ in range(MOST_STARTS):
        assert counter.status(ticket_id).state == "queued"
        counter.store.start_next()
        counter.reopen()
        counter.store.take_up()
    status = counter.status(ticket_id)
    assert status.state == "failed"
    assert status.message == "the server stopped 3 times while it was checked"


def test_a_job_that_was_put_back_is_not_counted_as_a_death(counter: Counter) -> None:
    ticket_id = counter.send("ann")
    for _ in range(2 * MOST_STARTS):
        job = counter.store.start_next()
        assert job is not None
        counter.store.put_back(job)
        counter.store.take_up()
    assert counter.status(ticket_id).state == "queued"


@pytest.mark.parametrize("outcome", [REFUSED, SCORED, Outcome("failed", message="died")])
def test_an_outcome_is_kept_as_it_was(counter: Counter, outcome: Outcome) -> None:
    ticket_id = counter.send("ann")
    counter.finish(outcome)
    counter.reopen()
    status = counter.status(ticket_id)
    assert (status.state, status.problems) == (outcome.state, outcome.problems)
    assert (status.message, status.metrics) == (outcome.message, outcome.metrics)
    assert status.entry_path == (counter.folder / outcome.entry if outcome.entry else None)
    assert status.is_final


def test_an_unknown_ticket_is_an_error(counter: Counter) -> None:
    with pytest.raises(MissingObjectError, match="there is no such ticket"):
        counter.status("nobody has this")


@pytest.mark.parametrize("content", [b"no database at all, but long enough to be one" * 40])
def test_a_file_that_is_no_database_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "tickets.db").write_bytes(content)
    with pytest.raises(DataError, match=r"tickets\.db: no database of tickets"):
        Counter(tmp_path)


def test_tickets_of_another_version_are_refused(counter: Counter) -> None:
    with sqlite3.connect(counter.folder / "tickets.db") as db:
        db.execute("PRAGMA user_version = 9")
    db.close()
    with pytest.raises(DataError, match="tickets of version 9, this program reads 2"):
        counter.open()


def test_the_log_has_every_event_once_and_in_order(counter: Counter) -> None:
    counter.send("ann")
    with turned_away("one_at_a_time"):
        counter.send("ann")
    counter.finish()
    counter.reopen()
    counter.store.note("closed")
    events = counter.events()
    assert [one["event"] for one in events] == ["queued", "started", "refused", "closed"]
    assert [one["number"] for one in events] == [1, 2, 3, 4]
    assert events[2]["codes"] == ["E403"]
    assert events[0]["time"] == "2027-01-15T08:00:00.000+00:00"


def test_events_that_a_kill_kept_from_the_log_are_in_it_after_the_next_start(
    counter: Counter,
) -> None:
    counter.send("ann")
    with sqlite3.connect(counter.folder / "tickets.db") as db:
        db.execute('INSERT INTO events (line) VALUES (\'{"event": "late"}\')')
    db.close()
    counter.reopen()
    counter.store.note("opened")
    assert [one["event"] for one in counter.events()] == ["queued", "late", "opened"]


def test_a_log_on_a_full_disk_gets_its_events_later_and_no_half_line(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    old = '{"number": 0, "event": "old"}\n' * 100_000  # more than the database takes
    (tmp_path / "audit.jsonl").write_text(old)
    counter = Counter(tmp_path)
    with full_disk(len(old) + 20):
        counter.store.note("first")
    assert "the audit log cannot be written, its events wait" in caplog.text
    assert (tmp_path / "audit.jsonl").stat().st_size == len(old)
    counter.store.note("second")
    assert [one["event"] for one in counter.events()[100_000:]] == ["first", "second"]
    counter.store.close()


def test_a_line_without_its_end_is_cut_off_and_written_again(counter: Counter) -> None:
    counter.store.note("first")
    with (counter.folder / "audit.jsonl").open("a") as log:
        log.write('{"number": 2, "eve')
    counter.reopen()
    counter.store.note("second")
    assert [one["number"] for one in counter.events()] == [1, 2]


def test_a_log_of_another_desk_is_refused_instead_of_losing_events(counter: Counter) -> None:
    counter.store.note("first")
    with (counter.folder / "audit.jsonl").open("a") as log:
        log.write('{"number": 7, "event": "of another"}\n')
    with pytest.raises(DataError, match="it knows 1 events, the audit log beside it 7"):
        counter.open()


@pytest.mark.parametrize("text", ["what?\n", "{}\n", "[1]\n"])
def test_a_file_that_is_no_log_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "audit.jsonl").write_text(text)
    with pytest.raises(DataError, match="its last line is no event of an audit log"):
        AuditLog(tmp_path / "audit.jsonl")


def test_a_file_of_one_endless_line_is_refused_and_kept(tmp_path: Path) -> None:
    path = tmp_path / "audit.jsonl"
    path.write_bytes(b"x" * (2 << 20))
    with pytest.raises(DataError, match="its last line is over 1048576 bytes: no audit log"):
        AuditLog(path)
    assert path.stat().st_size == 2 << 20


def test_a_pseudonym_is_the_same_with_its_key_and_another_without(tmp_path: Path) -> None:
    first = Pseudonyms(tmp_path / "key")("203.0.113.7")
    assert Pseudonyms(tmp_path / "key")("203.0.113.7") == first
    assert Pseudonyms(tmp_path / "key")("203.0.113.8") != first
    assert Pseudonyms(tmp_path / "other")("203.0.113.7") != first
    assert (tmp_path / "key").stat().st_mode & 0o077 == 0


def test_a_file_too_large_is_turned_away_before_a_byte_is_copied(tmp_path: Path) -> None:
    upload = tmp_path / "large"
    upload.touch()
    os.truncate(upload, 10**12)  # sparse: copying it would take minutes
    with turned_away("too_large", r"has 1000000\.0 MB, at most 5 are taken"):
        copy_upload(upload, tmp_path / "copy", Limits(upload_mb=5))
    assert not (tmp_path / "copy").exists()


def test_a_disk_with_too_little_to_spare_is_no_room(tmp_path: Path) -> None:
    (tmp_path / "upload").write_bytes(b"x" * 100)
    with turned_away("no_room"):
        copy_upload(tmp_path / "upload", tmp_path / "copy", Limits(spare_disk_mb=10**9))


def test_a_disk_that_fills_up_while_copying_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "upload").write_bytes(b"x" * 3_000_000)
    with full_disk(1_500_000), turned_away("no_room"):
        copy_upload(tmp_path / "upload", tmp_path / "copy", Limits(spare_disk_mb=1))
    assert not (tmp_path / "copy").exists()


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="not a plain file"):
        copy_upload(tmp_path / "pipe", tmp_path / "copy", Limits())


@pytest.mark.parametrize("text", ["upload_mb = 0", "upload_mb = -3", "queue_length = true"])
def test_limits_that_are_no_whole_numbers_are_refused_by_name(tmp_path: Path, text: str) -> None:
    (tmp_path / "limits.toml").write_text(text)
    with pytest.raises(DataError, match=r"(upload_mb|queue_length) must be a whole number above"):
        load_settings(Limits, tmp_path / "limits.toml")
