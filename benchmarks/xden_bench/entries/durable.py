"""Files that are whole after a power cut, or not there; and one writer of the results at a time."""

from __future__ import annotations

import os
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Final

from filelock import FileLock

__all__ = ["LOCK_NAME", "results_lock", "sync_folder", "write_text", "write_whole"]

LOCK_NAME: Final = ".lock"
"""In the folder of results."""


def results_lock(results: Path) -> AbstractContextManager[object]:
    """Return the lock that whoever adds an entry holds; another waits, and a death frees it.

    Parameters
    ----------
    results
        Folder of all entries.
    """
    return FileLock(results / LOCK_NAME)


def write_whole(path: Path, data: bytes, mode: int = 0o666) -> None:
    """Write a file all at once, and wait until the disk has it.

    Parameters
    ----------
    path
        The file; one that is there is replaced.
    data
        Its content.
    mode
        Who may read and write it, less what the umask forbids.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with os.fdopen(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, mode), "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    sync_folder(path.parent)


def write_text(path: Path, text: str) -> None:
    """Write a text file as :func:`write_whole` does; its folder is made if it is missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, text.encode("utf-8"))


def sync_folder(path: Path) -> None:
    """Wait until the disk has the names in a folder; Windows does so by itself."""
    if os.name == "nt":
        return
    folder = os.open(path, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
