"""A whole object, rebuilt our way and the paper's way."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from xden_builder.capture import CaptureFolder
from xden_builder.capture.space import divide
from xden_builder.evaluate.methods import errors_of_fit, paper, poly
from xden_builder.evaluate.truth import errors_of, read_truth
from xden_builder.phantoms import write_captures
from xden_builder.phantoms.scanner import Scanner
from xden_builder.poly.settings import PolySettings
from xden_builder.speed.timing import timed

__all__ = ["CATEGORY", "compared_ways"]

CATEGORY: Final = "flashlight"
SEED: Final = 1
Way = tuple[float, float]
"""Processor seconds, and mean absolute error of the density in g/cm³."""


def compared_ways(size: int, repeats: int) -> tuple[int, Way, Way]:
    """Rebuild a simulated flashlight, and give the number of its parts and both ways.

    Ours finds pose, materials, gains, stray light and densities; the paper's finds one attenuation
    coefficient for each part. Both start from the capture as read, and end with densities.

    Parameters
    ----------
    size
        Pixels along each side of both radiographs.
    repeats
        Of our own way; the other runs once.
    """
    with TemporaryDirectory(prefix="xden-speed-") as scratch:
        root = Path(scratch) / "captures"
        write_captures(root, 1, SEED, scanner=Scanner.realistic(size), categories=[CATEGORY])
        folder = CaptureFolder(root)
        (object_id,) = folder.object_ids
        capture = folder.read(object_id)
        truth = read_truth(root / object_id, capture.parts)
    space = divide(capture.parts)
    theirs_s, density = timed(lambda: paper(capture, space.order), 1)
    theirs = errors_of(density, space.regions, truth).density_mae_g_cm3
    poly(capture, space, [None], PolySettings())  # compiles
    ours_s, (fit,) = timed(lambda: poly(capture, space, [None], PolySettings()), repeats)
    ours = errors_of_fit(fit, space, truth).density_mae_g_cm3
    return len(capture.parts), (ours_s, ours), (theirs_s, theirs)
