"""Phantoms as a capture folder, as a scanner and its operator would leave it."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, TypeVar

from xden1k.errors import DataError
from xden1k.values.ply import write_ply
from xden1k.values.types import Split
from xden_builder.capture import write_scanner
from xden_builder.capture.writing import write_image, write_json, write_table
from xden_builder.phantoms.glb import write_glb
from xden_builder.phantoms.grid import truth_grid
from xden_builder.phantoms.phantom import (
    Identity,
    Phantom,
    Plan,
    make_phantom,
    plan_objects,
)
from xden_builder.phantoms.posing import (
    AS_SCANNED,
    MeshFrame,
    Posing,
    draw_mesh_frame,
    posed,
    true_poses,
)
from xden_builder.phantoms.realism import TIDY, Realism
from xden_builder.phantoms.scanner import VIEWS, Scanner, panel_name, scanner_file
from xden_builder.workers import run_each

__all__ = [
    "Progress",
    "each_object",
    "make_scanner",
    "object_columns",
    "refuse_filled",
    "simulation",
    "write_captures",
    "write_object",
    "write_planned",
    "write_set",
]

Result = TypeVar("Result")
Progress = Callable[[str], None]
NOTHING: Final[Mapping[str, Any]] = MappingProxyType({})


def make_scanner(size: int | None, ideal: bool, scanner: Scanner | None = None) -> Scanner:
    """Give the scanner of the command line.

    Parameters
    ----------
    size
        Pixels along each side, in place of the scanner's own.
    ideal
        Whether nothing errs.
    scanner
        The monochromatic one by default.
    """
    scanner = scanner or Scanner.monochromatic()
    scanner = scanner if size is None else replace(scanner, size_px=size)
    return scanner.ideal() if ideal else scanner


def write_captures(
    out: Path,
    count: int,
    seed: int,
    *,
    size: int | None = None,
    ideal: bool = False,
    scanner: Scanner | None = None,
    realism: Realism = TIDY,
    posing: Posing = AS_SCANNED,
    workers: int = 1,
    progress: Progress = lambda _: None,
    categories: Sequence[str] = (),
    split: Split | None = None,
    unseen: Sequence[str] = (),
) -> None:
    """Simulate a capture folder, with the truth and the appearance in each object's folder.

    Beside what the builder reads: ``truth.json``, ``truth.npz`` (:class:`TruthGrid`) and
    ``appearance.glb``. An object that the panel does not hold is scanned in the large setting, and
    has a ``scanner.toml`` of its own. ``objects.csv`` comes last: without it there is no capture
    folder. The same arguments give the same bytes, whatever the number of processes.

    Parameters
    ----------
    out
        A folder that is empty or does not exist.
    count, seed, categories, split, unseen
        Which objects; see :func:`plan_objects`.
    size, ideal, scanner
        See :func:`make_scanner`.
    realism
        How often there are pores, paint and labels that err.
    posing
        Where objects lie, and in which frame their meshes come.
    workers
        Number of processes.
    progress
        Called with the id of each object that is done.

    Raises
    ------
    DataError
        If the folder is not empty, an argument is out of range or an object too large.
    """
    plans = plan_objects(count, seed, categories, split, unseen)
    scanner = make_scanner(size, ideal, scanner)
    write_planned(out, plans, scanner, realism, posing=posing, workers=workers, progress=progress)


def write_planned(
    out: Path,
    plans: Sequence[Plan],
    scanner: Scanner,
    realism: Realism,
    *,
    posing: Posing = AS_SCANNED,
    workers: int = 1,
    progress: Progress = lambda _: None,
) -> None:
    """Simulate a capture folder of some objects of one seed; otherwise as :func:`write_captures`.

    Raises
    ------
    DataError
        If the folder is not empty, or an object too large.
    """
    refuse_filled(out)
    seed = plans[0].seed
    out.mkdir(parents=True, exist_ok=True)
    task = partial(_write_object, out, scanner, realism, posing, seed)
    settings = set(each_object(task, plans, workers, progress))
    rows = [object_columns(plan, posing) for plan in plans]
    write_set(out, rows, scanner, seed, settings, simulation(seed, scanner, realism, posing))


def write_set(
    out: Path,
    rows: Sequence[Mapping[str, str]],
    scanner: Scanner,
    seed: int,
    settings: Container[str],
    told: Mapping[str, Any],
) -> None:
    """Write what is beside the objects' folders: scanner, panels, simulation, ``objects.csv``.

    Parameters
    ----------
    out
        The capture folder.
    rows
        Of ``objects.csv``, all with the same columns.
    scanner, seed
        Of the set.
    settings
        In which objects were scanned: ``standard``, ``large``.
    told
        What ``simulation.json`` says.
    """
    write_scanner(scanner_file(scanner), out / "scanner.toml")
    _write_panels(out, scanner, seed, "standard")
    if "large" in settings:
        _write_panels(out, scanner.large(), seed, "large")
    write_json(out / "simulation.json", told)
    write_table(out / "objects.csv", list(rows[0]), [list(row.values()) for row in rows])


def object_columns(plan: Identity, posing: Posing) -> dict[str, str]:
    """Give the columns of ``objects.csv`` that there is something to say in."""
    row = {
        "object_id": plan.object_id,
        "category": plan.kind,
        "split": plan.split,
        "source": "phantom",
    }
    if posing.pose == "unknown":
        units = draw_mesh_frame(plan, posing).units
        row |= {"mesh_units": units, "pose": posing.pose}
    if posing.pose == "unknown" or posing.mesh_scale != "known":
        row |= {"mesh_scale": posing.mesh_scale}
    return row


def each_object(
    task: Callable[[str], Result], plans: Sequence[Plan], workers: int, progress: Progress
) -> Iterator[Result]:
    """Yield the result of a task for each object's id, in order, from so many processes.

    Raises
    ------
    Exception
        The first one a task raises.
    """
    ids = [plan.object_id for plan in plans]
    if workers == 1:
        answers: Iterator[tuple[str, Result | BaseException]] = ((key, task(key)) for key in ids)
    else:
        answers = run_each(task, ids, workers)
    early: dict[str, Result] = {}
    waiting = iter(ids)
    expected = next(waiting, None)
    for object_id, answer in answers:
        if isinstance(answer, BaseException):
            raise answer
        early[object_id] = answer
        progress(object_id)
        while expected in early:
            yield early.pop(expected)
            expected = next(waiting, None)


def refuse_filled(out: Path) -> None:
    """Make sure that a new folder may be written.

    Raises
    ------
    DataError
        If something is there that is not an empty folder.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise DataError(f"{out}: expected a folder that is empty or does not exist")


def simulation(seed: int, scanner: Scanner, realism: Realism, posing: Posing) -> dict[str, Any]:
    """Give every setting of a simulation, of JSON's types."""
    values = {"seed": seed, "scanner": scanner.settings(), "realism": asdict(realism)}
    return values | posing.settings()


def _write_object(
    out: Path, scanner: Scanner, realism: Realism, posing: Posing, seed: int, object_id: str
) -> str:
    return write_object(out, make_phantom(Plan.of(seed, object_id), realism), scanner, posing)


def write_object(
    out: Path,
    phantom: Phantom,
    scanner: Scanner,
    posing: Posing,
    told: Mapping[str, Any] = NOTHING,
) -> str:
    """Write the folder of one object; return the setting it was scanned in.

    Parameters
    ----------
    out
        The capture folder.
    phantom
        As it was made, not posed yet.
    scanner, posing
        How it is taken.
    told
        What ``truth.json`` says beside what it always does.

    Raises
    ------
    DataError
        If it is too large; nothing is written then.
    """
    phantom = posed(phantom, scanner, posing)
    setting, scanner = scanner.setting_for(phantom)
    folder = out / phantom.plan.object_id
    folder.mkdir()
    if setting != "standard":
        write_scanner(scanner_file(scanner, setting), folder / "scanner.toml")
    frame = draw_mesh_frame(phantom.plan, posing)
    _write_parts(folder, phantom, scanner, frame)
    shares = {}
    for view in VIEWS:
        signal = scanner.signal(phantom, view)
        write_image(folder / f"{view}.tif", scanner.radiograph(phantom, view, signal))
        shares[view] = signal.scatter_share
    truth = _truth(phantom, setting, scanner, shares)
    write_json(folder / "truth.json", {**truth, **told} | true_poses(phantom.plan, scanner, posing))
    truth_grid(phantom).save(folder / "truth.npz")
    return setting


def _write_parts(folder: Path, phantom: Phantom, scanner: Scanner, frame: MeshFrame) -> None:
    """Write the meshes as they are handed over, their labels, and what they look like."""
    (folder / "parts").mkdir()
    error = scanner.mesh_error(phantom.plan)
    meshes = [frame.applied(error.applied(part.mesh)) for part in phantom.parts]
    for part, mesh in zip(phantom.parts, meshes, strict=True):
        write_ply(folder / "parts" / f"{part.name}.ply", frame.in_units(mesh), frame.units)
    labels = [(part.name, part.label_material) for part in phantom.parts]
    write_table(folder / "parts.csv", ("name", "material"), labels)
    write_glb(folder / "appearance.glb", phantom.parts, meshes)


def _write_panels(out: Path, scanner: Scanner, seed: int, setting: str) -> None:
    """Write the flats and darks of a setting."""
    for view in dict.fromkeys(map(scanner.panel_of, VIEWS)):
        panel = scanner.calibration(seed, view)
        if panel is not None:
            write_image(out / panel_name("flat", view, setting), panel.flat)
            write_image(out / panel_name("dark", view, setting), panel.dark)


def _truth(
    phantom: Phantom, setting: str, scanner: Scanner, scatter_share: Mapping[str, float]
) -> dict[str, Any]:
    """Give what only the simulator knows; all but the mesh error is of the true meshes."""
    mass = phantom.mass_properties
    return {
        "schema": "xden-truth/1",
        "object_id": phantom.plan.object_id,
        "seed": phantom.plan.seed,
        "setting": setting,
        "energy_kev": scanner.reference_kev,
        "gain": {view: scanner.exposure(phantom.plan, view) for view in VIEWS},
        "scatter_share": scatter_share,
        "mesh_error": scanner.mesh_error(phantom.plan).as_dict(),
        "mass_g": mass.mass_g,
        "com_cm": mass.com_cm.tolist(),
        "inertia_g_cm2": mass.inertia_g_cm2.tolist(),
        "parts": [
            {
                "name": part.name,
                "role": part.role,
                "material": part.material,
                "label": part.label_material,
                "density_g_cm3": part.density_g_cm3,
                "solid_share": part.solid_share,
                "lac_per_cm": lac_per_cm,
                "volume_cm3": float(part.mesh.volume),
                "color_rgb": part.color_rgb,
                "metalness": part.metalness,
                "roughness": part.roughness,
                "painted": part.painted,
            }
            for part, lac_per_cm in zip(
                phantom.parts, scanner.lac_per_cm(phantom).tolist(), strict=True
            )
        ],
    }
