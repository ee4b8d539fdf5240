"""The user's cache: where it is, and pieces of remote files and pictures in it, up to a size."""

from __future__ import annotations

import logging
import os
import sys
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Final

from xden1k.errors import DataError

__all__ = ["LIMIT_VARIABLE", "PieceCache", "cache_folder", "cache_limit"]

LIMIT_VARIABLE = "XDEN1K_CACHE_GB"
"""The environment variable that says how much of each may be kept."""
DEFAULT_GB: Final = 10.0
KEPT: Final = 0.9
"""Share of the limit that is left when the oldest pieces go."""
SUM_BYTES: Final = 4

logger = logging.getLogger(__name__)


def cache_folder() -> Path:
    """Return the user's cache for this dataset, as the platform has it; it may not exist yet."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or "~/AppData/Local"
    elif sys.platform == "darwin":
        base = "~/Library/Caches"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base).expanduser() / "xden1k"


def cache_limit() -> int:
    """Bytes that may be kept of remote files, and of pictures: ``XDEN1K_CACHE_GB``, else 10 GB.

    Raises
    ------
    DataError
        If the variable is not a number, 0 or more.
    """
    text = os.environ.get(LIMIT_VARIABLE) or str(DEFAULT_GB)
    with suppress(ValueError, OverflowError):
        if (limit := int(float(text) * 1e9)) >= 0:
            return limit
    raise DataError(f"{LIMIT_VARIABLE} must be a number of gigabytes, 0 or more, got {text!r}")


class PieceCache:
    """Keeps pieces of files by name, drops the least recently read ones where there are too many.

    A piece that a disk has damaged is as good as not there. Where nothing can be written, it says
    so once and keeps nothing. Several processes may share one folder.

    Parameters
    ----------
    folder
        Where it lies; made when it is needed.
    limit_bytes
        How much it may keep; 0 = nothing.
    """

    def __init__(self, folder: Path, limit_bytes: int) -> None:
        self.folder, self.limit_bytes = folder, limit_bytes
        self._room: float | None = None
        """Bytes until it looks again; None before it has looked."""

    def get(self, name: str) -> bytes | None:
        """Return a piece; None if it is not there."""
        path = self.folder / name
        try:
            content = path.read_bytes()
        except OSError:
            return None
        head, piece = content[:SUM_BYTES], content[SUM_BYTES:]
        if head != _sum(piece):
            self.drop(name)
            return None
        with suppress(OSError):
            os.utime(path)
        return piece

    def put(self, name: str, piece: bytes) -> None:
        """Keep a piece, if there is room at all."""
        if len(piece) > self.limit_bytes:
            return
        path = self.folder / name
        fresh = path.with_name(f"{path.name}.{os.getpid()}.new")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            fresh.write_bytes(_sum(piece) + piece)
            fresh.replace(path)
        except OSError as err:
            fresh.unlink(missing_ok=True) if fresh.parent.is_dir() else None
            self.limit_bytes = 0
            logger.warning("what is read is not kept in %s: %s", self.folder, err.strerror or err)
            return
        self._make_room(len(piece))

    def drop(self, name: str) -> None:
        """Forget a piece."""
        with suppress(OSError):
            (self.folder / name).unlink()

    def _make_room(self, taken: int) -> None:
        if self._room is not None:
            self._room -= taken
        if self._room is None or self._room < 0:
            pieces = sorted(self._pieces())
            total = sum(size for _, size, _ in pieces)
            if total > self.limit_bytes:
                total = self._drop_oldest(pieces, total)
            # Other processes fill it too: look again long before it could be full by us alone.
            self._room = (self.limit_bytes - total) / 4

    def _drop_oldest(self, pieces: list[tuple[int, int, str]], total: int) -> int:
        for _, size, name in pieces:
            if total <= KEPT * self.limit_bytes:
                break
            self.drop(name)
            total -= size
        return total

    def _pieces(self) -> list[tuple[int, int, str]]:
        """Time of the last use, size and name of each piece."""
        found = []
        for path in self.folder.rglob("*"):
            with suppress(OSError):
                stat = path.stat()
                if path.is_file():
                    name = path.relative_to(self.folder).as_posix()
                    found.append((stat.st_mtime_ns, stat.st_size, name))
        return found


def _sum(piece: bytes) -> bytes:
    return zlib.crc32(piece).to_bytes(SUM_BYTES, "little")
