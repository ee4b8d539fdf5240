"""A folder of captures by the other simulator, with the truth beside each object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal

from xden1k.errors import DataError
from xden1k.values.ply import write_ply
from xden_builder.capture import write_scanner
from xden_builder.capture.writing import write_image, write_json, write_table
from xden_builder.phantoms.peer.matter import xraylib
from xden_builder.phantoms.peer.objects import PeerObject, make_object, plan_bench
from xden_builder.phantoms.peer.radiograph import Beam, expose, make_beam
from xden_builder.phantoms.peer.rays import gvxr
from xden_builder.phantoms.peer.setup import VIEWS, BenchSettings, Setup, draw_setup
from xden_builder.phantoms.phantom import Plan
from xden_builder.phantoms.writer import each_object

__all__ = ["Filter", "write_bench"]

Filter = Literal["told", "untold"]


def write_bench(
    out: Path,
    count: int,
    settings: BenchSettings,
    *,
    copper: Filter = "told",
    weighed: bool = False,
    workers: int = 1,
    progress: Callable[[str], None] = lambda _: None,
) -> None:
    """Simulate a capture folder: one scanner, drawn by the seed, and ``count`` objects.

    ``bench.json`` holds the scanner as it is, ``scanner.toml`` what the lab says of it. Objects and
    images do not depend on what is told. ``objects.csv`` comes last.

    Parameters
    ----------
    out
        A folder that is empty or does not exist.
    count, settings
        Which objects and which scanner.
    copper
        Whether the lab knows of the copper in its filter.
    weighed
        Whether objects were on a scale.
    workers
        Number of processes.
    progress
        Called with the id of each object that is done.

    Raises
    ------
    DataError
        If the folder is not empty.
    MissingExtraError
        If a simulator is not installed; nothing is written then.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise DataError(f"{out}: expected a folder that is empty or does not exist")
    setup = draw_setup(settings.seed, settings.size_px, settings.screen)
    _need_simulators(setup)
    out.mkdir(parents=True, exist_ok=True)
    plans = plan_bench(count, settings.seed)
    masses = list(each_object(partial(_write_object, out, settings), plans, workers, progress))
    write_scanner(setup.told(copper=copper == "told"), out / "scanner.toml")
    write_json(out / "bench.json", asdict(settings) | {"scanner": setup.to_dict()})
    header = ("object_id", "category", "source", "mass_g")
    rows = [
        (plan.object_id, plan.category.name, "phantom", f"{mass:.4g}" if weighed else "")
        for plan, mass in zip(plans, masses, strict=True)
    ]
    write_table(out / "objects.csv", header, rows)


def _need_simulators(setup: Setup) -> None:
    """Find out before anything is written that one is missing."""
    xraylib()
    gvxr()
    setup.tube.photons_per_cm2()


@cache
def _scanner(seed: int, size_px: int, screen: str) -> tuple[Setup, Beam]:
    setup = draw_setup(seed, size_px, screen)
    return setup, make_beam(setup)


def _write_object(out: Path, settings: BenchSettings, object_id: str) -> float:
    """Write the folder of one object; return its mass on the scale."""
    setup, beam = _scanner(settings.seed, settings.size_px, settings.screen)
    plan = Plan.of(settings.seed, object_id)
    thing = make_object(plan, unannotated_share=settings.unannotated_share)
    folder = out / object_id
    (folder / "parts").mkdir(parents=True)
    for part in thing.annotated:
        write_ply(folder / "parts" / f"{part.name}.ply", thing.handed_over(part))
    labels = [(part.name, part.label) for part in thing.annotated]
    write_table(folder / "parts.csv", ("name", "material"), labels)
    for view in VIEWS:
        image = expose(setup, beam, thing, view, settings.scatter)
        write_image(folder / f"{view}.tif", image)
    write_json(folder / "truth.json", _truth(thing))
    return thing.mass_properties.mass_g * (1 + thing.scale_error)


def _truth(thing: PeerObject) -> dict[str, Any]:
    """Give what only the simulator knows, in the form of the other simulator's ``truth.json``."""
    mass = thing.mass_properties
    return {
        "schema": "xden-truth/1",
        "object_id": thing.plan.object_id,
        "seed": thing.plan.seed,
        "mesh_error": {"matrix": thing.matrix.tolist()},
        "mass_g": mass.mass_g,
        "com_cm": mass.com_cm.tolist(),
        "left_out": thing.left_out,
        "parts": [
            {
                "name": part.name,
                "material": part.substance.name,
                "right_label": part.substance.label,
                "label": part.label,
                "density_g_cm3": part.density_g_cm3,
                "volume_cm3": float(part.mesh.volume),
            }
            for part in thing.parts
        ],
    }
