"""What meshes before the scanner were made from, so that another mesh or image is noticed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from xden1k.errors import DataError

__all__ = ["ORIGIN_NAME", "files_digest", "refuse_stale"]

ORIGIN_NAME: Final = "made_from.json"
"""Beside the parts of an object."""


def files_digest(files: Iterable[tuple[str, Path]]) -> str:
    """Return the SHA-256 over names and contents of files; what is not there is left out."""
    digest = hashlib.sha256()
    for name, path in sorted(files):
        if path.is_file():
            with path.open("rb") as stream:
                content = hashlib.file_digest(stream, "sha256").hexdigest()
            digest.update(json.dumps([name, content]).encode())
    return digest.hexdigest()


def refuse_stale(path: Path, now: Mapping[str, str]) -> None:
    """Refuse meshes that were put before the scanner from something else.

    Parameters
    ----------
    path
        A ``made_from.json`` beside them. What it does not name is not asked for.
    now
        What the object has now: checksums and words, by what they are of.

    Raises
    ------
    DataError
        If one of them is another now, or the file is no JSON object.
    """
    try:
        told = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError) as err:
        raise DataError(f"{path}: expected a JSON object, cannot read it: {err}") from err
    if not isinstance(told, dict):
        raise DataError(f"{path}: expected a JSON object, got {type(told).__name__}")
    for kind, is_now in now.items():
        if told.get(kind, is_now) != is_now:
            raise DataError(
                f"{path}: these meshes were put in place with other {kind} than the captures have "
                "now; run `xden-build align` again"
            )
