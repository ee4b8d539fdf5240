"""``xden``: look at a dataset folder, check it, fetch it."""

from __future__ import annotations

import dataclasses
import importlib
import math
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import click

from xden1k.commands import (
    DONE_IN_PART,
    LOCAL_ROOT,
    ROOT,
    OpenGroup,
    json_option,
    open_root,
    print_json,
)
from xden1k.errors import DataError, MissingObjectError
from xden1k.format.shapes import ON_PARTNEXT

if TYPE_CHECKING:
    from xden1k.export import Exported
    from xden1k.folder import DatasetFolder
    from xden1k.values.types import DensityObject

__all__ = ["cli"]

FOLDER = click.Path(path_type=Path, file_okay=False)
PICTURE = click.Path(path_type=Path, dir_okay=False)
FORMATS = ("mjcf", "urdf", "sdf", "usd", "glb", "obj", "nifti", "vti", "npz", "hdf5")
PART_HEADS = ("part", "material", "LAC 1/cm", "density g/cm³", "sd", "source", "flags")

root_option = click.option(
    "--root",
    type=ROOT,
    help="Dataset folder or URL. Default: $XDEN1K_ROOT, else what was downloaded, else the sample.",
)


def choosing_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate with the options that choose objects."""
    for name, text in (
        ("flag", "Only objects with this flag, or with a part that has it."),
        ("category", "Only objects of this category."),
        ("split", "Only this split. Default: all."),
    ):
        command = click.option(f"--{name}", help=text)(command)
    return command


@click.group(cls=OpenGroup)
@click.version_option(package_name="xden1k", prog_name="xden")
def cli() -> None:
    """Look at a dataset of objects with known density, check it, fetch it."""


@cli.command(epilog="Example: xden info --root dataset")
@root_option
@json_option
def info(root: Path | str | None, as_json: bool) -> None:
    """Say what a dataset folder holds, and where it comes from."""
    folder = open_root(root)
    folder.manifest.check_files(folder.root)
    values = _summary(folder)
    if as_json:
        print_json(values)
        return
    for name in ("root", "version", "builder"):
        click.echo(f"{name:<12}{values[name]}")
    for name in ("splits", "sources", "densities", "categories"):
        click.echo(f"{name:<12}{_counts(values[name])}")
    if without := values["without_radiographs"]:
        click.echo(f"{'no X-rays':<12}{_counts(without)}")
    if disturbed := values["disturbed"]:
        click.echo(f"{'disturbed':<12}radiographs {disturbed['radiographs']}")
    if count := values["on_partnext"]:
        click.echo(f"{'shapes':<12}{count} are {ON_PARTNEXT}")
    click.echo(f"{'size':<12}{values['bytes'] / 1e6:.1f} MB in {values['files']} files")
    unpacked = f"{values['unpacked_bytes'] / 1e6:.1f} MB, the size of a cache of `datasets`"
    click.echo(f"{'unpacked':<12}{unpacked}")


def _counts(counts: dict[str, int], shown: int = 8) -> str:
    words = [f"{name} {count}" for name, count in counts.items()]
    more = [f"and {len(words) - shown} more"] if len(words) > shown else []
    return ", ".join(words[:shown] + more)


def _summary(folder: DatasetFolder) -> dict[str, Any]:
    manifest = folder.manifest
    return {
        "root": str(folder.root),
        "version": manifest.version,
        "builder": manifest.builder,
        "splits": manifest.splits,
        "sources": manifest.sources,
        "densities": manifest.density_sources,
        "without_radiographs": manifest.without_radiographs,
        "disturbed": manifest.disturbed and dataclasses.asdict(manifest.disturbed),
        "on_partnext": manifest.on_partnext,
        "categories": dict(sorted(Counter(folder.light_column("category")).items())),
        "files": len(manifest.files),
        "bytes": sum(file.bytes for file in manifest.files),
        "unpacked_bytes": sum(file.num_bytes for file in manifest.shards()),
    }


@cli.command(epilog="Example: xden show kettle-0003 --root dataset -o kettle.png")
@click.argument("object_id", metavar="ID")
@root_option
@click.option(
    "-o", "--out", type=PICTURE, help="The PNG to write. Default: ID.png here; none with --json."
)
@json_option
def show(object_id: str, root: Path | str | None, out: Path | None, as_json: bool) -> None:
    """Draw an object: radiographs, residuals, slices, parts."""
    obj = open_root(root).object(object_id)
    if out is None and not as_json:
        out = Path(f"{object_id}.png")
    if out is not None:
        _figures().object_sheet(obj, out)
    if as_json:
        print_json(_values(obj) | ({} if out is None else {"picture": str(out)}))
    else:
        click.echo(_text(obj))
        click.echo(f"\n{out}")


def _figures() -> ModuleType:
    from xden1k.errors import require

    require("matplotlib", "view")
    return importlib.import_module("xden1k.pictures.figures")


@cli.command("list", epilog="Example: xden list --split test --category mug --root dataset")
@root_option
@choosing_options
@json_option
def list_objects(as_json: bool, **which: Any) -> None:
    """List objects: category, split, source, mass and flags of each."""
    from xden1k.folder.listing import LISTED, listed

    rows = listed(open_root(which.pop("root")), **which)
    if as_json:
        print_json({"objects": rows})
        return
    from tabulate import tabulate

    cells = [["" if row[name] is None else row[name] for name in LISTED] for row in rows]
    for row in cells:
        row[-1] = ", ".join(row[-1])
    click.echo(tabulate(cells, LISTED, floatfmt=".4g", disable_numparse=[0, 1]))


@cli.command(epilog="Example: xden gallery --split test -o sheet.png --root dataset")
@root_option
@choosing_options
@click.option("--columns", type=click.IntRange(min=1), default=4, help="Objects in a row.")
@click.option("-o", "--out", type=PICTURE, default=Path("gallery.png"), help="The PNG to write.")
@json_option
def gallery(columns: int, out: Path, as_json: bool, **which: Any) -> None:
    """Draw many objects on one sheet: radiographs, a density slice, name and mass."""
    from tqdm import tqdm

    from xden1k.folder.listing import listed

    folder = open_root(which.pop("root"))
    ids = [row["object_id"] for row in listed(folder, **which)]
    bar = tqdm(ids, disable=None, leave=False)
    _figures().contact_sheet(map(folder.object, bar), out, columns)
    if as_json:
        print_json({"objects": ids, "picture": str(out)})
    else:
        click.echo(f"{len(ids)} objects\n{out}")


def _text(obj: DensityObject) -> str:
    from tabulate import tabulate

    rows = [
        (
            *(part.name, part.material or "unknown", part.lac_per_cm, part.density_g_cm3),
            *(part.density_sd_g_cm3, part.density_source, ", ".join(part.flags)),
        )
        for part in obj.parts
    ]
    mass = f"{obj.mass_g:.4g} g" if math.isfinite(obj.mass_g) else "mass unknown"
    head = f"{obj.object_id}: {obj.category}, {mass}, {obj.source}, {obj.split} split"
    return f"{head}\n\n{tabulate(rows, PART_HEADS, floatfmt='.4g')}"


def _values(obj: DensityObject) -> dict[str, Any]:
    """Values for JSON, which has no not-a-number."""
    figures = ("lac_per_cm", "apparent_density_g_cm3", "density_g_cm3", "density_sd_g_cm3")
    words = ("name", "material", "density_source", "flags")
    return {
        "object_id": obj.object_id,
        "category": obj.category,
        "split": obj.split,
        "source": obj.source,
        "mass_g": _number(obj.mass_g),
        "weighed_mass_g": obj.weighed_mass_g,
        "com_cm": [_number(value) for value in obj.com_cm],
        "parts": [
            {name: getattr(part, name) for name in words}
            | {name: _number(getattr(part, name)) for name in figures}
            | {"label_voxels": voxels}
            for part, voxels in zip(obj.parts, obj.label_voxels.tolist(), strict=True)
        ],
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


@cli.command(epilog="Example: xden verify dataset")
@click.argument("root", type=LOCAL_ROOT)
@json_option
def verify(root: Path, as_json: bool) -> None:
    """Check every file and every row of a dataset folder.

    Prints each problem and exits with 1 if there is one.
    """
    from tqdm import tqdm

    from xden1k.folder.verify import verify_folder
    from xden1k.format.manifest import Manifest

    manifest = Manifest.read(root, damaged=True)
    with tqdm(total=manifest.objects, disable=None, leave=False) as bar:
        problems = verify_folder(root, on_row=bar.update)
    if as_json:
        print_json({"root": str(root), "objects": manifest.objects, "problems": problems})
    elif problems:
        click.echo("\n".join(problems))
    else:
        click.echo(f"{root}: {manifest.objects} objects in {len(manifest.files)} files, all sound")
    if problems:
        raise SystemExit(1)


@cli.command(epilog="Example: xden download --revision v1.2.0")
@click.option("--repo-id", metavar="ID", help="Hub repository. Default: zhangjxx/XDen-1K.")
@click.option("--revision", metavar="TAG", help="Tag or commit. Default: the newest.")
@json_option
def download(repo_id: str | None, revision: str | None, as_json: bool) -> None:
    """Fetch the dataset from the Hub into the cache, and verify it."""
    from xden1k.access import hub
    from xden1k.format.manifest import Manifest

    folder = hub.download(repo_id or hub.REPO_ID, revision)
    if as_json:
        print_json({"root": str(folder), "version": Manifest.read(folder).version})
    else:
        click.echo(folder)


@cli.command(epilog="Example: xden export hammer-0000 --format mjcf -o models --check")
@click.argument("object_ids", metavar="[ID]...", nargs=-1)
@click.option("--format", "format_name", type=click.Choice(FORMATS), required=True)
@click.option("-o", "--out", type=FOLDER, required=True, help="Each object gets a folder in it.")
@root_option
@click.option("--split", help="All objects of a split, instead of ids.")
@click.option("--check", is_flag=True, help="Have it read by the format's own tools as well.")
@click.option("--pieces", type=click.IntRange(1), default=1, help="Convex pieces for collisions.")
@json_option
def export(
    object_ids: tuple[str, ...], root: Path | None, split: str | None, as_json: bool, **how: Any
) -> None:
    """Write objects for simulators, viewers and other libraries.

    mjcf, urdf, sdf and usd: one rigid body with its exact mass, centre and inertia, in m and kg.
    glb and obj: its part meshes, in m. nifti and vti: its voxels. npz: all there is of an object,
    in cm and g. hdf5: all there is of all of them, stacked.
    """
    if bool(object_ids) == bool(split):
        raise click.UsageError("give the ids of objects, or --split for all of one")
    folder = open_root(root)
    ids = object_ids or folder.ids(split)
    with _notes():
        done, failed = (_stacked if how["format_name"] == "hdf5" else _each)(folder, ids, **how)
    if as_json:
        exports = [dataclasses.asdict(one) | {"path": str(one.path)} for one in done]
        print_json({"exported": exports, "failed": failed})
    for path in dict.fromkeys(one.path for one in done if not as_json):
        click.echo(path)
    for message in failed.values():
        click.echo(f"Error: {message}", err=True)
    if failed:
        raise SystemExit(DONE_IN_PART if done else 1)


Done = tuple[list["Exported"], dict[str, str]]


def _each(
    folder: DatasetFolder,
    ids: Sequence[str],
    *,
    format_name: str,
    out: Path,
    check: bool,
    pieces: int,
) -> Done:
    """Export object by object; what fails is told with its reason."""
    from tqdm import tqdm

    from xden1k.export import exported

    done, failed = [], {}
    for object_id in tqdm(ids, disable=None, leave=False):
        try:
            obj = folder.object(object_id)
            done.append(exported(obj, format_name, out, check=check, pieces=pieces))
        except (DataError, MissingObjectError) as err:
            failed[object_id] = str(err)
    return done, failed


def _stacked(
    folder: DatasetFolder, ids: Sequence[str], *, out: Path, check: bool, **_: Any
) -> Done:
    from tqdm import tqdm

    from xden1k.export import export_stack

    objects = map(folder.object, tqdm(ids, disable=None, leave=False))
    return export_stack(objects, out, check=check), {}


@contextmanager
def _notes() -> Iterator[None]:
    """Turn warnings into lines on stderr."""
    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always", UserWarning)
        yield
    for note in notes:
        click.echo(f"note: {note.message}", err=True)
