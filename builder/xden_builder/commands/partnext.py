"""``xden-build partnext``: simulated captures of PartNeXt's shapes."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xden1k.commands import DONE_IN_PART, json_option, print_json
from xden_builder.commands.scanning import scan_options, simulated_scanner, wanted_realism
from xden_builder.commands.shared import FOLDER, names_in, progress_bar, workers_option

if TYPE_CHECKING:
    from xden_builder.phantoms.partnext.writer import Failure, Made, PartNeXtSet

__all__ = ["partnext"]


@click.command(epilog="Example: xden-build partnext PartNeXt --out captures --seed 1 --count 8")
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False, exists=True))
@click.option("--out", metavar="CAPTURES", type=FOLDER, required=True, help="Folder to write.")
@click.option("--seed", type=click.IntRange(min=0), required=True, help="What is drawn.")
@click.option("--objects", default="", metavar="ID,...", help="Only these models.")
@click.option("--count", type=click.IntRange(min=1), help="Only the first, in the order of ids.")
@click.option(
    "--size-cm",
    nargs=2,
    type=float,
    metavar="LEAST MOST",
    show_default="2 10",
    help="Half of the longest side, drawn evenly in its logarithm: a GLB has no scale.",
)
@click.option(
    "--grid",
    type=click.IntRange(min=24),
    default=96,
    show_default=True,
    help="Voxels a side of the grid on which parts become solids.",
)
@scan_options
@workers_option
@json_option
def partnext(
    folder: Path, out: Path, as_dataset: bool, workers: int, as_json: bool, **asked: Any
) -> None:
    """Simulate captures of materials drawn at random, on shapes of PartNeXt.

    FOLDER holds annotations (Parquet, JSON lines or Arrow) and meshes, glbs/000-000/ID.glb, as
    AuWang/PartNeXt and AuWang/PartNeXt_mesh on the Hub. Each annotated part becomes a closed solid
    or gets a wall, and what is left inside filler, void or an inclusion, by the seed and the
    object's id. Shapes keep their own licences: do not pass them on. Exits with 3 if some objects
    failed; they are listed.
    """
    from xden_builder.phantoms.partnext.writer import write_partnext, write_partnext_truth

    models = _models(folder, **asked)
    chosen = models.chosen()
    write = write_partnext_truth if as_dataset else write_partnext
    with progress_bar(len(chosen.entries)) as bar:

        def report(done: Failure | str) -> None:
            if isinstance(done, str):
                bar.update()
            else:
                bar.write(f"failed: {done.line}", file=sys.stderr)

        made = write(out, models, chosen, workers=workers, report=report)
    _tell(out, made, as_json, kind="dataset" if as_dataset else "captures", seed=models.seed)
    if made.failures:
        raise SystemExit(DONE_IN_PART)


def _models(
    folder: Path,
    *,
    seed: int,
    objects: str,
    count: int | None,
    size_cm: tuple[float, float] | None,
    grid: int,
    size: int | None,
    scanner: Path | None,
    lifelike: bool | None,
    ideal: bool,
    pose: Any,
    mesh_scale: Any,
    turned: bool,
) -> PartNeXtSet:
    """Put together what is asked for."""
    from xden_builder.phantoms.partnext.phantom import HALF_CM, Shaping
    from xden_builder.phantoms.partnext.writer import PartNeXtSet
    from xden_builder.phantoms.posing import Posing
    from xden_builder.phantoms.writer import make_scanner

    return PartNeXtSet(
        folder,
        seed,
        make_scanner(size, ideal, simulated_scanner(scanner, ideal, turned)),
        wanted_realism(lifelike, ideal),
        Posing(pose, mesh_scale),
        Shaping(size_cm or HALF_CM, grid),
        tuple(names_in(objects)),
        count,
    )


def _tell(out: Path, made: Made, as_json: bool, *, kind: str, seed: int) -> None:
    from xden1k.format.shapes import ON_PARTNEXT

    if as_json:
        print_json({"out": str(out), "kind": kind, "seed": seed, **made.to_dict()})
        return
    again = f"; {made.repeated} more rows of the same models" * bool(made.repeated)
    click.echo(
        f"{out}: {kind} of {ON_PARTNEXT}, seed {seed}: {len(made.objects)} objects, "
        f"{len(made.failures)} failed{again}"
    )
