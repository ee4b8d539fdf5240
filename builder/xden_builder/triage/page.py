"""The page: one HTML file that asks nobody for anything.

Every text of the data is escaped by the template engine, and a content security policy lets the
page use its own pictures, style and script alone: whatever a name or a note says, nothing else is
loaded or run.
"""

from __future__ import annotations

import base64
import hashlib
import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from xden_builder.triage.card import Card
from xden_builder.triage.chart import chart
from xden_builder.triage.findings import Findings
from xden_builder.triage.flags import FlagKind, Severity, flag_kinds
from xden_builder.triage.pictures import RESIDUAL_LIMIT

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

__all__ = ["render"]

TEMPLATE: Final = "index.html.j2"
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
    cards: Sequence[Card], failures: Sequence[tuple[str, str]], name: str, path: Path
) -> None:
    """Write the page.

    Parameters
    ----------
    cards
        The objects, in the order in which they are shown.
    failures
        Object id and reason of objects that cannot be shown.
    name
        Of the dataset.
    path
        The file.
    """
    severities = Counter(card.findings.severity for card in cards)
    style, script = _resource("report.css"), _resource("report.js")
    stream = (
        _environment()
        .get_template(TEMPLATE)
        .stream(
            name=name,
            cards=cards,
            failures=failures,
            counts=[(key or "none", words, severities[key]) for key, words in COUNTED.items()],
            kinds=_kinds(cards),
            categories=sorted({card.findings.category for card in cards}),
            sources=[(SOURCES[key], n) for key, n in Counter(c.source for c in cards).items()],
            chart=chart(cards),
            residual_limit=RESIDUAL_LIMIT,
            style=style,
            script=script,
            style_hash=_hash(style),
            script_hash=_hash(script),
        )
    )
    with path.open("wb") as file:
        stream.dump(file, encoding="utf-8")


def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("xden_builder.triage", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(figure=_figure, fixed=_fixed, code=_code)
    environment.globals.update(source_words=SOURCES, mass=_mass, few=FEW)
    return environment


def _kinds(cards: Iterable[Card]) -> list[tuple[FlagKind, int]]:
    """Return each flag that was raised and for how many objects, the gravest first."""
    counts = Counter(kind for card in cards for kind in card.findings.by_kind)
    known = list(flag_kinds())
    rank = {kind: known.index(kind.flag) if kind.flag in known else -1 for kind in counts}
    return sorted(counts.items(), key=lambda each: (rank[each[0]], each[0].flag))


def _resource(name: str) -> Markup:
    """Return a file of this package as it is, for the page."""
    from markupsafe import Markup

    text = (files("xden_builder.triage") / name).read_text(encoding="utf-8")
    return Markup(text)  # noqa: S704 - our own file


def _hash(text: str) -> str:
    """Name a style or script as a content security policy does."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode('ascii')}"


def _figure(value: Any, digits: int = 4) -> str:
    """Format a figure; what is not known is a dash.

    Examples
    --------
    >>> _figure(225.04), _figure(12345.6), _figure(0.98765, 3), _figure(None)
    ('225', '12350', '0.988', '-')
    """
    if value is None or math.isnan(value):
        return "-"
    return f"{float(f'{value:.{digits}g}'):g}"


def _fixed(value: float | None, decimals: int) -> str:
    """Format a figure near 1; what is not known is a dash.

    Examples
    --------
    >>> _fixed(0.99997, 4), _fixed(-0.08963, 4), _fixed(None, 4)
    ('1.0000', '-0.0896', '-')
    """
    return "-" if value is None or math.isnan(value) else f"{value:.{decimals}f}"


def _mass(findings: Findings) -> str:
    """Format a mass with its standard deviation, as far as they are known."""
    if math.isnan(findings.mass_g):
        return "mass unknown"
    sd = "" if math.isnan(findings.mass_sd_g) else f" ± {_figure(findings.mass_sd_g, 2)}"
    return f"{_figure(findings.mass_g)}{sd} g"


def _code(text: str) -> Markup:
    """Escape a text, and mark as code what stands in backticks."""
    from markupsafe import Markup, escape

    pieces = re.split(r"`([^`]+)`", text)
    marked = (
        Markup("<code>{}</code>").format(piece) if number % 2 else escape(piece)
        for number, piece in enumerate(pieces)
    )
    return Markup("").join(marked)
