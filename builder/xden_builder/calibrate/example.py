"""A calibration folder by our own simulator, to try the command on."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from xden1k.errors import DataError
from xden1k.values.materials import load_materials
from xden1k.values.views import ViewGeometry
from xden_builder.calibrate.designs import BALLS, PLATES, Stair
from xden_builder.calibrate.sheets import BALL_TABLE, write_ball_table
from xden_builder.calibrate.told import SCHEMA
from xden_builder.capture import write_scanner
from xden_builder.capture.writing import write_image, write_json
from xden_builder.phantoms.phantom import Phantom, PhantomPart, Plan, random_numbers
from xden_builder.phantoms.scanner import VIEWS, Scanner, panel_name, scanner_file

__all__ = ["QUARTER", "calibration_toml", "draw_scanner", "wedge_entries", "write_example"]

OFF_CM: Final = 0.1
"""How far sources and panels may be from where they are told."""
TOLD_KV: Final = 100.0
TOLD_AL_CM: Final = 0.25
DATE: Final = "2026-03-14"
PLACED_CM: Final = 0.02
PLACED_DEG: Final = 0.05
"""Standard deviations of where a pin holds the balls, along each axis and about it."""
ENERGY_GROUPS: Final = 96
"""Of the simulated beam: the 24 of other scans let 1 % less through 10 mm of steel than the whole
spectrum does, with 96 it is less than a tenth of that."""
QUARTER: Final = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""From how a plate stands for ``pa`` to how it stands for ``lat``."""


def draw_scanner(seed: int, size_px: int) -> Scanner:
    """Draw a scanner with every effect: 96 to 104 kV, 2.5 to 3.5 mm Al, up to 0.3 mm Cu."""
    rng = random_numbers(seed, "calibrate/tube")
    filters = {"Al": round(rng.uniform(0.25, 0.35), 3), "Cu": round(rng.uniform(0.0, 0.03), 4)}
    return replace(
        Scanner.realistic(size_px),
        kv=round(rng.uniform(96.0, 104.0), 1),
        filtration_cm=filters,
        energy_groups=ENERGY_GROUPS,
    )


def write_example(out: Path, seed: int, size_px: int) -> None:
    """Simulate scans of all phantoms on a scanner that is told a little wrong.

    ``truth.json`` holds the scanner as it is.

    Parameters
    ----------
    out
        A folder that does not exist.
    seed
        Of the scanner and the noise.
    size_px
        Pixels along each side of a panel.

    Raises
    ------
    DataError
        If the folder is there.
    """
    if out.exists():
        raise DataError(f"{out}: is there already; nothing is overwritten")
    scanner = draw_scanner(seed, size_px)
    out.mkdir(parents=True)
    _write_panels(out, scanner, seed)
    entries = [
        entry
        for name, stairs in PLATES.items()
        for view in VIEWS
        for entry in _write_plate(out, scanner, seed, name, stairs, view)
    ]
    for view in VIEWS:
        _write_image(out / "balls", scanner, _balls(seed), view)
    write_ball_table(out / BALL_TABLE)
    _write_told(out, scanner, seed)
    (out / "calibration.toml").write_text(calibration_toml(entries), encoding="utf-8")
    write_json(out / "truth.json", _truth(scanner, seed))


def _truth(scanner: Scanner, seed: int) -> dict[str, Any]:
    """Give the tube, the views in the object frame, and where the balls stand in it."""
    return {
        "kv": scanner.kv,
        "filtration_cm": dict(scanner.filtration_cm),
        "views": {view: scanner.geometry(view).to_dict() for view in VIEWS},
        "balls_matrix": _balls_matrix(seed).tolist(),
    }


def wedge_entries(
    scan: str, stairs: Sequence[Stair], view: str, geometry: ViewGeometry
) -> Iterator[dict[str, Any]]:
    """Give the entries of ``calibration.toml`` that a person reads off an image."""
    for stair in stairs:
        centres = stair.centres_cm if view == "pa" else stair.centres_cm @ QUARTER.T
        places = np.round(geometry.project(centres)[:, [1, 0]]).tolist()
        yield {
            "scan": scan,
            "view": view,
            "material": stair.material,
            "thickness_cm": list(stair.thickness_cm),
            "first_px": places[0],
            "last_px": places[-1],
            "step_cm": stair.height_cm,
            "width_cm": stair.width_cm,
        }


def _write_panels(out: Path, scanner: Scanner, seed: int) -> None:
    for view in VIEWS:
        taken = scanner.calibration(seed, view)
        assert taken is not None  # the realistic scanner counts
        write_image(out / panel_name("flat", view), taken.flat)
        write_image(out / panel_name("dark", view), taken.dark)


def _write_plate(
    out: Path, scanner: Scanner, seed: int, name: str, stairs: Sequence[Stair], view: str
) -> Iterator[dict[str, Any]]:
    matrix = np.eye(4)
    matrix[:3, :3] = np.eye(3) if view == "pa" else QUARTER
    parts = [_part(stair.name, stair.mesh, stair.material, matrix) for stair in stairs]
    _write_image(out / name, scanner, _phantom(seed, list(PLATES).index(name), parts), view)
    return wedge_entries(name, stairs, view, scanner.geometry(view))


def _balls(seed: int) -> Phantom:
    meshes = (("balls", BALLS.balls_mesh, "steel"), ("tube", BALLS.tube_mesh, "pmma"))
    matrix = _balls_matrix(seed)
    return _phantom(seed, len(PLATES), [_part(*each, matrix) for each in meshes])


def _balls_matrix(seed: int) -> Float[np.ndarray, "4 4"]:
    """Draw where the ball phantom stands."""
    rng = random_numbers(seed, "calibrate/pin")
    turn_deg, shift_cm = rng.normal(size=(2, 3)) * np.array([[PLACED_DEG], [PLACED_CM]])
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(turn_deg, degrees=True).as_matrix()
    matrix[:3, 3] = shift_cm
    return matrix


def _part(
    name: str, mesh: trimesh.Trimesh, material: str, matrix: Float[np.ndarray, "4 4"]
) -> PhantomPart:
    density, there = load_materials()[material].density_nominal_g_cm3, mesh.copy()
    there.apply_transform(matrix)
    return PhantomPart(name, name, there, material, density, (0.5, 0.5, 0.5))


def _phantom(seed: int, ordinal: int, parts: Sequence[PhantomPart]) -> Phantom:
    """Put parts together; the plan only keeps the random numbers of scans apart."""
    return Phantom(Plan(seed, 0, ordinal), tuple(parts))


def _write_image(folder: Path, scanner: Scanner, phantom: Phantom, view: str) -> None:
    folder.mkdir(exist_ok=True)
    write_image(folder / f"{view}.tif", scanner.radiograph(phantom, view))


def _write_told(out: Path, scanner: Scanner, seed: int) -> None:
    """Tell voltage, filters and places as a console and a ruler do."""
    rng = random_numbers(seed, "calibrate/told")
    said = replace(scanner, kv=TOLD_KV, filtration_cm={"Al": TOLD_AL_CM})
    file = scanner_file(said)
    views = {
        name: replace(view, geometry=_told_geometry(view.geometry, rng))
        for name, view in file.views.items()
    }
    write_scanner(replace(file, views=views), out / "scanner.toml")


def _told_geometry(geometry: ViewGeometry, rng: np.random.Generator) -> ViewGeometry:
    source, panel = OFF_CM * rng.uniform(-1.0, 1.0, (2, 3)) / np.sqrt(3)
    assert geometry.source_cm is not None
    return replace(
        geometry, source_cm=geometry.source_cm + source, pixel00_cm=geometry.pixel00_cm + panel
    )


def calibration_toml(entries: Sequence[Mapping[str, Any]]) -> str:
    """Write ``calibration.toml`` with these wedges and the designed balls."""
    blocks = [f'schema = "{SCHEMA}"\ndate = {DATE}\ntube = "simulated"\n']
    for entry in entries:
        lines = [f"{key} = {json.dumps(value)}" for key, value in entry.items()]
        blocks.append("\n".join(["[[wedges]]", *lines, ""]))
    blocks.append(
        f'[balls]\nscan = "balls"\ntable = "{BALL_TABLE}"\ndiameter_cm = {BALLS.ball_cm:g}\n'
        f"placed_within_cm = {PLACED_CM}\nplaced_within_deg = {PLACED_DEG}\n"
    )
    return "\n".join(blocks)
