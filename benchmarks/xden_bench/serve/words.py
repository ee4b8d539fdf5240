"""What the pages say, without a page: of an object, of a file sent in, of who sent it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from xden1k.predictions import CODES, Problem
from xden1k.values.types import DensityObject
from xden_bench.scoring.metrics import METRICS
from xden_bench.serve.tickets import TurnedAwayError

if TYPE_CHECKING:
    from fastapi import Request

__all__ = ["account_of", "object_line", "problem_rows", "result_rows", "user_of"]

Rows = list[list[Any]]

SOURCES: Final = {
    "scan": "scan; the truth is the builder's reconstruction",
    "phantom": "phantom: simulated, never on a scanner",
    "ct": "ct: views computed from a CT",
    "published": "published: the authors' release; the truth is this project's estimate",
}


def user_of(request: Request, *, login: bool) -> str:
    """Whom the limits count by: the account, or the address if there is no login.

    Raises
    ------
    TurnedAwayError
        If a login is needed and there is none.
    """
    if login:
        if (name := account_of(request)) is None:
            raise TurnedAwayError("not_here", "log in with Hugging Face first")
        return name
    return request.client.host if request.client else ""


def account_of(request: Request) -> str | None:
    """Return the account at Hugging Face that a visitor has logged in with, if any."""
    from huggingface_hub import parse_huggingface_oauth

    found = parse_huggingface_oauth(request)
    return found.user_info.preferred_username if found else None


def problem_rows(problems: tuple[Problem, ...]) -> tuple[list[str], Rows]:
    """Headings and rows of the problems: code, object, its meaning, what was found."""
    rows = [[one.code, one.object_id or "file", CODES[one.code], one.message] for one in problems]
    return ["code", "object", "meaning", "found"], rows


def result_rows(metrics: Mapping[str, Mapping[str, Any]]) -> tuple[list[str], Rows]:
    """Headings and rows of a result: metric, mean, mean by category, 95 % interval."""
    rows = [
        [
            METRICS[name].heading,
            f"{one['mean']:.4f}",
            _printed([one["macro_mean"]] if "macro_mean" in one else None),
            _printed(one["ci95"]),
        ]
        for name, one in metrics.items()
    ]
    return ["metric", "mean", "by category", "95 % interval"], rows


def _printed(values: Sequence[float] | None) -> str:
    """Return a mean, or both ends of an interval; a dash where there is none."""
    return " to ".join(f"{one:.4f}" for one in values) if values else "-"


def object_line(obj: DensityObject) -> str:
    """One line of Markdown on an object: category, source, mass, centre of mass, flags."""
    mass = f"{obj.mass_g:.4g} g" if np.isfinite(obj.mass_g) else "mass unknown"
    weighed = [] if obj.weighed_mass_g is None else [f"weighed {obj.weighed_mass_g:.4g} g"]
    centre = ", ".join(f"{round(float(value), 2) + 0.0:.2f}" for value in obj.com_cm)
    words = [
        f"**{obj.object_id}**",
        obj.category.replace("_", " "),
        f"source **{SOURCES[obj.source]}**",
        mass,
        *weighed,
        f"centre of mass ({centre}) cm",
        *(f"flag {flag}" for flag in obj.flags),
    ]
    return " · ".join(words)
