"""The page of a report."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final

from xden_builder.triage.card import Card
from xden_builder.triage.chart import chart
from xden_builder.triage.findings import Findings
from xden_builder.triage.flags import FlagKind, Severity, flag_kinds
from xden_builder.triage.html import figure, render_page, resource
from xden_builder.triage.pictures import RESIDUAL_LIMIT
from xden_builder.triage.remarks import FolderRemark

__all__ = ["is_report", "render"]

TITLE: Final = ": what needs you</title>"
"""Ends that of every page, of all versions."""
HEAD_BYTES: Final = 4096
"""Of a page, in which its title stands."""
COUNTED: Final[Mapping[Severity | None, str]] = {
    "needs_you": "need you",
    "information": "for information",
    None: "without a flag",
}
FEW: Final = 3
"""So few objects are all open from the start."""
SOURCES: Final = {
    "scan": "scanned",
    "phantom": "simulated, never on a scanner",
    "ct": "views computed from a CT",
    "published": "the authors' release",
}


def render(
    cards: Sequence[Card],
    failures: Sequence[tuple[str, str]],
    remarks: Sequence[FolderRemark],
    name: str,
    path: Path,
) -> None:
    """Write the page.

    Parameters
    ----------
    cards
        The objects, in the order in which they are shown.
    failures
        Object id and reason of objects that cannot be shown.
    remarks
        What all objects show together.
    name
        Of the dataset.
    path
        The file.
    """
    severities = Counter(card.findings.severity for card in cards)
    render_page(
        "xden_builder.triage",
        path,
        style=resource("report.css"),
        script=resource("report.js"),
        name=name,
        cards=cards,
        failures=failures,
        remarks=remarks,
        counts=[(key or "none", words, severities[key]) for key, words in COUNTED.items()],
        kinds=_kinds(cards),
        categories=sorted({card.findings.category for card in cards}),
        sources=[(SOURCES[key], n) for key, n in Counter(c.source for c in cards).items()],
        chart=chart(cards),
        residual_limit=RESIDUAL_LIMIT,
        source_words=SOURCES,
        mass=_mass,
        few=FEW,
    )


def is_report(path: Path) -> bool:
    """Whether a page was written by :func:`render`."""
    with path.open("rb") as stream:
        return TITLE.encode() in stream.read(HEAD_BYTES)


def _kinds(cards: Iterable[Card]) -> list[tuple[FlagKind, int]]:
    """Return each flag that was raised and for how many objects, the gravest first."""
    counts = Counter(kind for card in cards for kind in card.findings.by_kind)
    known = list(flag_kinds())
    rank = {kind: known.index(kind.flag) if kind.flag in known else -1 for kind in counts}
    return sorted(counts.items(), key=lambda each: (rank[each[0]], each[0].flag))


def _mass(findings: Findings) -> str:
    """Format a mass with its standard deviation, as far as they are known."""
    if math.isnan(findings.mass_g):
        return "mass unknown"
    sd = "" if math.isnan(findings.mass_sd_g) else f" ± {figure(findings.mass_sd_g, 2)}"
    return f"{figure(findings.mass_g)}{sd} g"
