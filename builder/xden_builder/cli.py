"""``xden-build``: simulate captures, rebuild them, audit the result, measure the speed."""

from __future__ import annotations

import logging
import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from xden1k.commands import DONE_IN_PART, Group, json_option, print_json
from xden_builder.commands.evaluate import evaluate
from xden_builder.commands.shared import progress_bar, workers_option

if TYPE_CHECKING:
    from xden1k.values.types import Split
    from xden_builder.audit.run import AuditReport
    from xden_builder.phantoms.check import SetReport
    from xden_builder.pipeline.run import BuildReport, Outcome
    from xden_builder.pipeline.storage import Place
    from xden_builder.speed.growth import Cost
    from xden_builder.speed.ratios import Comparison

__all__ = ["cli"]

FOLDER = click.Path(path_type=Path, file_okay=False)
MOST_FLAGGED = 30
"""Objects whose flags are printed; the report has them all."""


@click.group(cls=Group)
@click.version_option(package_name="xden1k", prog_name="xden-build")
def cli() -> None:
    """Rebuild density from radiographs and part meshes; simulate captures to try it on."""
    logging.basicConfig(format="%(levelname)s: %(message)s")


@cli.command(epilog="Example: xden-build phantoms captures --count 24 --seed 1")
@click.argument("out", type=FOLDER)
@click.option("--count", type=click.IntRange(min=1), required=True, help="Objects to make.")
@click.option("--seed", type=click.IntRange(min=0), required=True, help="Which objects.")
@click.option(
    "--size",
    type=click.IntRange(min=16),
    show_default="512, or the scanner file's",
    help="Pixels a side.",
)
@click.option("--categories", default="", help="Only these, separated by commas.")
@click.option(
    "--split",
    type=click.Choice(["train", "val", "test"]),  # SPLITS, whose import takes NumPy's time
    help="Of the objects, only those of a split.",
)
@click.option(
    "--scanner",
    type=click.Path(path_type=Path, dir_okay=False),
    help="TOML file of the simulated scanner.",
    show_default="realistic",
)
@click.option(
    "--lifelike/--tidy",
    default=None,
    show_default="lifelike",
    help="Whether there are pores, paint, and labels that err or are missing.",
)
@click.option("--ideal", is_flag=True, help="Nothing errs; monochromatic and tidy, if not chosen.")
@click.option("--as-dataset", is_flag=True, help="Write the truth as a dataset folder instead.")
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
    scanner: Path | None,
    lifelike: bool | None,
    ideal: bool,
    as_dataset: bool,
    check: bool,
    workers: int,
    as_json: bool,
) -> None:
    """Simulate captures of objects whose density is known.

    With --check, exits with 3 if a part is open or shares space with another, an object does not
    read back, or a truth grid weighs something else than its parts.
    """
    from xden_builder.phantoms import plan_objects, write_captures, write_truth_dataset
    from xden_builder.phantoms.realism import LIFELIKE, TIDY
    from xden_builder.phantoms.scanner import Scanner, load_scanner

    if as_dataset and check:
        raise click.UsageError("--check is for captures, not for --as-dataset")
    made = Scanner.monochromatic() if ideal else Scanner.realistic()
    write = write_truth_dataset if as_dataset else write_captures
    names = [name for name in categories.split(",") if name]
    count_made = len(plan_objects(count, seed, names, split))
    with progress_bar(count_made) as bar:
        write(
            out,
            count,
            seed,
            size=size,
            ideal=ideal,
            scanner=load_scanner(scanner) if scanner else made,
            realism=LIFELIKE if (not ideal if lifelike is None else lifelike) else TIDY,
            workers=workers,
            progress=lambda _: bar.update(),
            categories=names,
            split=split,
        )
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


@cli.command(epilog="Example: xden-build run captures --out dataset")
@click.argument("captures")
@click.option("--out", required=True, help="Dataset folder to write.")
@click.option(
    "--model",
    type=click.Choice(["poly", "paper"]),
    default="poly",
    show_default=True,
    help="poly: by the tube's spectrum, with pose and stray light; paper: one constant for all.",
)
@click.option("--parts", help="Other part meshes in place of the annotated ones.")
@click.option(
    "--cluster",
    metavar="ADDRESS",
    default="",
    help="Work on the Ray cluster there, in place of processes here.",
)
@workers_option
@json_option
def run(
    captures: str,
    out: str,
    model: Any,
    parts: str | None,
    cluster: str,
    workers: int,
    as_json: bool,
) -> None:
    """Rebuild every object of a capture folder into a dataset folder.

    CAPTURES, --out and --parts are folders, or fsspec URLs such as s3://bucket/captures. Can be
    stopped and started again: finished objects are kept in OUT.work. Exits with 3 if some objects
    failed; they are listed, and in OUT.work/build_report.json.
    """
    from xden_builder.pipeline.run import build
    from xden_builder.pipeline.storage import place
    from xden_builder.reconstruct.settings import BuildSettings

    told = click.get_current_context().get_parameter_source("workers")
    if cluster and told is ParameterSource.COMMANDLINE:
        raise click.UsageError("--workers has no meaning with --cluster: Ray knows its cores")
    with progress_bar() as bar, redirect_stdout(sys.stderr):  # where Ray tells of lost machines

        def on_done(outcome: Outcome) -> None:
            bar.update()
            if outcome.status == "failed":
                bar.write(f"failed: {outcome.object_id}: {outcome.message}", file=sys.stderr)

        report = build(
            place(captures),
            place(out),
            BuildSettings(model=model),
            workers=workers,
            cluster=cluster,
            parts=place(parts) if parts else None,
            on_start=bar.reset,
            on_done=on_done,
        )
    if as_json:
        print_json(report.to_dict())
    else:
        _echo_report(report, place(out))
    if report.failures:
        raise SystemExit(DONE_IN_PART)


@cli.command(epilog="Example: xden-build audit dataset --captures captures")
@click.argument("root", type=FOLDER)
@click.option("--captures", type=FOLDER, required=True, help="What the dataset was made from.")
@workers_option
@json_option
def audit(root: Path, captures: Path, workers: int, as_json: bool) -> None:
    """Compare a dataset with its radiographs and CTs.

    Its parts are projected again with the attenuation that was fitted. Exits with 3 if a view does
    not show its object's parts (correlation below 0.9), or an object could not be audited.
    """
    from xden1k.folder import open_folder
    from xden_builder.audit.run import audit_folder

    with progress_bar(len(open_folder(root).ids())) as bar:
        report = audit_folder(root, captures, workers=workers, on_done=lambda _: bar.update())
    if as_json:
        print_json(report.to_dict())
    else:
        _echo_audits(report)
    if not report.good:
        raise SystemExit(DONE_IN_PART)


cli.add_command(evaluate)


@cli.command(epilog="Example: xden-build gallery gallery.png")
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


@cli.command(epilog="Example: xden-build speed --growth -o growth.png")
@click.option(
    "--size",
    type=click.IntRange(min=64),
    default=1024,
    show_default=True,
    help="Pixels a side of the comparisons.",
)
@click.option("--growth", is_flag=True, help="Measure growth with pixels, faces and parts instead.")
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Draw the growth into this PNG too.",
)
@json_option
def speed(size: int, growth: bool, out: Path | None, as_json: bool) -> None:
    """Measure our ways against others, as ratios in one run; or how time and memory grow."""
    if growth:
        _growth(out, as_json)
        return
    if out:
        raise click.UsageError("--out draws the growth: it needs --growth")
    from xden_builder.speed.ratios import comparisons

    rows = list(comparisons(size))
    if as_json:
        print_json([row.to_dict() for row in rows])
    else:
        _echo_comparisons(rows)


def _growth(out: Path | None, as_json: bool) -> None:
    from xden_builder.speed.growth import cases, costs, draw_growth

    chosen, rows = cases(), []
    with progress_bar(len(chosen), "case") as bar:
        for row in costs(chosen):
            rows.append(row)
            bar.update()
    if as_json:
        print_json([row.to_dict() for row in rows])
    else:
        _echo_growth(rows)
    if out:
        draw_growth(rows, out)


def _echo_growth(rows: list[Cost]) -> None:
    from tabulate import tabulate

    from xden_builder.speed.growth import AXES, along

    costs = {row.case: row for row in rows}
    headers = ["varied", "", "path lengths, CPU s", "fit, CPU s", "start, MB", "+ lengths", "+ fit"]
    table = [
        (
            axis,
            f"{getattr(row.case, axis):,}",
            *(f"{seconds:.3f}" for seconds in (row.lengths_s, row.fit_s)),
            *(f"{memory:.0f}" for memory in (row.start_mb, row.lengths_mb, row.fit_mb)),
        )
        for axis in AXES
        for row in map(costs.__getitem__, along(axis))
    ]
    aligned = ("left", *["right"] * 6)
    click.echo(tabulate(table, headers, disable_numparse=True, colalign=aligned))


def _echo_comparisons(rows: list[Comparison]) -> None:
    from tabulate import tabulate

    for row in rows:
        table = [
            ("ours: " + row.ours, f"{row.ours_s:.4f}", f"{row.ours_error:.1e}"),
            (row.other, f"{row.other_s:.4f}", f"{row.other_error:.1e}"),
        ]
        digits = 0 if row.ratio > 10 else 1
        click.echo(f"\n{row.task}: {row.ratio:.{digits}f} times the {row.clock} time")
        click.echo(tabulate(table, [row.task, "s", row.error], disable_numparse=True))


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


def _echo_report(report: BuildReport, out: Place) -> None:
    from xden_builder.pipeline.run import REPORT_NAME, work_folder
    from xden_builder.pipeline.storage import inside

    flagged = [outcome for outcome in report.outcomes if outcome.flags]
    for outcome in flagged[:MOST_FLAGGED]:
        click.echo(f"flagged: {outcome.object_id}: {', '.join(outcome.flags)}")
    if len(flagged) > MOST_FLAGGED:
        click.echo(f"flagged: {len(flagged) - MOST_FLAGGED} more objects, in the report")
    counts = ", ".join(f"{report.count(s)} {s}" for s in ("built", "kept", "failed"))
    click.echo(f"{out}: {counts}; report in {inside(work_folder(out), REPORT_NAME)}")


def _echo_audits(report: AuditReport) -> None:
    from tabulate import tabulate

    headers = ["object", "view", "T MAE", "T corr", "p MAE", "p corr", "T MAE beside", "verdict"]
    rows = [
        (
            one.object_id,
            view.name if view.fitted else f"{view.name} (unseen)",
            f"{view.transmission_mae:.2g}",
            f"{view.transmission_corr:.5f}",
            f"{view.attenuation_mae:.2g}",
            f"{view.attenuation_corr:.5f}",
            f"{view.background_transmission_mae:.2g}",
            view.verdict.upper() if view.verdict == "bad" else view.verdict,
        )
        for one in report.audits
        for view in one.views
    ]
    click.echo(tabulate(rows, headers, disable_numparse=True))
    for one in report.audits:
        if one.ct:
            click.echo(
                f"{one.object_id} against its CT: voxel MAE {one.ct.voxel_mae_per_cm:.3g}/cm "
                f"({one.ct.voxel_mae_rel:.1%}), mass ratio {one.ct.mass_ratio:.4f}, "
                f"centre of mass off by {one.ct.com_l1_cm:.2g} cm (L1)"
            )
    click.echo("T = transmission, p = -ln T, on pixels whose ray meets the object; beside = air")
    for object_id, message in report.failures:
        click.echo(f"failed: {object_id}: {message}", err=True)
