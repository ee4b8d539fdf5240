"""``xden-bench manip``: what a centre of mass is worth to a gripper, in simulation."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xden1k.commands import command_line, json_option, print_json
from xden_bench.commands.picking import controls_asked, numbers_asked, submissions_asked
from xden_bench.commands.shared import (
    FILE,
    FOLDER,
    interval_text,
    open_reference,
    progress_bar,
    root_option,
    split_option,
)

if TYPE_CHECKING:
    from xden_bench.manip.item import Item
    from xden_bench.manip.scenes import Scenes
    from xden_bench.manip.table import Line

__all__ = ["manip", "run"]

TOLD = "Simulated picks of simulated objects; no robot was used."


@click.group(epilog="Example: xden-bench manip prepare data --out scenes")
def manip() -> None:
    """Try centres of mass on simulated picks.

    Everything that these commands give is simulated.
    """


@manip.command(epilog="Example: xden-bench manip prepare data --out scenes --tier quick")
@click.argument("root", type=FOLDER)
@click.option("--out", type=FOLDER, required=True, help="Folder of scenes to write.")
@click.option(
    "--tier",
    type=click.Choice(["quick", "full"]),
    default="quick",
    show_default=True,
    help="How many objects and draws.",
)
@split_option
@click.option("--grasps", type=FOLDER, help="Grasps of another detector, ID.npz for each object.")
@click.option("--hulls", type=FOLDER, help="Where hulls are kept.  [default: OUT.hulls]")
@click.option(
    "--max-hulls", type=click.IntRange(min=1), help="Another number of hulls; rows say so."
)
@json_option
def prepare(
    root: Path,
    out: Path,
    tier: str,
    split: str,
    grasps: Path | None,
    hulls: Path | None,
    max_hulls: int | None,
    as_json: bool,
) -> None:
    """Choose objects of the dataset ROOT, and freeze all that trials of them need.

    Prints how many objects each rule took out.
    """
    from xden_bench.manip.preparing import Examiner, choose
    from xden_bench.manip.protocol import load_manip_protocol
    from xden_bench.manip.scenes import open_scenes, write_scenes

    rules, reference = load_manip_protocol(), open_reference(root, split)
    varied = {} if max_hulls is None else {"max_hulls": max_hulls}
    rules = replace(rules, hulls=replace(rules.hulls, **varied))
    examiner = Examiner(
        reference.folder,
        rules,
        rules.tiers[tier].draws,
        hulls or out.with_name(f"{out.name}.hulls"),
        grasps,
    )
    chosen = choose(reference.ids, examiner, rules.tiers[tier], progress_bar)
    dataset = {
        "revision": reference.revision,
        "manifest_sha256": reference.manifest_sha256,
        "split": split,
    }
    write_scenes(chosen, rules, dataset, tier, out, varied)
    scenes = open_scenes(out)
    if as_json:
        print_json({**scenes.facts, "sha256": scenes.sha256})
    else:
        _echo_scenes(scenes)


@manip.command(epilog="Example: xden-bench manip run scenes preds.npz --out rows --root data")
@click.argument("scenes", type=FOLDER)
@click.argument("submissions", type=FILE, nargs=-1)
@click.option("--control", "names", multiple=True, help="Only this control; can be given again.")
@click.option("--no-controls", is_flag=True, help="The submissions alone.")
@click.option("--out", type=FOLDER, required=True, help="Folder of rows to write.")
@root_option
@click.option(
    "--vary",
    metavar="NAME=VALUE",
    multiple=True,
    help="Another number of the protocol's [solver]; the rows say so.",
)
@click.option(
    "--friction-scale",
    type=click.FloatRange(min=0, min_open=True),
    default=1.0,
    show_default=True,
    help="Of the friction of every trial; rows say so.",
)
@click.option("--homogeneous", is_flag=True, help="Spread each object's mass evenly.")
@click.option(
    "--workers", type=click.IntRange(min=1), default=1, show_default=True, help="Processes."
)
@json_option
@click.pass_context
def run(
    context: click.Context,
    scenes: Path,
    submissions: tuple[Path, ...],
    names: tuple[str, ...],
    no_controls: bool,
    out: Path,
    root: Path | str | None,
    vary: tuple[str, ...],
    friction_scale: float,
    homogeneous: bool,
    workers: int,
    as_json: bool,
) -> None:
    """Try controls, and SUBMISSIONS, on the same candidates and draws.

    Can be stopped and started again: what is done is kept in the folder of rows.
    """
    from xden_bench.entries.provenance import code_commit, package_version
    from xden_bench.manip.running import Tries, Variant, run_rows
    from xden_bench.manip.scenes import open_scenes

    if names and no_controls:
        raise click.UsageError("Of --control and --no-controls give one.")
    opened = open_scenes(scenes)
    items = {item.object_id: item for item in opened.items()}
    choosers = [
        *controls_asked(items, opened, names, no_controls=no_controls),
        *submissions_asked(submissions, items, opened, root),
    ]
    if not choosers:
        raise click.UsageError("give a submission, or leave --no-controls away")
    facts = {
        "command": command_line(context, "xden-bench manip"),
        "xden_version": package_version(),
        "commit": code_commit(),
    }
    tries = Tries(opened, choosers, Variant(numbers_asked(vary), friction_scale, homogeneous))
    paths = run_rows(tries, out, facts, workers, progress_bar)
    if as_json:
        print_json({"rows": [str(path) for path in paths]})
    else:
        click.echo(f"{TOLD} {len(paths)} rows in {out}")


@manip.command(epilog="Example: xden-bench manip table rows/*.json")
@click.argument("rows", type=FILE, nargs=-1, required=True)
@click.option("--figure", type=FILE, help="Draw success against the error of the centre of mass.")
@click.option(
    "--joined", is_flag=True, help="Join rows of one name that are of several splits' scenes."
)
@json_option
def table(rows: tuple[Path, ...], figure: Path | None, joined: bool, as_json: bool) -> None:
    """Compare ROWS on each stratum, with `uniform` and with `true`."""
    from xden_bench.manip.protocol import load_manip_protocol
    from xden_bench.manip.rows import read_joined_rows, read_rows
    from xden_bench.manip.table import lines

    read = read_joined_rows(rows) if joined else read_rows(rows)
    found = lines(read, load_manip_protocol().statistics)
    warnings = sum(
        int(trial.warnings > 0) for row in read for one in row.objects for trial in one.trials
    )
    if figure:
        from xden_bench.manip.figure import draw_ladder

        draw_ladder(found, f"Simulated picks, stratum off, {_variant(read[0].facts)}", figure)
    if as_json:
        told = [asdict(line) for line in found]
        print_json({"simulated": True, "lines": told, "warnings": warnings})
        return
    click.echo(f"{TOLD} {_variant(read[0].facts)}")
    _echo_lines(found)
    click.echo(f"\ntrials with a warning of the solver: {warnings}")


@manip.command(epilog="Example: xden-bench manip show hammer-0008 scenes --picture hammer.png")
@click.argument("object_id")
@click.argument("scenes", type=FOLDER)
@click.option("--picture", type=FILE, help="Draw picks by `uniform` and by `true`, one a row.")
@click.option("--regime", type=click.Choice(["easy", "hard"]), default="hard", show_default=True)
@click.option("--draw", type=click.IntRange(min=0), default=0, show_default=True)
@json_option
def show(
    object_id: str, scenes: Path, picture: Path | None, regime: str, draw: int, as_json: bool
) -> None:
    """Tell what is frozen of one object of SCENES, and draw picks of it.

    Pictures need EGL or OSMesa, and no display.
    """
    os.environ.setdefault("MUJOCO_GL", "egl")  # read when MuJoCo is imported
    from xden_bench.manip.scenes import open_scenes

    opened = open_scenes(scenes)
    item = opened.item(object_id)
    outcomes = _drawn(opened, item, picture, regime, draw) if picture else {}
    facts = {
        "object_id": item.object_id,
        "category": item.category,
        "stratum": item.stratum,
        "mass_g": item.mass.mass_g,
        "com_cm": item.mass.com_cm.tolist(),
        "uniform_cm": item.uniform_cm.tolist(),
        "long_axis": item.long_axis.tolist(),
        "rest_rotation": item.rest.rotation.tolist(),
        "rest_origin_cm": item.rest.origin_cm.tolist(),
        "hulls": len(item.hulls),
        "candidates": len(item.grasps),
        "draws": {name: [asdict(one) for one in draws] for name, draws in item.draws.items()},
        "outcomes": outcomes,
    }
    if as_json:
        print_json(facts)
        return
    _echo_item(item)
    for name, outcome in outcomes.items():
        click.echo(f"{picture}: {name}, {regime} {draw}, simulated: {outcome}")


def _drawn(scenes: Scenes, item: Item, picture: Path, regime: str, draw: int) -> dict[str, str]:
    """Draw picks by uniform and by true, and return what became of each."""
    import numpy as np
    from PIL import Image

    from xden1k.errors import DataError
    from xden_bench.manip.grasps import nearest
    from xden_bench.manip.pictures import strip

    draws = item.draws[regime]
    if draw >= len(draws):
        raise DataError(f"--draw: {item.object_id} has {len(draws)} draws, 0 to {len(draws) - 1}")
    strips: list[Any] = []
    outcomes: dict[str, str] = {}
    for name, centre_cm in (("uniform", item.uniform_cm), ("true", item.mass.com_cm)):
        (centre,) = item.rest.to_world(centre_cm[None])
        frames, outcomes[name] = strip(
            item, nearest(item.grasps, centre), draws[draw], scenes.rules
        )
        strips.append(frames)
    Image.fromarray(np.concatenate(strips)).save(picture)
    return outcomes


def _variant(facts: Mapping[str, Any]) -> str:
    """Say by what rules rows were made."""
    departs = "".join(f", {name} {value:g}" for name, value in facts["varied"].items())
    even = ", mass spread evenly" if facts["homogeneous"] else ""
    joined = f", splits {' and '.join(facts['joined'])} joined" if "joined" in facts else ""
    return (
        f"{facts['protocol']}, tier {facts['tier']}, MuJoCo {facts['mujoco']}"
        f"{departs}{even}{joined}"
    )


def _echo_scenes(scenes: Scenes) -> None:
    from tabulate import tabulate

    from xden_bench.manip.preparing import RULES

    facts = scenes.facts
    columns = (
        "object_id",
        "stratum",
        "mass_g",
        "uniform_along_cm",
        "hulls",
        "candidates",
        "redrawn",
    )
    rows = [[one[name] for name in columns] for one in facts["objects"]]
    click.echo(TOLD)
    click.echo(tabulate(rows, columns, floatfmt=".1f"))
    for rule, out in facts["taken_out"].items():
        click.echo(f"taken out, {rule}: {len(out)} ({RULES[rule]})")
    click.echo(f"not examined further, stratum full: {facts['not_needed']}")


def _echo_lines(found: Sequence[Line]) -> None:
    from tabulate import tabulate

    headings = (
        *(
            "row",
            "success",
            "95 % (Wilson)",
            "95 % over objects",
            "vs uniform",
            "p",
            "vs true",
            "p",
        ),
        *("wrist, N·m", "turn, °", "|axial error|, cm", "ladder"),
    )
    for stratum in dict.fromkeys(line.stratum for line in found):
        rows = [_cells(line) for line in found if line.stratum == stratum]
        click.echo(f"\nstratum {stratum}")
        click.echo(tabulate(rows, headings, disable_numparse=True))


def _cells(line: Line) -> list[str]:
    low, high = line.wilson
    compared = [
        cell
        for name in ("uniform", "true")
        for cell in (
            f"{line.against[name].difference.mean:+.1%}",
            f"{line.against[name].objects.p_equal:.2g}",
        )
    ]
    return [
        line.name,
        f"{line.success:.1%}",
        f"{low:.1%} to {high:.1%}",
        interval_text(line.over_objects, ".1%"),
        *compared,
        f"{line.figures['wrist_moment_nm']:.3f}",
        f"{line.figures['turn_deg']:.1f}",
        "-" if line.axial_error_cm is None else f"{line.axial_error_cm:.2f}",
        "-" if line.expected is None else f"{line.expected:.1%}",
    ]


def _echo_item(item: Item) -> None:
    click.echo(
        f"{item.object_id}: {item.category}, stratum {item.stratum}, {item.mass.mass_g:.1f} g, "
        f"centroid {item.along_cm(item.uniform_cm):+.2f} cm from the centre of mass along the "
        f"longest axis; {len(item.hulls)} hulls, {len(item.grasps)} candidates"
    )
    for regime, draws in item.draws.items():
        for number, draw in enumerate(draws):
            click.echo(
                f"{regime} {number}: friction {draw.friction:.3f}, {draw.grip_force_n:.1f} N a "
                f"finger, shaken by {draw.shake_rad:.3f} rad, drawn anew {draw.redrawn} times"
            )
