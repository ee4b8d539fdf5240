"""The audit log: one JSON line for each event, each on the disk before the next."""

from __future__ import annotations

import hashlib
import hmac
import json
import os
import secrets
from pathlib import Path
from typing import Final

from xden1k.errors import DataError
from xden_bench.entries.durable import write_whole

__all__ = ["AuditLog", "Pseudonyms"]

_TAIL_BYTES: Final = 1 << 20
"""Far more than the longest line."""


class AuditLog:
    """A file of numbered JSON lines that only grows.

    A line that a full disk or a power cut left without its end is cut off when the file is opened:
    whoever wrote it was never told that it is there.

    Parameters
    ----------
    path
        Made if it is missing, readable by its owner only.

    Attributes
    ----------
    last
        Number of the last line; 0 in an empty file.

    Raises
    ------
    DataError
        If the file does not end with a numbered JSON line.
    """

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o600)
        try:
            self.last = _last_number(self._file, path)
        except BaseException:
            os.close(self._file)
            raise

    def append(self, number: int, line: str) -> None:
        """Write a line and wait until the disk has it.

        Parameters
        ----------
        number
            Higher than ``last``; it is a member of the line's object, too.
        line
            JSON.

        Raises
        ------
        OSError
            If it cannot be written whole; then nothing of it stays.
        """
        before, data = os.fstat(self._file).st_size, line.encode() + b"\n"
        try:
            written = os.write(self._file, data)
            if written < len(data):
                os.write(self._file, data[written:])  # says why it cannot
            os.fsync(self._file)
        except OSError:
            os.ftruncate(self._file, before)
            raise
        self.last = number

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)


class Pseudonyms:
    """Turns users into names that say nothing without the key, and stay the same with it.

    A plain or salted hash of an address is found by trying all addresses, so it is a keyed hash.
    Whoever deletes the key makes every name in the log and among the tickets anonymous for good.

    Parameters
    ----------
    path
        Of the key, made if it is missing, readable by its owner only.
    """

    def __init__(self, path: Path) -> None:
        if not path.exists():
            write_whole(path, secrets.token_bytes(32), mode=0o600)
        self._key = path.read_bytes()

    def __call__(self, user: str) -> str:
        """Return the name of a user, 16 hexadecimal digits."""
        data = user.encode("utf-8", "surrogatepass")
        return hmac.new(self._key, data, hashlib.sha256).hexdigest()[:16]


def _last_number(file: int, path: Path) -> int:
    """Cut off what follows the last whole line and return that line's number."""
    size = os.fstat(file).st_size
    start = max(0, size - _TAIL_BYTES)
    tail = os.pread(file, size - start, start)
    whole = tail[: tail.rfind(b"\n") + 1]
    if start and not whole:
        raise DataError(f"{path}: its last line is over {_TAIL_BYTES} bytes: no audit log")
    os.ftruncate(file, start + len(whole))
    if not whole:
        return 0
    try:
        return int(json.loads(whole.splitlines()[-1])["number"])
    except (ValueError, TypeError, KeyError) as err:
        raise DataError(f"{path}: its last line is no event of an audit log") from err
