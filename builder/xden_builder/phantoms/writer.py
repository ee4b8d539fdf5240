"""Phantoms as a capture folder, as a scanner and its operator would leave it."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import trimesh

from xden1k.errors import DataError, require
from xden_builder.capture import write_scanner
from xden_builder.phantoms.phantom import Phantom, Plan, make_phantom, plan_objects
from xden_builder.phantoms.realism import TIDY, Realism
from xden_builder.phantoms.scanner import VIEWS, Scanner
from xden_builder.workers import run_each

__all__ = ["each_object", "make_scanner", "simulation", "write_captures"]

Result = TypeVar("Result")
Progress = Callable[[str], None]


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
    workers: int = 1,
    progress: Progress = lambda _: None,
    categories: Sequence[str] = (),
) -> None:
    """Simulate a capture folder, with a ``truth.json`` in each object's folder.

    ``objects.csv`` comes last: without it there is no capture folder. The same arguments give the
    same bytes, whatever the number of processes.

    Parameters
    ----------
    out
        A folder that is empty or does not exist.
    count, seed, categories
        Which objects; see :func:`plan_objects`.
    size, ideal, scanner
        See :func:`make_scanner`.
    realism
        How often there are pores, paint and labels that err.
    workers
        Number of processes.
    progress
        Called with the id of each object that is done.

    Raises
    ------
    DataError
        If the folder is not empty, or an argument is out of range.
    """
    plans = plan_objects(count, seed, categories)
    scanner = make_scanner(size, ideal, scanner)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise DataError(f"{out}: expected a folder that is empty or does not exist")
    out.mkdir(parents=True, exist_ok=True)
    task = partial(_write_object, out, scanner, realism, seed)
    for _ in each_object(task, plans, workers, progress):
        pass
    _write_panels(out, scanner, seed)
    _write_json(out / "simulation.json", simulation(seed, scanner, realism))
    _write_csv(
        out / "objects.csv",
        ("object_id", "category", "split", "source"),
        [(plan.object_id, plan.category.name, plan.split, "phantom") for plan in plans],
    )


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


def simulation(seed: int, scanner: Scanner, realism: Realism) -> dict[str, Any]:
    """Give every setting of a simulation, of JSON's types."""
    return {"seed": seed, "scanner": scanner.settings(), "realism": asdict(realism)}


def _write_object(out: Path, scanner: Scanner, realism: Realism, seed: int, object_id: str) -> None:
    """Write the folder of one object."""
    tifffile = require("tifffile", "build")
    phantom = make_phantom(Plan.of(seed, object_id), realism)
    folder = out / object_id
    (folder / "parts").mkdir(parents=True)
    error = scanner.mesh_error(phantom.plan)
    for part in phantom.parts:
        _write_ply(folder / "parts" / f"{part.name}.ply", error.applied(part.mesh))
    labels = [(part.name, part.label_material) for part in phantom.parts]
    _write_csv(folder / "parts.csv", ("name", "material"), labels)
    shares = {}
    for view in VIEWS:
        signal = scanner.signal(phantom, view)
        image = scanner.radiograph(phantom, view, signal)
        tifffile.imwrite(folder / f"{view}.tif", image, compression="zlib", metadata=None)
        shares[view] = signal.scatter_share
    _write_json(folder / "truth.json", _truth(phantom, scanner, shares))


def _write_ply(path: Path, mesh: trimesh.Trimesh) -> None:
    """Write a mesh in double precision, which trimesh's own writer would round to single.

    Rounding each part by itself makes facets that should coincide cross each other.
    """
    faces = np.empty(len(mesh.faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment cm\n"
        f"element vertex {len(mesh.vertices)}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(header.encode() + mesh.vertices.astype("<f8").tobytes() + faces.tobytes())


def _write_panels(out: Path, scanner: Scanner, seed: int) -> None:
    """Write what all objects share: the scanner file, flats and darks."""
    tifffile = require("tifffile", "build")
    write_scanner(scanner.file(), out / "scanner.toml")
    for view in VIEWS:
        panel = scanner.calibration(seed, view)
        if panel is not None:
            for name, image in (("flat", panel.flat), ("dark", panel.dark)):
                tifffile.imwrite(
                    out / f"{name}_{view}.tif", image, compression="zlib", metadata=None
                )


def _truth(
    phantom: Phantom, scanner: Scanner, scatter_share: Mapping[str, float]
) -> dict[str, Any]:
    """Give what only the simulator knows; all but the mesh error is of the true meshes."""
    mass = phantom.mass_properties
    return {
        "schema": "xden-truth/1",
        "object_id": phantom.plan.object_id,
        "seed": phantom.plan.seed,
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
                "lac_per_cm": scanner.lac_per_cm(part),
                "volume_cm3": float(part.mesh.volume),
                "color_rgb": part.color_rgb,
                "metalness": part.metalness,
                "roughness": part.roughness,
                "painted": part.painted,
            }
            for part in phantom.parts
        ],
    }


def _write_json(path: Path, values: dict[str, Any]) -> None:
    path.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")


def _write_csv(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([header, *rows])
