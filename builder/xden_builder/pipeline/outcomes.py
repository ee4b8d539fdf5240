"""What became of each object of a run, and of all of them."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any, Final, Literal

from xden1k.values.cost import Cost
from xden1k.values.plain import plain
from xden_builder.pipeline.version import BUILDER
from xden_builder.poly.hardness import Hardness
from xden_builder.triage.findings import Findings
from xden_builder.triage.remarks import FolderRemark, folder_remarks
from xden_builder.triage.sizes import FolderSize, folder_size

__all__ = ["REPORT_NAME", "REPORT_SCHEMA", "BuildReport", "Outcome", "Status"]

REPORT_NAME: Final = "build_report.json"
REPORT_SCHEMA: Final = "xden-build-report/3"
COSTS: Final = tuple(field.name for field in fields(Cost))

Status = Literal["built", "kept", "failed"]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one object.

    Parameters
    ----------
    object_id
        Which.
    status
        ``built`` now, ``kept`` from an earlier run, or ``failed``.
    message
        Why it failed; empty otherwise.
    findings
        Flags and numbers by which the object is judged; None if it failed.
    cost
        What it took the worker, of an object that is kept hardly anything; None if it failed.
    digest
        Checksum of all it was made from; empty if it failed.
    """

    object_id: str
    status: Status
    message: str = ""
    findings: Findings | None = None
    cost: Cost | None = None
    digest: str = ""

    @property
    def needs_you(self) -> bool:
        """Whether a person must look: it failed, or its gravest flag says so."""
        return self.findings is None or self.findings.severity == "needs_you"

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        found = {"severity": "needs_you"} if self.findings is None else self.findings.to_dict()
        return {
            "object_id": self.object_id,
            "status": self.status,
            "message": self.message,
            **found,
            **(dict.fromkeys(COSTS) if self.cost is None else asdict(self.cost)),
            "digest": self.digest,
        }


@dataclass(frozen=True, slots=True)
class BuildReport:
    """What became of every object of a rebuild.

    Parameters
    ----------
    outcomes
        Of each object, sorted by id.
    beam
        That was found for all; None where none was sought.
    shared_processor_s
        What workers took to find what objects share; None if it was kept from an earlier run, or
        is not told.
    """

    outcomes: tuple[Outcome, ...]
    beam: Hardness | None = None
    shared_processor_s: float | None = None

    def count(self, status: Status) -> int:
        """How many objects ended so."""
        return sum(outcome.status == status for outcome in self.outcomes)

    @property
    def failures(self) -> tuple[Outcome, ...]:
        """The objects that failed."""
        return tuple(outcome for outcome in self.outcomes if outcome.status == "failed")

    @property
    def judged(self) -> tuple[Findings, ...]:
        """Findings of the objects that are there, the worst first."""
        found = [outcome.findings for outcome in self.outcomes if outcome.findings is not None]
        return tuple(sorted(found, key=lambda findings: findings.order))

    @property
    def size(self) -> FolderSize | None:
        """How large the objects are beside their meshes; None where none tells it."""
        return folder_size(self.judged)

    @property
    def remarks(self) -> tuple[FolderRemark, ...]:
        """What all objects show together, if it is not as it was told; the gravest first."""
        found = folder_remarks(self.beam, self.size, self.judged)
        return tuple(sorted(found, key=lambda each: each.severity != "needs_you"))

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        size = self.size
        counts = {status: self.count(status) for status in ("built", "kept", "failed")}
        values: dict[str, Any] = plain(
            {
                "schema": REPORT_SCHEMA,
                "builder": BUILDER,
                **counts,
                "beam": None if self.beam is None else asdict(self.beam),
                "size": None if size is None else asdict(size),
                "shared_processor_s": self.shared_processor_s,
                "remarks": [asdict(remark) for remark in self.remarks],
                "needs_you": sum(outcome.needs_you for outcome in self.outcomes),
                "objects": [outcome.to_dict() for outcome in self.outcomes],
            }
        )
        return values
