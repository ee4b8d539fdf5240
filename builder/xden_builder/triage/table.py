"""Findings as a table, one row for each object."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import pandas as pd

from xden_builder.triage.card import Card
from xden_builder.triage.findings import Findings

__all__ = ["table"]

FORMULA_STARTS: Final = ("=", "+", "-", "@", "\t", "\r")
"""Spreadsheets run what begins so (OWASP, CSV injection)."""


def table(cards: Iterable[Card]) -> pd.DataFrame:
    """Return figures and flags of objects, in their order; what is not known is empty."""
    return pd.DataFrame([_row(card) for card in cards])


def _row(card: Card) -> dict[str, Any]:
    findings = card.findings
    weighing = findings.weighing or {}
    return {
        "object_id": _as_text(findings.object_id),
        "category": _as_text(findings.category),
        "source": card.source,
        "severity": findings.severity or "",
        "flags": _as_text(" ".join(map(str, findings.remarks))),
        "mass_g": findings.mass_g,
        "mass_sd_g": findings.mass_sd_g,
        "weighed_mass_g": findings.weighed_mass_g,
        "by_images_g": weighing.get("by_images_g"),
        "by_images_sd_g": weighing.get("by_images_sd_g"),
        **_views(findings),
    }


def _views(findings: Findings) -> dict[str, Any]:
    return {
        key: value
        for name, found in sorted(findings.views.items())
        for key, value in (
            (f"{name}_transmission_corr", found["transmission_corr"]),
            (f"{name}_content_share", found["unexplained"]["content_share"]),
            (f"{name}_shadow_share", found["unexplained"]["shadow_share"]),
            (f"{name}_blur_share", found["blur"]["share"] if "blur" in found else None),
        )
    }


def _as_text(cell: str) -> str:
    """Mark as text what a spreadsheet would take for a formula."""
    return f"'{cell}" if cell.startswith(FORMULA_STARTS) else cell
