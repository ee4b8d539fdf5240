"""``python -m xden_baselines.views``: pictures of a split as scenes that other programs read."""

from __future__ import annotations

from pathlib import Path

import click

from xden1k.commands import Group, json_option, open_root, print_json

__all__ = ["cli"]

PROGRAM = "python -m xden_baselines.views"


@click.group(cls=Group)
def cli() -> None:
    """Pictures of phantoms for programs of others."""


@cli.command(epilog=f"Example: {PROGRAM} export SCENES --root DATA --split test --pictures shaded")
@click.argument("out", type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "--root",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    help="Dataset folder. [default: as xden-bench]",
)
@click.option("--split", default="test", show_default=True, help="Objects to draw.")
@click.option(
    "--pictures",
    type=click.Choice(["flat", "shaded"]),
    default="flat",
    show_default=True,
    help="How they are drawn.",
)
@click.option("--per-ring", default=8, show_default=True, help="Views on each of three rings.")
@click.option("--size", default=320, show_default=True, help="Rows and columns of a picture.")
@json_option
def export(
    out: Path, root: Path | None, split: str, pictures: str, per_ring: int, size: int, as_json: bool
) -> None:
    """Write a scene folder OUT/OBJECT_ID for each object.

    Scenes that are there already are kept, so that an interrupted export goes on.
    """
    from functools import partial

    from tqdm import tqdm

    from xden_baselines.views.cameras import Rig
    from xden_baselines.views.exporting import export_scenes
    from xden_baselines.views.source import RenderedPhantoms, ShadedPhantoms

    kind = {"flat": RenderedPhantoms, "shaded": ShadedPhantoms}[pictures]
    source = kind(Rig(per_ring=per_ring, size_px=size))
    bar = partial(tqdm, unit="object", disable=None, leave=False)
    count = export_scenes(open_root(root), split, source, out, bar)
    if as_json:
        print_json({"folder": str(out), "written": count, "pictures": source.description})
    else:
        click.echo(f"{out}: {count} scenes written, {source.description}")


if __name__ == "__main__":
    cli(prog_name=PROGRAM)
