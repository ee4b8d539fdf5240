"""Pages: one HTML file each that asks nobody for anything.

Every text of the data is escaped by the template engine, and a content security policy lets the
page use its own pictures, style and script alone: whatever a name or a note says, nothing else is
loaded or run.
"""

from __future__ import annotations

import base64
import hashlib
import math
import re
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

__all__ = ["figure", "render_page", "resource"]

TEMPLATE: Final = "index.html.j2"


def render_page(package: str, path: Path, *, style: str, script: str = "", **values: Any) -> None:
    """Write a page.

    Parameters
    ----------
    package
        Whose ``index.html.j2`` it is made of.
    path
        The file.
    style, script
        All the page has of them; our own files, not of the data.
    values
        Of the template, beside ``style``, ``script`` and, for the policy, ``style_hash`` and
        ``script_hash``.
    """
    from markupsafe import Markup

    stream = (
        _environment(package)
        .get_template(TEMPLATE)
        .stream(
            **values,
            style=Markup(style),  # noqa: S704 - our own file
            script=Markup(script),  # noqa: S704 - our own file
            style_hash=_hash(style),
            script_hash=_hash(script),
        )
    )
    with path.open("wb") as file:
        stream.dump(file, encoding="utf-8")


def resource(name: str) -> str:
    """Return a style or script that pages share."""
    return (files("xden_builder.triage") / name).read_text(encoding="utf-8")


def _environment(package: str) -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader(package, ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(figure=figure, fixed=_fixed, code=_code)
    return environment


def _hash(text: str) -> str:
    """Name a style or script as a content security policy does."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode('ascii')}"


def figure(value: Any, digits: int = 4) -> str:
    """Format a figure; what is not known is a dash.

    Examples
    --------
    >>> figure(225.04), figure(12345.6), figure(0.98765, 3), figure(None)
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


def _code(text: str) -> Markup:
    """Escape a text, and mark as code what stands in backticks."""
    from markupsafe import Markup, escape

    pieces = re.split(r"`([^`]+)`", text)
    marked = (
        Markup("<code>{}</code>").format(piece) if number % 2 else escape(piece)
        for number, piece in enumerate(pieces)
    )
    return Markup("").join(marked)
