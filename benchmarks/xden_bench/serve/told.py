"""What the pages share: errors as a message on the page, settings of events and components."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, Final, ParamSpec, TypeVar

import gradio as gr

from xden1k.errors import XDenError

__all__ = ["GRID", "PRIVATE", "frame", "offer", "told"]

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

PRIVATE: Final[dict[str, Any]] = {"api_visibility": "private"}
"""Of every event: for the page itself, no interface for programs."""
GRID: Final[dict[str, Any]] = {"interactive": False, "type": "array", "buttons": []}
"""Of every table."""


def told(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Decorate what answers an event: a deliberate error is shown on the page, in its words."""

    @functools.wraps(function)
    def answer(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        try:
            return function(*args, **kwargs)
        except XDenError as err:
            raise gr.Error(str(err), print_exception=False) from err

    return answer


def frame(headings: Sequence[str], rows: list[list[Any]]) -> Any:
    """Fill a table: numbers sort as numbers, everything else is plain text."""
    columns = zip(*rows, strict=True) if rows else ([] for _ in headings)
    kinds = ["number" if any(map(_is_number, column)) else "str" for column in columns]
    return gr.update(value={"headers": list(headings), "data": rows}, datatype=kinds)


def offer(choices: Sequence[Any], chosen: Any) -> Any:
    """Fill a list of choices, given as values or as pairs of label and value; keep the chosen one.

    Returns
    -------
    tuple
        The update of the component, and the value it has then: the first if the chosen one is
        none of them, None if there are none.
    """
    values = [one[1] if isinstance(one, tuple) else one for one in choices]
    value = chosen if chosen in values else next(iter(values), None)
    return gr.update(choices=list(choices), value=value), value


def _is_number(cell: Any) -> bool:
    return isinstance(cell, int | float)
