"""Where a dataset folder is made, and how it comes to its place in one step.

A writer works in a hidden folder beside the place, ``.NAME.xxxxxxxx.partial``, and holds a lock in
it for as long as it lives. A folder whose lock is free is what a killed writer left.
"""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from xden1k.errors import DataError

__all__ = ["exclusive", "expect_free", "new_folder", "publish", "staging"]

LOCK_NAME = "writer.lock"
OLD_NAME = "old"
AT_FDCWD, RENAME_EXCHANGE = -100, 2
"""Of Linux' ``fcntl.h``."""


@contextmanager
def staging(out: Path) -> Iterator[Path]:
    """Make a hidden folder beside a place, gone at the end; what dead writers left goes first.

    Parameters
    ----------
    out
        The place; its parent must exist.

    Yields
    ------
    Path
        The folder.
    """
    _clear_away(out)
    with tempfile.TemporaryDirectory(
        prefix=f".{out.name}.", suffix=".partial", dir=out.parent
    ) as beside:
        # Locked before it gets its name: a lock of this name that is free has lost its writer.
        unnamed = Path(beside) / f"{LOCK_NAME}.new"
        with exclusive(unnamed):
            unnamed.rename(Path(beside) / LOCK_NAME)
            yield Path(beside)


def expect_free(out: Path) -> None:
    """Make sure that a new folder can come to a place.

    Raises
    ------
    DataError
        If there is something in it.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise DataError(f"{out}: expected a folder that is empty or does not exist")


@contextmanager
def new_folder(out: Path) -> Iterator[Path]:
    """Make a folder that comes to its place complete, or not at all where making it fails.

    Yields
    ------
    Path
        An empty folder to write into.

    Raises
    ------
    DataError
        If there is something in its place.
    """
    expect_free(out)
    out.absolute().parent.mkdir(parents=True, exist_ok=True)
    with staging(out.absolute()) as beside:
        made = beside / "made"
        made.mkdir()
        yield made
        publish(made, out)


@contextmanager
def exclusive(path: Path) -> Iterator[None]:
    """Hold the lock of a file, which is made where it is missing, until the end or death.

    Where the system or the file system has no locks, nothing is held.

    Raises
    ------
    BlockingIOError
        If another process holds it.
    """
    with path.open("ab") as file:
        _lock(file)
        yield


def publish(root: Path, out: Path) -> None:
    """Put a finished folder in its place; it changes places with an older one that is there.

    Where the system cannot exchange two folders in one step, ``out`` is absent for an instant.

    Parameters
    ----------
    root
        The folder, inside one of :func:`staging`.
    out
        Its place.
    """
    if not out.exists():
        root.rename(out)
    elif not _exchange(root, out):
        old = root.with_name(OLD_NAME)
        out.rename(old)
        try:
            root.rename(out)
        except OSError:
            old.rename(out)
            raise


def _exchange(one: Path, other: Path) -> bool:
    """Swap two folders in one step; False where that cannot be done."""
    try:
        renameat2 = ctypes.CDLL(None).renameat2
    except (AttributeError, TypeError):  # not Linux, or an old C library
        return False
    paths = AT_FDCWD, os.fsencode(one), AT_FDCWD, os.fsencode(other)
    return bool(renameat2(*paths, RENAME_EXCHANGE) == 0)


def _lock(file: IO[bytes]) -> bool:
    """Take the lock of an open file; False where there are none, an error if it is taken."""
    if sys.platform == "win32":
        return False
    import fcntl

    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:  # some network file systems
        return False
    return True


def _clear_away(out: Path) -> None:
    """Remove what killed writers of this place left; an older folder they put aside comes back."""
    named = re.compile(re.escape(f".{out.name}.") + r"[a-z0-9_]{8}\.partial")
    for left in [path for path in out.parent.iterdir() if named.fullmatch(path.name)]:
        with suppress(OSError), (left / LOCK_NAME).open("r+b") as file:  # no lock: not ours
            if _lock(file):
                if (left / OLD_NAME).exists() and not out.exists():
                    (left / OLD_NAME).rename(out)
                shutil.rmtree(left)
