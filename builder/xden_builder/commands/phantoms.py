"""``xden-build phantoms`` and ``gallery``: simulated objects of known density."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from xden1k.commands import DONE_IN_PART, json_option, print_json
from xden1k.errors import DataError
from xden_builder.commands.scanning import scan_options, simulated_scanner, wanted_realism
from xden_builder.commands.shared import FOLDER, loading, names_in, progress_bar, workers_option

if TYPE_CHECKING:
    from xden1k.values.types import Split
    from xden_builder.capture.pose import MeshScale
    from xden_builder.phantoms.check import SetReport

__all__ = ["gallery", "phantoms"]


@click.command(epilog="Example: xden-build phantoms captures --count 24 --seed 1")
@click.argument("out", type=FOLDER)
@click.option("--count", type=click.IntRange(min=1), required=True, help="Objects to make.")
@click.option("--seed", type=click.IntRange(min=0), required=True, help="Which objects.")
@click.option("--categories", default="", help="Only these, separated by commas.")
@click.option(
    "--split",
    type=click.Choice(["train", "val", "test", "unseen"]),  # SPLITS, whose import takes long
    help="Of the objects, only those of a split.",
)
@click.option(
    "--unseen",
    default="",
    metavar="NAMES|FILE",
    help="Categories of the split unseen: separated by commas, or `unseen_categories` of a TOML.",
)
@scan_options
@click.option("--check", is_flag=True, help="Look whether shapes and grids are sound, in the end.")
@workers_option
@json_option
def phantoms(
    out: Path,
    count: int,
    seed: int,
    size: int | None,
    categories: str,
    split: Split | None,
    unseen: str,
    scanner: Path | None,
    lifelike: bool | None,
    ideal: bool,
    pose: Literal["near", "unknown"],
    mesh_scale: MeshScale,
    turned: bool,
    as_dataset: bool,
    check: bool,
    workers: int,
    as_json: bool,
) -> None:
    """Simulate captures of objects whose density is known.

    What --as-dataset writes is verified in the end, as `xden verify` does.
    With --check, exits with 3 if a part is open or shares space with another, an object does not
    read back, or a truth grid weighs something else than its parts.
    """
    with loading():
        from xden_builder.phantoms import plan_objects, write_captures, write_truth_dataset
        from xden_builder.phantoms.posing import Posing

    if as_dataset and check:
        raise click.UsageError("--check is for captures, not for --as-dataset")
    write = write_truth_dataset if as_dataset else write_captures
    names = names_in(categories)
    never_learned = _unseen(unseen)
    count_made = len(plan_objects(count, seed, names, split, never_learned))
    with progress_bar(count_made) as bar:
        write(
            out,
            count,
            seed,
            size=size,
            ideal=ideal,
            scanner=simulated_scanner(scanner, ideal, turned),
            realism=wanted_realism(lifelike, ideal),
            posing=Posing(pose, mesh_scale),
            workers=workers,
            progress=lambda _: bar.update(),
            categories=names,
            split=split,
            unseen=never_learned,
        )
    if as_dataset:
        _verify(out, count_made)
    kind = "dataset" if as_dataset else "captures"
    report = _checked(out, count_made, workers) if check else None
    if as_json:
        values = {"out": str(out), "kind": kind, "count": count_made, "seed": seed}
        print_json(values | ({"check": report.to_dict()} if report else {}))
    else:
        click.echo(f"{out}: {kind} of {count_made} phantoms, seed {seed}")
        if report:
            _echo_check(report)
    if report and not report.good:
        raise SystemExit(DONE_IN_PART)


def _unseen(told: str) -> list[str]:
    """Read names of categories, or the TOML file that has them."""
    from xden1k.values.settings import read_toml

    if not told.endswith(".toml"):
        return names_in(told)
    names = read_toml(Path(told)).get("unseen_categories")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise DataError(f"{told}: expected a list of names under unseen_categories, got {names!r}")
    return names


def _verify(out: Path, count: int) -> None:
    from xden1k.folder.verify import refuse_unsound

    with progress_bar(count) as bar:
        refuse_unsound(out, bar.update)


def _checked(out: Path, count: int, workers: int) -> SetReport:
    from xden_builder.phantoms.check import check_set

    with progress_bar(count) as bar:
        return check_set(out, workers=workers, progress=lambda _: bar.update())


def _echo_check(report: SetReport) -> None:
    from xden_builder.phantoms.check import MEDIAN_MASS_ERROR, WORST_MASS_ERROR

    for check in report.failures:
        click.echo(f"unsound: {check.object_id}: {'; '.join(check.faults)}", err=True)
    click.echo(
        f"{len(report.checks) - len(report.failures)} of {len(report.checks)} sound; mass of grids "
        f"against parts: {report.median_mass_error:.3%} off in the median (limit "
        f"{MEDIAN_MASS_ERROR:.1%}), {report.worst_mass_error:.2%} at worst ({WORST_MASS_ERROR:.0%})"
    )


@click.command(epilog="Example: xden-build gallery gallery.png")
@click.argument("out", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@json_option
def gallery(out: Path, seed: int, as_json: bool) -> None:
    """Draw one phantom of each category: a shaded view, PA and LAT."""
    from xden_builder.phantoms import gallery as draw

    draw(out, seed)
    if as_json:
        print_json({"out": str(out), "seed": seed})
    else:
        click.echo(out)
