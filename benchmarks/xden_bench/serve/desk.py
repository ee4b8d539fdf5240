"""The desk: takes submissions from users, has them scored one by one, and loses none.

::

    STATE/  lock         held while a desk is open
            tickets.db   SQLite: every ticket and its outcome
            audit.jsonl  one line for each event, append-only
            user-key     turns users into pseudonyms
            uploads/     TICKET.npz: what waits, and what was scored

An upload is copied there whole before its ticket exists; the scoring process writes the entry
before the ticket says ``scored``. A kill between the two leaves a file without a ticket, which the
next desk removes, or an entry without its ticket's outcome, which scoring it again finds.
"""

from __future__ import annotations

import datetime
import secrets
import sqlite3
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Final

from filelock import FileLock, Timeout

from xden1k.errors import DataError
from xden_bench.entries.durable import sync_folder
from xden_bench.scoring.protocol import Protocol
from xden_bench.scoring.reference import Reference
from xden_bench.serve.audit_log import AuditLog, Pseudonyms
from xden_bench.serve.disk import Copy, copy_upload, is_full
from xden_bench.serve.limits import Limits
from xden_bench.serve.outcome import Outcome, find_entered
from xden_bench.serve.runner import Runner
from xden_bench.serve.store import Store
from xden_bench.serve.tickets import Status, Ticket, TurnedAwayError
from xden_bench.serve.worker import Setting

__all__ = ["Desk"]

_NAME_LENGTH: Final = 80


class Desk:
    """Takes submissions for one split and enters them among the results.

    Every method may be called from any thread and returns at once, but for the copying of the
    upload: scoring goes on in a process of its own. Use it as a context manager.

    Parameters
    ----------
    reference
        The truth.
    rules
        The protocol.
    results
        Folder of the entries, as ``xden-bench submit`` writes them; made if it is missing.
    state
        Folder of the desk's own: uploads, tickets, audit log. One desk at a time.
    limits
        How much it takes on.
    clock
        Seconds since 1970.

    Raises
    ------
    DataError
        If another desk is open on the state folder, or it holds something else.
    """

    def __init__(
        self,
        reference: Reference,
        rules: Protocol,
        *,
        results: Path,
        state: Path,
        limits: Limits = Limits(),  # noqa: B008 - it is frozen
        clock: Callable[[], float] = time.time,
    ) -> None:
        self.reference, self.rules, self.limits = reference, rules, limits
        self.results, self._uploads, self._clock = results, state / "uploads", clock
        results.mkdir(parents=True, exist_ok=True)
        state.mkdir(parents=True, exist_ok=True, mode=0o700)
        self._uploads.mkdir(exist_ok=True)
        with ExitStack() as opened:
            opened.enter_context(_locked(state))
            self._pseudonym = Pseudonyms(state / "user-key")
            self._store = _open_store(state, clock)
            opened.callback(self._store.close)
            self._clear_away()
            self._runner = Runner(
                self._store, self._setting(), limits.job_seconds, self._upload, self._entered
            )
            self._store.note("opened", split=reference.split, manifest=reference.manifest_sha256)
            self._runner.start()
            opened.callback(self._store.note, "closed")
            opened.callback(self._runner.stop)
            self._opened = opened.pop_all()

    def check(self, user: str) -> None:
        """See whether a user may send a file now, before it is received.

        Raises
        ------
        TurnedAwayError
            If not.
        """
        pseudonym = self._pseudonym(user)
        try:
            self._store.check(pseudonym, self.limits)
        except TurnedAwayError as away:
            self._note_turned_away(pseudonym, away)
            raise

    def submit(self, upload: Path, *, user: str, filename: str, check_only: bool = False) -> Ticket:
        """Take a file; it is copied, the upload can go.

        Parameters
        ----------
        upload
            The file as the web server stored it.
        user
            Whom the limits count by, such as a login or an address; only a keyed hash is kept.
        filename
            As the user calls it.
        check_only
            Whether to say what is wrong with it, and neither score nor enter it.

        Raises
        ------
        TurnedAwayError
            If the file is not taken; its ``reason`` and text say why.
        OSError
            If the upload cannot be read.
        """
        pseudonym = self._pseudonym(user)
        try:
            try:
                ticket = self._take(upload, pseudonym, filename, check_only)
            except (OSError, sqlite3.OperationalError) as err:
                if isinstance(err, OSError) and not is_full(err):
                    raise
                said = "the server cannot keep the file now: try later"
                raise TurnedAwayError("no_room", said) from err
        except TurnedAwayError as away:
            self._note_turned_away(pseudonym, away)
            raise
        self._runner.wake()
        return ticket

    def status(self, ticket_id: str) -> Status:
        """Say how it stands with a file.

        Raises
        ------
        MissingObjectError
            If there is no such ticket.
        """
        number, status = self._store.status(ticket_id, self.results)
        if status.state != "checking":
            return status
        checked, total = self._runner.progress(number)
        return replace(status, checked=checked, total=total)

    def upload_of(self, submission_sha256: str) -> Path | None:
        """Return the scored submission of that checksum if it came to this desk, else None."""
        ticket_id = self._store.scored_ticket(submission_sha256)
        return self._upload(ticket_id) if ticket_id else None

    def close(self) -> None:
        """Stop; what is queued or half done is taken up by the next desk on the state folder."""
        self._opened.close()

    def __enter__(self) -> Desk:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _take(self, upload: Path, user: str, filename: str, check_only: bool) -> Ticket:
        """Copy a file and queue it."""
        self._store.check(user, self.limits)  # before any copying
        ticket_id = secrets.token_urlsafe(16)
        path = self._upload(ticket_id)
        partial = path.with_suffix(".partial")
        try:
            copy = copy_upload(upload, partial, self.limits)
            ticket = self._ticket(ticket_id, filename, copy, check_only)
            self._store.admit(ticket, user, self.limits, lambda: self._keep(ticket, partial))
        except BaseException:
            partial.unlink(missing_ok=True)
            path.unlink(missing_ok=True)
            raise
        return ticket

    def _keep(self, ticket: Ticket, partial: Path) -> None:
        """Give a copied file its name for good, unless it is entered already.

        No job of this file waits when this is asked, so one that was scored is entered.
        """
        if found := self._entered(ticket.sha256):
            said = f"this very file is entered already: {found.entry}"
            raise TurnedAwayError("entered", said)
        partial.replace(self._upload(ticket.ticket_id))
        sync_folder(self._uploads)

    def _ticket(self, ticket_id: str, filename: str, copy: Copy, check_only: bool) -> Ticket:
        sent = datetime.datetime.fromtimestamp(self._clock(), tz=datetime.UTC)
        about = (_printable(filename), copy.sha256, copy.size_bytes, sent)
        return Ticket(ticket_id, *about, check_only)

    def _note_turned_away(self, user: str, away: TurnedAwayError) -> None:
        try:
            self._store.note("turned_away", user=user, reason=away.reason)
        except sqlite3.OperationalError as err:
            away.add_note(f"not in the audit log: {err}")

    def _upload(self, ticket_id: str) -> Path:
        return self._uploads / f"{ticket_id}.npz"

    def _entered(self, sha256: str) -> Outcome | None:
        return find_entered(
            self.results,
            sha256,
            protocol=self.rules.name,
            manifest_sha256=self.reference.manifest_sha256,
            split=self.reference.split,
        )

    def _setting(self) -> Setting:
        root, results = self.reference.folder.root.absolute(), self.results.absolute()
        memory = self.limits.job_memory_bytes
        return Setting(str(root), self.reference.split, self.rules.name, str(results), memory)

    def _clear_away(self) -> None:
        """Remove uploads that no ticket needs: of killed desks, and refused ones."""
        needed = {self._upload(ticket_id) for ticket_id in self._store.kept_tickets()}
        for path in self._uploads.iterdir():
            if path not in needed:
                path.unlink()


def _locked(state: Path) -> AbstractContextManager[object]:
    """Take the lock of a state folder, which a kill frees."""
    try:
        return FileLock(state / "lock", timeout=0, thread_local=False).acquire()
    except Timeout as err:
        raise DataError(f"{state}: another desk is open on this folder") from err


def _open_store(state: Path, clock: Callable[[], float]) -> Store:
    """Open the tickets and take up what the last desk left."""
    log = AuditLog(state / "audit.jsonl")
    try:
        store = Store(state / "tickets.db", log, clock)
    except BaseException:
        log.close()
        raise
    try:
        store.take_up()
    except sqlite3.Error as err:
        store.close()
        raise DataError(f"{state}: the tickets cannot be taken up: {err}") from err
    return store


def _printable(filename: str) -> str:
    r"""Return a stranger's name of a file so that it can be shown.

    Examples
    --------
    >>> _printable("../my\u202enet.npz")
    '../my?net.npz'
    """
    shown = "".join(one if one.isprintable() else "?" for one in filename[:_NAME_LENGTH])
    return shown or "unnamed"
