"""Audit a whole dataset folder: a process per core, one bad object never stops the rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from xden1k.folder import open_folder
from xden_builder.audit.object import ObjectAudit, audit_object
from xden_builder.capture import CaptureFolder
from xden_builder.workers import gather

__all__ = ["AuditReport", "audit_folder"]


@dataclass(frozen=True, slots=True)
class AuditReport:
    """Audits of a dataset folder, sorted by object, and what could not be audited.

    Parameters
    ----------
    audits
        One for each object that could be audited.
    failures
        Object id and reason of the others.
    """

    audits: tuple[ObjectAudit, ...]
    failures: tuple[tuple[str, str], ...]

    @property
    def good(self) -> bool:
        """Whether everything was audited, and every view shows its parts."""
        return not self.failures and all(audit.good for audit in self.audits)

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return {
            "good": self.good,
            "objects": [audit.to_dict() for audit in self.audits],
            "failures": [{"object_id": key, "message": why} for key, why in self.failures],
        }


def audit_folder(
    root: Path,
    captures: Path,
    *,
    workers: int,
    on_done: Callable[[str], None] = lambda _: None,
) -> AuditReport:
    """Audit every object of a dataset folder against its capture.

    Parameters
    ----------
    root
        The dataset folder.
    captures
        The capture folder it was made from.
    workers
        Number of processes.
    on_done
        Called with each object's id as it is done.

    Raises
    ------
    DataError
        If one of the folders as a whole is not readable.
    """
    CaptureFolder(captures)
    task = partial(_audit_object, root, captures)
    audits, failures = gather(task, open_folder(root).ids(), workers, on_done)
    return AuditReport(tuple(audits.values()), tuple(failures))


def _audit_object(root: Path, captures: Path, object_id: str) -> ObjectAudit:
    source = CaptureFolder(captures)
    obj = open_folder(root).object(object_id)
    return audit_object(obj, source.read(object_id), source.ct(object_id))
