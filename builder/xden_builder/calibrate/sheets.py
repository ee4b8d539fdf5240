"""The phantoms as tables: places of balls, sizes of steps."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from xden_builder.calibrate.designs import BALLS, PLATES, Stair
from xden_builder.capture.writing import write_table

__all__ = ["BALL_TABLE", "STEP_TABLE", "steps_of", "write_ball_table", "write_step_table"]

BALL_TABLE: Final = "balls.csv"
STEP_TABLE: Final = "steps.csv"


def write_ball_table(path: Path) -> None:
    """Write the centres of the balls, as ``calibration.toml`` wants them."""
    rows = [
        (str(number), *(f"{value:.4f}" for value in centre))
        for number, centre in enumerate(BALLS.centres_cm.tolist(), start=1)
    ]
    write_table(path, ("ball", "x_cm", "y_cm", "z_cm"), rows)


def write_step_table(path: Path) -> None:
    """Write thickness, place and size of each step of all plates."""
    rows = [
        (plate, stair.name, stair.material, str(number), *(f"{value:.4g}" for value in values))
        for plate, stairs in PLATES.items()
        for stair in stairs
        for number, values in enumerate(steps_of(stair), start=1)
    ]
    sizes = ("thickness_cm", "x_cm", "z_cm", "height_cm", "width_cm")
    write_table(path, ("plate", "stair", "material", "step", *sizes), rows)


def steps_of(stair: Stair) -> list[tuple[float, ...]]:
    """List thickness, x, z, height and width of each step."""
    return [
        (thickness, x, z, stair.height_cm, stair.width_cm)
        for thickness, (x, _, z) in zip(stair.thickness_cm, stair.centres_cm, strict=True)
    ]
