"""Which code makes the rows, and whether every machine has it."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Hashable
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Final, Protocol, runtime_checkable

from xden1k import __version__
from xden1k.errors import XDenError

__all__ = ["BUILDER", "OtherVersionError", "made_by_checksum", "refuse_other_code"]

BUILDER: Final = f"xden-build {__version__}"
NOT_IN_ROWS: Final[frozenset[str]] = frozenset({"calibrate", "phantoms", "triage"})
"""Rooms that rebuilt rows do not depend on: a change there makes no object anew."""


@runtime_checkable
class Settings(Hashable, Protocol):
    """Whatever changes the result of a run."""

    @property
    def digest(self) -> str:
        """Checksum of the settings."""


class OtherVersionError(XDenError):
    """A worker's machine has other code than the one that started the run."""


@cache
def made_by_checksum(settings: Settings, left_out: frozenset[str] = NOT_IN_ROWS) -> str:
    """Checksum of settings and code, so that a corrected builder makes its objects anew."""
    digest = hashlib.sha256(f"{BUILDER}\n{settings.digest}\n".encode())
    for package, folder in ((name, Path(str(files(name)))) for name in ("xden1k", "xden_builder")):
        for path in sorted(folder.rglob("*")):
            inside_it = path.relative_to(folder)
            if path.suffix in (".py", ".csv") and inside_it.parts[0] not in left_out:
                digest.update(f"{package}/{inside_it.as_posix()}\n".encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()


def refuse_other_code(settings: Settings, made_by: str) -> None:
    """Make sure that a worker has the code of the machine that the run started on.

    Raises
    ------
    OtherVersionError
        If it has not.
    """
    if made_by_checksum(settings) != made_by:
        raise OtherVersionError(
            f"{platform.node()} has another version of xden1k than the machine the run started on"
        )
