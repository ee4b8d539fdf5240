"""What the desk gives out: a ticket for each file it took, and how it stands with it."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from xden1k.errors import XDenError
from xden1k.predictions import Problem

__all__ = ["Reason", "State", "Status", "Ticket", "TurnedAwayError"]

State = Literal["queued", "checking", "refused", "sound", "scored", "failed"]
"""``queued`` and ``checking`` come to one of the other four, which are final.

``sound`` is a file that was only to be checked, and would be entered.

``refused`` is the fault of the file, ``failed`` is not known to be: the process died, ran out of
time or memory, or the disk was full.
"""

Reason = Literal[
    "too_large",
    "too_often",
    "one_at_a_time",
    "queue_full",
    "entered",
    "no_room",
    "no_file",
    "too_slow",
    "not_here",
]
"""Why a file is not taken at all."""


class TurnedAwayError(XDenError):
    """The desk did not take a file; nothing of it is kept.

    Parameters
    ----------
    reason
        For a program.
    message
        For the user, on one line.
    """

    def __init__(self, reason: Reason, message: str) -> None:
        super().__init__(message)
        self.reason = reason


@dataclass(frozen=True, slots=True)
class Ticket:
    """A file that the desk took.

    Parameters
    ----------
    ticket_id
        Nobody can guess it: whoever has it may see how the file fares.
    filename
        As the user calls it, printable, at most 80 characters; text of a stranger.
    sha256
        Checksum of the file.
    size_bytes
        Of the file.
    sent
        When, UTC.
    check_only
        Whether it is only to be checked, and not entered.
    """

    ticket_id: str
    filename: str
    sha256: str
    size_bytes: int
    sent: datetime.datetime
    check_only: bool = False


@dataclass(frozen=True, slots=True)
class Status:
    """How it stands with a file.

    Parameters
    ----------
    ticket
        The file.
    state
        See :data:`State`.
    ahead
        While ``queued``: files that are checked before it; else 0.
    checked, total
        While ``checking``: objects done, of how many; 0 of 0 until the file is open.
    problems
        ``refused``: everything that is wrong, errors first. ``sound``, ``scored``: the warnings.
    message
        ``refused`` or ``failed``: why, on one line, where it is no coded problem; else empty.
    entry_path
        ``scored``: the entry's JSON file; else None.
    metrics
        ``scored``: as in the entry, by name ``{"mean": float, "ci95": [low, high]}``; else empty.
    """

    ticket: Ticket
    state: State
    ahead: int
    checked: int
    total: int
    problems: tuple[Problem, ...]
    message: str
    entry_path: Path | None
    metrics: Mapping[str, Mapping[str, Any]]

    @property
    def is_final(self) -> bool:
        """Whether nothing will change any more."""
        return self.state not in ("queued", "checking")
