"""Uploads on the disk: copied whole or not at all; and what a full disk is called."""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from xden_bench.serve.limits import Limits
from xden_bench.serve.tickets import TurnedAwayError

__all__ = ["Copy", "copy_upload", "is_full"]

_CHUNK = 1 << 20


@dataclass(frozen=True, slots=True)
class Copy:
    """An upload that has been copied.

    Parameters
    ----------
    sha256, size_bytes
        Of what was copied.
    """

    sha256: str
    size_bytes: int


def copy_upload(upload: Path, to: Path, limits: Limits) -> Copy:
    """Copy a file that a stranger sent, and wait until the disk has it.

    Raises
    ------
    TurnedAwayError
        If it is too large, which shows before anything is copied, or the disk has no room.
        Nothing is left at ``to``.
    OSError
        If it cannot be read or is no plain file.
    """
    if not upload.is_file():  # a pipe would be waited for without end
        raise OSError(errno.EINVAL, "not a plain file", str(upload))
    _check_size(upload.stat().st_size, limits)
    if shutil.disk_usage(to.parent).free < upload.stat().st_size + limits.spare_disk_bytes:
        raise TurnedAwayError("no_room", "the server has no room for the file now: try later")
    try:
        return _copy(upload, to, limits)
    except BaseException as err:
        to.unlink(missing_ok=True)
        if isinstance(err, OSError) and is_full(err):
            said = "the server has no room for the file now: try later"
            raise TurnedAwayError("no_room", said) from err
        raise


def is_full(error: OSError) -> bool:
    """Whether an error says that the disk, or what one may use of it, is full."""
    return error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def _copy(upload: Path, to: Path, limits: Limits) -> Copy:
    digest, size = hashlib.sha256(), 0
    with upload.open("rb") as source, to.open("xb") as copy:
        while data := source.read(_CHUNK):
            size += len(data)
            _check_size(size, limits)  # it may have grown since it was measured
            digest.update(data)
            copy.write(data)
        copy.flush()
        os.fsync(copy.fileno())
    return Copy(digest.hexdigest(), size)


def _check_size(size_bytes: int, limits: Limits) -> None:
    if size_bytes > limits.upload_bytes:
        said = f"the file has {size_bytes / 1e6:.1f} MB, at most {limits.upload_mb} are taken"
        raise TurnedAwayError("too_large", said)
