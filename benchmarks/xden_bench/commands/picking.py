"""What ``manip run`` is asked to try, read from its arguments."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from xden1k.errors import DataError
from xden_bench.commands.shared import open_reference, progress_bar

if TYPE_CHECKING:
    from xden_bench.manip.choosing import Chooser
    from xden_bench.manip.item import Item
    from xden_bench.manip.scenes import Scenes

__all__ = ["controls_asked", "numbers_asked", "submissions_asked"]


def controls_asked(
    items: Mapping[str, Item], scenes: Scenes, names: tuple[str, ...], *, no_controls: bool
) -> Sequence[Chooser]:
    """Return the controls of ``--control`` and ``--no-controls``, all where none is named."""
    from xden_bench.manip.choosing import by_name, controls

    if no_controls:
        return ()
    every = controls(items, scenes.rules)
    return by_name(every, names) if names else tuple(every)


def submissions_asked(
    paths: Sequence[Path], items: Mapping[str, Item], scenes: Scenes, root: Path | str | None
) -> Sequence[Chooser]:
    """Return who takes what submissions say.

    Raises
    ------
    DataError
        If the scenes are of another dataset than ``--root`` names.
    """
    from xden_bench.manip.choosing import submitted

    if not paths:
        return ()
    dataset = scenes.facts["dataset"]
    reference = open_reference(root, dataset["split"])
    if reference.manifest_sha256 != dataset["manifest_sha256"]:
        raise DataError(
            f"{scenes.path}: of another dataset, {dataset['manifest_sha256'][:12]}, than "
            f"{reference.folder.root}, {reference.manifest_sha256[:12]}"
        )
    return [submitted(path, items, reference, progress_bar) for path in paths]


def numbers_asked(vary: Sequence[str]) -> dict[str, float]:
    """Read the NAME=VALUE of ``--vary``."""
    found = {}
    for text in vary:
        if not (match := re.fullmatch(r"(\w+)=([-+.\deE]+)", text)):
            raise click.UsageError(f"--vary: expected NAME=VALUE, got {text!r}")
        try:
            found[match[1]] = float(match[2])
        except ValueError as err:
            raise click.UsageError(f"--vary: {err}") from err
    return found
