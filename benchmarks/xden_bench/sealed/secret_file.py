"""Secrets in files that their owner alone may read."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import Final

from xden1k.errors import DataError

__all__ = ["read_secret", "write_secret"]

MAX_BYTES: Final = 1024


def write_secret(path: Path, line: str) -> None:
    """Write one line to a new file, which its owner alone may read.

    Raises
    ------
    DataError
        If there is a file already: a key that is lost is lost for good.
    """
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError as err:
        raise DataError(f"{path} exists, and a key is never overwritten") from err
    with os.fdopen(handle, "w", encoding="ascii", newline="\n") as file:
        file.write(f"{line}\n")
        file.flush()
        os.fsync(handle)


def read_secret(path: Path) -> bytes:
    """Read the file, at most 1,024 bytes of it.

    Raises
    ------
    OSError
        If there is no such file.
    DataError
        If others than its owner may read it.
    """
    with path.open("rb") as file:
        mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
        if os.name != "nt" and mode & 0o077:  # Windows has no such bits
            raise DataError(f"{path}: others may read this key, mode {mode:03o}: chmod 600 {path}")
        return file.read(MAX_BYTES)
