"""The submissions behind the entries, so that anyone scores them again."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from xden1k.errors import DataError
from xden1k.format.checksums import file_sha256

__all__ = ["ARCHIVE", "archived", "check_url", "keep"]

ARCHIVE: Final = "archive"
"""Folder among the results: SHA256.npz for each submission that lies here."""


def keep(submission: Path, sha256: str, results: Path) -> None:
    """Copy a submission into the archive; one that is there is left.

    Raises
    ------
    DataError
        If the file is no longer the one that was scored.
    OSError
        If the disk does not take it.
    """
    path = _place(sha256, results)
    if path.exists():
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    try:
        shutil.copyfile(submission, partial)
        _check(partial, sha256)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def archived(entry: Mapping[str, Any], results: Path) -> Path:
    """Where an entry's submission lies here.

    Raises
    ------
    DataError
        If the entry names none, it lies elsewhere, or it is another file.
    """
    if (named := entry.get("archive")) is None:
        raise DataError("the entry archives no submission")
    path = _place(named["sha256"], results)
    if not path.is_file():
        where = f"fetch it from {named['url']}" if named["url"] else "it is missing"
        raise DataError(f"{path}: the entry's submission lies there or is given: {where}")
    _check(path, named["sha256"])
    return path


def check_url(url: str) -> None:
    """Refuse an address that is no plain web address.

    Raises
    ------
    DataError
        If it is none.
    """
    if not re.fullmatch(r"https://[\w./:~%?=&#+-]{1,400}", url):
        raise DataError(f"the archive's address must be https://..., got {url[:100]!a}")


def _place(sha256: str, results: Path) -> Path:
    return results / ARCHIVE / f"{sha256}.npz"


def _check(path: Path, sha256: str) -> None:
    if (found := file_sha256(path)) != sha256:
        raise DataError(f"{path}: sha256 must be {sha256}, the submission's, is {found}")
