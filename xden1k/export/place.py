"""Where an export goes: a folder of its own, which appears whole or not at all."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from xden1k.errors import DataError

__all__ = ["RECORD", "in_place", "write_record"]

RECORD: Final = "object.json"
"""What was exported, from which object, under which names; lists the files."""


@contextmanager
def in_place(out: Path, format_name: str, object_id: str) -> Iterator[Path]:
    """Make a folder elsewhere, and put it in its place once it is whole.

    Parameters
    ----------
    out
        Its place: nothing, an empty folder, or an earlier export of the same object in the same
        format.
    format_name, object_id
        What is exported.

    Yields
    ------
    Path
        The folder to write to, beside its place; gone if anything fails.

    Raises
    ------
    DataError
        If the place holds something else.
    """
    _check_free(out, format_name, object_id)
    prefix, suffix = f".{out.name}.", ".partial"
    with (
        _made(out.parent),
        tempfile.TemporaryDirectory(prefix=prefix, suffix=suffix, dir=out.parent) as beside,
    ):
        folder = Path(beside) / "new"
        folder.mkdir()
        yield folder
        if not out.exists():
            folder.rename(out)
            return
        old = out.rename(Path(beside) / "old")
        try:
            folder.rename(out)
        except OSError:
            old.rename(out)
            raise


@contextmanager
def _made(folder: Path) -> Iterator[None]:
    """Make a folder with all it lies in; what is new and empty goes again if anything fails."""
    new = [one for one in (folder, *folder.parents) if not one.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        with suppress(OSError):
            for one in new:
                one.rmdir()
        raise


def _check_free(out: Path, format_name: str, object_id: str) -> None:
    if out.is_dir():
        known = _listed(out / RECORD, {"format": format_name, "object_id": object_id})
        files = {path.relative_to(out).as_posix() for path in out.rglob("*") if not path.is_dir()}
        if others := sorted(files - known):
            raise DataError(
                f"{out}: expected a new or empty folder, or an earlier {format_name} export "
                f"of {object_id}, got a folder that holds {others[0]}"
            )
    elif out.exists():
        raise DataError(f"{out}: expected a folder, got a file")


def _listed(record: Path, same: dict[str, str]) -> set[str]:
    """Files of an earlier export of the same; none where there is no such."""
    try:
        values: Any = json.loads(record.read_text(encoding="utf-8"))
        return {RECORD, *values["files"]} if same.items() <= values.items() else set()
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return set()


def write_record(folder: Path, values: dict[str, Any]) -> None:
    """Write the record, with a list of the files that are there."""
    files = sorted(
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()
    )
    text = json.dumps({**values, "files": files}, indent=2, ensure_ascii=False, allow_nan=False)
    (folder / RECORD).write_text(text + "\n", encoding="utf-8")
