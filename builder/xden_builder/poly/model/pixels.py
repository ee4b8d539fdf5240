"""Which pixels of a radiograph are compared: inner ones by themselves, outlines in blocks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from scipy.ndimage import distance_transform_edt

from xden1k.rays import PathLengths
from xden1k.rays.lattice import Lattice
from xden1k.values.arrays import Mask
from xden1k.values.views import XRayView
from xden_builder.fit.crops import Crop
from xden_builder.fit.outline import on_outline
from xden_builder.poly.model import kernels
from xden_builder.poly.model.beam import ViewBeam
from xden_builder.poly.model.frames import any_of, binned

__all__ = [
    "BLOCK_PX",
    "BLOCK_RAYS",
    "ViewPixels",
    "block_width",
    "choose_pixels",
    "hardening_per_mm_cu",
]

BLOCK_PX: Final = 3
"""A block is so many pixels wide: a surface that is off by a fraction of one moves little of it."""
BLOCK_RAYS: Final = 2 * BLOCK_PX
PIXELS_A_PART: Final = 250
MOST_BLOCKS: Final = 150
LEAST_BLOCKS: Final = 50
"""Compared for each part in each view; most pixels serve several parts."""
SATURATED: Final = 50
"""Samples known from below alone, of each kind and part in each view."""
UNEVEN: Final = 0.1
"""Of a length: rays of a pixel that meet so much more or less of a part in the mean are not for its
centre's ray to stand for."""
AIR_PIXELS: Final = 300
COPPER: Final = (("Cu", 1.0),)
COPPER_G_CM3: Final = 8.96
AIR_CM: Final = (0.4, 5.0)
"""Air between these distances from the object tells gain and scatter."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewPixels:
    """Chosen samples of one view: pixels, blocks of pixels, and air.

    Parameters
    ----------
    pixels
        Shape (n,): flat index of the pixel, or of the one in the middle of the block.
    index
        Shape (n,): flat index into the image of pixels, or into that of blocks.
    is_block
        Shape (n,).
    lengths_cm
        Shape (n, s, K): of up to s rays.
    rays
        Shape (n,): how many of them are averaged.
    weights
        Shape (n, groups): of the open field.
    measured
        Shape (n,): transmission.
    at_least
        Shape (n,): whether that is known from below alone, for saturation.
    """

    pixels: Int64[np.ndarray, "n"]
    index: Int64[np.ndarray, "n"]
    is_block: Bool[np.ndarray, "n"]
    lengths_cm: Float32[np.ndarray, "n s k"]
    rays: Int64[np.ndarray, "n"]
    weights: Float64[np.ndarray, "n groups"]
    measured: Float64[np.ndarray, "n"]
    at_least: Bool[np.ndarray, "n"]

    @property
    def meets(self) -> Bool[np.ndarray, "n k"]:
        """Whether any ray of a sample meets a part."""
        return np.asarray(self.lengths_cm.any(axis=1))

    def predict(
        self, mac_cm2_g: Float64[np.ndarray, "k groups"], density_g_cm3: Float64[np.ndarray, "k"]
    ) -> tuple[Float64[np.ndarray, "n"], Float64[np.ndarray, "n k"]]:
        """Transmission of the direct beam, and its derivatives by the densities."""
        slopes = np.empty((len(self.pixels), len(density_g_cm3)))
        transmission = np.empty(len(self.pixels))
        kernels.predict(
            self.lengths_cm,
            self.rays,
            mac_cm2_g,
            density_g_cm3,
            self.weights,
            transmission,
            slopes,
        )
        return transmission, slopes


def hardening_per_mm_cu(samples: ViewPixels, beam: ViewBeam) -> Float64[np.ndarray, "n groups"]:
    """Change of the open field's weights by a filter of copper, which keep adding up to 1."""
    per_mm = beam.groups.mac_cm2_g(COPPER) * COPPER_G_CM3 / 10
    mean = samples.weights @ per_mm
    return np.asarray(samples.weights * (mean[:, None] - per_mm))


class _Samples(NamedTuple):
    """Some samples of one kind."""

    pixels: Int64[np.ndarray, "n"]
    places: Int64[np.ndarray, "n"]
    lengths_cm: Float32[np.ndarray, "n s k"]
    measured: Float64[np.ndarray, "n"]
    at_least: Bool[np.ndarray, "n"]


def block_width(lengths: PathLengths, blocks: PathLengths) -> int:
    """Pixels along a side of what outlines are compared in: 1 where that is pixels, too.

    Rows of the images do not tell it: those that fill no block are left over.
    """
    return 1 if blocks is lengths else BLOCK_PX


def choose_pixels(
    view: XRayView,
    saturated: Mask,
    lengths: PathLengths,
    blocks: PathLengths,
    beam: ViewBeam,
    rng: np.random.Generator,
) -> ViewPixels:
    """Choose samples of every part, inner pixels first, and of the air around the object.

    What holds saturated pixels comes last, and a little of it: it tells from below alone.

    Parameters
    ----------
    view
        The radiograph; a saturated pixel has the least transmission it can have.
    saturated
        Shape (rows, columns): those pixels.
    lengths
        Of one ray a pixel.
    blocks
        Of :data:`BLOCK_RAYS` rays along each side of a block, on the lattice that is turned against
        the raster, or of the same pixels as ``lengths`` if outlines are compared pixel by pixel.
    beam
        Of the panel.
    rng
        Chooses.
    """
    width = block_width(lengths, blocks)
    outline = on_outline(lengths) | _uneven(lengths, blocks, width)
    usable = view.valid.ravel()[lengths.pixels] & ~lengths.broken & ~outline
    full = saturated.ravel()[lengths.pixels]
    met = lengths.lengths_cm[:, 0] > 0
    parts = met.shape[1]
    inner = _some_of_each(rng, met & (usable & ~full)[:, None], np.full(parts, PIXELS_A_PART))
    found = met[inner].sum(axis=0)
    image, _ = binned(view, width)
    whole = _whole(view.valid, width).ravel()[blocks.pixels] & ~blocks.broken
    partly_full = any_of(saturated, width).ravel()[blocks.pixels]
    wanted = (PIXELS_A_PART - found).clip(LEAST_BLOCKS, MOST_BLOCKS)
    met_by_blocks = blocks.lengths_cm.any(axis=1)
    outer = _some_of_each(rng, met_by_blocks & (whole & ~partly_full)[:, None], wanted)
    air = _air(view, lengths, rng)
    few = np.full(parts, SATURATED)
    inner = np.append(inner, _some_of_each(rng, met & (usable & full)[:, None], few))
    outer = np.append(
        outer, _some_of_each(rng, met_by_blocks & (whole & partly_full)[:, None], few)
    )
    transmission = view.transmission.ravel().astype(np.float64)
    kinds = (
        _Samples(
            lengths.pixels[inner],
            lengths.pixels[inner],
            lengths.lengths_cm[inner],
            transmission[lengths.pixels[inner]],
            full[inner],
        ),
        _Samples(
            _middles(blocks.pixels[outer], blocks.shape[1], width, view.transmission.shape[1]),
            blocks.pixels[outer],
            blocks.lengths_cm[outer],
            image.ravel()[blocks.pixels[outer]].astype(np.float64),
            partly_full[outer],
        ),
        _Samples(
            air,
            air,
            np.zeros((len(air), 1, parts), dtype=np.float32),
            transmission[air],
            saturated.ravel()[air],
        ),
    )
    return _gathered(kinds, beam)


def _uneven(lengths: PathLengths, blocks: PathLengths, width: int) -> Bool[np.ndarray, "n"]:
    """Whether a pixel's centre does not stand for it, shape (n,).

    Of some part its rays meet more or less in the mean. Neighbours do not tell: those of a coil may
    all meet the middle of its wire. Lengths that grow steadily across a pixel have nearly the
    centre's as their mean: its rays lie about a tenth of a pixel beside it. Pixels beyond the last
    whole block have their centres alone.
    """
    centre = lengths.lengths_cm[:, 0]
    if width == 1 or not len(blocks.pixels):
        return np.zeros(len(centre), dtype=np.bool_)
    row, column = (width * (Lattice.of(BLOCK_RAYS, turned=True).offsets_px.T + 0.5)).astype(int)
    owners = width * row + column
    means = np.stack(
        [blocks.lengths_cm[:, owners == pixel].mean(axis=1) for pixel in range(width**2)], axis=1
    )
    rows, columns = np.divmod(lengths.pixels, lengths.shape[1])
    places = np.full([-(-size // width) for size in lengths.shape], -1)
    places[np.divmod(blocks.pixels, blocks.shape[1])] = np.arange(len(blocks.pixels))
    place = places[rows // width, columns // width]
    mean = means[place, width * (rows % width) + columns % width]
    off = (np.abs(mean - centre) > UNEVEN * centre).any(axis=1)
    return np.asarray(off & (place >= 0))


def _gathered(kinds: tuple[_Samples, _Samples, _Samples], beam: ViewBeam) -> ViewPixels:
    """Put pixels, blocks and air into one table."""
    most = max(each.lengths_cm.shape[1] for each in kinds)
    padded = [
        np.pad(each.lengths_cm, ((0, 0), (0, most - each.lengths_cm.shape[1]), (0, 0)))
        for each in kinds
    ]
    counts = [len(each.pixels) for each in kinds]
    pixels = np.concatenate([each.pixels for each in kinds])
    return ViewPixels(
        pixels=pixels,
        index=np.concatenate([each.places for each in kinds]),
        is_block=np.repeat([False, True, False], counts),
        lengths_cm=np.ascontiguousarray(np.concatenate(padded)),
        rays=np.repeat([each.lengths_cm.shape[1] for each in kinds], counts),
        weights=beam.weights(pixels),
        measured=np.concatenate([each.measured for each in kinds]),
        at_least=np.concatenate([each.at_least for each in kinds]),
    )


def _some_of_each(
    rng: np.random.Generator, met: Bool[np.ndarray, "n k"], wanted: Int64[np.ndarray, "k"]
) -> Int64[np.ndarray, "m"]:
    """Rows, ascending, that hold at most so many of each column's."""
    order = rng.permutation(np.flatnonzero(met.any(axis=1)))
    chosen = [order[met[order, part]][:count] for part, count in enumerate(wanted.tolist())]
    return np.unique(np.concatenate(chosen))


def _whole(
    valid: Bool[np.ndarray, "rows columns"], width: int
) -> Bool[np.ndarray, "block_rows block_columns"]:
    """Blocks whose pixels are all valid: the model averages over all of them."""
    rows, columns = (size // width for size in valid.shape)
    cut = valid[: rows * width, : columns * width]
    return np.asarray(cut.reshape(rows, width, columns, width).all(axis=(1, 3)))


def _middles(
    index: Int64[np.ndarray, "n"], columns: int, width: int, columns_of_view: int
) -> Int64[np.ndarray, "n"]:
    """Flat indices of the pixels in the middle of blocks."""
    rows, columns_ = (width * place + (width - 1) // 2 for place in np.divmod(index, columns))
    return np.asarray(rows * columns_of_view + columns_)


def _air(view: XRayView, lengths: PathLengths, rng: np.random.Generator) -> Int64[np.ndarray, "m"]:
    """Choose valid pixels in a ring around the object; none where no ray meets it."""
    if not len(lengths.pixels):
        return np.zeros(0, dtype=np.int64)
    step = float(np.linalg.norm(view.geometry.column_step_cm))
    near, far = (distance / step for distance in AIR_CM)
    crop = Crop.around(lengths.pixels, lengths.shape, margin_px=int(np.ceil(far)))
    empty = crop.image(np.zeros(len(lengths.pixels), dtype=bool), background=True)
    distance = distance_transform_edt(empty)
    ring = (distance >= near) & (distance <= far) & view.valid[crop.box]
    rows, columns = (
        place + part.start for place, part in zip(np.nonzero(ring), crop.box, strict=True)
    )
    flat = rng.permutation(rows * lengths.shape[1] + columns)
    return np.sort(flat[:AIR_PIXELS])
