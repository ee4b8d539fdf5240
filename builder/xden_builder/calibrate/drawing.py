"""The phantoms to be made: meshes, a sheet of steps and balls, and a drawing with dimensions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import trimesh
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from xden1k.errors import DataError
from xden_builder.calibrate.designs import BALLS, PLATES, RIM_CM, Stair
from xden_builder.calibrate.sheets import (
    BALL_TABLE,
    STEP_TABLE,
    steps_of,
    write_ball_table,
    write_step_table,
)

__all__ = ["write_designs"]

MM: Final = 10.0
"""In a centimetre: workshops and printers take millimetres."""


def write_designs(out: Path) -> tuple[Path, ...]:
    """Write STL meshes in millimetres, ``steps.csv``, ``balls.csv``, and an SVG drawing of each.

    Parameters
    ----------
    out
        A folder that does not exist.

    Returns
    -------
    tuple of Path
        What was written.

    Raises
    ------
    DataError
        If the folder is there.
    """
    if out.exists():
        raise DataError(f"{out}: is there already; nothing is overwritten")
    out.mkdir(parents=True)
    for plate, stairs in PLATES.items():
        for stair in stairs:
            _write_stl(stair.mesh, out / f"{plate}_{stair.name}.stl")
        _draw_plate(plate, stairs, out / f"{plate}.svg")
    _write_stl(BALLS.tube_mesh, out / "balls_tube.stl")
    _draw_balls(out / "balls.svg")
    write_step_table(out / STEP_TABLE)
    write_ball_table(out / BALL_TABLE)
    return tuple(sorted(out.iterdir()))


def _write_stl(mesh: trimesh.Trimesh, path: Path) -> None:
    """Write a mesh in millimetres."""
    trimesh.Trimesh(MM * mesh.vertices, mesh.faces, process=False).export(path)


def _draw_plate(name: str, stairs: Sequence[Stair], path: Path) -> None:
    """Draw a plate as the beam sees it, the thickness of each step written on it."""
    figure, axis = _sheet(f"plate {name}: as the source sees it; thickness and sizes in mm")
    for stair in stairs:
        for thickness, x, z, height, width in steps_of(stair):
            corner = MM * (x - width / 2), MM * (z - height / 2)
            axis.add_patch(Rectangle(corner, MM * width, MM * height, fill=False))
            axis.annotate(f"{MM * thickness:g}", (MM * x, MM * z), ha="center", va="center")
        top = MM * (stair.top_z_cm + stair.height_cm / 2 + 0.3)
        size = f"{stair.material}\n{MM * stair.width_cm:g} x {MM * stair.height_cm:g}"
        axis.annotate(size, (MM * stair.x_cm, top), ha="center", fontsize=7)
    axis.set(xlim=(-62, 62), ylim=(-105, 120))
    figure.savefig(path, metadata={"Date": None})


def _draw_balls(path: Path) -> None:
    """Draw the tube from the side, its balls numbered from the top."""
    figure, axis = _sheet(
        f"balls: {BALLS.count} of {MM * BALLS.ball_cm:g} mm, centres on a circle of "
        f"{2 * MM * BALLS.radius_cm:g} mm; wall {MM * BALLS.wall_cm:g} mm; sizes in mm"
    )
    outer, half = (
        MM * (BALLS.radius_cm + BALLS.wall_cm / 2),
        MM * (BALLS.centres_cm[0, 2] + RIM_CM),
    )
    axis.add_patch(Rectangle((-outer, -half), 2 * outer, 2 * half, fill=False))
    for number, (x, y, z) in enumerate((MM * BALLS.centres_cm).tolist(), start=1):
        axis.add_patch(Circle((x, z), MM * BALLS.ball_cm / 2, fill=y < 0))
        side, inward = ("right", -1) if x > 0 else ("left", 1)
        words = f"{number}: {x:.1f}, {y:.1f}, {z:.1f}"
        axis.annotate(words, (x + 5 * inward, z), ha=side, va="center", fontsize=5)
    axis.set(xlim=(-outer - 10, outer + 10), ylim=(-half - 10, half + 10))
    figure.savefig(path, metadata={"Date": None})


def _sheet(title: str) -> tuple[Figure, Any]:
    figure = Figure(figsize=(7.0, 10.0), layout="constrained")
    axis = figure.subplots()
    axis.set_aspect("equal")
    axis.set(xlabel="x, mm", ylabel="z, mm")
    axis.set_title(title, fontsize=8)
    return figure, axis
