"""One object of each category in every format: how far from the truth, and what others would say.

``PYTHONPATH=.:benchmarks:baselines:builder python -m tests.export.sweep`` prints the tables
of the manual.
"""

from __future__ import annotations

import dataclasses
import sys
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import trimesh
from tabulate import tabulate

from tests import phantoms
from tests.export.flight import fly
from xden1k.export import FORMATS, Deviation, exported
from xden1k.export.body import body_of
from xden1k.export.check import deviation
from xden1k.export.si import Inertial
from xden1k.format.records import object_row, row_object
from xden1k.rays import object_grids
from xden1k.values.mass import mass_of_meshes
from xden1k.values.types import DensityObject, Part
from xden_builder.phantoms.catalogue import CATALOGUE
from xden_builder.phantoms.phantom import make_phantom, plan_objects

SEED = 2026
FLIGHT_S = 0.25
WATER_KG_M3 = 1000.0


@dataclasses.dataclass(frozen=True)
class Tried:
    """What came of one object."""

    object_id: str
    formats: dict[str, Deviation]
    centre_m: float
    spin: float
    opened: list[str]
    hulls: Deviation
    uniform: Deviation
    water_hull: Deviation


def objects(seed: int = SEED) -> Iterator[DensityObject]:
    """One simulated object of each category, as the dataset stores it; nothing was X-rayed."""
    blank = tuple(phantoms.view(name, [], (8, 8), 10.0) for name in ("pa", "lat"))
    for plan in plan_objects(len(CATALOGUE), seed):
        phantom = make_phantom(plan)
        grids = object_grids([part.mesh for part in phantom.parts], range(len(phantom.parts)))
        parts = tuple(
            Part(part.name, part.mesh, part.material, 0.17 * part.density_g_cm3, part.density_g_cm3,
                 part.density_g_cm3, 0.0, "truth", (), part.color_rgb)
            for part in phantom.parts
        )  # fmt: skip
        density = grids.density([part.density_g_cm3 for part in parts])
        obj = DensityObject(
            object_id=plan.object_id,
            category=plan.category.name,
            split=plan.split,
            source="phantom",
            views=blank,
            parts=parts,
            labels=grids.labels,
            occupancy=grids.occupancy,
            envelope=grids.envelope,
            density=density,
            apparent_density=density,
            origin_cm=grids.field.origin_cm,
            voxel_size_cm=grids.field.voxel_size_cm,
        )
        yield row_object(object_row(obj))


def tried(obj: DensityObject, out: Path) -> Tried:
    """Export an object in all formats, let it fly, and weigh it as others do."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".* is written as it is, but some simulators")
        made = {name: exported(obj, name, out / name, check=True) for name in FORMATS}
        inertial = body_of(obj).inertial
    meshes = (made["mjcf"].path.parent / "meshes").iterdir()
    opened = [file.name for file in meshes if not trimesh.load_mesh(file).is_watertight]
    centre_m, spin = fly(made["mjcf"].path, inertial, FLIGHT_S)
    return Tried(
        obj.object_id,
        {name: one.deviation for name, one in made.items()},
        centre_m,
        spin,
        opened,
        *(deviation(other, inertial) for other in others(obj)),
    )


def others(obj: DensityObject) -> tuple[Inertial, Inertial, Inertial]:
    """Hulls of the parts with true densities; a uniform solid of true mass; one hull of water."""
    meshes = [part.mesh for part in obj.parts]
    densities = [part.density_g_cm3 for part in obj.parts]
    mean = obj.mass_g / sum(float(mesh.volume) for mesh in meshes)
    whole = trimesh.util.concatenate(meshes).convex_hull
    return (
        Inertial.of(mass_of_meshes([mesh.convex_hull for mesh in meshes], densities)),
        Inertial.of(mass_of_meshes(meshes, [mean] * len(meshes))),
        Inertial.of(mass_of_meshes([whole], [WATER_KG_M3 / 1000])),
    )


def tables(results: Sequence[Tried]) -> str:
    """Largest deviations of each format; median and largest of the wrong ways."""
    formats = [
        (name, *(f"{max(getattr(one.formats[name], key) for one in results):.1e}" for key in KEYS))
        for name in FORMATS
    ]
    ways = []
    for name in ("hulls", "uniform", "water_hull"):
        cells = []
        for key in KEYS:
            values = [getattr(getattr(one, name), key) for one in results]
            worst = results[int(np.argmax(values))].object_id
            cells.append(f"{np.median(values):.2g}, {max(values):.3g} ({worst})")
        ways.append((name, *cells))
    flight = [
        f"{key}: {max(getattr(one, key) for one in results):.1e}" for key in ("centre_m", "spin")
    ]
    parts = [
        tabulate(formats, ("format", *KEYS), "pipe"),
        tabulate(ways, ("way", *KEYS), "pipe"),
        "; ".join(flight),
    ]
    return "\n\n".join(parts)


KEYS = ("mass", "com", "inertia")


def sweep() -> Iterator[Tried]:
    """Try one object of each category."""
    for obj in objects():
        with tempfile.TemporaryDirectory() as out:
            yield tried(obj, Path(out))


if __name__ == "__main__":
    found = []
    for one in sweep():
        found.append(one)
        sys.stderr.write("".join(f"not closed: {name}\n" for name in one.opened))
        largest = max(deviation.largest for deviation in one.formats.values())
        sys.stderr.write(f"{one.object_id} {largest:.1e} {one.centre_m:.1e} {one.spin:.1e}\n")
    sys.stdout.write(tables(found) + "\n")
