"""Images compared by how they change from pixel to pixel, where a part may have no mesh.

In logarithms what has no mesh adds to what the meshes take (Beer-Lambert), smoothly but at its own
edges: the wall of a vessel around its content, a head on its wedge. So neighbouring pixels differ
by the meshes alone nearly everywhere, and a loss that large residuals do not rule leaves aside the
rest. It is what a gradient difference does for a radiograph that shows more than its model (Penney
et al., 1998, doi:10.1109/42.730403).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Final

import numpy as np
from jaxtyping import Float64, Int64

from xden1k.values.arrays import Mask
from xden_builder.fit.problem import Evaluation
from xden_builder.poly.descent import descend
from xden_builder.poly.pyramid import PIXEL_SD, SHADED, WORTH, Level
from xden_builder.poly.target import Bounds

__all__ = ["Edges", "descend_by_edges", "edge_doubt"]

EDGE_SD: Final = 0.01
"""Of the logarithm of light from pixel to pixel, behind anything but the darkest."""
MOST: Final = 4
"""How often derivatives are taken by each standard deviation."""
DARK: Final = 0.1
"""Share of the light, below which its logarithm is known less well."""
DARKEST: Final = 1e-3
"""Share of the light that has a logarithm."""

Pairs = tuple[Int64[np.ndarray, "m"], Int64[np.ndarray, "m"]]
"""Places of neighbouring pixels: of the one before, and of the one after."""


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Images of a level, compared by differences of neighbouring pixels; its unknowns.

    Parameters
    ----------
    level
        Renders the images.
    pairs
        Of each view, among its compared pixels.
    scales
        Of each view, shape (m,): standard deviations of these differences.
    """

    level: Level
    pairs: Sequence[Pairs]
    scales: Sequence[Float64[np.ndarray, "_m"]]

    @classmethod
    def of(cls, level: Level, sd: float = EDGE_SD) -> Edges:
        """Compare images by differences of their logarithms, of some standard deviation."""
        pairs = []
        for mask, whole, places in zip(level.masks, level.whole, level.places, strict=True):
            before, after = _neighbours(mask & ~whole.at_least)
            pairs.append((places[before], places[after]))
        scales = map(_scale, level.measured, pairs, repeat(sd))
        return cls(level, pairs, list(scales))

    def believed(self, _residuals: Sequence[Float64[np.ndarray, "_m"]]) -> Edges:
        """Keep standard deviations, whatever a model leaves."""
        return self

    def residuals(self, unknowns: Float64[np.ndarray, "u"]) -> list[Float64[np.ndarray, "_m"]]:
        """Model less measurement of each view, in standard deviations."""
        return self._off(self.level.images(unknowns))

    def residuals_and_slopes(
        self, unknowns: Float64[np.ndarray, "u"]
    ) -> tuple[list[Float64[np.ndarray, "_m"]], list[Float64[np.ndarray, "_m u"]]]:
        """Give the residuals of each view, and their derivatives by all unknowns."""
        residuals, slopes = self.level.residuals_and_slopes(unknowns)
        seen = zip(residuals, self.level.measured, strict=True)
        images = [PIXEL_SD * off + measured for off, measured in seen]
        changes = []
        both = zip(slopes, images, self.pairs, self.scales, strict=True)
        for slope, image, (before, after), scale in both:
            by = PIXEL_SD * slope * _slope(image)[:, None]
            changes.append((by[after] - by[before]) / scale[:, None])
        return self._off(images), changes

    def loss(
        self, unknowns: Float64[np.ndarray, "u"], residuals: Sequence[Float64[np.ndarray, "_m"]]
    ) -> float:
        """Cauchy's loss of all differences, with priors."""
        return self.level.expected(unknowns) + self.share * sum(map(_cauchy, residuals))

    def evaluate(
        self,
        unknowns: Float64[np.ndarray, "u"],
        residuals: Sequence[Float64[np.ndarray, "_m"]],
        slopes: Sequence[Float64[np.ndarray, "_m u"]],
    ) -> Evaluation:
        """Loss, and half its derivatives."""
        weights = [self.share / (1 + off**2) for off in residuals]
        gradient, hessian = self.level.derivatives(unknowns, residuals, weights, slopes)
        return Evaluation(self.loss(unknowns, residuals), gradient, hessian, ())

    @property
    def share(self) -> float:
        """What a difference counts."""
        return WORTH / max(sum(map(len, self.scales)), WORTH)

    def _off(self, images: Sequence[Float64[np.ndarray, "_n"]]) -> list[Float64[np.ndarray, "_m"]]:
        """Images of the model less the measured ones, in standard deviations."""
        both = zip(images, self.level.measured, self.pairs, self.scales, strict=True)
        return [
            _differences(_logarithm(image) - _logarithm(seen), pairs) / scale
            for image, seen, pairs, scale in both
        ]


def descend_by_edges(
    level: Level, unknowns: Float64[np.ndarray, "u"], sds: Sequence[float], bounds: Bounds
) -> Float64[np.ndarray, "u"]:
    """Go down by differences of neighbouring pixels, of one standard deviation after the other."""
    for sd in sds:
        unknowns = descend(Edges.of(level, sd), unknowns, MOST, *bounds).unknowns
    return unknowns


def edge_doubt(level: Level, unknowns: Float64[np.ndarray, "u"]) -> float:
    """Mean of Cauchy's loss of neighbouring pixels' differences, where either is shaded.

    All pixels count, also those that are not compared, since each pose has windows of its own.
    """
    off = np.concatenate(list(_everywhere(level, unknowns)))
    return _cauchy(off) / max(len(off), 1)


def _everywhere(
    level: Level, unknowns: Float64[np.ndarray, "u"]
) -> Iterator[Float64[np.ndarray, "_a"]]:
    """Yield the residuals of each whole view, of pairs of which a pixel is shaded."""
    lights = zip(*level.lights(unknowns), strict=True)
    each = zip(lights, level.images(unknowns), level.masks, level.whole, strict=True)
    for (gain, share), image, mask, whole in each:
        seen = whole.image.astype(np.float64)
        model = gain + share * whole.glare
        model[mask] = image
        pairs = _neighbours(whole.known & ~whole.at_least)
        off = _differences(_logarithm(model) - _logarithm(seen), pairs)
        shaded = np.minimum(seen, model).ravel() < SHADED * gain
        counts = shaded[pairs[0]] | shaded[pairs[1]]
        yield (off / _scale(seen, pairs, EDGE_SD))[counts]


def _neighbours(usable: Mask) -> Pairs:
    """Find pixels beside each other along rows and columns, as flat indices."""
    index = np.arange(usable.size).reshape(usable.shape)
    before = np.concatenate([index[:, :-1].ravel(), index[:-1].ravel()])
    after = np.concatenate([index[:, 1:].ravel(), index[1:].ravel()])
    both = usable.ravel()[before] & usable.ravel()[after]
    return before[both], after[both]


def _differences(values: Float64[np.ndarray, "..."], pairs: Pairs) -> Float64[np.ndarray, "m"]:
    """Give what neighbours differ by."""
    before, after = pairs
    flat = values.ravel()
    return np.asarray(flat[after] - flat[before])


def _logarithm(light: Float64[np.ndarray, "*n"]) -> Float64[np.ndarray, "*n"]:
    return np.asarray(np.log(light.clip(min=DARKEST)))


def _slope(light: Float64[np.ndarray, "n"]) -> Float64[np.ndarray, "n"]:
    """Give the derivative of that logarithm."""
    return np.where(light > DARKEST, 1 / light.clip(min=DARKEST), 0.0)


def _scale(seen: Float64[np.ndarray, "..."], pairs: Pairs, sd: float) -> Float64[np.ndarray, "m"]:
    """Give standard deviations of differences of logarithms: what is dark is known less well."""
    before, after = (seen.ravel()[end].clip(min=DARKEST) for end in pairs)
    return np.asarray(sd * np.maximum(DARK / np.sqrt(before * after), 1.0))


def _cauchy(off: Float64[np.ndarray, "n"]) -> float:
    """Cauchy's loss of residuals in standard deviations, which no large one rules."""
    return float(np.log1p(off**2).sum())
