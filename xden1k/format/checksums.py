"""Checksums of files and of Parquet footers, and the list of them in a dataset folder."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Final

from xden1k.errors import DataError
from xden1k.format.remote import RemotePath

__all__ = ["CHECKSUMS_NAME", "check_document", "file_sha256", "footer_sha256", "listed_sums"]

CHECKSUMS_NAME: Final = "SHA256SUMS"
MAGIC: Final = b"PAR1"
TAIL_BYTES: Final = 8
"""Length of the footer, four bytes, and the magic: the end of every Parquet file."""


def file_sha256(path: Path) -> str:
    """Checksum of a file, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def footer_sha256(path: Path) -> str:
    """Checksum of the footer of a Parquet file, its length and magic included, hexadecimal.

    Pages have checksums of their own, the footer, which says where and what they are, has none.

    Raises
    ------
    DataError
        If the file does not end as Parquet does.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(max(size - TAIL_BYTES, 0))
        tail = file.read()
        length = int.from_bytes(tail[:4], "little") + TAIL_BYTES
        if tail[4:] != MAGIC or length > size:
            raise DataError(f"{path}: does not end as a Parquet file does: cut short or damaged")
        file.seek(size - length)
        return hashlib.sha256(file.read()).hexdigest()


def listed_sums(root: Path | RemotePath) -> dict[str, str]:
    """Checksum of each file that a folder's list names; none where there is no list."""
    try:
        content = (root / CHECKSUMS_NAME).read_bytes()
    except FileNotFoundError:
        return {}
    lines = content.decode(errors="replace").splitlines()
    return {name: digest for digest, _, name in (line.partition("  ") for line in lines)}


def check_document(root: Path | RemotePath, name: str) -> bytes:
    """Return a document, if it is the one which the folder's list of checksums names.

    Raises
    ------
    FileNotFoundError
        If there is none.
    DataError
        If it was damaged or changed.
    """
    content = (root / name).read_bytes()
    wanted = listed_sums(root).get(name)
    if wanted is not None and hashlib.sha256(content).hexdigest() != wanted:
        raise DataError(
            f"{root / name}: its sha256 is not the one in {CHECKSUMS_NAME}: damaged or changed; "
            f"`xden verify {root}` lists every such file"
        )
    return content
