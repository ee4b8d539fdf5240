"""Which objects a dataset folder holds, by split, category and flag."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

from xden1k.errors import DataError, did_you_mean
from xden1k.folder.reader import DatasetFolder

__all__ = ["LISTED", "check_known", "listed"]

LISTED: Final = ("object_id", "category", "split", "source", "mass_g", "flags")
"""What is told of each object."""


def listed(
    folder: DatasetFolder,
    split: str | None = None,
    category: str | None = None,
    flag: str | None = None,
) -> list[dict[str, Any]]:
    """Return the objects that are chosen, each with the light columns :data:`LISTED`.

    Only the light columns of the folder are read. ``flags`` are those of the object and of its
    parts, each once.

    Parameters
    ----------
    folder
        The dataset.
    split, category, flag
        Only objects with this; None = all. A flag may be the object's or one of its parts'.

    Raises
    ------
    DataError
        If the folder has no such split, category or flag, with the nearest there is.
    """
    chosen = set(folder.ids(split))
    columns = {name: folder.light_column(name) for name in (*LISTED, "part_flags")}
    rows = [
        dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)
    ]
    for row in rows:
        flags = [*row["flags"], *(each for part in row.pop("part_flags") for each in part)]
        row["flags"] = list(dict.fromkeys(flags))
    if category is not None:
        check_known(folder, "category", category, (row["category"] for row in rows))
    if flag is not None:
        check_known(folder, "flag", flag, (each for row in rows for each in row["flags"]))
    return [
        row
        for row in rows
        if row["object_id"] in chosen
        and category in (None, row["category"])
        and (flag is None or flag in row["flags"])
    ]


def check_known(folder: DatasetFolder, what: str, name: str, known: Iterable[str]) -> None:
    """Refuse a name that no object of a folder has.

    Raises
    ------
    DataError
        With the nearest that one has.
    """
    names = sorted(set(known))
    if name not in names:
        hint = did_you_mean(name, names)
        raise DataError(f"{folder.root}: no {what} {name!r} among {len(names)}{hint}")
