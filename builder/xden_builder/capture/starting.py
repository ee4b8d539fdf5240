"""The files that a lab fills in, as a start: every key, with an example's values."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Final

from xden1k.errors import DataError

__all__ = ["EXAMPLE", "TEMPLATES", "write_template"]

EXAMPLE: Final = "example-0001"
"""The object of the template, which has neither radiographs nor meshes."""
TEMPLATES: Final = ("scanner.toml", "objects.csv", f"{EXAMPLE}/parts.csv")


def write_template(folder: Path) -> tuple[Path, ...]:
    """Write a ``scanner.toml``, an ``objects.csv`` and the ``parts.csv`` of an example.

    Parameters
    ----------
    folder
        May hold other files, or not exist.

    Returns
    -------
    tuple of Path
        What was written.

    Raises
    ------
    DataError
        If one of the files is there; then nothing is written.
    """
    paths = [folder / name for name in TEMPLATES]
    if there := [path for path in paths if path.exists()]:
        raise DataError(f"{there[0]}: is there already; nothing is written")
    for path in paths:
        above = next(each for each in path.parents if each.exists())
        if not above.is_dir():
            raise DataError(f"{above}: expected a folder, got a file; nothing is written")
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(_template(path.name), encoding="utf-8")
    return tuple(paths)


def _template(name: str) -> str:
    return (files("xden_builder.capture") / "templates" / name).read_text(encoding="utf-8")
