"""A whole object, rebuilt our way and the paper's way."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from xden1k.rays import disjoint_regions, ownership_order
from xden_builder.capture import Capture, CaptureFolder
from xden_builder.evaluate.methods import paper, poly
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
    meshes = [part.mesh for part in capture.parts]
    order = ownership_order(meshes, [part.priority for part in capture.parts])
    regions = disjoint_regions(meshes, order)

    def ours(capture: Capture) -> np.ndarray:
        (fit,) = poly(capture, order, regions, [None], PolySettings())
        return fit.solution.density_g_cm3

    def way(work: Callable[[], np.ndarray], repeats: int) -> Way:
        seconds, density = timed(work, repeats)
        return seconds, errors_of(density, regions, truth).density_mae_g_cm3

    ours(capture)  # compiles
    return len(meshes), way(lambda: ours(capture), repeats), way(lambda: paper(capture, order), 1)
