"""What the commands of ``xden-build`` share: folders, how many processes, and a progress bar."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

__all__ = ["FOLDER", "echo_scanner", "parts_option", "progress_bar", "workers_option"]

FOLDER = click.Path(path_type=Path, file_okay=False)

workers_option = click.option(
    "--workers",
    type=click.IntRange(min=1),
    default=lambda: len(os.sched_getaffinity(0)),
    show_default="one per core",
    help="Processes.",
)

parts_option = click.option(
    "--parts",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    help="Other part meshes in place of the annotated ones.",
)


@contextmanager
def progress_bar(total: int | None = None, unit: str = "object") -> Iterator[Any]:
    """Show a bar with the rate and what is left, on a terminal only."""
    from tqdm import tqdm

    told = "{l_bar}{bar}| {n_fmt} of {total_fmt}, {rate_noinv_fmt}, {remaining} left{postfix}"
    with tqdm(total=total, unit=f" {unit}s", bar_format=told, smoothing=0.1, disable=None) as bar:
        yield bar


def echo_scanner(captures: str) -> None:
    """Say once, beside the output, what is to be said of the scanner of a capture folder."""
    from xden_builder.pipeline.remarks import calibration_remark, filtration_remark
    from xden_builder.pipeline.storage import place

    for remark in (calibration_remark, filtration_remark):
        if said := remark(place(captures)):
            click.echo(said, err=True)
