"""Objects that are put in place already, kept between runs as rows of work files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from xden1k.values.plain import plain
from xden_builder.pipeline.align.card import AlignCard, AlignedView, CandidateCard
from xden_builder.triage.pictures import Picture

__all__ = ["card_of", "row_of", "write_files"]

PICTURES: Final = ("before", "after", "differs")
"""Of a view."""


def row_of(card: AlignCard | None, folder: Path) -> dict[str, Any]:
    """Make a row of an object's card and of all files that were written for it.

    Parameters
    ----------
    card
        None where its meshes were near as told.
    folder
        Of its files.
    """
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {
        "card": None if card is None else plain(asdict(card)),
        "names": [path.relative_to(folder).as_posix() for path in paths],
        **{str(number): path.read_bytes() for number, path in enumerate(paths)},
    }


def card_of(row: Mapping[str, Any]) -> AlignCard | None:
    """Read the card of such a row."""
    values = row["card"]
    if values is None:
        return None
    return AlignCard(
        **values
        | {
            "flags": tuple(values["flags"]),
            "candidates": tuple(map(_candidate, values["candidates"])),
            "views": tuple(map(_view, values["views"])),
        }
    )


def write_files(row: Mapping[str, Any], folder: Path) -> None:
    """Write the files of such a row again."""
    for number, name in enumerate(row["names"]):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(row[str(number)])


def _candidate(values: Mapping[str, Any]) -> CandidateCard:
    pictures = tuple((name, _picture(one)) for name, one in values["pictures"])
    densities = tuple((name, density) for name, density in values["densities_g_cm3"])
    return CandidateCard(**{**values, "pictures": pictures, "densities_g_cm3": densities})


def _view(values: Mapping[str, Any]) -> AlignedView:
    return AlignedView(**{**values, **{name: _picture(values[name]) for name in PICTURES}})


def _picture(values: Mapping[str, Any] | None) -> Picture | None:
    return None if values is None else Picture(**values)
