"""The leaderboard's addresses: the page, and the same for programs. Needs the extra ``view``."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import lru_cache
from threading import Lock
from typing import Any, Final

from markupsafe import Markup
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route

from xden_bench.entries.ranking import Entry
from xden_bench.scoring.metrics import METRICS
from xden_bench.serve import api
from xden_bench.serve.board import ORACLE, Asked, best_first, board_values, kind
from xden_bench.serve.figures import interval_picture
from xden_bench.serve.render import render
from xden_bench.serve.standings import Snapshot, Standings, Table

__all__ = ["Once", "board_routes"]

PAGES_KEPT: Final = 256
CHARTED: Final = 25
"""Methods that are drawn, beside the oracles: more make a chart that no screen holds."""
HISTORY_S: Final = 60
"""For which the history is not looked up again."""
_QUESTIONS: Final = ("table", "track", "metric", "row")


def board_routes(standings: Standings) -> list[Route]:
    """Return the addresses of the leaderboard.

    Pages are drawn once for each snapshot and question: what is asked again is there already.
    """
    chart = Once(_chart)
    page = Once(lambda snapshot, asked: _page(snapshot, asked, chart))
    as_csv, as_json = Once(api.board_csv), Once(api.board_json)

    @lru_cache(1)
    def history(_: int) -> list[dict[str, Any]]:
        return api.history(standings.results)

    def show_page(request: Request) -> Response:
        texts = {key: request.query_params.get(key) or None for key in _QUESTIONS}
        return HTMLResponse(page(standings.now, Asked(**texts)))

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


class Once:
    """Computes something once for each question on a snapshot, however many ask at the same time.

    What is there already is had without a lock. What was said of an older snapshot goes, and so
    does the oldest answer when there are too many.

    Parameters
    ----------
    compute
        Given a snapshot, and more that can be a key.
    """

    def __init__(self, compute: Callable[..., Any]) -> None:
        self._compute, self._lock = compute, Lock()
        self._about: Snapshot | None = None
        self._found: dict[tuple[Any, ...], Any] = {}

    def __call__(self, snapshot: Snapshot, *asked: Any) -> Any:
        """Return what the function does."""
        key = (snapshot, *asked)
        if (found := self._found.get(key)) is not None:
            return found
        with self._lock:
            if self._about is not snapshot:
                self._about, self._found = snapshot, {}
            if key not in self._found:
                self._found[key] = self._compute(*key)
            if len(self._found) > PAGES_KEPT:
                del self._found[next(iter(self._found))]
            return self._found[key]


def _page(snapshot: Snapshot, asked: Asked, chart: Once) -> str:
    values = board_values(snapshot, asked)
    if "table" in values:
        values["chart"] = chart(snapshot, values["table"], values["metric"])
    return render("board", page="/board", **values)


def _chart(_: Snapshot, table: Table, metric: str) -> Markup:
    rows = _charted(best_first(table.rows, metric))
    heading = METRICS[metric].heading
    if len(rows) < len(table.rows):
        heading += f", the best {CHARTED}"
    picture = interval_picture(rows, metric, heading, [kind(row) for row in rows])
    return Markup(picture)  # noqa: S704 - drawn by matplotlib, which escapes


def _charted(rows: Sequence[Entry]) -> list[Entry]:
    """Keep the first of the methods, and every oracle."""
    methods = [row for row in rows if not kind(row).startswith(ORACLE)]
    left_out = {id(row) for row in methods[CHARTED:]}
    return [row for row in rows if id(row) not in left_out]
