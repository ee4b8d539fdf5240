"""The leaderboard's addresses: the page, and the same for programs. Needs the extra ``view``."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import lru_cache
from typing import Any, Final

from markupsafe import Markup
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route

from xden_bench.scoring.metrics import METRICS
from xden_bench.serve import api
from xden_bench.serve.board import Asked, best_first, board_values, kind
from xden_bench.serve.figures import interval_picture
from xden_bench.serve.render import render
from xden_bench.serve.standings import Snapshot, Standings, Table

__all__ = ["board_routes"]

PAGES_KEPT: Final = 256
HISTORY_S: Final = 60
"""For which the history is not looked up again."""
_QUESTIONS: Final = ("table", "track", "metric", "row")


def board_routes(standings: Standings) -> list[Route]:
    """Return the addresses of the leaderboard.

    Pages are drawn once for each snapshot: what is asked again is there already.
    """
    page, chart = lru_cache(PAGES_KEPT)(_page), lru_cache(PAGES_KEPT)(_chart)
    as_csv, as_json = lru_cache(1)(api.board_csv), lru_cache(1)(api.board_json)

    @lru_cache(1)
    def history(_: int) -> list[dict[str, Any]]:
        return api.history(standings.results)

    def show_page(request: Request) -> Response:
        texts = {key: request.query_params.get(key) or None for key in _QUESTIONS}
        return HTMLResponse(page(standings.now, Asked(**texts), chart))

    def show_json(_: Request) -> Response:
        return JSONResponse(as_json(standings.now))

    def show_csv(_: Request) -> Response:
        return Response(as_csv(standings.now), media_type="text/csv; charset=utf-8")

    def show_history(_: Request) -> Response:
        return JSONResponse(history(int(time.monotonic() / HISTORY_S)))

    return [
        Route("/board", show_page),
        Route("/api/board.json", show_json),
        Route("/api/board.csv", show_csv),
        Route("/api/history.json", show_history),
    ]


def _page(snapshot: Snapshot, asked: Asked, chart: Callable[[Table, str], Markup]) -> str:
    values = board_values(snapshot, asked)
    if "table" in values:
        values["chart"] = chart(values["table"], values["metric"])
    return render("board", page="/board", **values)


def _chart(table: Table, metric: str) -> Markup:
    rows = best_first(table.rows, metric)
    picture = interval_picture(rows, metric, METRICS[metric].heading, [kind(row) for row in rows])
    return Markup(picture)  # noqa: S704 - drawn by matplotlib, which escapes
