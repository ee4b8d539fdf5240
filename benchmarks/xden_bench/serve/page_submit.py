"""The page that takes a file and says live how it fares. Needs the extra ``view``."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Any, Final

import gradio as gr

from xden1k.errors import MissingObjectError
from xden_bench.serve.desk import Desk
from xden_bench.serve.tickets import Status, TurnedAwayError
from xden_bench.serve.told import GRID, PRIVATE, frame, told
from xden_bench.serve.words import problem_rows, result_rows, status_html, user_of

__all__ = ["submit_page", "visitor_memory"]

TICKET_KEY: Final = "xden-ticket"
POLL_SECONDS: Final = 0.7
IDLE: Final = "<p>No file sent yet.</p>"


def visitor_memory() -> tuple[gr.BrowserState, gr.Timer]:
    """Return what keeps a visitor's ticket, and the clock by which it is looked at.

    They belong outside the tabs: what is in one exists on the page once the tab was open.
    """
    kept = gr.BrowserState(None, storage_key=TICKET_KEY, secret=TICKET_KEY)
    return kept, gr.Timer(POLL_SECONDS, active=False)


def submit_page(
    desk: Desk, memory: tuple[gr.BrowserState, gr.Timer], *, login: bool
) -> tuple[Callable[..., list[Any]], Any, list[Any]]:
    """Build the page inside a tab; what is returned is as of the leaderboard's page.

    Parameters
    ----------
    desk
        Takes the files.
    memory
        From :func:`visitor_memory`.
    login
        Whether users must log in with Hugging Face; else the limits count by address.
    """
    limits, split = desk.limits, desk.reference.split
    gr.Markdown(
        f"Send a `preds.npz` for the **{split}** split of dataset {desk.reference.revision}, at "
        f"most {limits.upload_mb} MB, {limits.jobs_per_user_hour} files an hour, one at a time. "
        "It is checked whole; every problem is listed. A sound file becomes an entry, which is "
        "public and never changed. `xden-bench validate` and `xden-bench score` do the same on "
        "your own machine and keep nothing.",
        elem_classes="note",
    )
    if login:
        gr.LoginButton()
    file = gr.File(label="preds.npz", file_types=[".npz"], type="filepath", elem_id="upload")
    send = gr.Button("Check and enter", variant="primary", elem_id="send")
    state = gr.HTML(IDLE, elem_id="status")
    problems = gr.Dataframe(
        label="Problems and footnotes", elem_id="problems", wrap=True, visible=False, **GRID
    )
    result = gr.Dataframe(label="Result", elem_id="result", visible=False, **GRID)
    ticket, timer = memory
    shown = [state, problems, result, timer]

    @told
    def take(path: str | None, request: gr.Request) -> list[Any]:
        if path is None:
            raise gr.Error("Choose a file first.", print_exception=False)
        try:
            user = user_of(request, login=login)
            got = desk.submit(Path(path), user=user, filename=Path(path).name)
        except TurnedAwayError as err:
            text = f"<p><strong>Not taken.</strong> {escape(str(err))}</p>"
            hidden = gr.update(visible=False)
            return [gr.skip(), text, hidden, hidden, gr.Timer(active=False)]
        return [got.ticket_id, *_shown(desk.status(got.ticket_id))]

    @told
    def look(ticket_id: str | None) -> list[Any]:
        if ticket_id is None:
            return [IDLE, gr.skip(), gr.skip(), gr.Timer(active=False)]
        try:
            return _shown(desk.status(ticket_id))
        except MissingObjectError:
            return [IDLE, gr.skip(), gr.skip(), gr.Timer(active=False)]

    send.click(take, file, [ticket, *shown], **PRIVATE)
    timer.tick(look, ticket, shown, show_progress="hidden", **PRIVATE)
    return look, ticket, shown


def _shown(status: Status) -> list[Any]:
    return [
        status_html(status),
        frame(*problem_rows(status.problems)) | {"visible": bool(status.problems)},
        frame(*result_rows(status.metrics)) | {"visible": bool(status.metrics)},
        gr.Timer(active=not status.is_final),
    ]
