"""What the commands of ``xden-build`` share: folders, how many processes, and a progress bar."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

__all__ = [
    "FOLDER",
    "Progress",
    "echo_scanner",
    "loading",
    "names_in",
    "parts_option",
    "progress_bar",
    "resumable",
    "workers_option",
]

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells know it."""

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


def names_in(text: str) -> list[str]:
    """Read names separated by commas, with or without blanks.

    Examples
    --------
    >>> names_in("mug-0000, pen-0001,")
    ['mug-0000', 'pen-0001']
    """
    return [name for name in map(str.strip, text.split(",")) if name]


@contextmanager
def progress_bar(total: int | None = None, unit: str = "object") -> Iterator[Any]:
    """Show a bar with the rate and what is left, on a terminal only."""
    from tqdm import tqdm

    told = "{l_bar}{bar}| {n_fmt} of {total_fmt}, {rate_noinv_fmt}, {remaining} left{postfix}"
    with tqdm(total=total, unit=f" {unit}s", bar_format=told, smoothing=0.1, disable=None) as bar:
        yield bar


@dataclass(slots=True)
class Progress:
    """How many objects there are and are done, on a bar."""

    bar: Any
    total: int = 0
    done: int = 0
    before: str = ""
    """How far what comes before them is; empty once it is done."""

    def start(self, total: int) -> None:
        """Show how many there are."""
        self.total = total
        self.bar.reset(total)

    def step(self) -> None:
        """Show that another is done."""
        self.done += 1
        self.bar.update()


@contextmanager
def loading() -> Iterator[None]:
    """Let Ctrl-C end the program at once while modules are loaded: nothing has begun.

    Some libraries take whatever an import of theirs raises for a package that is not there, an
    interrupt too, and go on without it.
    """
    asked = signal.getsignal(signal.SIGINT)
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or asked is not signal.default_int_handler:  # ignored, or not ours
        yield
        return
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, asked)


@contextmanager
def resumable(progress: Progress) -> Iterator[None]:
    """When interrupted, say how far it got and leave."""
    try:
        yield
    except KeyboardInterrupt:
        parts = [f"{progress.done} of {progress.total} done", progress.before, "run again to go on"]
        so_far = "; ".join(filter(None, parts))
        progress.bar.write(so_far if progress.total else "stopped before the start", sys.stderr)
        raise SystemExit(INTERRUPTED) from None


def echo_scanner(captures: str) -> None:
    """Say once, beside the output, what is to be said of the scanner of a capture folder."""
    from xden_builder.pipeline.remarks import calibration_remark, filtration_remark
    from xden_builder.pipeline.storage import place

    for remark in (calibration_remark, filtration_remark):
        if said := remark(place(captures)):
            click.echo(said, err=True)
