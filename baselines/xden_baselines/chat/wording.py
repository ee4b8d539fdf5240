"""What a model puts around its answer: thoughts, fences, emphasis, brackets, remarks."""

from __future__ import annotations

import re
from collections.abc import Iterator

from xden1k.errors import DataError

__all__ = ["answer_lines", "bare", "said"]

_THOUGHT = re.compile(r"<(think|thinking|reasoning)>.*?</\1>", re.DOTALL | re.IGNORECASE)
_OPEN_THOUGHT = re.compile(r"<(think|thinking|reasoning)>", re.IGNORECASE)
_END_OF_THOUGHT = re.compile(r"</(?:think|thinking|reasoning)>", re.IGNORECASE)
"""Alone where the server's template has opened the thought."""
_HALF = re.compile("[\ud800-\udfff]")
"""Of a character: JSON can hold one, a request cannot."""
_FENCE = re.compile(r"```[\w-]*\n(.*?)\n?```", re.DOTALL)
_BULLET = re.compile(r"^\s*(?:[-*\u2022]\s+|\d{1,2}[.)]\s+)")
_LEAD_IN = re.compile(
    r"(?:(?:the|my|final)\s+)*(?:answer|output|response|result|list)(?:\s+is)?\s*:\s*(?=\S)",
    re.IGNORECASE,
)
"""What stands before an answer on its own line."""
_EMPHASIS = re.compile(r"\*+|`+|(?<!\w)_+|_+(?!\w)")
_PAIRS = {"(": ")", "[": "]", "<": ">", '"': '"', "'": "'"}


def said(text: str) -> str:
    r"""Return an answer without the thoughts before it, out of its code fence, without emphasis.

    Raises
    ------
    DataError
        If it ends within a thought, or has half a character in it.

    Examples
    --------
    >>> said("<think>wood? no</think>Here it is:\n```text\n**Steel**, 0.8\n```")
    'Steel, 0.8'
    """
    rest = _THOUGHT.sub("", text)
    if _OPEN_THOUGHT.search(rest):
        raise DataError("the answer ends within a thought: more tokens are needed")
    rest = _END_OF_THOUGHT.split(rest)[-1]
    if _HALF.search(rest):
        raise DataError("the answer has half a character in it")
    fenced = _FENCE.findall(rest)
    return _EMPHASIS.sub("", fenced[-1] if fenced else rest).strip()


def answer_lines(text: str) -> Iterator[str]:
    r"""Give the lines of an answer that are not empty, without bullets, numbers and ``Answer:``.

    Examples
    --------
    >>> list(answer_lines("1. steel\n\n- oak\nAnswer: pine"))
    ['steel', 'oak', 'pine']
    """
    for line in said(text).splitlines():
        if plain := _BULLET.sub("", line).strip():
            found = _LEAD_IN.match(plain)
            yield plain[found.end() :] if found else plain


def bare(text: str) -> str:
    """Return a text without the brackets or quotes all around it, and without a full stop.

    Examples
    --------
    >>> bare(' (a lid, "steel", 0.8). '), bare("(a) lid (b)"), bare("(lid (a))")
    ('a lid, "steel", 0.8', '(a) lid (b)', 'lid (a)')
    """
    plain = text.strip().rstrip(".;").strip()
    while len(plain) > 1 and _PAIRS.get(plain[0]) == plain[-1] and not _opens(plain):
        plain = plain[1:-1].strip()
    return plain


def _opens(text: str) -> bool:
    """Whether the first bracket or quote is closed before the end."""
    first, last = text[0], _PAIRS[text[0]]
    if first == last:
        return first in text[1:-1]
    depth = 0
    for place, sign in enumerate(text):
        depth += (sign == first) - (sign == last)
        if depth == 0:
            return place < len(text) - 1
    return True
