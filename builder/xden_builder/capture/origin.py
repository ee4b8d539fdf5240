"""What meshes were put into the scanner's frame from, so that another mesh or image is noticed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from xden1k.errors import DataError

__all__ = ["REGISTRATION_NAME", "files_digest", "refuse_stale"]

REGISTRATION_NAME: Final = "registration.json"
"""Beside parts that were put into the scanner's frame: how, and from what."""


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
    """Refuse meshes in the scanner's frame that were put there from something else.

    Parameters
    ----------
    path
        A ``registration.json`` beside them. What it does not name is not asked for: a folder of
        meshes that a person put in place knows no images.
    now
        Checksums of what the object has now, by what they are of.

    Raises
    ------
    DataError
        If a checksum is another now, or the file is no JSON object.
    """
    for kind, checksum in _made_from(path).items():
        if kind in now and now[kind] != checksum:
            raise DataError(
                f"{path}: these meshes were put in place with other {kind} than the captures have "
                "now; run `xden-build align` again"
            )


def _made_from(path: Path) -> Mapping[str, Any]:
    try:
        told = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError) as err:
        raise DataError(f"{path}: expected a JSON object, cannot read it: {err}") from err
    made_from = told.get("made_from", {}) if isinstance(told, dict) else None
    if not isinstance(made_from, dict):
        raise DataError(f"{path}: expected a JSON object, with another of checksums as made_from")
    return made_from
