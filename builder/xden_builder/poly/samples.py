"""Stage 4 of the fit: path lengths in the refined pose, and the samples that are compared.

Comes from :mod:`pose`, leads to :mod:`estimate`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float64

from xden1k.rays import PathLengths, path_lengths
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.poly.model.beam import ViewBeam
from xden_builder.poly.model.frames import coarse
from xden_builder.poly.model.pixels import BLOCK_PX, BLOCK_RAYS, ViewPixels, choose_pixels
from xden_builder.poly.model.radiograph import gain_prior
from xden_builder.poly.model.size import Size
from xden_builder.poly.model.stray import coarse_binning, glare_of, middle_of, scatter_reaches_cm
from xden_builder.poly.pose import Placement, PoseFit
from xden_builder.poly.settings import PolySettings
from xden_builder.poly.start import Guess

__all__ = ["Samples", "Seen", "take_samples"]

BLOCKS_AT_ONCE: Final = 1 << 15
"""Of which all crossings are held: about those of a radiograph of 512² pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """One view, its meshes in their refined pose.

    Parameters
    ----------
    view, beam
        The radiograph, and what reaches its panel.
    geometry
        In the frame of the meshes, after the pose.
    lengths
        Of one ray a pixel.
    blocks
        Of the blocks that outlines are compared in; ``lengths`` where they are not.
    smooth, glare
        Of the coarse panel, for stray light; and the view's light as it spreads there.
    reaches_cm
        Assumed standard deviations of near and far scatter on the panel.
    samples
        What is compared.
    noise_sd
        Behind something opaque.
    gain
        Mean and standard deviation of the gain, before the fit.
    """

    view: XRayView
    beam: ViewBeam
    geometry: ViewGeometry
    lengths: PathLengths
    blocks: PathLengths
    smooth: PathLengths
    glare: Float64[np.ndarray, "coarse_rows coarse_columns"]
    reaches_cm: tuple[float, float]
    samples: ViewPixels
    noise_sd: float
    gain: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Everything that densities are estimated from.

    Parameters
    ----------
    guess
        To start from.
    pose
        None where it was not sought.
    size
        Of the object, beside its meshes; the scene's have it.
    seen
        The fitted views.
    """

    guess: Guess
    pose: PoseFit | None
    size: Size
    seen: tuple[Seen, ...]


def take_samples(placement: Placement, settings: PolySettings) -> Samples:
    """Render path lengths where the object stands, and choose samples of them."""
    scene = placement.guess.scene
    whole = scene.space.meshes, scene.space.order
    middle_cm = middle_of(whole[0])
    rng = np.random.default_rng(0)
    seen = []
    for view, saturated, beam, geometry, noise_sd, bounds in zip(
        scene.views,
        scene.saturated,
        scene.light.beams,
        placement.geometries,
        scene.noise_sd,
        scene.gains,
        strict=True,
    ):
        lengths = path_lengths(*whole, geometry)
        blocks = lengths
        if settings.blocks and min(geometry.shape) > BLOCK_PX:
            blocks = _of_blocks(*whole, coarse(geometry, BLOCK_PX))
        smooth = path_lengths(*whole, coarse(geometry, coarse_binning(geometry.shape)))
        samples = choose_pixels(view, saturated, lengths, blocks, beam, rng)
        seen.append(
            Seen(
                view,
                beam,
                geometry,
                lengths,
                blocks,
                smooth,
                glare_of(view, smooth.shape),
                scatter_reaches_cm(geometry, middle_cm),
                samples,
                noise_sd,
                gain_prior(bounds),
            )
        )
    return Samples(placement.guess, placement.fit, placement.size, tuple(seen))


def _of_blocks(
    meshes: Sequence[trimesh.Trimesh], order: Sequence[int], geometry: ViewGeometry
) -> PathLengths:
    """Path lengths of blocks, some rows of them at a time: a turned lattice holds all crossings."""
    rows, columns = geometry.shape
    height = max(BLOCKS_AT_ONCE // columns, 1)
    strips = []
    for first in range(0, rows, height):
        strip = replace(
            geometry,
            pixel00_cm=geometry.pixel00_cm + first * geometry.row_step_cm,
            shape=(min(height, rows - first), columns),
        )
        lengths = path_lengths(meshes, order, strip, BLOCK_RAYS, turned=True)
        strips.append(replace(lengths, pixels=lengths.pixels + first * columns))
    return PathLengths(
        np.concatenate([each.pixels for each in strips]),
        np.concatenate([each.lengths_cm for each in strips]),
        np.concatenate([each.shared_cm for each in strips]),
        np.concatenate([each.broken for each in strips]),
        geometry.shape,
    )
