"""The desk: takes submissions from users, has them scored one by one, and loses none."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

from xden_bench.protocol import Protocol as Rules
from xden_bench.reference import Reference
from xden_bench.serve.limits import Limits
from xden_bench.serve.tickets import Status, Ticket

__all__ = ["Desk"]


class Desk(Protocol):
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
        Folder of the entries, as ``xden-bench submit`` writes them.
    state
        Folder of the desk's own: uploads, tickets, audit log. One desk at a time.
    limits
        How much it takes on.

    Raises
    ------
    DataError
        If another desk is open on the state folder, or it holds something else.
    """

    def __init__(
        self,
        reference: Reference,
        rules: Rules,
        *,
        results: Path,
        state: Path,
        limits: Limits = ...,
    ) -> None: ...

    def submit(self, upload: Path, *, user: str, filename: str) -> Ticket:
        """Take a file; it is copied, the upload can go.

        Parameters
        ----------
        upload
            The file as the web server stored it.
        user
            Whom the limits count by, such as a login or an address; only a keyed hash is kept.
        filename
            As the user calls it.

        Raises
        ------
        TurnedAwayError
            If the file is not taken; its ``reason`` and text say why.
        OSError
            If the upload cannot be read.
        """
        ...

    def status(self, ticket_id: str) -> Status:
        """Say how it stands with a file.

        Raises
        ------
        MissingObjectError
            If there is no such ticket.
        """
        ...

    def entries(self) -> tuple[dict[str, Any], ...]:
        """Every entry among the results, as :func:`xden_bench.result.read_entries` gives them.

        They are read again only when a file of the results has changed.

        Raises
        ------
        DataError
            If one of them cannot be trusted.
        """
        ...

    def upload_of(self, submission_sha256: str) -> Path | None:
        """Return the scored submission of that checksum if it came to this desk, else None."""
        ...

    def close(self) -> None:
        """Stop; what is queued or half done is taken up by the next desk on the state folder."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...
