"""The web app under load: readers and writers at the same time, and a server that is killed twice.

Everything is asked of a server of its own, at an address of the loopback, as strangers would ask.
"""

from __future__ import annotations

import asyncio
import os
import re
import socket
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import httpx
import numpy as np

from xden1k.folder import DatasetFolder, open_folder
from xden1k.predictions import SubmissionMeta, write_predictions
from xden_bench.entries.reading import read_entries
from xden_bench.speed.memory import anonymous_mb

__all__ = ["measure_serving"]

PAUSE_S: Final = 0.5
"""Between two requests of a reader, and two looks of a writer at how a file fares."""
PAGES: Final = ("/board", "/board?metric=mass_mape", "/api/board.json", "/api/board.csv", "/submit")
ALONE: Final = 50
"""Requests of one reader before the others come."""
FILES: Final = 3
"""The most that one writer sends; they are made before the load, lest that be measured too."""
_LIMITS: Final = "jobs_per_user_hour = 100000\nqueue_length = 1000\n"
_PROXY: Final = "127.0.0.1"
_TIMEOUT_S: Final = 60.0


@dataclass
class _Seen:
    """What was measured.

    Parameters
    ----------
    seconds
        Of each answered request, by what was asked.
    tickets
        Addresses of the pages of all files that were taken.
    memory_mb
        Of the server, in each of its lives, once a second.
    """

    seconds: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    tickets: list[str] = field(default_factory=list)
    memory_mb: list[list[float]] = field(default_factory=list)


class _Server:
    """A server in a process that can be killed, on folders that outlive it."""

    def __init__(self, root: Path, place: Path, seen: _Seen) -> None:
        (place / "limits.toml").write_text(_LIMITS)
        with socket.socket() as free:
            free.bind((_PROXY, 0))
            port = free.getsockname()[1]
        self.url = f"http://{_PROXY}:{port}"
        folders = ["--results", place / "results", "--state", place / "state"]
        more = ["--port", port, "--settings", place / "limits.toml", "--trusted-proxy", _PROXY]
        words = map(str, ["serve", "--root", root, *folders, *more])
        self._command = [sys.executable, "-c", "from xden_bench.cli import cli; cli()", *words]
        self._log, self._seen = place / "log", seen
        self.start()

    def start(self) -> None:
        """Start it; it answers when this returns."""
        self._seen.memory_mb.append([])
        with self._log.open("ab") as log:
            self.process = subprocess.Popen(  # noqa: S603 - our own program
                self._command, stdout=log, stderr=subprocess.STDOUT
            )
        while not self._answers():
            if self.process.poll() is not None:
                raise RuntimeError(f"the server ended: {self._log.read_text()[-2000:]}")
            time.sleep(0.1)

    def kill(self) -> None:
        """End it without a word."""
        self.process.kill()
        self.process.wait()

    def note_memory(self) -> None:
        """Note what it takes now."""
        self._seen.memory_mb[-1].append(anonymous_mb(self.process.pid))

    def _answers(self) -> bool:
        with suppress(httpx.TransportError):
            return httpx.get(f"{self.url}/board").is_success
        return False


def measure_serving(
    root: Path, place: Path, *, readers: int, writers: int, seconds: float
) -> dict[str, Any]:
    """Measure a server that many read from and send to, and that is killed twice meanwhile.

    Parameters
    ----------
    root
        Dataset; its test split is predicted.
    place
        Empty folder, or one with entries in ``results``.
    readers, writers
        How many, at the same time.
    seconds
        How long. The kills are after a third and after two thirds.

    Returns
    -------
    dict of str to Any
        ``machine``; ``requests``, by what was asked, each with ``count`` and ``p50_s``, ``p95_s``,
        ``worst_s``, ``board alone`` being of one reader before the load; ``taken`` and ``scored``,
        files; ``missing``, files that were taken and have no entry; ``memory_mb``, the first and
        the last of each life of the server.

    Raises
    ------
    DataError
        If the dataset cannot be read, a stored entry is not sound, or this is not Linux.
    """
    machine = {"cores": os.cpu_count(), "load_before": os.getloadavg()[0]}
    (place / "results").mkdir(exist_ok=True)
    before = len(read_entries(place / "results"))
    seen = _Seen()
    server = _Server(root, place, seen)
    try:
        asyncio.run(_load(server, seen, root, place, readers, writers, seconds))
    finally:
        server.kill()
    entered = len(read_entries(place / "results")) - before
    return {
        "machine": machine | {"load_after": os.getloadavg()[0]},
        "requests": {name: _summary(times) for name, times in seen.seconds.items()},
        "taken": len(seen.tickets),
        "scored": entered,
        "missing": len(set(seen.tickets)) - entered,
        "memory_mb": [[life[0], life[-1]] for life in seen.memory_mb if life],
    }


async def _load(
    server: _Server,
    seen: _Seen,
    root: Path,
    place: Path,
    readers: int,
    writers: int,
    seconds: float,
) -> None:
    async with _visitor(server, "192.0.2.1") as alone:
        for _ in range(ALONE):
            await _timed(seen, "board alone", alone.get, "/board")
    folder = open_folder(root)
    files = [
        [_submission(folder, place, number, turn) for turn in range(FILES)]
        for number in range(writers)
    ]
    end = time.monotonic() + seconds
    tasks = [_read(server, seen, number, end) for number in range(readers)]
    tasks += [_write(server, seen, own, number, end) for number, own in enumerate(files)]
    await asyncio.gather(_kill_twice(server, seconds), _watch(server, end), *tasks)


async def _read(server: _Server, seen: _Seen, number: int, end: float) -> None:
    async with _visitor(server, f"10.1.0.{number}") as reader:
        while time.monotonic() < end:
            for page in PAGES:
                with suppress(httpx.TransportError):  # the server was killed
                    await _timed(seen, page, reader.get, page)
                await asyncio.sleep(PAUSE_S)


async def _write(
    server: _Server, seen: _Seen, files: Sequence[Path], number: int, end: float
) -> None:
    """Send one file after another; each is looked at until it has a rank."""
    async with _visitor(server, f"10.2.0.{number}") as writer:
        for file in files:
            if time.monotonic() < end:
                ticket = await _sent(seen, writer, file)
                seen.tickets.append(ticket)
                await _ranked(seen, writer, ticket)


async def _sent(seen: _Seen, writer: httpx.AsyncClient, file: Path) -> str:
    """Send a file until it is taken, and return the address of its page."""
    while True:
        with suppress(httpx.TransportError):
            form = {"file": (file.name, file.read_bytes())}
            answer = await _timed(seen, "send a file", writer.post, "/submit", files=form)
            if answer.status_code == httpx.codes.SEE_OTHER:
                return str(answer.headers["location"])
            if answer.status_code == httpx.codes.CONFLICT:  # taken, but the answer was lost
                return file.name
        await asyncio.sleep(PAUSE_S)


async def _ranked(seen: _Seen, writer: httpx.AsyncClient, ticket: str) -> None:
    """Wait until a file has a rank."""
    if not ticket.startswith("/"):
        return
    start = time.monotonic()
    while True:
        with suppress(httpx.TransportError):
            page = await _timed(seen, "how it fares", writer.get, f"{ticket}?part=status")
            if 'id="standing"' in page.text:
                seen.seconds["from sent to ranked"].append(time.monotonic() - start)
                return
            if re.search(r'data-state="(refused|failed)"', page.text):
                raise RuntimeError(f"a sound file was not entered: {page.text}")
        await asyncio.sleep(PAUSE_S)


async def _kill_twice(server: _Server, seconds: float) -> None:
    for _ in range(2):
        await asyncio.sleep(seconds / 3)
        server.kill()
        await asyncio.to_thread(server.start)


async def _watch(server: _Server, end: float) -> None:
    while time.monotonic() < end:
        if server.process.poll() is None:
            server.note_memory()
        await asyncio.sleep(1)


@asynccontextmanager
async def _visitor(server: _Server, address: str) -> AsyncIterator[httpx.AsyncClient]:
    headers = {"x-forwarded-for": address}
    async with httpx.AsyncClient(
        base_url=server.url, headers=headers, timeout=_TIMEOUT_S
    ) as client:
        yield client


async def _timed(seen: _Seen, name: str, ask: Callable[..., Any], *what: Any, **how: Any) -> Any:
    start = time.monotonic()
    answer = await ask(*what, **how)
    seen.seconds[name].append(time.monotonic() - start)
    return answer


def _submission(folder: DatasetFolder, place: Path, number: int, turn: int) -> Path:
    """Write a file like no other: one density everywhere inside each object."""
    path = place / f"{number}-{turn}.npz"
    meta = SubmissionMeta(
        method=f"load-{number}-{turn}",
        dataset_revision=folder.manifest.version,
        config="default",
        split="test",
        inputs=("mesh",),
        training_data=(),
        external_data=False,
    )
    density = np.float32(0.5 + 0.05 * number + 0.001 * turn)
    shapes = ((one, folder.object(one).envelope) for one in folder.ids("test"))
    write_predictions(path, meta, ((one, density * (shape > 0)) for one, shape in shapes))
    return path


def _summary(times: Sequence[float]) -> dict[str, float]:
    p50, p95 = np.quantile(times, [0.5, 0.95])
    return {
        "count": len(times),
        "p50_s": float(p50),
        "p95_s": float(p95),
        "worst_s": max(times),
    }
