"""The page of an alignment."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Final

from xden_builder.pipeline.align.card import AlignCard
from xden_builder.triage.flags import flag_kind, flag_kinds
from xden_builder.triage.html import render_page, resource

__all__ = ["render"]

FEW: Final = 6
"""So few objects are all open from the start."""
PACKAGE: Final = "xden_builder.pipeline.align"


def render(
    cards: Sequence[AlignCard], failures: Sequence[tuple[str, str]], name: str, path: Path
) -> None:
    """Write the page.

    Parameters
    ----------
    cards
        The objects, in the order in which they are shown.
    failures
        Object id and reason of objects that could not be put in place.
    name
        Of the captures.
    path
        The file.
    """
    raised = Counter(flag for card in cards for flag in card.flags)
    own_style = (files(PACKAGE) / "align.css").read_text(encoding="utf-8")
    render_page(
        PACKAGE,
        path,
        style=resource("report.css") + own_style,
        name=name,
        cards=cards,
        failures=failures,
        clean=sum(not card.flags for card in cards),
        kinds=[(flag_kind(flag), raised[flag]) for flag in flag_kinds() if flag in raised],
        few=FEW,
    )
