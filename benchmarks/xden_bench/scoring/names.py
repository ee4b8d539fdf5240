"""When two names of methods are the same to a reader."""

from __future__ import annotations

import unicodedata
from typing import Final

__all__ = ["skeleton"]

_LOOK_ALIKES: Final = (("rn", "m"), ("vv", "w"), ("0", "o"), ("1", "l"), ("i", "l"), ("5", "s"))
"""Names are ASCII, so that this short list replaces the tables of Unicode (UTS 39)."""


def skeleton(name: str) -> str:
    """Return what is left of a name without case, spaces, punctuation and letters that look alike.

    Examples
    --------
    >>> skeleton(" W.a.t.e.r ") == skeleton("vvater")
    True
    >>> skeleton("Pixie 2") == skeleton("pixie-3")
    False
    """
    folded = unicodedata.normalize("NFKC", name).casefold()
    letters = "".join(one for one in folded if one.isalnum())
    for written, seen in _LOOK_ALIKES:
        letters = letters.replace(written, seen)
    return letters
