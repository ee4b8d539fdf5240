"""Images compared by how they change from pixel to pixel, where a part may have no mesh.

In logarithms what has no mesh adds to what the meshes take (Beer-Lambert), smoothly but at its own
edges: the wall of a vessel around its content, a head on its wedge. So neighbouring pixels differ
by the meshes alone nearly everywhere, and a loss that large residuals do not rule leaves aside the
rest. It is what a gradient difference does for a radiograph that shows more than its model (Penney
et al., 1998, doi:10.1109/42.730403). What is missing only takes light: a model that is darker than
an image is wrong there, and its want of light counts along with the differences.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from operator import itemgetter
from typing import Final

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.optimize import minimize

from xden1k.values.arrays import Mask
from xden_builder.fit.problem import Evaluation
from xden_builder.poly.descent import descend
from xden_builder.poly.model.poses import RIGID
from xden_builder.poly.pyramid import AIR, PIXEL_SD, SHADED, WORTH, Level
from xden_builder.poly.target import Bounds

__all__ = ["Edges", "descend_by_edges", "edge_doubt", "sought_by_edges"]

EDGE_SD: Final = 0.01
"""Of the logarithm of light from pixel to pixel, behind anything but the darkest."""
MOST: Final = 4
"""How often derivatives are taken by each standard deviation."""
MOST_TRIES: Final = 200
"""Poses that a search without derivatives tries."""
DARK: Final = 0.1
"""Share of the light, below which its logarithm is known less well."""
DARKEST: Final = 1e-3
"""Share of the light that has a logarithm."""

Pairs = tuple[Int64[np.ndarray, "_m"], Int64[np.ndarray, "_m"]]
"""Places of neighbouring pixels: of the one before, and of the one after."""


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Images of a level, compared by differences of neighbouring pixels; its unknowns.

    Residuals of a view are those of its differences and, after them, how much each pixel of the
    model is too dark.

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
        return self._off(self.level.residuals(unknowns))

    def residuals_and_slopes(
        self, unknowns: Float64[np.ndarray, "u"]
    ) -> tuple[list[Float64[np.ndarray, "_m"]], list[Float64[np.ndarray, "_m u"]]]:
        """Give the residuals of each view, and their derivatives by all unknowns."""
        residuals, slopes = self.level.residuals_and_slopes(unknowns)
        changes = []
        each = zip(slopes, residuals, self.level.measured, self.pairs, self.scales, strict=True)
        for slope, off, seen, (before, after), scale in each:
            by = PIXEL_SD * slope * _slope(PIXEL_SD * off + seen)[:, None]
            darker = np.where(off[:, None] < 0, slope, 0.0)
            changes.append(np.concatenate([(by[after] - by[before]) / scale[:, None], darker]))
        return self._off(residuals), changes

    def loss(
        self, unknowns: Float64[np.ndarray, "u"], residuals: Sequence[Float64[np.ndarray, "_m"]]
    ) -> float:
        """Cauchy's loss of all residuals, with priors."""
        return self.level.expected(unknowns) + self.left(residuals)

    def left(self, residuals: Sequence[Float64[np.ndarray, "_m"]]) -> float:
        """Cauchy's loss of all residuals, without priors."""
        return self.share * sum(map(_cauchy, residuals))

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
        """What a difference counts, or a pixel that is too dark."""
        return WORTH / max(sum(map(len, [*self.scales, *self.level.measured])), WORTH)

    def _off(self, plain: Sequence[Float64[np.ndarray, "_n"]]) -> list[Float64[np.ndarray, "_m"]]:
        """Turn residuals of the level into those of differences and of light that is wanting."""
        each = zip(plain, self.level.measured, self.pairs, self.scales, strict=True)
        return [
            np.concatenate(
                [
                    _differences(_logarithm(PIXEL_SD * off + seen) - _logarithm(seen), pairs)
                    / scale,
                    np.minimum(off, 0.0),
                ]
            )
            for off, seen, pairs, scale in each
        ]


def descend_by_edges(
    level: Level, unknowns: Float64[np.ndarray, "u"], sds: Sequence[float], bounds: Bounds
) -> Float64[np.ndarray, "u"]:
    """Go down by differences of neighbouring pixels, of one standard deviation after the other."""
    for sd in sds:
        unknowns = descend(Edges.of(level, sd), unknowns, MOST, *bounds).unknowns
    return unknowns


def sought_by_edges(
    level: Level,
    unknowns: Float64[np.ndarray, "u"],
    sd: float,
    reaches: tuple[float, float],
    bounds: Bounds,
) -> Float64[np.ndarray, "u"]:
    """Look for the pose that views share without derivatives by it, which lead to the next trough.

    By quadratic models in trust regions (COBYQA: Ragonneau, 2022, arXiv:2210.12018); in each pose
    densities, gains and glare are found anew, from those of the best.

    Parameters
    ----------
    level
        Renders the images.
    unknowns
        Where it begins.
    sd
        Of a difference.
    reaches
        First and last trust region: radians, and as a share of the object's radius.
    bounds
        Least and most unknowns.
    """
    edges, first = Edges.of(replace(level, still=True), sd), len(unknowns) - level.poses.count
    units = np.array([1.0] * 3 + [level.target.radius_cm] * 3)
    pose = slice(first, first + RIGID)
    start, best = unknowns[pose] / units, (np.inf, unknowns)

    def left(at: Float64[np.ndarray, "6"]) -> float:
        nonlocal best
        there = best[1].copy()
        there[pose] = at * units
        low, high = (np.append(end[:first], there[first:]) for end in bounds)
        end = descend(edges, there, 1, low, high)
        here = edges.left(end.residuals)
        best = min(best, (here, end.unknowns), key=itemgetter(0))
        return here

    first_reach, last_reach = reaches
    options = {
        "initial_tr_radius": first_reach,
        "final_tr_radius": last_reach,
        "maxfev": MOST_TRIES,
    }
    least, most = (end[pose] / units for end in bounds)
    minimize(left, start, method="COBYQA", bounds=np.stack([least, most], axis=1), options=options)
    return best[1]


def edge_doubt(level: Level, unknowns: Float64[np.ndarray, "u"]) -> float:
    """Cauchy's loss of pixels' differences, and of too dark ones, for each pair in shadow.

    Pairs are counted that are shaded in the images, whatever the model shades beside them: one that
    covers a panel evenly differs nowhere. All pixels count, also those that are not compared, since
    each pose has windows of its own.
    """
    left, shaded_pairs = 0.0, 0
    lights = zip(*level.lights(unknowns), strict=True)
    each = zip(lights, level.images(unknowns), level.masks, level.whole, strict=True)
    for (gain, share), image, mask, whole in each:
        seen = whole.image.astype(np.float64)
        model = gain + share * whole.glare
        model[mask] = image
        pairs = _neighbours(whole.known & ~whole.at_least)
        off = _differences(_logarithm(model) - _logarithm(seen), pairs)
        off /= _scale(seen, pairs, EDGE_SD)
        lit = SHADED * _open_field(seen[whole.known])
        by_image, by_either = (
            _either(light < lit, pairs) for light in (seen, np.minimum(seen, model))
        )
        darker = np.minimum(model - seen, 0.0)[whole.known] / PIXEL_SD
        left += _cauchy(off[by_either]) + _cauchy(darker)
        shaded_pairs += int(by_image.sum())
    return left / max(shaded_pairs, 1)


def _open_field(seen: Float64[np.ndarray, "n"]) -> float:
    """Give the usual light of pixels that nothing shades."""
    brightest = float(np.quantile(seen, AIR))
    return float(np.median(seen[seen > SHADED * brightest]))


def _either(there: Mask, pairs: Pairs) -> Bool[np.ndarray, "m"]:
    """Give pairs in either of whose pixels something is so."""
    return np.asarray(there.ravel()[pairs[0]] | there.ravel()[pairs[1]])


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
