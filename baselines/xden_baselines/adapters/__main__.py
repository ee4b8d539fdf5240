"""``python -m xden_baselines.adapters``: make a submission of the files of a method's own run.

A command of its own, beside ``xden-bench baseline``: what it needs, files, frames and units, no
method has, and the benchmark imports no baseline.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xden1k.commands import Group, command_line, json_option, open_root, print_json

if TYPE_CHECKING:
    from xden1k.predictions import SubmissionMeta
    from xden_baselines.adapters.running import Read, Report

__all__ = ["cli"]

PROGRAM = "python -m xden_baselines.adapters"
FILE = click.Path(path_type=Path, dir_okay=False, exists=True)
FOLDER = click.Path(path_type=Path, file_okay=False, exists=True)
Decorator = Callable[[Any], Any]


@click.group(cls=Group)
def cli() -> None:
    """Make a submission of the files of a method's own run."""


def _run_options(frame: str | None, method: str | None, inputs: tuple[str, ...]) -> Decorator:
    """Add what every adapter takes; what has no default is required."""
    options: list[Decorator] = [
        click.argument("runs", type=FOLDER),
        click.option("--root", type=FOLDER, help="Dataset folder. [default: as xden-bench]"),
        click.option("--split", default="test", show_default=True, help="What the run predicted."),
        click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True),
        click.option(
            "--method", default=method, required=not method, show_default=True, help="Its name."
        ),
        click.option(
            "--inputs",
            multiple=True,
            type=click.Choice(["mesh", "rgb", "parts", "text", "xray"]),
            default=inputs,
            required=not inputs,
            show_default=True,
            help="All it looked at beside the mesh; repeatable.",
        ),
        click.option("--training-data", multiple=True, help="It was trained on; repeatable."),
        click.option("--seconds", type=float, help="It took for an object, if measured."),
        click.option(
            "--frame",
            type=click.Choice(["m", "cm", "box"]),
            default=frame,
            show_default=True,
            help="Its frame: the object's in m or cm, or one with its axes, fitted to its box.",
        ),
        click.option("--transforms", type=FILE, help="Where each object lies; before --frame."),
        click.option(
            "--floaters",
            type=click.FloatRange(0, 0.1),
            default=0.001,
            show_default=True,
            help="Share of the points that may float beyond each end of an axis.",
        ),
        json_option,
        click.pass_context,
    ]

    def decorate(command: Any) -> Any:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


unit_option = click.option(
    "--unit", type=click.Choice(["kg/m3", "g/cm3"]), required=True, help="Of the densities."
)


@cli.command(epilog=f"Example: {PROGRAM} nerf2physics RUNS --root DATA --out nerf2physics.npz")
@_run_options("m", "NeRF2Physics", ("rgb",))
def nerf2physics(context: click.Context, runs: Path, **asked: Any) -> None:
    """NeRF2Physics: scenes with points.npz, and masses."""
    from xden_baselines.adapters.scenes import read_nerf2physics

    _run(context, lambda name, _: read_nerf2physics(runs, name), asked)


@cli.command(epilog=f"Example: {PROGRAM} pugs RUNS --root DATA --out pugs.npz")
@_run_options("m", "PUGS", ("rgb",))
def pugs(context: click.Context, runs: Path, **asked: Any) -> None:
    """PUGS: scenes with pred_result_density, and masses."""
    from xden_baselines.adapters.scenes import read_pugs

    _run(context, lambda name, _: read_pugs(runs, name), asked)


@cli.command(
    epilog=f"Example: {PROGRAM} pixie RUNS --renders render_outputs --ranges RANGES.yaml "
    "--root DATA --out pixie.npz"
)
@click.option("--renders", type=FOLDER, required=True, help="With NAME/clip_features.npz.")
@click.option("--ranges", type=FILE, help="normalization_ranges.yaml; not for PLY files.")
@_run_options("box", "Pixie", ("rgb",))
def pixie(
    context: click.Context, runs: Path, renders: Path, ranges: Path | None, **asked: Any
) -> None:
    """Pixie: results of an inference run and the voxel grids they came from."""
    from xden_baselines.adapters.voxels import density_range, read_pixie

    span = density_range(ranges) if ranges else None
    _run(context, lambda name, _: read_pixie(runs, name, renders, span), asked)


@cli.command(epilog=f"Example: {PROGRAM} vomp RUNS --root DATA --out vomp.npz")
@click.option("--original-scale", is_flag=True, help="Coordinates are the mesh's: give its frame.")
@_run_options("box", "VoMP", ("rgb",))
def vomp(context: click.Context, runs: Path, original_scale: bool, **asked: Any) -> None:
    """VoMP: NAME.npz with voxel_data."""
    from xden_baselines.adapters.voxels import read_vomp

    _run(context, lambda name, _: read_vomp(runs, name, original_scale=original_scale), asked)


@cli.command(
    epilog=f"Example: {PROGRAM} gaussianproperty RUNS --unit kg/m3 --frame m --root DATA "
    "--out gaussianproperty.npz"
)
@unit_option
@click.option("--densities", type=FILE, help="JSON: [low, high] in kg/m3 of each material.")
@_run_options(None, "GaussianProperty", ("rgb",))
def gaussianproperty(
    context: click.Context, runs: Path, unit: Any, densities: Path | None, **asked: Any
) -> None:
    """GaussianProperty: labels.npz, point_cloud.ply with a density, or a case with cameras."""
    from xden_baselines.adapters.points import density_table, read_gaussian_property

    read = partial(read_gaussian_property, runs, unit=unit, table=density_table(densities))
    _run(context, read, asked)


@cli.command(
    "generic_points",
    epilog=f"Example: {PROGRAM} generic_points RUNS --method mine --inputs rgb --unit kg/m3 "
    "--frame m --root DATA --out mine.npz",
)
@unit_option
@_run_options(None, None, ())
def generic_points(context: click.Context, runs: Path, unit: Any, **asked: Any) -> None:
    """Any method: NAME/points.npz."""
    from xden_baselines.adapters.points import read_points

    _run(context, lambda name, _: read_points(runs, name, unit), asked)


def _run(context: click.Context, read: Read, asked: dict[str, Any]) -> None:
    """Adapt the run and say what came of it."""
    from tqdm import tqdm

    from xden_baselines.adapters.frames import Frames
    from xden_baselines.adapters.running import Row, adapt

    row = Row(
        method=asked["method"],
        adapter=context.info_name or "",
        inputs=tuple(dict.fromkeys(["mesh", *asked["inputs"]])),
        training_data=asked["training_data"],
        seconds_per_object=asked["seconds"],
        command=command_line(context, PROGRAM),
    )
    frames = Frames.read(asked["frame"], asked["transforms"])
    few: float = asked["floaters"]
    bar = partial(tqdm, unit="object", disable=None, leave=False)
    meta, report = adapt(
        lambda name, sample: replace(read(name, sample), few=few),
        frames,
        open_root(asked["root"]),
        asked["split"],
        asked["out"],
        row,
        bar,
    )
    _echo(asked["out"], meta, report, as_json=asked["as_json"])


def _echo(out: Path, meta: SubmissionMeta, report: Report, *, as_json: bool) -> None:
    import json
    from dataclasses import asdict
    from statistics import median

    if as_json:
        print_json({"file": str(out), "meta": json.loads(meta.to_json()), **asdict(report)})
        return
    click.echo(f"{out}: {meta.method}, track {meta.track}, split {meta.split} ({meta.notes})")
    found = [one.mass_native_g for one in report.objects]
    if masses := [mass for mass in found if mass is not None]:
        count = f"{len(masses)} of {len(found)} objects"
        click.echo(f"mass by its own rule, never scored: median {median(masses):.4g} g, {count}")


if __name__ == "__main__":
    cli(prog_name=PROGRAM)
