"""The plain pages: every text of the data is escaped by the template engine. Extra ``view``."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined

__all__ = ["STATIC", "render", "static"]

STATIC: Final = {"site.css": "text/css", "ticket.js": "text/javascript"}
"""Files that the pages load, and their types."""


def render(template: str, **values: Any) -> str:
    """Fill a template of the folder ``pages``."""
    return _environment().get_template(f"{template}.html.j2").render(**values)


@cache
def static(name: str) -> bytes:
    """Return a file of :data:`STATIC`."""
    return (files("xden_bench.serve") / "pages" / name).read_bytes()


@cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("xden_bench.serve", "pages"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
