"""The pages that take a file and say live how it fares. Needs the extra ``view``."""

from __future__ import annotations

import asyncio
from contextlib import aclosing
from http import HTTPStatus
from typing import Any, Final

from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Route

from xden_bench.entries.standing import standing
from xden_bench.serve.board import Asked, link
from xden_bench.serve.desk import Desk
from xden_bench.serve.incoming import Incoming
from xden_bench.serve.render import render
from xden_bench.serve.standings import Snapshot, Standings, place_of
from xden_bench.serve.tickets import Status, Ticket, TurnedAwayError
from xden_bench.serve.words import account_of, problem_rows, result_rows, user_of

__all__ = ["submit_routes"]

_CODES: Final = {
    "too_large": HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
    "too_often": HTTPStatus.TOO_MANY_REQUESTS,
    "one_at_a_time": HTTPStatus.TOO_MANY_REQUESTS,
    "entered": HTTPStatus.CONFLICT,
    "no_file": HTTPStatus.BAD_REQUEST,
    "too_slow": HTTPStatus.REQUEST_TIMEOUT,
    "not_here": HTTPStatus.FORBIDDEN,
}
_FULL: Final = HTTPStatus.SERVICE_UNAVAILABLE


class _Page:
    """Answers to what visitors send.

    Parameters
    ----------
    desk
        Takes the files.
    standings
        Has the ranks.
    incoming
        Receives the files.
    login
        Whether users must log in with Hugging Face; else the limits count by address.
    """

    def __init__(
        self, desk: Desk, standings: Standings, incoming: Incoming, *, login: bool
    ) -> None:
        self.desk, self.standings, self.incoming, self.login = desk, standings, incoming, login

    def ask(self, request: Request, away: TurnedAwayError | None = None) -> Response:
        """Show the form, and why a file was not taken."""
        page = render(
            "submit",
            page="/submit",
            split=self.desk.reference.split,
            revision=self.desk.reference.revision,
            protocol=self.desk.rules.name,
            limits=self.desk.limits,
            login=self.login,
            user=account_of(request) if self.login else None,
            away=away and str(away),
        )
        return HTMLResponse(page, _CODES.get(away.reason, _FULL) if away else HTTPStatus.OK)

    async def take(self, request: Request) -> Response:
        """Take a file, and lead to its page."""
        try:
            ticket = await self._taken(request)
        except TurnedAwayError as away:
            return await asyncio.to_thread(self.ask, request, away)
        return RedirectResponse(f"/submit/{ticket.ticket_id}", HTTPStatus.SEE_OTHER)

    def look(self, request: Request) -> Response:
        """Say how it stands with a file: the whole page, or what changes of it."""
        status = self.desk.status(request.path_params["ticket"])
        template = "status" if request.query_params.get("part") == "status" else "ticket"
        return HTMLResponse(render(template, page="/submit", **self._values(status)))

    async def _taken(self, request: Request) -> Ticket:
        if request.headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none"):
            raise TurnedAwayError("not_here", "a file can only be sent from this page")
        user = user_of(request, login=self.login)
        await asyncio.to_thread(self.desk.check, user)
        async with (
            aclosing(request.stream()) as body,
            self.incoming.receive(user, request.headers, body) as got,
        ):
            return await asyncio.to_thread(
                self.desk.submit,
                got.path,
                user=user,
                filename=got.filename,
                check_only=got.action == "check",
            )

    def _values(self, status: Status) -> dict[str, Any]:
        place = self._place(status)
        said, href = _standing(self.standings.now, place) if place else ("", "")
        return {
            "status": status,
            "errors": sum(one.is_error for one in status.problems),
            "problems": problem_rows(status.problems)[1],
            "result": result_rows(status.metrics),
            "standing": said,
            "href": href,
            "waiting": not status.is_final or bool(place and not said),
        }

    def _place(self, status: Status) -> str:
        """Where the entry lies among the results, without its suffix; nothing if there is none."""
        if status.entry_path is None:
            return ""
        return status.entry_path.relative_to(self.desk.results).with_suffix("").as_posix()


def submit_routes(
    desk: Desk, standings: Standings, incoming: Incoming, *, login: bool
) -> list[Route]:
    """Return the addresses that take files and tell of them."""
    page = _Page(desk, standings, incoming, login=login)
    return [
        Route("/submit", page.ask),
        Route("/submit", page.take, methods=["POST"]),
        Route("/submit/{ticket}", page.look),
    ]


def _standing(snapshot: Snapshot, place: str) -> tuple[str, str]:
    """Where an entry stands, and the address of its row; empty while its rank is being computed."""
    found = snapshot.row_of(place)
    if found is None:
        return "", ""
    table, row = found
    said = standing(row, table.rank_of(row), table.ranks)
    return said, link(Asked(row=place_of(row)))
