"""Griffe extension: the few marks of reStructuredText in our docstrings, as Markdown."""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension, Module, Object

ROLE = re.compile(r":(?:class|func|meth|mod|data|attr|exc|obj):`~?([^`]+)`")


class MarkdownDocstrings(Extension):
    """Turns roles and literal blocks into what the site renders."""

    def on_package(self, *, pkg: Module, **_: Any) -> None:
        """Rewrite every docstring of a package."""
        _rewrite(pkg)


def _rewrite(obj: Object) -> None:
    if obj.docstring:
        obj.docstring.value = as_markdown(obj.docstring.value)
    for member in obj.members.values():
        if not member.is_alias:
            _rewrite(member)


def as_markdown(text: str) -> str:
    """Return a docstring without roles, ``::`` and double backticks.

    Examples
    --------
    >>> as_markdown("See :func:`~xden1k.rays.path_lengths` of ``rays``::")
    'See `path_lengths` of `rays`:'
    """
    text = ROLE.sub(lambda role: f"`{role[1].rsplit('.', 1)[-1]}`", text)
    text = re.sub(r"``([^`]+)``", r"`\1`", text)
    text = re.sub(r"^::$", "", text, flags=re.MULTILINE)
    return re.sub(r"::$", ":", text, flags=re.MULTILINE)
