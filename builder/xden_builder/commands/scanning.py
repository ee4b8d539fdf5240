"""Options of the commands that simulate scans: the scanner, and what it is told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, TypeVar

import click

if TYPE_CHECKING:
    from xden_builder.phantoms.realism import Realism
    from xden_builder.phantoms.scanner import Scanner

__all__ = ["scan_options", "simulated_scanner", "wanted_realism"]

Command = TypeVar("Command", bound=Callable[..., Any])
Pose = Literal["near", "unknown"]

_OPTIONS: Final = (
    click.option(
        "--size",
        type=click.IntRange(min=16),
        show_default="512, or the scanner file's",
        help="Pixels a side.",
    ),
    click.option(
        "--scanner",
        type=click.Path(path_type=Path, dir_okay=False),
        help="TOML file of the simulated scanner.",
        show_default="realistic",
    ),
    click.option(
        "--lifelike/--tidy",
        default=None,
        show_default="lifelike",
        help="Whether there are pores, paint, and labels that err or are missing.",
    ),
    click.option(
        "--ideal", is_flag=True, help="Nothing errs; monochromatic and tidy, if not chosen."
    ),
    click.option(
        "--pose",
        type=click.Choice(["near", "unknown"]),
        default="near",
        show_default=True,
        help="Meshes in the scanner's frame, or of objects that lie anyhow, in one of their own.",
    ),
    click.option(
        "--mesh-scale",
        type=click.Choice(["known", "near", "unknown"]),
        default="known",
        show_default=True,
        help="What is said of the meshes' size; unknown, with --pose unknown: a scale of its own.",
    ),
    click.option("--turned", is_flag=True, help="One tube; objects are turned by hand for LAT."),
    click.option("--as-dataset", is_flag=True, help="Write the truth as a dataset folder instead."),
)


def scan_options(command: Command) -> Command:
    """Give a command these options, in this order."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def simulated_scanner(scanner: Path | None, ideal: bool, turned: bool) -> Scanner:
    """Give the scanner that is asked for; ``ideal`` chooses a default, and takes no error away."""
    from xden_builder.phantoms.scanner import Scanner, load_scanner

    made = Scanner.monochromatic() if ideal else Scanner.realistic()
    taken = load_scanner(scanner) if scanner else made
    return replace(taken, one_tube=True) if turned else taken


def wanted_realism(lifelike: bool | None, ideal: bool) -> Realism:
    """Say how untidy objects are: as asked, else lifelike unless all is ideal."""
    from xden_builder.phantoms.realism import LIFELIKE, TIDY

    return LIFELIKE if (not ideal if lifelike is None else lifelike) else TIDY
