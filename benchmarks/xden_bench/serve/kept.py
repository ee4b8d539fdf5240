"""What was computed once, kept on the disk by the content it was computed from."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from xden_bench.entries.durable import write_text
from xden_bench.entries.result import NOTES
from xden_bench.entries.signing import MAINTAINERS

__all__ = ["Kept", "entry_key", "key_of"]

_CODE: Final = ("entries", "scoring")
"""Rooms whose code verifies and ranks."""


class Kept:
    """Values of JSON by key, one file each. A folder of the server's own: what is in it is trusted.

    Parameters
    ----------
    folder
        Made if it is missing.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder

    def __contains__(self, key: str) -> bool:
        """Whether there is a value."""
        return self._path(key).is_file()

    def __getitem__(self, key: str) -> Any:
        """Return a value.

        Raises
        ------
        FileNotFoundError
            If there is none.
        """
        return json.loads(self._path(key).read_bytes())

    def __setitem__(self, key: str, value: Any) -> None:
        """Keep a value; it is there whole or not at all."""
        write_text(self._path(key), json.dumps(value))

    def keep_only(self, keys: Iterable[str]) -> None:
        """Remove every other value."""
        needed = {self._path(key) for key in keys}
        for path in self._folder.iterdir():
            if path not in needed:
                path.unlink()

    def _path(self, key: str) -> Path:
        return self._folder / f"{key}.json"


def key_of(*parts: str | bytes) -> str:
    """Return the key of what follows from these contents and from the code that reads them."""
    digest = hashlib.sha256(_code())
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        digest.update(hashlib.sha256(data).digest())
    return digest.hexdigest()


def entry_key(path: Path, results: Path) -> str:
    """Return the key of an entry: of its place, its two files, the notes beside it and their keys.

    Raises
    ------
    OSError
        If one of its files cannot be read.
    """
    beside = [path.with_suffix(suffix) for suffix in (".parquet", *NOTES)]
    beside.append(results / MAINTAINERS)
    place = path.relative_to(results).as_posix()
    return key_of(place, path.read_bytes(), *(one.read_bytes() for one in beside if one.is_file()))


@cache
def _code() -> bytes:
    """Digest of the code that verifies and ranks: what other code found is found again."""
    digest = hashlib.sha256()
    for room in _CODE:
        for file in sorted(files(f"xden_bench.{room}").iterdir(), key=lambda one: one.name):
            if file.name.endswith((".py", ".toml")):
                digest.update(file.read_bytes())
    return digest.digest()
