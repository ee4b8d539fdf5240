"""What is to be said of one rebuilt object, from what its row of the dataset keeps."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from xden_builder.triage.flags import FlagKind, Severity, flag_kind, flag_kinds

__all__ = ["COLUMNS", "Findings", "Remark", "find"]

COLUMNS: Final = (
    *("object_id", "category", "flags", "mass_g", "weighed_mass_g"),
    *("part_names", "part_flags", "meta_json"),
)
"""Of a row of the dataset: those that findings are made of."""


@dataclass(frozen=True, slots=True)
class Remark:
    """A flag where it was raised.

    Parameters
    ----------
    flag
        Its name.
    of
        The part or view it was raised for; empty for the object.
    """

    flag: str
    of: str = ""

    @property
    def kind(self) -> FlagKind:
        """What the flag means."""
        return flag_kind(self.flag)

    @property
    def rank(self) -> int:
        """0 is the gravest; a flag that is not known comes before all."""
        return list(flag_kinds()).index(self.flag) if self.flag in flag_kinds() else -1

    def __str__(self) -> str:
        return f"{self.of}:{self.flag}" if self.of else self.flag

    def to_dict(self) -> dict[str, str]:
        """Values for JSON."""
        return {"flag": self.flag, "of": self.of, "severity": self.kind.severity}


@dataclass(frozen=True, slots=True)
class Findings:
    """Remarks and numbers by which one object is judged.

    Parameters
    ----------
    object_id, category
        Which, and what it is.
    remarks
        The gravest first.
    mass_g, mass_sd_g
        As rebuilt; nan where no density is known.
    weighed_mass_g
        On the scale; None where it never was on one.
    weighing
        The mass on the scale beside that by the images alone, as ``meta_json`` has it.
    views
        By view: correlation of transmission, shares and boxes of what is unexplained, and blur, as
        ``meta_json`` has them.
    size_factor
        Length of the object over that of its meshes; None where it was not sought.
    apart
        How much larger it is before one view than before the others, as ``meta_json`` has it; None
        where that was not asked.
    """

    object_id: str
    category: str
    remarks: tuple[Remark, ...]
    mass_g: float
    mass_sd_g: float
    weighed_mass_g: float | None
    weighing: Mapping[str, Any] | None
    views: Mapping[str, Mapping[str, Any]]
    size_factor: float | None = None
    apart: Mapping[str, Any] | None = None

    @property
    def severity(self) -> Severity | None:
        """That of the gravest remark; None without any."""
        return self.remarks[0].kind.severity if self.remarks else None

    @property
    def needs_you(self) -> tuple[Remark, ...]:
        """Remarks for which a person must look."""
        return tuple(one for one in self.remarks if one.kind.severity == "needs_you")

    @property
    def by_kind(self) -> Mapping[FlagKind, tuple[Remark, ...]]:
        """The remarks by what they say, the gravest first."""
        kinds = dict.fromkeys(remark.kind for remark in self.remarks)
        return {
            kind: tuple(remark for remark in self.remarks if remark.kind == kind) for kind in kinds
        }

    @property
    def order(self) -> tuple[float, ...]:
        """Sorts the worst object first: by its gravest remark, then by how many grave ones."""
        grave = self.needs_you
        share = self.mass_sd_g / self.mass_g if self.mass_g else math.inf
        first = self.remarks[0].rank if self.remarks else len(flag_kinds())
        return (first, -len(grave), math.inf if math.isnan(share) else -share)

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON; boxes and pictures are the report's."""
        return {
            "severity": self.severity,
            "flags": [remark.to_dict() for remark in self.remarks],
            "mass_g": self.mass_g,
            "mass_sd_g": self.mass_sd_g,
            "weighed_mass_g": self.weighed_mass_g,
            "weighing": self.weighing,
            "views": self.views,
            "size_factor": self.size_factor,
        }


def find(row: Mapping[str, Any]) -> Findings:
    """Judge one object.

    Parameters
    ----------
    row
        Of the dataset: :data:`COLUMNS` at least.

    Examples
    --------
    >>> row = {"object_id": "mug-1", "category": "mug", "flags": ["pa:saturated"], "mass_g": 225.0,
    ...        "weighed_mass_g": None, "part_names": ["body"], "part_flags": [["label_doubted"]],
    ...        "meta_json": "{}"}
    >>> [str(remark) for remark in find(row).remarks]
    ['body:label_doubted', 'pa:saturated']
    """
    meta = json.loads(row["meta_json"])
    return Findings(
        object_id=row["object_id"],
        category=row["category"],
        remarks=tuple(sorted(_remarks(row), key=lambda remark: (remark.rank, str(remark)))),
        mass_g=row["mass_g"],
        mass_sd_g=meta.get("uncertainty", {}).get("mass_sd_g", math.nan),
        weighed_mass_g=row["weighed_mass_g"],
        weighing=meta.get("poly", {}).get("weighing"),
        views=meta.get("reprojection", {}),
        size_factor=meta.get("mesh_size", {}).get("factor"),
        apart=((meta.get("poly") or {}).get("pose") or {}).get("apart"),
    )


def _remarks(row: Mapping[str, Any]) -> Iterator[Remark]:
    for text in row["flags"]:
        of, _, flag = text.rpartition(":")
        yield Remark(flag, of)
    for name, flags in zip(row["part_names"], row["part_flags"], strict=True):
        yield from (Remark(flag, name) for flag in flags)
