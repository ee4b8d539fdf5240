"""The split of each object: stated by the captures, or drawn once and kept ever after.

An object whose ``objects.csv`` names no split gets one when it is first built, and ``splits.csv``
beside the captures remembers it: a new object changes nothing for the others.
"""

from __future__ import annotations

import csv
import errno
import hashlib
import io
import logging
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from xden1k.errors import DataError
from xden1k.values.types import SPLITS, UNSEEN, Split
from xden_builder.capture import ObjectRow
from xden_builder.pipeline.storage import Place, inside, read_bytes, write_bytes

__all__ = ["SPLITS_NAME", "draw_splits", "read_splits", "with_splits"]

SPLITS_NAME: Final = "splits.csv"
SHARES: Final[Mapping[Split, int]] = {"train": 7, "val": 1, "test": 2}
"""Of ten objects of a category; one of which objects are unseen is in no other split."""
COLUMNS: Final = ("object_id", "split")

logger = logging.getLogger(__name__)


def with_splits(captures: Place, rows: Mapping[str, ObjectRow]) -> dict[str, ObjectRow]:
    """Give every object a split, and write down those that were drawn.

    What ``objects.csv`` states holds, then what ``splits.csv`` remembers. Where that file cannot
    be written the splits hold for this build alone, and a warning says so.

    Parameters
    ----------
    captures
        The capture folder.
    rows
        Of its ``objects.csv``, by object id.

    Raises
    ------
    DataError
        If ``splits.csv`` is not what an earlier build wrote; the message names the row.
    """
    remembered = read_splits(inside(captures, SPLITS_NAME))
    stated = {object_id: row.split for object_id, row in rows.items() if row.split is not None}
    known = {name: split for name, split in remembered.items() if name in rows} | stated
    splits = draw_splits({name: row.category for name, row in rows.items()}, known)
    if set(stated) < set(rows) and remembered | splits != remembered:
        _write(captures, remembered | splits)
    return {name: replace(row, split=splits[name]) for name, row in rows.items()}


def draw_splits(categories: Mapping[str, str], known: Mapping[str, Split]) -> dict[str, Split]:
    """Give each new object to the split that is furthest below its share in its category.

    Objects come in the order of a checksum of their ids, which also decides between equals, so
    that neither the order of a table nor the names choose.

    Parameters
    ----------
    categories
        Of all objects, by id.
    known
        Splits of those that have one.

    Examples
    --------
    >>> splits = draw_splits({f"mug-{n:04}": "mug" for n in range(20)}, {})
    >>> sorted(Counter(splits.values()).items())
    [('test', 4), ('train', 14), ('val', 2)]
    """
    splits = dict(known)
    counts: dict[str, Counter[Split]] = {}
    for object_id, split in known.items():
        counts.setdefault(categories[object_id], Counter())[split] += 1
    for object_id in sorted(categories.keys() - known.keys(), key=_checksum):
        count = counts.setdefault(categories[object_id], Counter())
        splits[object_id] = _furthest_below(count, _checksum(object_id))
        count[splits[object_id]] += 1
    return splits


def _furthest_below(count: Counter[Split], draw: int) -> Split:
    """Compare in whole numbers, so that equals are equal."""
    if count[UNSEEN]:
        return UNSEEN
    after, ten = count.total() + 1, sum(SHARES.values())
    missing = {split: share * after - ten * count[split] for split, share in SHARES.items()}
    most = [split for split in SHARES if missing[split] == max(missing.values())]
    return most[draw % len(most)]


def _checksum(object_id: str) -> int:
    return int.from_bytes(hashlib.sha256(object_id.encode()).digest())


def read_splits(file: Place) -> dict[str, Split]:
    """Read a table of splits, by object id; none where there is no file.

    Raises
    ------
    DataError
        If it is no table of ids, each once, and splits; the message names the row.
    """
    content = read_bytes(file)
    if content is None:
        return {}
    try:
        header, *lines = list(csv.reader(io.StringIO(content.decode("utf-8-sig"))))
    except (UnicodeDecodeError, ValueError, csv.Error) as err:
        raise DataError(f"{file}: expected a table with the columns {COLUMNS}: {err}") from err
    if tuple(header) != COLUMNS:
        raise DataError(f"{file}: columns must be {', '.join(COLUMNS)}, got {', '.join(header)}")
    splits: dict[str, Split] = {}
    for number, line in enumerate(lines, start=2):
        if len(line) != len(COLUMNS) or line[1] not in SPLITS or line[0] in splits:
            raise DataError(
                f"{file}: row {number}: expected an object id of its own and one of "
                f"{', '.join(SPLITS)}, got {','.join(line)!r}"
            )
        splits[line[0]] = line[1]
    return splits


def _write(captures: Place, splits: Mapping[str, Split]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(sorted(splits.items()))
    file = inside(captures, SPLITS_NAME)
    try:
        write_bytes(file, text.getvalue().encode())
    except OSError as err:
        if not isinstance(err, PermissionError) and err.errno != errno.EROFS:
            raise
        logger.warning(
            "%s cannot be written (%s): the splits drawn now hold for this build alone; state them "
            "in objects.csv",
            file if isinstance(file, Path) else captures,
            err.strerror,
        )
