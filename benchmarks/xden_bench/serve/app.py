"""The web app put together: pages, look, and the server's guards. Needs the extra ``view``."""

from __future__ import annotations

import os
from collections.abc import Awaitable, Callable, MutableMapping
from pathlib import Path
from typing import Any, Final

import gradio as gr
from starlette.middleware import Middleware

from xden_bench.serve.desk import Desk
from xden_bench.serve.explorer import Explorer
from xden_bench.serve.page_board import board_page
from xden_bench.serve.page_explore import explore_page
from xden_bench.serve.page_submit import submit_page, visitor_memory
from xden_bench.serve.told import PRIVATE

__all__ = ["HEADERS", "Guard", "build_app", "launch"]

Message = MutableMapping[str, Any]
Send = Callable[[Message], Awaitable[None]]

HEADERS: Final = {
    "content-security-policy": (
        "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; "
        "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
        "connect-src 'self' data: blob:; worker-src 'self' blob:; object-src 'none'; "
        "base-uri 'self'"
    ),
    "x-content-type-options": "nosniff",
    "referrer-policy": "same-origin",
}
"""Of every answer: a page may load nothing from elsewhere, whatever gradio would like to."""

CSS: Final = """
.gradio-container {
  width: 100%; min-width: 0; max-width: min(1280px, 100vw) !important; margin: auto;
  box-sizing: border-box; overflow-x: clip;
}
.gradio-container .column, .gradio-container .block, .gradio-container .form { min-width: 0 }
.note { font-size: 0.92em; opacity: 0.85 }
#chart { max-width: 900px }
#status progress { width: 100%; height: 0.9em }
#board td, #problems td, #parts td { overflow-wrap: anywhere }
@media (hover: none) {
  .header-cell .cell-menu-button { display: flex !important }
  .header-cell .cell-wrap { padding-right: 2em }
}
@media (max-width: 640px) {
  .gradio-container .row, .gradio-container .form { flex-direction: column }
  .gradio-container .row > * { width: 100%; min-width: 0 !important }
  .gradio-container { padding: 6px !important }
  .gradio-container table { font-size: 0.82em }
}
"""
CACHE_SECONDS: Final = (600, 3600)
"""How often gradio's copies of files are looked through, and the age at which they go."""
AT_ONCE: Final = 4
"""Events answered at the same time."""


def build_app(desk: Desk, scratch: Path, *, login: bool = False) -> gr.Blocks:
    """Build the three pages over a desk.

    Parameters
    ----------
    desk
        Has the entries, takes files, and knows the dataset.
    scratch
        Empty folder for 3D models.
    login
        Whether whoever sends a file must log in with Hugging Face (in a Space of theirs).
    """
    os.environ["GRADIO_ANALYTICS_ENABLED"] = "False"
    explorer = Explorer(desk.reference.folder, desk.upload_of, scratch)
    app = gr.Blocks(title="XDen-1K benchmark", analytics_enabled=False, delete_cache=CACHE_SECONDS)
    with app:
        gr.Markdown(
            "# XDen-1K benchmark\n\nHow dense is every voxel of an object, where is its centre of "
            "mass, and what does it weigh?"
        )
        memory = visitor_memory()
        with gr.Tabs():
            with gr.Tab("Leaderboard", id="leaderboard") as first:
                board = board_page(desk.entries, desk.results)
            with gr.Tab("Objects", id="objects") as second:
                fill_objects_on = explore_page(explorer, desk.entries, desk.results)
            with gr.Tab("Submit", id="submit") as third:
                sent = submit_page(desk, memory, login=login)
        app.load(*board, **PRIVATE)
        app.load(*sent, show_progress="hidden", **PRIVATE)
        third.select(*sent, show_progress="hidden", **PRIVATE)
        first.select(*board, show_progress="hidden", **PRIVATE)
        fill_objects_on(second.select)
    return app


def launch(app: gr.Blocks, desk: Desk, *, host: str, port: int, block: bool = True) -> str:
    """Serve the app; returns its address at once if it does not block.

    Raises
    ------
    OSError
        If the port is taken.
    """
    app.queue(api_open=False, default_concurrency_limit=AT_ONCE)
    _, address, _ = app.launch(
        server_name=host,
        server_port=port,
        share=False,
        prevent_thread_lock=not block,
        show_error=True,
        quiet=True,
        footer_links=[],
        max_file_size=desk.limits.upload_bytes,
        ssr_mode=False,
        app_kwargs={"middleware": [Middleware(Guard)]},
        theme=gr.themes.Default(
            font=["system-ui", "sans-serif"], font_mono=["ui-monospace", "monospace"]
        ),
        css=CSS,
    )
    return str(address)


class Guard:
    """Puts :data:`HEADERS` on every answer of a web application."""

    def __init__(self, app: Callable[..., Awaitable[None]]) -> None:
        self._app = app

    async def __call__(self, scope: Message, receive: Callable[..., Any], send: Send) -> None:
        """Answer a request."""

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                extra = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
                message = {**message, "headers": [*message.get("headers", []), *extra]}
            await send(message)

        await self._app(scope, receive, guarded)
