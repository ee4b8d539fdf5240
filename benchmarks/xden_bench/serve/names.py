"""Names and links of strangers: whether they can be mistaken for others."""

from __future__ import annotations

import re
import unicodedata
from typing import Final

__all__ = ["alphabets", "is_link"]

_LINK: Final = re.compile(r"https?://[A-Za-z0-9.-]+(:\d+)?(/[\w./:~%?=&#+-]*)?", re.ASCII)


def alphabets(text: str) -> str:
    r"""Name the alphabets of a text that has other signs than ASCII, else return nothing.

    Letters of other alphabets look like Latin ones, so that a text can be taken for another.

    Examples
    --------
    >>> alphabets("pixie"), alphabets("p\u0456xie"), alphabets("\u0440\u0430")
    ('', 'Cyrillic and Latin', 'Cyrillic')
    """
    if text.isascii():
        return ""
    found = {unicodedata.name(one, "unknown").split()[0].title() for one in text if one.isalpha()}
    return " and ".join(sorted(found)) or "none"


def is_link(text: str) -> bool:
    r"""Whether a text is a web address of ASCII alone, which is what it looks like.

    Examples
    --------
    >>> is_link("https://example.org/code"), is_link("https://ex\u0430mple.org")
    (True, False)
    """
    return _LINK.fullmatch(text) is not None
