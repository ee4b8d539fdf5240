"""Files on their way in: in a folder of their own, bounded, and gone once their sender is answered.

A file is sent and taken in one request, so that none waits for a second one that never comes.
"""

from __future__ import annotations

import asyncio
import shutil
import tempfile
import threading
from collections.abc import AsyncIterable, AsyncIterator, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from xden_bench.serve.form import FORM_BYTES, Form, no_file
from xden_bench.serve.limits import Limits
from xden_bench.serve.tickets import TurnedAwayError

__all__ = ["Incoming", "Received"]

_MINUTE_S: Final = 60


@dataclass(frozen=True, slots=True)
class Received:
    """A form that was sent.

    Parameters
    ----------
    path
        Its file.
    filename
        As the sender calls it.
    action
        The button that was pressed.
    """

    path: Path
    filename: str
    action: str


class Incoming:
    """Receives forms with one file each.

    Parameters
    ----------
    folder
        Of its own; emptied at the start.
    limits
        How much is received at the same time, and for how long.
    """

    def __init__(self, folder: Path, limits: Limits) -> None:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        self._folder, self._limits = folder, limits
        self._lock, self._bytes = threading.Lock(), dict[str, int]()

    @asynccontextmanager
    async def receive(
        self, user: str, headers: Mapping[str, str], body: AsyncIterable[bytes]
    ) -> AsyncIterator[Received]:
        """Receive a form; its file is gone at the end.

        Parameters
        ----------
        user
            One form at a time for each.
        headers
            Of the request: length and type of the body, which is never longer than they say.
        body
            In pieces.

        Raises
        ------
        TurnedAwayError
            If it is not received, or has no file.
        """
        size = _length(headers)
        with self._room(user, size), tempfile.NamedTemporaryFile(dir=self._folder) as file:
            form = Form(headers.get("content-type", ""), file)
            try:
                async with asyncio.timeout(self._limits.upload_minutes * _MINUTE_S):
                    async for piece in body:
                        await asyncio.to_thread(form.write, piece)
            except TimeoutError as err:
                said = f"sending it took more than {self._limits.upload_minutes} minutes"
                raise TurnedAwayError("too_slow", said) from err
            file.flush()
            if not file.tell():
                raise no_file()
            yield Received(Path(file.name), form.filename, form.fields.get("action", ""))

    @contextmanager
    def _room(self, user: str, size: int) -> Iterator[None]:
        """Hold room for what a user sends."""
        limits = self._limits
        with self._lock:
            if user in self._bytes:
                raise TurnedAwayError("one_at_a_time", "one file at a time: another is being sent")
            if size > limits.upload_bytes + FORM_BYTES:
                said = f"the file has {size / 1e6:.1f} MB, at most {limits.upload_mb} are taken"
                raise TurnedAwayError("too_large", said)
            if sum(self._bytes.values()) + size > limits.incoming_bytes:
                said = "too many files are being sent at this moment: try later"
                raise TurnedAwayError("no_room", said)
            if shutil.disk_usage(self._folder).free < size + limits.spare_disk_bytes:
                said = "the server has no room for the file now: try later"
                raise TurnedAwayError("no_room", said)
            self._bytes[user] = size
        try:
            yield
        finally:
            with self._lock:
                del self._bytes[user]


def _length(headers: Mapping[str, str]) -> int:
    """Return how long the body is; the web server lets no more through."""
    length = headers.get("content-length", "")
    if not length.isdecimal():
        raise no_file()
    return int(length)
