"""Text of strangers in Markdown."""

from __future__ import annotations

import re

__all__ = ["code", "link", "plain"]


def plain(text: str) -> str:
    """Text that Markdown shows as it is, whatever a stranger put into it.

    A ``<`` becomes an entity: what reads the page as HTML knows of no other escape.
    """
    return re.sub(r"([\\`*_\[\]>|~&$])", r"\\\1", text).replace("<", "&lt;")


def code(text: str) -> str:
    """Text as code, also in a table; with a ``<``, which stays one in backticks, as HTML."""
    if "<" in text:
        return f"<code>{plain(text)}</code>"
    return "`{}`".format(text.replace("`", "'").replace("|", "\\|"))


def link(text: str) -> str:
    """Turn a plain web address into a link, anything else into text."""
    return f"<{text}>" if re.fullmatch(r"https?://[\w./:~%?=&#+-]+", text) else plain(text)
