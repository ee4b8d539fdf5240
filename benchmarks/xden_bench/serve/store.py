"""The tickets, in SQLite: what a kill at any moment leaves is a whole state.

SQLite (of Python's standard library) because its transactions and unique indexes hold by
themselves what files and locks would have to be made to hold: a job is in one state, a user has
one job at a time, a file waits once, and an event is noted exactly when its change is made.
WAL with ``synchronous = FULL`` keeps every committed change through a power cut.

Events go into the same transaction, and from there to the audit log; what a kill keeps from the
log is written to it at the next start.
"""

from __future__ import annotations

import datetime
import json
import logging
import sqlite3
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from xden1k.errors import DataError, MissingObjectError
from xden_bench.serve.audit_log import AuditLog
from xden_bench.serve.limits import Limits
from xden_bench.serve.outcome import Outcome
from xden_bench.serve.tickets import Status, Ticket, TurnedAwayError

__all__ = ["Job", "Store"]

logger = logging.getLogger(__name__)

HOUR_S: Final = 3600.0
MOST_STARTS: Final = 3
"""A job that was under way each time when the desk died is perhaps what killed it."""
VERSION: Final = 2

_SCHEMA: Final = f"""
BEGIN;
CREATE TABLE jobs (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    ticket_id TEXT NOT NULL UNIQUE,
    user TEXT NOT NULL,
    filename TEXT NOT NULL,
    sha256 TEXT NOT NULL,
    size_bytes INTEGER NOT NULL,
    sent REAL NOT NULL,
    state TEXT NOT NULL CHECK (
        state IN ('queued', 'checking', 'refused', 'sound', 'scored', 'failed')
    ),
    check_only INTEGER NOT NULL,
    starts INTEGER NOT NULL DEFAULT 0,
    outcome TEXT
);
CREATE UNIQUE INDEX one_at_a_time ON jobs (user) WHERE state IN ('queued', 'checking');
CREATE UNIQUE INDEX waits_once ON jobs (sha256) WHERE state IN ('queued', 'checking');
CREATE INDEX by_state ON jobs (state);
CREATE TABLE events (number INTEGER PRIMARY KEY AUTOINCREMENT, line TEXT NOT NULL);
PRAGMA user_version = {VERSION};
COMMIT;
"""


@dataclass(frozen=True, slots=True)
class Job:
    """A file that is being checked.

    Parameters
    ----------
    number
        Place in the order of sending.
    ticket_id, sha256, check_only
        As in the ticket.
    """

    number: int
    ticket_id: str
    sha256: str
    check_only: bool


class Store:
    """Every ticket there ever was.

    Parameters
    ----------
    path
        The database, made if it is missing.
    log
        The audit log; closed with the store.
    clock
        Seconds since 1970. It may jump: order is kept by number, never by time.

    Raises
    ------
    DataError
        If the file is no database of this version.
    """

    def __init__(self, path: Path, log: AuditLog, clock: Callable[[], float]) -> None:
        self._log, self._clock, self._lock = log, clock, threading.Lock()
        self._db = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
        self._db.row_factory = sqlite3.Row
        try:
            self._open(path)
        except BaseException:
            self._db.close()
            raise

    def _open(self, path: Path) -> None:
        try:
            self._db.execute("PRAGMA journal_mode = WAL")
            self._db.execute("PRAGMA synchronous = FULL")
            (version,) = self._db.execute("PRAGMA user_version").fetchone()
            if version == 0:
                self._db.executescript(_SCHEMA)
        except sqlite3.DatabaseError as err:
            raise DataError(f"{path}: no database of tickets: {err}") from err
        if version not in (0, VERSION):
            raise DataError(f"{path}: tickets of version {version}, this program reads {VERSION}")
        query = "SELECT coalesce(max(seq), 0) FROM sqlite_sequence WHERE name = 'events'"
        (noted,) = self._db.execute(query).fetchone()
        if self._log.last > noted:
            raise DataError(
                f"{path}: it knows {noted} events, the audit log beside it {self._log.last}: they "
                "are not of one desk"
            )

    def close(self) -> None:
        """Close the database and the log."""
        with self._lock:
            self._db.close()
            self._log.close()

    def note(self, event: str, **details: Any) -> None:
        """Write an event to the audit log."""
        with self._change() as note:
            note(event, **details)

    def check(self, user: str, limits: Limits) -> None:
        """See whether a user may send a file now.

        Parameters
        ----------
        user
            By pseudonym.
        limits
            The rules.

        Raises
        ------
        TurnedAwayError
            If not.
        """
        with self._lock:
            self._check(user, limits)

    def admit(
        self, ticket: Ticket, user: str, limits: Limits, keep_file: Callable[[], object]
    ) -> None:
        """Queue a file, if its user may send one now and it does not wait already.

        Parameters
        ----------
        ticket
            Its ticket.
        user
            By pseudonym.
        limits
            The rules.
        keep_file
            Puts the file where the job looks for it, before the job is there for good; or raises,
            and nothing is queued.

        Raises
        ------
        TurnedAwayError
            If it is not taken.
        """
        row = (ticket.ticket_id, user, ticket.filename, ticket.sha256, ticket.size_bytes)
        with self._change() as note:
            self._check(user, limits)
            if self._count("sha256 = ? AND state IN ('queued', 'checking')", ticket.sha256):
                raise TurnedAwayError("entered", "this very file waits to be scored already")
            added = self._db.execute(
                "INSERT INTO jobs (ticket_id, user, filename, sha256, size_bytes, sent, check_only,"
                " state) VALUES (?, ?, ?, ?, ?, ?, ?, 'queued')",
                (*row, ticket.sent.timestamp(), ticket.check_only),
            )
            size = ticket.size_bytes
            note("queued", job=added.lastrowid, user=user, sha256=ticket.sha256, size_bytes=size)
            keep_file()

    def take_up(self) -> None:
        """Queue again what was under way when the last desk ended, at its old place in line."""
        with self._change() as note:
            for row in self._db.execute("SELECT * FROM jobs WHERE state = 'checking'").fetchall():
                if row["starts"] < MOST_STARTS:
                    self._set(row["number"], state="queued")
                    note("taken_up", job=row["number"])
                else:
                    said = f"the server stopped {MOST_STARTS} times while it was checked"
                    outcome = Outcome("failed", message=said)
                    self._set(row["number"], state="failed", outcome=outcome.to_json())
                    note("failed", job=row["number"], message=said)

    def start_next(self) -> Job | None:
        """Start the job that has waited longest; None if none waits."""
        with self._change() as note:
            row = self._db.execute(
                "SELECT * FROM jobs WHERE state = 'queued' ORDER BY number LIMIT 1"
            ).fetchone()
            if row is None:
                return None
            self._set(row["number"], state="checking", starts=row["starts"] + 1)
            note("started", job=row["number"], start=row["starts"] + 1)
            return Job(row["number"], row["ticket_id"], row["sha256"], bool(row["check_only"]))

    def put_back(self, job: Job) -> None:
        """Queue a started job again, as if it had not been."""
        with self._change() as note:
            self._db.execute(
                "UPDATE jobs SET state = 'queued', starts = starts - 1 WHERE number = ?",
                (job.number,),
            )
            note("put_back", job=job.number)

    def finish(self, job: Job, outcome: Outcome) -> None:
        """Keep how a job ended."""
        with self._change() as note:
            self._set(job.number, state=outcome.state, outcome=outcome.to_json())
            codes = sorted({problem.code for problem in outcome.problems})
            details = {"codes": codes, "message": outcome.message, "entry": outcome.entry}
            kept = {key: value for key, value in details.items() if value}
            note(outcome.state, job=job.number, **kept)

    def status(self, ticket_id: str, results: Path) -> tuple[int, Status]:
        """Return a job's number and how it stands with it, but for the objects checked.

        Raises
        ------
        MissingObjectError
            If there is no such ticket.
        """
        with self._lock:
            row = self._db.execute(
                "SELECT * FROM jobs WHERE ticket_id = ?", (ticket_id,)
            ).fetchone()
            if row is None:
                raise MissingObjectError("there is no such ticket")
            before = "state IN ('queued', 'checking') AND number < ?"
            ahead = self._count(before, row["number"]) if row["state"] == "queued" else 0
        ended = Outcome.from_json(row["outcome"]) if row["outcome"] else None
        return row["number"], Status(
            ticket=_ticket(row),
            state=row["state"],
            ahead=ahead,
            checked=0,
            total=0,
            problems=ended.problems if ended else (),
            message=ended.message if ended else "",
            entry_path=results / ended.entry if ended and ended.entry else None,
            metrics=ended.metrics if ended else {},
        )

    def kept_tickets(self) -> frozenset[str]:
        """Tickets whose files are needed: queued, checking or scored."""
        with self._lock:
            rows = self._db.execute(
                "SELECT ticket_id FROM jobs WHERE state IN ('queued', 'checking', 'scored')"
            )
            return frozenset(row["ticket_id"] for row in rows)

    def scored_ticket(self, sha256: str) -> str | None:
        """Ticket of the scored file of that checksum."""
        with self._lock:
            row = self._db.execute(
                "SELECT ticket_id FROM jobs WHERE sha256 = ? AND state = 'scored'"
                " ORDER BY number DESC LIMIT 1",
                (sha256,),
            ).fetchone()
            return row and str(row["ticket_id"])

    @contextmanager
    def _change(self) -> Iterator[Callable[..., None]]:
        """Make a change, whole or not at all; gives what notes its events."""
        with self._lock:
            self._db.execute("BEGIN IMMEDIATE")
            try:
                yield self._note
                self._db.execute("COMMIT")
            except BaseException:
                if self._db.in_transaction:
                    self._db.execute("ROLLBACK")
                raise
            self._pass_on()

    def _note(self, event: str, **details: Any) -> None:
        time = _utc(self._clock()).isoformat(timespec="milliseconds")
        line = json.dumps({"time": time, "event": event, **details})
        self._db.execute("INSERT INTO events (line) VALUES (?)", (line,))

    def _pass_on(self) -> None:
        """Move events from the database to the log; a log on a full disk gets them later."""
        try:
            rows = self._db.execute(
                "SELECT * FROM events WHERE number > ? ORDER BY number", (self._log.last,)
            ).fetchall()
            for number, line in rows:
                values = {"number": number, **json.loads(line)}
                self._log.append(number, json.dumps(values))
            self._db.execute("DELETE FROM events WHERE number <= ?", (self._log.last,))
        except (OSError, sqlite3.OperationalError) as err:
            logger.error("the audit log cannot be written, its events wait: %s", err)

    def _check(self, user: str, limits: Limits) -> None:
        if self._count("user = ? AND state IN ('queued', 'checking')", user):
            said = "one file at a time: the one you sent before is still being checked"
            raise TurnedAwayError("one_at_a_time", said)
        # Within an hour either way: had the clock been wrong and was then set back, what was sent
        # meanwhile would lie in the future, and block its user until then.
        now = self._clock()
        recent = self._count("user = ? AND abs(sent - ?) < ?", user, now, HOUR_S)
        if recent >= limits.jobs_per_user_hour:
            said = f"you sent {recent} files within an hour, at most {limits.jobs_per_user_hour}"
            raise TurnedAwayError("too_often", f"{said} are taken: try later")
        waiting = self._count("state IN ('queued', 'checking')")
        if waiting >= limits.queue_length:
            said = f"{waiting} files wait to be scored, which is the most: try later"
            raise TurnedAwayError("queue_full", said)

    def _count(self, where: str, *values: object) -> int:
        query = f"SELECT count(*) FROM jobs WHERE {where}"  # noqa: S608 - where is ours
        (count,) = self._db.execute(query, values).fetchone()
        return int(count)

    def _set(self, number: int, **columns: object) -> None:
        names = ", ".join(f"{name} = ?" for name in columns)
        query = f"UPDATE jobs SET {names} WHERE number = ?"  # noqa: S608 - names are ours
        self._db.execute(query, (*columns.values(), number))


def _ticket(row: sqlite3.Row) -> Ticket:
    return Ticket(
        row["ticket_id"],
        row["filename"],
        row["sha256"],
        row["size_bytes"],
        _utc(row["sent"]),
        bool(row["check_only"]),
    )


def _utc(seconds: float) -> datetime.datetime:
    return datetime.datetime.fromtimestamp(seconds, tz=datetime.UTC)
