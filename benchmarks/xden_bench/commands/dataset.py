"""``xden-bench dataset``: the official dataset of the benchmark, made here or fetched."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xden1k.commands import DONE_IN_PART, json_option, print_json
from xden1k.errors import DataError
from xden_bench.commands.shared import FOLDER, echo_lines, progress_bar

if TYPE_CHECKING:
    from xden_bench.datasets import Difference, Recipe

__all__ = ["dataset"]


@click.command(epilog="Example: xden-bench dataset XDen-P2000 --out data")
@click.argument("name")
@click.option("--out", metavar="ROOT", type=FOLDER, help="Dataset folder to make.")
@click.option("--objects", metavar="0-39", default="", help="Only these, as they are drawn.")
@click.option("--from-hub", metavar="REPO@REVISION", help="Fetch it into the cache instead.")
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    default=lambda: len(os.sched_getaffinity(0)),
    show_default="one per core",
    help="Processes.",
)
@json_option
def dataset(
    name: str,
    out: Path | None,
    objects: str,
    from_hub: str | None,
    workers: int,
    as_json: bool,
) -> None:
    """Make the official dataset of the benchmark, and compare it with the published checksums.

    Says first how large it is and how long it takes. Can be stopped and started again: what is
    finished is kept in ROOT.work. Exits with 3 if something differs from what is published, which
    is told by object and column.
    """
    from xden_bench.datasets import load_recipe, make_dataset

    recipe = load_recipe(name)
    if from_hub:
        if out or objects:
            raise click.UsageError(
                "--from-hub fetches all of it into the cache: no --out, --objects"
            )
        _tell(recipe, _fetched(recipe, from_hub), (), as_json)
        return
    if out is None:
        raise click.UsageError("give --out ROOT, or --from-hub REPO@REVISION")
    chosen = _chosen(objects)
    count = len(range(recipe.objects)[chosen])
    click.echo(_ahead(recipe, out, count, workers), err=True)
    bar: Any = progress_bar([""] * count)
    make_dataset(recipe, out, workers=workers, objects=chosen, on_done=lambda _: bar.update())
    bar.close()
    differing = _compared(recipe, out, whole=not objects)
    _tell(recipe, out, differing, as_json)
    if differing:
        raise SystemExit(DONE_IN_PART)


def _chosen(objects: str) -> slice:
    """Read which objects to make; all if nothing is said."""
    if not objects:
        return slice(None)
    if not (match := re.fullmatch(r"(\d+)-(\d+)", objects)):
        raise click.UsageError(f"--objects: expected FIRST-LAST, such as 0-39, got {objects!r}")
    return slice(int(match[1]), int(match[2]) + 1)


def _ahead(recipe: Recipe, out: Path, count: int, workers: int) -> str:
    megabytes = 1000 * recipe.gigabytes * count / recipe.objects
    minutes = math.ceil(recipe.seconds_an_object * count / workers / 60)
    return (
        f"{recipe.name}: {count} objects, {megabytes:.0f} MB in {out} (three times that while it "
        f"is made), about {minutes} min with {workers} free cores; can be stopped and started "
        "again"
    )


def _fetched(recipe: Recipe, told: str) -> Path:
    """Fetch a dataset from the Hub into the cache, where commands look without ``--root``."""
    from xden1k.access.hub import download

    if not recipe.manifest_sha256:
        raise DataError(f"{recipe.name}: no checksum is published yet, so none can be fetched")
    repo_id, _, revision = told.partition("@")
    return download(repo_id, revision or None, manifest_sha256=recipe.manifest_sha256)


def _compared(recipe: Recipe, out: Path, *, whole: bool) -> tuple[Difference, ...]:
    """Verify what was made, and compare it with what is published."""
    from xden1k.folder import open_folder
    from xden1k.folder.verify import refuse_unsound
    from xden_bench.datasets.fingerprints import differences, published

    folder = open_folder(out)
    bar: Any = progress_bar(folder.ids())
    refuse_unsound(out, bar.update)
    bar.close()
    fingerprints = published(recipe.name)
    if (whole and folder.manifest_sha256 == recipe.manifest_sha256) or fingerprints is None:
        return ()
    return differences(folder, fingerprints, progress_bar)


def _tell(recipe: Recipe, root: Path, differing: Sequence[Difference], as_json: bool) -> None:
    from xden1k.folder import open_folder

    folder = open_folder(root)
    splits, made = folder.manifest.splits, folder.manifest_sha256
    as_published = made == recipe.manifest_sha256
    if as_json:
        values = {"root": str(root), "splits": splits, "manifest_sha256": made}
        told = [asdict(one) | {"is_scored": one.is_scored} for one in differing]
        print_json(values | {"as_published": as_published, "differences": told})
        return
    counts = ", ".join(f"{split} {count}" for split, count in splits.items())
    click.echo(f"{root}: {counts}; manifest {made}{', as published' * as_published}")
    if differing:
        echo_lines("differs from the published dataset:", differing)
        click.echo(_advice(recipe, differing))


def _advice(recipe: Recipe, differing: Sequence[Difference]) -> str:
    """Say what to do with a dataset that differs."""
    versions = ", ".join(f"{name} {version}" for name, version in recipe.versions.items())
    fetch = (
        f"`xden-bench dataset {recipe.name} --from-hub REPO@REVISION` fetches the published one; "
        f"it was made on x86-64 with {versions}."
    )
    if any(one.is_scored for one in differing):
        return (
            f"Scores are computed from some of these: do not enter scores of this folder. {fetch}"
        )
    return (
        "Scores are computed from none of these: any one submission has the same scores here. A "
        f"method that reads them may answer otherwise in the last digits. {fetch}"
    )
