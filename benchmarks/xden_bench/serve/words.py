"""What the pages say, without a page: of an object, of a file sent in, of who sent it."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any, Final

import numpy as np

from xden1k.errors import XDenError
from xden1k.predictions import CODES, Problem
from xden1k.values.types import DensityObject
from xden_bench.scoring.metrics import METRICS
from xden_bench.serve.tickets import Status

__all__ = ["object_line", "problem_rows", "result_rows", "status_html", "user_of"]

Rows = list[list[Any]]

SOURCES: Final = {
    "scan": "scan; the truth is the builder's reconstruction",
    "phantom": "phantom: simulated, never on a scanner",
    "ct": "ct: views computed from a CT",
    "published": "published: the authors' release; the truth is this project's estimate",
}


def user_of(request: Any, *, login: bool) -> str:
    """Whom the limits count by: the account, or the address if there is no login.

    Raises
    ------
    XDenError
        If a login is needed and there is none.
    """
    if not login:
        return str(request.username or request.client.host)
    account: Mapping[str, Any] = request.session.get("oauth_info") or {}
    name = account.get("userinfo", {}).get("preferred_username")
    if not name:
        raise XDenError("Log in with Hugging Face first.")
    return str(name)


def status_html(status: Status) -> str:
    """Say how it stands with a file; whatever comes from a stranger is escaped."""
    name = f"<code>{escape(status.ticket.filename)}</code>"
    errors = sum(one.is_error for one in status.problems)
    footnotes = len(status.problems) - errors
    said = {
        "queued": f"<strong>Queued</strong>: {status.ahead} before it.",
        "checking": f"<strong>Checking</strong>: {status.checked} of {status.total} objects.",
        "refused": f"<strong>Refused</strong>, problems: {errors}. {escape(status.message)}",
        "failed": f"<strong>Failed</strong>, not known to be its fault. {escape(status.message)}",
        "scored": f"<strong>Entered</strong>, footnotes: {footnotes}.",
    }[status.state]
    bar = ""
    if status.state == "checking" and status.total:
        bar = f'<progress max="{status.total}" value="{status.checked}"></progress>'
    return f'<div role="status" data-state="{status.state}"><p>{name} {said}</p>{bar}</div>'


def problem_rows(problems: tuple[Problem, ...]) -> tuple[list[str], Rows]:
    """Headings and rows of the problems: code, object, its meaning, what was found."""
    rows = [[one.code, one.object_id or "file", CODES[one.code], one.message] for one in problems]
    return ["code", "object", "meaning", "found"], rows


def result_rows(metrics: Mapping[str, Mapping[str, Any]]) -> tuple[list[str], Rows]:
    """Headings and rows of a result: metric, mean, 95 % interval."""
    rows = [
        [METRICS[name].heading, f"{one['mean']:.4f}", "{:.4f} to {:.4f}".format(*one["ci95"])]
        for name, one in metrics.items()
    ]
    return ["metric", "mean", "95 % interval"], rows


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
