"""The shadow of an object in a radiograph."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float64
from scipy.ndimage import (
    binary_dilation,
    binary_erosion,
    find_objects,
    gaussian_filter,
    label,
)

from xden1k.errors import DataError
from xden1k.values.arrays import Image, Mask
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.capture.gaps import without_gaps
from xden_builder.capture.ignored import ignore_name

__all__ = ["Shadow", "shadow_of"]

RIM_PX: Final = 4
"""Along the image's edge: air, whose median is the open field."""
FAINTEST, OF_TYPICAL = (0.005, 0.02), 0.15
"""-ln T of a shadow, averaged over a pixel and its neighbours: least and most, and the share of
what is typical of the object, so that thin wood loses no rim."""
DARKEST, OF_DARKEST = 0.95, 0.02
"""Quantile of a shadow's opacity, and the least share of it that is no glow beside it."""
NOISE_SD: Final = 6.0
"""Standard deviations of the air's noise that a shadow is above."""
LEAST_SHARE: Final = 0.003
"""Of all shadow: a smaller piece of it is noise."""
LEAST_PX: Final = 20
CUT_SHARE: Final = 0.1
"""Of the shadow's longer side: a longer stretch on the image's edge is no noise."""
MASKED_SHARE: Final = 0.5
"""Of a shadow's outline, along what is masked: more is what a mask has left of a shadow."""
MASKED_TIMES: Final = 3.0
"""And so many times its pixels are masked."""
BESIDE_PX: Final = 3
"""Of what is masked: as near, an outline lies along it."""
OPAQUE: Final = 2e-3
"""Least transmission that is told from none."""
BRIGHT, DIM, MOST_DIM = 0.98, 0.5, 0.2
"""Quantile of an image that is bright, as what share of it a rim is no air, and how much of it may
be such."""


@dataclass(frozen=True, slots=True, eq=False)
class Shadow:
    """A radiograph as what the object takes from the light.

    Parameters
    ----------
    geometry
        Of the view.
    opacity
        Shape (rows, columns): 1 - T with the air at 0, and 0 outside the shadow.
    mask
        Shape (rows, columns): the shadow.
    box_px
        Shape (4,): first column, first row, last column, last row of its edges.
    turned
        Whether the object was turned by hand before this view, so that it lies elsewhere in it.
    """

    geometry: ViewGeometry
    opacity: Float64[np.ndarray, "rows columns"]
    mask: Mask
    box_px: Float64[np.ndarray, "4"]
    turned: bool = False

    @property
    def middle_px(self) -> Float64[np.ndarray, "2"]:
        """Column and row of the middle of its box."""
        return np.asarray((self.box_px[:2] + self.box_px[2:]) / 2)

    @property
    def size_px(self) -> Float64[np.ndarray, "2"]:
        """Columns and rows of its box."""
        return np.asarray(self.box_px[2:] - self.box_px[:2])

    @property
    def typical_depth(self) -> float:
        """-ln T of its middle pixel."""
        return self._middle_depth(0.0)

    @property
    def own_depth(self) -> float:
        """The same of pixels that are dark themselves; most of a wire's shadow lies beside it."""
        return self._middle_depth(OF_DARKEST)

    def _middle_depth(self, share: float) -> float:
        opacity = self.opacity[self.mask]
        dark = opacity[opacity >= share * np.quantile(opacity, DARKEST)]
        return max(float(-np.log1p(-np.median(dark))), FAINTEST[0])


def shadow_of(view: XRayView, saturated: Mask | None = None, *, turned: bool = False) -> Shadow:
    """Find the shadow.

    Dead pixels and lines are filled in; what else is not valid, such as a masked table, is air.

    Parameters
    ----------
    view
        The radiograph.
    saturated
        Which pixels are, if any: air, of which it is told how bright it is at least, and no more.
    turned
        As of :class:`Shadow`.

    Raises
    ------
    DataError
        If there is none, or the image's edge cuts it, or it lies along what is masked or dead.
    """
    image = without_gaps(view)
    depth = -np.log(image.clip(min=OPAQUE))
    rim = np.ones(depth.shape, dtype=np.bool_)
    rim[RIM_PX:-RIM_PX, RIM_PX:-RIM_PX] = False
    depth = np.nan_to_num(depth - np.nanmedian(depth[rim]) if view.valid[rim].any() else depth)
    if saturated is not None:
        depth[saturated] = 0.0
    smooth = gaussian_filter(depth, 1.0)
    mask = _large_pieces(smooth > _faintest(smooth, rim & view.valid))
    if mask.sum() < LEAST_PX:
        _refuse_dim_rim(view.name, image, rim)
        raise DataError(f"view {view.name}: no shadow of an object is in the image")
    rows, columns = find_objects(mask.astype(np.int8))[0]
    box = np.array([columns.start, rows.start, columns.stop, rows.stop]) - 0.5
    _refuse_cut(view.name, mask, box)
    _refuse_masked(view.name, mask, np.isnan(image))
    opacity = np.where(mask, 1 - np.exp(-depth), 0.0).clip(0, 1 - OPAQUE)
    return Shadow(view.geometry, opacity, mask, box, turned)


def _refuse_dim_rim(name: str, image: Image, rim: Mask) -> None:
    """Refuse an image whose rim, by which air is told, is far from as bright as what is within."""
    dim = float(np.mean(image[rim] < DIM * np.nanquantile(image, BRIGHT)))
    if dim > MOST_DIM:
        raise DataError(
            f"view {name}: {dim:.0%} of the image's rim lets less than {DIM:.0%} of the light of "
            "what is brightest through, and air was expected there: mask a collimator or a frame "
            f"({ignore_name(name)}), or move the object away from the rim"
        )


def _faintest(depth: Float64[np.ndarray, "rows columns"], air: Mask) -> float:
    """-ln T above which there is shadow."""
    least, most = FAINTEST
    typical = np.median(depth[depth > least]) if (depth > least).any() else most
    noise = 1.48 * np.median(np.abs(depth[air])) if air.any() else most
    return float(np.clip(OF_TYPICAL * typical, max(least, NOISE_SD * noise), most))


def _large_pieces(mask: Mask) -> Mask:
    pieces, count = label(mask)
    sizes = np.bincount(pieces.ravel(), minlength=count + 1)
    sizes[0] = 0
    return np.asarray((sizes > LEAST_SHARE * max(sizes.sum(), 1))[pieces])


def _refuse_masked(name: str, mask: Mask, masked: Mask) -> None:
    outline = mask & ~binary_erosion(mask)
    beside = binary_dilation(masked, iterations=BESIDE_PX)
    share = float((outline & beside).sum() / outline.sum())
    if share > MASKED_SHARE and masked.sum() > MASKED_TIMES * mask.sum():
        raise DataError(
            f"view {name}: {share:.0%} of the outline of what is left as a shadow lies along what "
            f"was not measured, expected at most {MASKED_SHARE:.0%}: does what ignore_{name}.png "
            "marks, or an area of dead pixels, cover the object?"
        )


def _refuse_cut(name: str, mask: Mask, box_px: Float64[np.ndarray, "4"]) -> None:
    edges = {"top": mask[0], "bottom": mask[-1], "left": mask[:, 0], "right": mask[:, -1]}
    longest = max(box_px[2:] - box_px[:2])
    for edge, pixels in edges.items():
        if pixels.sum() > CUT_SHARE * longest:
            raise DataError(
                f"view {name}: the {edge} edge of the image cuts the shadow over "
                f"{int(pixels.sum())} pixels; the whole object must be in the image, and a table "
                "or holder masked or annotated as a part"
            )
