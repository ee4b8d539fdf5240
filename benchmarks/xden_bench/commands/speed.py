"""The command that measures how long scoring and loading take."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import click

from xden1k.commands import json_option, open_root, print_json
from xden_bench.commands.shared import FILE, root_option

__all__ = ["speed"]

READERS, WRITERS = 40, 20
"""Of the web app under load."""


@click.command(epilog="Example: xden-bench speed preds.npz")
@click.argument("submission", type=FILE, required=False)
@root_option
@click.option("--split", default="test", show_default=True, help="Split to score or load.")
@click.option(
    "--repeats",
    type=click.IntRange(min=1),
    default=5,
    show_default=True,
    help="Runs of each kind; the median holds.",
)
@click.option("--loading", is_flag=True, help="Measure loading against np.memmap instead.")
@click.option("--serving", is_flag=True, help="Put the web app under load instead.")
@click.option(
    "--seconds",
    type=click.FloatRange(min=1),
    default=60,
    show_default=True,
    help="Of the load.",
)
@json_option
def speed(
    submission: Path | None,
    root: Path | str | None,
    split: str,
    repeats: int,
    loading: bool,
    serving: bool,
    seconds: float,
    as_json: bool,
) -> None:
    """Measure scoring against reading the same arrays, in one run.

    Without a SUBMISSION, water is scored.

    With --loading: torch samples against np.memmap of the same decoded bytes, memory over ten
    epochs, opening 1,000 objects, importing the package. Linux only; takes minutes.

    With --serving: 40 readers and 20 senders of files at the same time, on a server that is killed
    twice meanwhile; every file that was taken must be entered. Linux only; needs the extras view
    and build.
    """
    if (loading or serving) and submission is not None:
        raise click.UsageError("--loading and --serving take no submission.")
    if loading and serving:
        raise click.UsageError("Of --loading and --serving give one.")
    if serving:
        _serving(root, seconds, as_json)
    elif loading:
        _loading(root, split, repeats, as_json)
    else:
        _scoring(submission, root, split, repeats, as_json)


def _scoring(
    submission: Path | None, root: Path | str | None, split: str, repeats: int, as_json: bool
) -> None:
    from dataclasses import asdict

    from xden_bench.methods.baseline import find_predictor, run_predictor
    from xden_bench.scoring.protocol import load_protocol
    from xden_bench.speed.scoring import measure_speed

    folder = open_root(root)
    with tempfile.TemporaryDirectory() as scratch:
        if submission is None:
            submission = Path(scratch) / "water.npz"
            run_predictor(find_predictor("water"), folder, split, submission)
        measured = measure_speed(submission, folder.path, split, load_protocol(), repeats)
    if as_json:
        print_json({**asdict(measured), "ratio": measured.ratio})
    else:
        click.echo(
            f"{measured.objects} objects: reading {measured.read_seconds:.3f} s, checking and "
            f"scoring (reading included) {measured.score_seconds:.3f} s, ratio {measured.ratio:.2f}"
        )


def _loading(root: Path | str | None, split: str, repeats: int, as_json: bool) -> None:
    from xden_bench.speed.report import measure_loading

    measured = measure_loading(open_root(root).path, split, repeats)
    if as_json:
        print_json(measured)
    else:
        _echo_loading(measured)


def _serving(root: Path | str | None, seconds: float, as_json: bool) -> None:
    from xden1k.errors import require
    from xden_bench.speed.serving import measure_serving

    require("gradio", "view")
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        measured = measure_serving(
            open_root(root).path, place, readers=READERS, writers=WRITERS, seconds=seconds
        )
    if as_json:
        print_json(measured)
    else:
        _echo_serving(measured)


def _echo_serving(measured: dict[str, Any]) -> None:
    machine = measured["machine"]
    click.echo(
        f"{machine['cores']} cores, load {machine['load_before']:.1f} before and "
        f"{machine['load_after']:.1f} after; {READERS} readers, {WRITERS} senders"
    )
    columns = ("p50_s", "p95_s", "worst_s")
    rows = [
        (name, row["count"], *(f"{row[column]:.3f}" for column in columns))
        for name, row in measured["requests"].items()
    ]
    _table("answers", ["", "answers", "p50, s", "p95, s", "worst, s"], rows)
    click.echo(
        f"\n{measured['taken']} files taken, {measured['scored']} entered, "
        f"{measured['missing']} missing"
    )
    for first, last in measured["memory_mb"]:
        click.echo(f"memory of the server, first and last: {first:.1f} and {last:.1f} MB")


def _echo_loading(measured: dict[str, Any]) -> None:
    data, machine = measured["data"], measured["machine"]
    click.echo(
        f"{data['objects']} objects of {data['sample_mb']:.1f} MB as samples, "
        f"{data['stored_mb']:.2f} MB on disk; {machine['cores']} cores, load "
        f"{machine['load_before']:.1f} before"
    )
    headers = ("ours, ms", "np.memmap, ms", "ratio", "lowest", "highest")
    rows = [(row["workers"], *_times(row)) for row in measured["loaders"]]
    _table("full samples, from a loader", ["workers", *headers], rows)
    parts = [
        (row["fields"], f"{row['mb']:.2f}", *_times(row), f"{row['share']:.2f}")
        for row in measured["fields"]
    ]
    _table("fields, one process", ["fields", "MB", *headers, "share"], parts)
    single = [
        (name, *(f"{row[column]:.1f}" for column in ("median_ms", "worst_ms", "worst_cpu_ms")))
        for name, row in measured["access"].items()
    ]
    headings = ["", "median, ms", "worst, ms", "worst of CPU, ms"]
    _table("single objects in random order", headings, single)
    for row in measured["memory"]:
        shown, growth = " ".join(f"{mb:.1f}" for mb in row["mb"]), max(row["mb"]) - row["mb"][0]
        click.echo(
            f"\nanonymous memory after each epoch, {row['workers']} workers: {shown} MB; "
            f"growth after the first {growth:.1f} MB"
        )
    opening = measured["opening"]
    starts = [
        (f"opening {opening['objects']} objects; pyarrow: its shards", *_times(opening)),
        ("import xden1k; numpy", *_times(measured["importing"])),
    ]
    _table("start", ["ours; other", "ours, ms", "other, ms", *headers[2:]], starts)


def _times(row: dict[str, Any]) -> tuple[str, ...]:
    times = (f"{row[name]:.1f}" for name in ("ours_ms", "other_ms"))
    return (*times, *(f"{row[name]:.2f}" for name in ("ratio", "lowest", "highest")))


def _table(title: str, headers: list[str], rows: list[tuple[Any, ...]]) -> None:
    from tabulate import tabulate

    aligned = ("left", *["right"] * (len(headers) - 1))
    click.echo(f"\n{title}")
    click.echo(tabulate(rows, headers, disable_numparse=True, colalign=aligned))
