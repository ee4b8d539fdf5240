"""``xden-build evaluate``: phantoms, truth against reconstruction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import click

from xden1k.commands import DONE_IN_PART, json_option, print_json
from xden_builder.commands.shared import progress_bar, workers_option

if TYPE_CHECKING:
    from xden_builder.evaluate.run import Evaluation

__all__ = ["evaluate"]

SEED = 4711
"""Of objects that nothing was developed on."""
COMPOSITION_SD = 0.02
"""Alloys and liquids differ by a per cent or two from one maker to another, plastics and glass by
more (assumed)."""


@click.command(epilog="Example: xden-build evaluate --count 20 --ablated 5 -o evaluation.md")
@click.argument("captures", type=click.Path(path_type=Path, file_okay=False, exists=True), nargs=-1)
@click.option(
    "--rebuilt",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    multiple=True,
    help="What `xden-build run` made of CAPTURES; once for each of them.",
)
@click.option(
    "--by-voxel",
    is_flag=True,
    help="With several --rebuilt of one CAPTURES: compare voxels and radiographs, not parts.",
)
@click.option(
    "--poses",
    is_flag=True,
    help="With --rebuilt: compare where the objects stand (needs the extra import).",
)
@click.option("--count", type=click.IntRange(min=1), default=200, show_default=True)
@click.option("--seed", type=click.IntRange(min=0), default=SEED, show_default=True)
@click.option("--size", type=click.IntRange(min=64), default=512, show_default=True)
@click.option(
    "--composition-sd",
    type=click.FloatRange(min=0, max=0.05),
    default=COMPOSITION_SD,
    show_default=True,
    help="Standard deviation of attenuation coefficients about the library's, as a share.",
)
@click.option(
    "--ablated",
    type=click.IntRange(min=0),
    default=60,
    show_default=True,
    help="Objects to try the fit on without each of its parts.",
)
@workers_option
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the tables into this file too.",
)
@json_option
def evaluate(
    captures: tuple[Path, ...],
    rebuilt: tuple[Path, ...],
    by_voxel: bool,
    poses: bool,
    count: int,
    seed: int,
    size: int,
    composition_sd: float,
    ablated: int,
    workers: int,
    out: Path | None,
    as_json: bool,
) -> None:
    """Rebuild objects whose density is known, and compare.

    CAPTURES is a folder of simulated captures of a tube, evaluated whole; without it, objects are
    simulated by --count, --seed, --size and --composition-sd, with every effect of the scanner,
    pores, and labels that err. With --rebuilt nothing is fitted: the dataset folders are compared
    with the truth, with --by-voxel whatever their parts are, such as those of X-Field or an outer
    surface alone, and with --poses by where the objects stand.
    Exits with 3 if some object could not be evaluated.
    """
    if out and not out.parent.is_dir():
        raise click.UsageError(f"--out: there is no folder {out.parent}")
    if by_voxel and poses:
        raise click.UsageError("expected --by-voxel or --poses, got both")
    if by_voxel:
        if len(captures) != 1 or not rebuilt:
            raise click.UsageError("--by-voxel: expected one folder CAPTURES, and --rebuilt")
        return _compare_interiors(captures[0], rebuilt, out, workers, as_json)
    if len(captures) != len(rebuilt) if rebuilt else len(captures) > 1:
        raise click.UsageError("expected one folder CAPTURES, or as many as --rebuilt")
    if poses:
        if not rebuilt:
            raise click.UsageError("--poses: expected --rebuilt")
        return _compare_poses(dict(zip(captures, rebuilt, strict=True)), out, workers, as_json)
    if rebuilt:
        return _compare(dict(zip(captures, rebuilt, strict=True)), out, as_json)
    with TemporaryDirectory(prefix="xden-evaluate-") as scratch:
        folder = (
            captures[0]
            if captures
            else _simulated(Path(scratch) / "captures", count, seed, size, composition_sd, workers)
        )
        report = _evaluated(folder, ablated, workers)
    from xden_builder.evaluate.table import markdown

    _tell(markdown(report), report.to_dict() if as_json else None, out, _failed(report.failures))


def _compare(folders: Mapping[Path, Path], out: Path | None, as_json: bool) -> None:
    from xden_builder.evaluate.rebuilt import read_rebuilt
    from xden_builder.evaluate.rebuilt_table import rebuilt_markdown

    sets = {str(captures): read_rebuilt(captures, root) for captures, root in folders.items()}
    tables = rebuilt_markdown(sets)
    values = {name: each.to_dict() for name, each in sets.items()} if as_json else None
    lines = [f"not rebuilt: {name}: {key}" for name, each in sets.items() for key in each.missing]
    _tell(tables, values, out, lines)


def _compare_interiors(
    captures: Path, roots: tuple[Path, ...], out: Path | None, workers: int, as_json: bool
) -> None:
    from xden_builder.evaluate.interiors import compare_interiors, interiors_markdown

    with progress_bar() as bar:
        found = compare_interiors(captures, roots, workers=workers, on_done=lambda _: bar.update())
    tables = interiors_markdown([str(root) for root in roots], found)
    values = {"rebuilt": [str(root) for root in roots], **found.to_dict()} if as_json else None
    _tell(tables, values, out, _failed(found.failures))


def _compare_poses(
    folders: Mapping[Path, Path], out: Path | None, workers: int, as_json: bool
) -> None:
    from xden_builder.evaluate.poses import compare_poses, poses_markdown

    sets = {}
    with progress_bar() as bar:
        for captures, root in folders.items():
            sets[str(captures)] = compare_poses(
                captures, root, workers=workers, on_done=lambda _: bar.update()
            )
    values = {name: each.to_dict() for name, each in sets.items()} if as_json else None
    lacking = [line for each in sets.values() for line in _failed(each.failures)]
    _tell(poses_markdown(sets), values, out, lacking)


def _failed(failures: Sequence[tuple[str, str]]) -> list[str]:
    return [f"failed: {object_id}: {why}" for object_id, why in failures]


def _tell(
    tables: str, values: Mapping[str, Any] | None, out: Path | None, lacking: Sequence[str]
) -> None:
    """Print tables, or values as JSON where there are some; then what is lacking, and exit so."""
    if values is not None:
        print_json(values)
    else:
        click.echo(tables)
    if out:
        out.write_text(tables, encoding="utf-8")
    for line in lacking:
        click.echo(line, err=True)
    if lacking:
        raise SystemExit(DONE_IN_PART)


def _simulated(
    out: Path, count: int, seed: int, size: int, composition_sd: float, workers: int
) -> Path:
    from xden_builder.phantoms import write_captures
    from xden_builder.phantoms.realism import LIFELIKE
    from xden_builder.phantoms.scanner import Scanner

    with progress_bar(count) as bar:
        write_captures(
            out,
            count,
            seed,
            size=size,
            scanner=replace(Scanner.realistic(), composition_sd=composition_sd),
            realism=LIFELIKE,
            workers=workers,
            progress=lambda _: bar.update(),
        )
    return out


def _evaluated(captures: Path, ablated: int, workers: int) -> Evaluation:
    from xden_builder.capture import CaptureFolder
    from xden_builder.evaluate.run import evaluate

    count = len(CaptureFolder(captures).object_ids)
    with progress_bar(count) as bar:
        return evaluate(captures, ablated=ablated, workers=workers, on_done=lambda _: bar.update())
