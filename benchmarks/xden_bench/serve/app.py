"""The web app put together: addresses, guards, and the server. Needs the extra ``view``."""

from __future__ import annotations

import socket
from collections.abc import Awaitable, Callable, MutableMapping, Sequence
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final

import uvicorn
from fastapi import FastAPI
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Route

from xden1k.errors import DataError, MissingObjectError
from xden_bench.serve.desk import Desk
from xden_bench.serve.incoming import Incoming
from xden_bench.serve.page_board import board_routes
from xden_bench.serve.page_submit import submit_routes
from xden_bench.serve.render import STATIC, render, static
from xden_bench.serve.standings import Standings

__all__ = ["OBJECTS", "Guard", "bind", "build_app", "headers", "serve"]

Message = MutableMapping[str, Any]
Send = Callable[[Message], Awaitable[None]]

OBJECTS: Final = "/objects"
"""Where gradio's page is; the others are plain."""
_PLAIN: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; style-src-attr 'unsafe-inline'; "
    "img-src 'self' data:; connect-src 'self'; form-action 'self'; base-uri 'none'"
)
_GRADIO: Final = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "connect-src 'self' data: blob:; worker-src 'self' blob:; object-src 'none'; "
    "base-uri 'self'; form-action 'self'"
)
_SPACES: Final = "https://huggingface.co"


def build_app(desk: Desk, standings: Standings, folder: Path, *, login: bool = False) -> FastAPI:
    """Build the pages over a desk, but for the explorer, which is mounted at :data:`OBJECTS`.

    Parameters
    ----------
    desk
        Takes files, and knows the dataset.
    standings
        Has the entries and their ranks.
    folder
        For files on their way in; it is of the server's own.
    login
        Whether whoever sends a file must log in with Hugging Face (in a Space of theirs).
    """
    routes: list[BaseRoute] = [
        Route("/", lambda _: RedirectResponse("/board")),
        Route("/static/{name}", _static),
        *board_routes(standings),
        *submit_routes(desk, standings, Incoming(folder / "incoming", desk.limits), login=login),
    ]
    app = FastAPI(
        routes=routes,
        openapi_url=None,
        exception_handlers={MissingObjectError: _missing, HTTPStatus.NOT_FOUND: _missing},
    )
    if login:
        from huggingface_hub import attach_huggingface_oauth

        attach_huggingface_oauth(app)
    app.add_middleware(Guard, embedded=login)
    return app


def bind(host: str, port: int) -> socket.socket:
    """Take an address, before anything else is begun; nobody is answered or kept waiting there yet.

    Raises
    ------
    DataError
        If it cannot be had.
    """
    found = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        found.bind((host, port))
    except OSError as err:
        found.close()
        raise DataError(
            f"cannot listen at {host}, port {port}: {err.strerror}: choose another --host or --port"
        ) from err
    return found


def serve(app: FastAPI, listener: socket.socket, trusted_proxies: Sequence[str]) -> None:
    """Serve until interrupted.

    Parameters
    ----------
    app
        From :func:`build_app`.
    listener
        From :func:`bind`, listening.
    trusted_proxies
        Addresses or networks whose ``X-Forwarded-For`` is believed: a visitor is then the last
        address in it that is none of theirs. Nobody else's is.
    """
    config = uvicorn.Config(
        app,
        log_level="warning",
        proxy_headers=bool(trusted_proxies),
        forwarded_allow_ips=list(trusted_proxies),
        server_header=False,
    )
    uvicorn.Server(config).run([listener])


def headers(path: str, *, embedded: bool) -> dict[str, str]:
    """Return what goes with every answer: a page may load nothing from elsewhere.

    Parameters
    ----------
    path
        What was asked for.
    embedded
        Whether the pages may stand in a page of Hugging Face; else in none but their own.
    """
    policy = _GRADIO if path.startswith(OBJECTS) else _PLAIN
    ancestors = f"'self' {_SPACES}" if embedded else "'self'"
    return {
        "content-security-policy": f"{policy}; frame-ancestors {ancestors}",
        "x-content-type-options": "nosniff",
        "referrer-policy": "same-origin",
        "cross-origin-opener-policy": "same-origin",
        "permissions-policy": "camera=(), geolocation=(), microphone=()",
    }


class Guard:
    """Puts :func:`headers` on every answer, and keeps files from the explorer, which needs none."""

    def __init__(self, app: Callable[..., Awaitable[None]], *, embedded: bool) -> None:
        self._app, self._embedded = app, embedded

    async def __call__(self, scope: Message, receive: Callable[..., Any], send: Send) -> None:
        """Answer a request."""
        path = scope.get("path", "")

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                ours = headers(path, embedded=self._embedded)
                extra = [(name.encode(), value.encode()) for name, value in ours.items()]
                message = {**message, "headers": [*message.get("headers", []), *extra]}
            await send(message)

        if path.startswith(OBJECTS) and "/upload" in path:
            await Response("no files here", HTTPStatus.FORBIDDEN)(scope, receive, guarded)
        else:
            await self._app(scope, receive, guarded)


def _static(request: Request) -> Response:
    name = request.path_params["name"]
    if name not in STATIC:
        raise MissingObjectError("there is no such file")
    return Response(static(name), media_type=STATIC[name])


async def _missing(_: Request, err: Exception) -> Response:
    said = str(err) if isinstance(err, MissingObjectError) else "There is no such page."
    page = render("problem", page="", title="Not found", said=said)
    return HTMLResponse(page, HTTPStatus.NOT_FOUND)
