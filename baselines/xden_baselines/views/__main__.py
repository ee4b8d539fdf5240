"""``python -m xden_baselines.views``: pictures of a split as scenes that other programs read."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from xden1k.commands import Group, json_option, open_root, print_json

if TYPE_CHECKING:
    from xden_baselines.views.source import RenderedPhantoms

__all__ = ["cli"]

PROGRAM = "python -m xden_baselines.views"


@click.group(cls=Group)
def cli() -> None:
    """Pictures of phantoms for programs of others."""


root_option = click.option(
    "--root",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    help="Dataset folder. [default: as xden-bench]",
)
pictures_option = click.option(
    "--pictures",
    type=click.Choice(["flat", "shaded"]),
    default="shaded",
    show_default=True,
    help="How they are drawn.",
)


@cli.command(epilog=f"Example: {PROGRAM} export RUNS --root DATA --split test")
@click.argument("out", type=click.Path(path_type=Path, file_okay=False))
@root_option
@click.option("--split", default="test", show_default=True, help="Objects to draw.")
@pictures_option
@click.option("--per-ring", default=4, show_default=True, help="Views on each of three rings.")
@click.option("--size", default=256, show_default=True, help="Rows and columns of a picture.")
@json_option
def export(
    out: Path, root: Path | None, split: str, pictures: str, per_ring: int, size: int, as_json: bool
) -> None:
    """Write a scene folder OUT/scenes/OBJECT_ID for each object.

    Scenes that are there already are kept, so that an interrupted export goes on.
    """
    from functools import partial

    from tqdm import tqdm

    from xden_baselines.views.exporting import export_scenes

    source = _source(pictures, per_ring, size)
    bar = partial(tqdm, unit="object", disable=None, leave=False)
    count = export_scenes(open_root(root), split, source, out, bar)
    if as_json:
        print_json({"folder": str(out), "written": count, "pictures": source.description})
    else:
        click.echo(f"{out}: {count} scenes written, {source.description}")


@cli.command(epilog=f"Example: {PROGRAM} page PAGE.png hammer-0000 thermos-0001")
@click.argument("out", type=click.Path(path_type=Path, dir_okay=False))
@click.argument("object_ids", nargs=-1, required=True)
@root_option
@pictures_option
@click.option("--width", default=1536, show_default=True, help="Of the page, pixels.")
def page(
    out: Path, object_ids: tuple[str, ...], root: Path | None, pictures: str, width: int
) -> None:
    """Draw objects, a row of twelve views of each, on one page: OUT, a PNG or JPEG."""
    from xden_baselines.views.page import page_of, write_page

    source = _source(pictures, per_ring=4, size_px=256)
    write_page(page_of(open_root(root), object_ids, source), out, width_px=width)
    click.echo(f"{out}: {len(object_ids)} objects, {source.description}")


def _source(pictures: str, per_ring: int, size_px: int) -> RenderedPhantoms:
    from xden_baselines.views.cameras import Rig
    from xden_baselines.views.source import RenderedPhantoms, ShadedPhantoms

    kind = {"flat": RenderedPhantoms, "shaded": ShadedPhantoms}[pictures]
    return kind(Rig(per_ring=per_ring, size_px=size_px))


if __name__ == "__main__":
    cli(prog_name=PROGRAM)
