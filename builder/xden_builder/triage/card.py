"""Everything the report shows of one object."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from xden1k.folder import DatasetFolder, open_folder
from xden1k.format.records import row_object
from xden1k.values.types import DensityObject, Part, Source
from xden_builder.triage.findings import Findings, find
from xden_builder.triage.pictures import ViewPictures, draw

__all__ = ["Card", "ViewCard", "make_card"]


@dataclass(frozen=True, slots=True)
class ViewCard:
    """One view: pictures, and what the rebuild found of it.

    Parameters
    ----------
    name
        The view's.
    drawn
        Its pictures.
    found
        Correlation and what is unexplained, as ``meta_json`` has them; empty where nothing was
        fitted.
    """

    name: str
    drawn: ViewPictures
    found: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class PartCard:
    """One part: its figures, nan where unknown."""

    name: str
    material: str
    density_g_cm3: float
    density_sd_g_cm3: float
    lac_per_cm: float
    source: str
    flags: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Card:
    """One object, small enough to be sent between processes.

    Parameters
    ----------
    findings
        How it is judged.
    source
        Whether it was scanned or simulated.
    notes
        Of ``objects.csv``.
    views, parts
        In the order of the object's.
    """

    findings: Findings
    source: Source
    notes: str
    views: tuple[ViewCard, ...]
    parts: tuple[PartCard, ...]

    @property
    def has_no_density(self) -> bool:
        """Whether no part has one, so that its attenuation is what is known of it."""
        return all(math.isnan(part.density_g_cm3) for part in self.parts)


def make_card(root: Path, object_id: str) -> Card:
    """Read an object of a dataset folder and draw it.

    Raises
    ------
    DataError
        If the row is damaged, or a mesh reaches behind the source.
    """
    row = _folder(root).row(object_id)
    obj, findings = row_object(row), find(row)
    return Card(
        findings,
        obj.source,
        str(obj.meta.get("notes", "")),
        tuple(_view_cards(obj, findings)),
        tuple(_part_card(part) for part in obj.parts),
    )


@cache
def _folder(root: Path) -> DatasetFolder:
    """Open a folder once in a process."""
    return open_folder(root)


def _view_cards(obj: DensityObject, findings: Findings) -> Iterator[ViewCard]:
    for view in obj.views:
        found = findings.views.get(view.name, {})
        flags = {remark.flag for remark in findings.remarks if remark.of == view.name}
        boxes = {
            f"{kind}_box": found["unexplained"][f"{kind}_box"]
            for kind in ("content", "shadow")
            if f"unexplained_{kind}" in flags
        }
        yield ViewCard(view.name, draw(obj, view, boxes), found)


def _part_card(part: Part) -> PartCard:
    return PartCard(
        part.name,
        part.material,
        part.density_g_cm3,
        part.density_sd_g_cm3,
        part.lac_per_cm,
        part.density_source,
        part.flags,
    )
