"""The web app's addresses, asked without a browser: pages, guards, uploads and their limits."""

from __future__ import annotations

import asyncio
import re
import socket
import time
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import uvicorn
from fastapi import FastAPI

from tests.bench.desks import turned_away
from tests.waiting import until
from xden1k.errors import DataError
from xden_bench.entries.reading import read_entries
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.serve import app as web
from xden_bench.serve.desk import Desk
from xden_bench.serve.incoming import Incoming
from xden_bench.serve.limits import Limits
from xden_bench.serve.page_board import Once
from xden_bench.serve.standings import Snapshot, Standings

Submit = Callable[..., Path]
PROXY = "127.0.0.1"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("site")


@pytest.fixture(scope="module")
def desk(reference: Reference, place: Path) -> Iterator[Desk]:
    limits = Limits(jobs_per_user_hour=100, upload_mb=3)
    folders = {"results": place / "results", "state": place / "state"}
    with Desk(reference, load_protocol(), **folders, limits=limits) as opened:
        yield opened


@pytest.fixture(scope="module")
def site(desk: Desk, place: Path) -> Iterator[Any]:
    """The app over a small dataset."""
    standings = Standings(desk.results, place / "state" / "kept", workers=0)
    with standings:
        yield web.build_app(desk, standings, place / "state")


@pytest.fixture
def ask(site: Any) -> Callable[..., httpx.Response]:
    """Ask the app for something; it may not wander off by itself."""

    def get(path: str, method: str = "GET", **how: Any) -> httpx.Response:
        async def answer() -> httpx.Response:
            transport = httpx.ASGITransport(site, client=("203.0.113.9", 4))
            async with httpx.AsyncClient(transport=transport, base_url="http://desk") as client:
                return await client.request(method, path, **how)

        return asyncio.run(answer())

    return get


@pytest.fixture
def send(ask: Callable[..., httpx.Response]) -> Callable[..., httpx.Response]:
    def post(file: Path | bytes, action: str = "submit", **how: Any) -> httpx.Response:
        data = file if isinstance(file, bytes) else file.read_bytes()
        return ask("/submit", "POST", files={"file": ("net.npz", data)}, data={"action": action})

    return post


def ended(ask: Callable[..., httpx.Response], address: str, state: str) -> str:
    """Wait until a file's page says so, and nothing is open any more."""
    until(lambda: 'data-waiting="no"' in ask(address).text, every_s=0.1)
    page = ask(address).text
    assert f'data-state="{state}"' in page
    return page


def halved(_: str, grid: np.ndarray) -> np.ndarray:
    return np.float32(0.5) * grid


def test_a_file_is_checked_then_entered_and_its_page_links_to_its_rank(
    ask: Callable[..., httpx.Response],
    send: Callable[..., httpx.Response],
    submission: Submit,
    desk: Desk,
    place: Path,
) -> None:
    file = submission(halved, method="halved")
    checked = send(file, "check")
    assert checked.status_code == 303
    page = ended(ask, checked.headers["location"], "sound")
    assert "nothing was scored" in page
    assert read_entries(desk.results) == ()

    page = ended(ask, send(file).headers["location"], "scored")
    href, said = re.findall(r'<a id="standing" href="([^"]+)">([^<]+)</a>', page)[0]
    assert said == "rank 1 of 1 in track geometry"
    anchor = href.partition("#")[2]
    board = ask(href).text
    assert f'<tr id="{anchor}" class=" open"' in board
    assert "0.500" in page

    again = send(file)
    assert again.status_code == 409
    assert "entered already" in again.text
    for answer in (page, board, again.text, ask("/api/board.json").text):
        assert str(place) not in answer
    assert list((place / "state" / "incoming").iterdir()) == []


def test_what_is_no_file_or_too_large_is_turned_away_and_leaves_nothing(
    ask: Callable[..., httpx.Response], send: Callable[..., httpx.Response], place: Path
) -> None:
    answers = {
        "empty": send(b""),
        "no form": ask("/submit", "POST", content=b"x"),
        "large": send(bytes(3_100_000)),
        "from elsewhere": ask("/submit", "POST", headers={"sec-fetch-site": "cross-site"}),
    }
    codes = {name: answer.status_code for name, answer in answers.items()}
    assert codes == {"empty": 400, "no form": 400, "large": 413, "from elsewhere": 403}
    assert "choose one file first" in answers["empty"].text
    assert list((place / "state" / "incoming").iterdir()) == []


def test_pages_say_nothing_of_elsewhere_and_stand_in_no_other_page(
    ask: Callable[..., httpx.Response],
) -> None:
    for path in ("/board", "/submit", "/objects/none", "/api/board.csv", "/none"):
        answer = ask(path)
        policy = answer.headers["content-security-policy"]
        assert policy.endswith("frame-ancestors 'self'")
        assert "http" not in policy
        assert answer.headers["x-content-type-options"] == "nosniff"
    assert ask("/none").status_code == ask("/static/../app.py").status_code == 404
    assert "unsafe-inline' 'unsafe-eval" not in ask("/board").headers["content-security-policy"]
    assert "huggingface" in web.headers("/board", embedded=True)["content-security-policy"]


def test_the_explorer_takes_no_files(ask: Callable[..., httpx.Response]) -> None:
    files = {"files": ("a.npz", b"x" * 100)}
    for path in ("/objects/gradio_api/upload", "/objects/gradio_api//upload/"):
        assert ask(path, "POST", files=files).status_code == 403


@pytest.mark.slow
def test_a_strangers_name_is_text_on_the_board(
    ask: Callable[..., httpx.Response], send: Callable[..., httpx.Response], submission: Submit
) -> None:
    name = '"><script>alert(1)</script>'
    file = submission(lambda _, grid: np.float32(0.6) * grid, method=name)
    ended(ask, send(file).headers["location"], "scored")
    assert "<script" not in ask("/board").text.lower()


def body(size: int, pause_s: float = 0.0) -> AsyncIterator[bytes]:
    async def pieces() -> AsyncIterator[bytes]:
        yield b'--x\r\nContent-Disposition: form-data; name="file"; filename="a"\r\n\r\n'
        for _ in range(size):
            await asyncio.sleep(pause_s)
            yield b"1"
        yield b"\r\n--x--\r\n"

    return pieces()


def headers(length: int) -> dict[str, str]:
    return {"content-type": "multipart/form-data; boundary=x", "content-length": str(length)}


async def hold(incoming: Incoming, user: str, length: int) -> None:
    async with incoming.receive(user, headers(length), body(3)):
        pass


def test_files_on_their_way_are_bounded_by_client_and_in_all(tmp_path: Path) -> None:
    limits = Limits(upload_mb=10, incoming_mb=15)
    incoming = Incoming(tmp_path / "in", limits)

    async def both(user: str, length: int) -> None:
        async with incoming.receive("a", headers(9_000_000), body(3)) as got:
            assert got.path.read_bytes() == b"111"
            await hold(incoming, user, length)

    with turned_away("one_at_a_time"):
        asyncio.run(both("a", 100))
    with turned_away("no_room"):
        asyncio.run(both("b", 9_000_000))
    asyncio.run(both("b", 5_000_000))
    assert list((tmp_path / "in").iterdir()) == []


def test_a_file_that_does_not_come_in_time_is_gone_and_so_is_what_a_killed_server_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "left").write_bytes(b"x")
    incoming = Incoming(tmp_path / "in", Limits(upload_minutes=1))
    assert list((tmp_path / "in").iterdir()) == []
    monkeypatch.setattr("xden_bench.serve.incoming._MINUTE_S", 0.01)

    async def slow() -> None:
        async with incoming.receive("a", headers(100), body(50, pause_s=0.01)):
            pass

    with turned_away("too_slow"):
        asyncio.run(slow())
    assert list((tmp_path / "in").iterdir()) == []


@pytest.mark.parametrize(
    ("trusted", "sent", "seen"),
    [
        ((), "198.51.100.1", PROXY),
        ((PROXY,), "198.51.100.1", "198.51.100.1"),
        ((PROXY,), "6.6.6.6, 198.51.100.1", "198.51.100.1"),
        ((PROXY, "10.0.0.0/8"), "6.6.6.6, 198.51.100.1, 10.1.2.3", "198.51.100.1"),
    ],
)
def test_a_forwarded_address_is_believed_of_a_configured_proxy_alone(
    trusted: tuple[str, ...], sent: str, seen: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A visitor who writes the header has no more identities than without it."""
    configs: list[uvicorn.Config] = []
    monkeypatch.setattr(uvicorn.Server, "run", lambda self, _: configs.append(self.config))
    found: list[str] = []

    class Noting(FastAPI):
        async def __call__(self, scope: Any, *_: Any) -> None:
            found.append(scope["client"][0])

    with socket.socket() as listener:
        web.serve(Noting(), listener, trusted)
    (config,) = configs
    config.load()
    scope = {
        "type": "http",
        "client": (PROXY, 9),
        "headers": [(b"x-forwarded-for", sent.encode())],
    }
    asyncio.run(config.loaded_app(scope, None, None))  # type: ignore[arg-type]
    assert found == [seen]


def test_a_page_is_drawn_once_for_many_readers_and_nothing_old_is_kept() -> None:
    drawn: list[Any] = []
    page = Once(lambda snapshot, asked: drawn.append(asked) or time.sleep(0.05) or asked)
    first, second = Snapshot(), Snapshot()
    with ThreadPoolExecutor(8) as readers:
        assert list(readers.map(page, [first] * 8, ["a"] * 8)) == ["a"] * 8
    assert drawn == ["a"]
    page(second, "b")
    assert list(page._found) == [(second, "b")]


def test_a_port_that_is_taken_is_one_line() -> None:
    with web.bind("127.0.0.1", 0) as taken:
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(DataError, match=rf"cannot listen at 127\.0\.0\.1, port {port}: .*use"):
            web.bind("127.0.0.1", port)
