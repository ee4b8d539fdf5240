"""One resolution of the search for the pose: what is compared, and how it is rendered.

Derivatives by pose are differences of whole renderings, since outlines move, but where the image
merely slides (:mod:`xden_builder.poly.model.motion`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import isqrt
from typing import Final

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from xden1k.rays import PathLengths, disjoint_path_lengths
from xden1k.values.arrays import Mask
from xden1k.values.views import ViewGeometry
from xden_builder.fit import huber
from xden_builder.fit.problem import Evaluation
from xden_builder.poly.model.direct import transmissions, transmissions_and_slopes
from xden_builder.poly.model.frames import coarse
from xden_builder.poly.model.motion import Gradient, slopes_by_pose
from xden_builder.poly.model.poses import Poses
from xden_builder.poly.target import Averaged, Target, Window

__all__ = [
    "AIR",
    "LOST_FROM",
    "PIXEL_SD",
    "RAYS",
    "SHADED",
    "WORTH",
    "Level",
    "subrays_of",
]

STEPS_CM: Final = 0.02
"""Of a difference at full resolution, times the binning.

Rotations and a change of size move the rim as far.
"""
RAYS: Final = 30_000
"""Through the object in a view, about: the fewer pixels it has, the more of them stand in each."""
MOST_SUBRAYS: Final = 8
"""Along each side of a pixel."""
KEPT_POSES: Final = 2
"""Whose path lengths are kept."""
PIXEL_SD: Final = 0.05
LOST_FROM: Final = 2.5
"""Standard deviations: how much too bright the model is where something without a mesh
took the light."""
WORTH: Final = 400.0
"""Independent observations that all pixels together are worth: their errors hang together."""
AIR: Final = 0.95
"""Quantile of the transmission that is about the open field's."""
SHADED: Final = 0.96
"""Of the light of the open field: less was taken by something."""
LEAST_LEFT: Final = 0.01
"""Mean square of residuals in ``PIXEL_SD``, below which a model is not believed to be better."""


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """Images averaged over ``binning * binning`` pixels, compared in windows.

    Unknowns: K densities, a gain of each view, a share of glare of each, and those of the poses.
    """

    target: Target
    poses: Poses
    binning: int
    panels: Sequence[ViewGeometry]
    """As told, with so many pixels read as one."""
    masks: Sequence[Mask]
    places: Sequence[Int64[np.ndarray, "_pixels"]]
    """Number of each pixel among the compared ones, -1 where it is not."""
    measured: Sequence[Float64[np.ndarray, "_p"]]
    glare: Sequence[Float64[np.ndarray, "_p"]]
    """As of :class:`Averaged`, of the compared pixels."""
    at_least: Sequence[Bool[np.ndarray, "_p"]]
    weights: Sequence[Float64[np.ndarray, "_p groups"]]
    """Shares of the energy groups in the open field of the compared pixels."""
    whole: Sequence[Averaged]
    """The images of which windows are compared."""
    subrays: Sequence[int]
    """Rays along each side of a pixel of each view."""
    slope_subrays: Sequence[int]
    """The same for derivatives by the poses."""
    turned: bool = True
    """Whether they stand turned against the raster, see :func:`xden1k.rays.path_lengths`."""
    step_cm: float = STEPS_CM
    """Of a difference, for each pixel that is averaged along a side."""
    forward: bool = False
    """Whether differences are between the image a step ahead and the image here, by the same rays,
    for half the renderings; central if not."""
    lost_from: float = np.inf
    """Standard deviations from which on light is taken for lost in what has no mesh; nowhere by
    default."""
    weighs: bool = False
    """Whether a descent believes the images as far as the model explains them."""
    worth: float = WORTH
    """Independent observations, of errors of ``PIXEL_SD``, that all pixels together are worth."""
    still: bool = False
    """Whether derivatives by the poses are left out, and are zero."""
    latest: dict[tuple[Target, Poses, int, int, int, bool, bytes], PathLengths] = field(
        default_factory=dict
    )
    """Path lengths of the views in the poses asked for last: a descent comes back to them. By all
    they hang on, so that levels which replace others share them: target, poses, binning, view, rays
    along a pixel's side, whether these are turned, and unknowns of the poses."""

    @classmethod
    def of(
        cls,
        target: Target,
        poses: Poses,
        windows: Sequence[Window],
        binning: int,
        images: Sequence[Averaged] | None = None,
        subrays: Sequence[int] | None = None,
        rays: int = RAYS,
    ) -> Level:
        """Compare images in a window of each; they are averaged here, if they are not yet.

        Rays are counted for meshes at rest, about so many through the object, if they are not told;
        for derivatives at most ``RAYS``.

        With two rays along each side an outline that runs along the pixels is felt in steps of half
        a pixel; a small object, of which hardly more is to be seen, is turned by a degree by it.
        """
        if images is None:
            pairs = zip(target.views, target.saturated, strict=True)
            images = [Averaged.of(view, saturated, binning) for view, saturated in pairs]
        masks, places, measured, glare, at_least, weights = [], [], [], [], [], []
        for each, beam, inside in zip(images, target.beams, windows, strict=True):
            mask = np.zeros_like(each.known)
            mask[inside] = each.known[inside]
            masks.append(mask)
            places.append(np.where(mask, mask.cumsum().reshape(mask.shape) - 1, -1).ravel())
            measured.append(each.image[mask].astype(np.float64))
            glare.append(each.glare[mask])
            at_least.append(each.at_least[mask])
            weights.append(beam.weights(np.flatnonzero(mask), binning))
        panels = [coarse(beam.geometry, binning) for beam in target.beams]
        if subrays is None:
            met = [_pixels_met(target, poses, *each) for each in enumerate(panels)]
            subrays = [subrays_of(pixels, binning, rays) for pixels in met]
            slope_subrays = [subrays_of(pixels, binning, min(rays, RAYS)) for pixels in met]
        else:
            slope_subrays = list(subrays)
        seen = masks, places, measured, glare, at_least, weights, images
        return cls(target, poses, binning, panels, *seen, subrays, slope_subrays)

    @property
    def parts(self) -> int:
        """Number of parts K."""
        return len(self.target.regions)

    def evaluate(
        self,
        unknowns: Float64[np.ndarray, "u"],
        residuals: Sequence[Float64[np.ndarray, "_n"]],
        slopes: Sequence[Float64[np.ndarray, "_n u"]],
    ) -> Evaluation:
        """Sum of squares, large ones tempered, with priors; and half its derivatives."""
        gradient, hessian = self.derivatives(unknowns, *self.weighed(residuals), slopes)
        return Evaluation(self.loss(unknowns, residuals), gradient, hessian, ())

    def weighed(
        self, residuals: Sequence[Float64[np.ndarray, "_n"]]
    ) -> tuple[list[Float64[np.ndarray, "_n"]], list[Float64[np.ndarray, "_n"]]]:
        """Give the residuals of each view, zero where they do not count, and their weights."""
        counted = list(self.counted(residuals))
        weights = [self.share * counts * self.weights_of(off) for counts, off in counted]
        return [off for _, off in counted], weights

    def derivatives(
        self,
        unknowns: Float64[np.ndarray, "u"],
        residuals: Sequence[Float64[np.ndarray, "_n"]],
        weights: Sequence[Float64[np.ndarray, "_n"]],
        slopes: Sequence[Float64[np.ndarray, "_n u"]],
    ) -> tuple[Float64[np.ndarray, "u"], Float64[np.ndarray, "u u"]]:
        """Half the gradient of weighted squares and priors, and the curvature."""
        mean, precision = self._prior()
        gradient, hessian = (unknowns - mean) * precision, np.diag(precision)
        for off, weight, slope in zip(residuals, weights, slopes, strict=True):
            weighted = slope * weight[:, None]
            gradient = gradient + weighted.T @ off
            hessian = hessian + weighted.T @ slope
        return gradient, hessian

    def loss(
        self, unknowns: Float64[np.ndarray, "u"], residuals: Sequence[Float64[np.ndarray, "_n"]]
    ) -> float:
        """Sum of squares as of :meth:`evaluate`, without derivatives."""
        return self.expected(unknowns) + self.share * self.left(residuals)

    def expected(self, unknowns: Float64[np.ndarray, "u"]) -> float:
        """Sum of squares of the priors."""
        mean, precision = self._prior()
        return float(((unknowns - mean) * precision) @ (unknowns - mean))

    def left(self, residuals: Sequence[Float64[np.ndarray, "_n"]]) -> float:
        """Sum of squares of all views, large ones tempered."""
        return sum(self.tempered(off) for _, off in self.counted(residuals))

    def mean_left(self, residuals: Sequence[Float64[np.ndarray, "_n"]]) -> float:
        """Mean of the same over the pixels that count."""
        counted = sum(int(counts.sum()) for counts, _ in self.counted(residuals))
        return self.left(residuals) / max(counted, 1)

    def tempered(self, off: Float64[np.ndarray, "_n"]) -> float:
        """Sum of squares of residuals that count, large ones tempered."""
        return huber.tempered(off, self.lost_from)

    def weights_of(self, off: Float64[np.ndarray, "_n"]) -> Float64[np.ndarray, "_n"]:
        """Weights with which least squares has the gradient of :meth:`tempered`."""
        return huber.weights(off, self.lost_from)

    def counted(
        self, residuals: Sequence[Float64[np.ndarray, "_n"]]
    ) -> Iterator[tuple[Bool[np.ndarray, "_n"], Float64[np.ndarray, "_n"]]]:
        """Yield which residuals of a view count, and all of them, zero where they do not."""
        for each, at_least in zip(residuals, self.at_least, strict=True):
            counts = huber.one_sided(each, at_least)
            yield counts, np.where(counts, each, 0.0)

    @property
    def share(self) -> float:
        """What a pixel counts."""
        return self.worth / max(sum(map(len, self.measured)), WORTH)

    def believed(self, residuals: Sequence[Float64[np.ndarray, "_n"]]) -> Level:
        """Weigh the images, if so told, by what a model leaves of them.

        Where that is a hundredth of the light, errors of ``PIXEL_SD`` would leave a small object
        where it was expected before.
        """
        if not self.weighs:
            return self
        mean = min(max(self.mean_left(residuals), LEAST_LEFT), 1.0)
        return replace(self, worth=WORTH / mean)

    def met(self, unknowns: Float64[np.ndarray, "u"]) -> Iterator[Bool[np.ndarray, "_p"]]:
        """Yield which compared pixels of a view meet the object."""
        *_, pose = self._split(unknowns)
        for number, measured in enumerate(self.measured):
            places = self.places[number][self._kept(number, pose).pixels]
            there = np.zeros(len(measured), dtype=np.bool_)
            there[places[places >= 0]] = True
            yield there

    def residuals(self, unknowns: Float64[np.ndarray, "u"]) -> list[Float64[np.ndarray, "_n"]]:
        """Model less measurement of each view, in standard deviations."""
        return self._off(self.images(unknowns))

    def _off(self, images: Sequence[Float64[np.ndarray, "_n"]]) -> list[Float64[np.ndarray, "_n"]]:
        """Images of the model less the measured ones, in standard deviations."""
        pairs = zip(images, self.measured, strict=True)
        return [(model - seen) / PIXEL_SD for model, seen in pairs]

    def images(self, unknowns: Float64[np.ndarray, "u"]) -> list[Float64[np.ndarray, "_n"]]:
        """Model of the compared pixels of each view, with its gain and glare."""
        density, gains, glares, pose = self._split(unknowns)
        return [
            gain * self._light(number, density, self._kept(number, pose)) + share * glare
            for number, (gain, share, glare) in enumerate(
                zip(gains.tolist(), glares.tolist(), self.glare, strict=True)
            )
        ]

    def loss_at(self, unknowns: Float64[np.ndarray, "u"]) -> float:
        """:meth:`loss` of the residuals there."""
        return self.loss(unknowns, self.residuals(unknowns))

    def rms(self, residuals: Sequence[Float64[np.ndarray, "_n"]]) -> float:
        """Root mean square residual of transmission, saturated pixels left out."""
        told = np.concatenate(residuals)[~np.concatenate(self.at_least)]
        return PIXEL_SD * float(np.sqrt((told**2).mean())) if told.size else 0.0

    def lights(self, unknowns: Float64[np.ndarray, "u"]) -> tuple[list[float], list[float]]:
        """Gains of the views, and their shares of glare."""
        _, gains, glares, _ = self._split(unknowns)
        return gains.tolist(), glares.tolist()

    def _split(
        self, unknowns: Float64[np.ndarray, "u"]
    ) -> tuple[
        Float64[np.ndarray, "k"],
        Float64[np.ndarray, "v"],
        Float64[np.ndarray, "v"],
        Float64[np.ndarray, "q"],
    ]:
        """Densities, gains, shares of glare, and poses."""
        views = len(self.target.beams)
        ends = np.cumsum([self.parts, views, views]).tolist()
        density, gains, glares, pose = np.split(unknowns, ends)
        return density, gains, glares, pose

    @property
    def precision(self) -> Float64[np.ndarray, "u"]:
        """One over the variances of the unknowns before the images."""
        return self._prior()[1]

    def _prior(self) -> tuple[Float64[np.ndarray, "u"], Float64[np.ndarray, "u"]]:
        """Means, and one over the variances."""
        glares = [self.target.glare[:2]] * len(self.target.gains)
        lights = np.array([*self.target.gains, *glares])
        sd = np.concatenate([np.full(self.parts, np.inf), lights[:, 1], self.poses.prior_sd])
        mean = np.concatenate([np.zeros(self.parts), lights[:, 0], np.zeros(self.poses.count)])
        return mean, sd**-2.0

    def residuals_and_slopes(
        self, unknowns: Float64[np.ndarray, "u"]
    ) -> tuple[list[Float64[np.ndarray, "_n"]], list[Float64[np.ndarray, "_n u"]]]:
        """Give the residuals of each view, and their derivatives by all unknowns."""
        views = range(len(self.target.beams))
        images, slopes = zip(*(self._slopes(unknowns, number) for number in views), strict=True)
        return self._off(images), [slope / PIXEL_SD for slope in slopes]

    def _slopes(
        self, unknowns: Float64[np.ndarray, "u"], number: int
    ) -> tuple[Float64[np.ndarray, "_p"], Float64[np.ndarray, "_p u"]]:
        """Give the image of a view, and its derivatives."""
        density, gains, glares, pose = self._split(unknowns)
        gain, seen, views = gains[number], self._kept(number, pose), len(gains)
        model, slopes = self.image_and_slopes(number, density, seen)
        jacobian = np.zeros((len(model), len(unknowns)))
        jacobian[:, : self.parts] = gain * slopes
        jacobian[:, self.parts + number] = model
        jacobian[:, self.parts + views + number] = self.glare[number]
        if not self.still:
            by_pose = self._slopes_by_pose(number, density, pose, model)
            jacobian[:, self.parts + 2 * views :] = gain * by_pose
        return gain * model + glares[number] * self.glare[number], jacobian

    def _slopes_by_pose(
        self,
        number: int,
        density: Float64[np.ndarray, "k"],
        pose: Float64[np.ndarray, "q"],
        model: Float64[np.ndarray, "_p"],
    ) -> Float64[np.ndarray, "_p q"]:
        """Give the derivatives of a view's image, without gain, by the unknowns of the poses."""
        same = self.slope_subrays[number] == self.subrays[number]
        if same and not self.turned:
            along = self._kept(number, pose)
        else:
            along = self._seen(number, pose, self.slope_subrays, turned=False)
        gradient = self._gradient(number, density, along)
        return slopes_by_pose(
            self.poses,
            number,
            self.panels[number],
            pose,
            gradient,
            partial(self._spread, number, gradient),
            partial(self._difference, number, density, pose, model if self.forward else None),
        )

    def _gradient(
        self, number: int, density: Float64[np.ndarray, "k"], seen: PathLengths
    ) -> Gradient:
        """Slopes of a view's image, by rays along its raster: those tell what rims differ by."""
        count, rays, parts = seen.lengths_cm.shape
        weights = self.target.beams[number].weights(seen.pixels, self.binning)
        light = transmissions(
            seen.lengths_cm.reshape(count * rays, 1, parts),
            np.repeat(weights, rays, axis=0),
            self.target.mac_cm2_g,
            density,
        )
        return Gradient.of(seen.pixels, light.reshape(count, rays), seen.shape)

    def _spread(
        self, number: int, gradient: Gradient, values: Float64[np.ndarray, "n"]
    ) -> Float64[np.ndarray, "_p"]:
        """Put values of the gradient's pixels in their places among the compared ones."""
        flat = gradient.rows * self.panels[number].shape[1] + gradient.columns
        places = self.places[number][flat]
        whole = np.zeros(len(self.measured[number]))
        whole[places[places >= 0]] = values[places >= 0]
        return whole

    def _difference(
        self,
        number: int,
        density: Float64[np.ndarray, "k"],
        pose: Float64[np.ndarray, "q"],
        here: Float64[np.ndarray, "_p"] | None,
        direction: Float64[np.ndarray, "q"],
    ) -> Float64[np.ndarray, "_p"]:
        """Difference of a view's image along a direction of the unknowns of the poses."""
        step = self.step_cm * self.binning
        if not direction[self.poses.shifts(number)].any():
            step /= self.target.radius_cm
        ahead = self._image(number, density, pose + step * direction)
        if here is not None:
            return np.asarray((ahead - here) / step)
        behind = self._image(number, density, pose - step * direction)
        return np.asarray((ahead - behind) / (2 * step))

    def _image(
        self, number: int, density: Float64[np.ndarray, "k"], pose: Float64[np.ndarray, "q"]
    ) -> Float64[np.ndarray, "_p"]:
        """Transmission of the compared pixels of a view, by the rays of derivatives."""
        seen = self._seen(number, pose, self.slope_subrays, turned=self.turned)
        return self._light(number, density, seen)

    def _light(
        self, number: int, density: Float64[np.ndarray, "k"], seen: PathLengths
    ) -> Float64[np.ndarray, "_p"]:
        """Give the same behind some path lengths."""
        places, lengths_cm, weights = self._compared(number, seen)
        image = np.ones(len(self.measured[number]))
        image[places] = transmissions(lengths_cm, weights, self.target.mac_cm2_g, density)
        return image

    def image_and_slopes(
        self, number: int, density: Float64[np.ndarray, "k"], seen: PathLengths
    ) -> tuple[Float64[np.ndarray, "_p"], Float64[np.ndarray, "_p k"]]:
        """Give transmission of a view's compared pixels behind path lengths, without gain.

        And its derivatives by density.
        """
        places, lengths_cm, weights = self._compared(number, seen)
        count = len(self.measured[number])
        image, slopes = np.ones(count), np.zeros((count, self.parts))
        image[places], slopes[places] = transmissions_and_slopes(
            lengths_cm, weights, self.target.mac_cm2_g, density
        )
        return image, slopes

    def _kept(self, number: int, pose: Float64[np.ndarray, "q"]) -> PathLengths:
        """Path lengths as of :meth:`seen`, anew only if the pose was not asked for just before."""
        rays = self.subrays[number], self.turned
        key = self.target, self.poses, self.binning, number, *rays, pose.tobytes()
        seen = self.latest.pop(key, None) or self.seen(number, pose)
        self.latest[key] = seen
        while len(self.latest) > KEPT_POSES * len(self.target.beams):
            del self.latest[next(iter(self.latest))]
        return seen

    def seen(self, number: int, pose: Float64[np.ndarray, "q"]) -> PathLengths:
        """Path lengths of a view with the object in a pose."""
        return self._seen(number, pose, self.subrays, turned=self.turned)

    def _seen(
        self,
        number: int,
        pose: Float64[np.ndarray, "q"],
        subrays: Sequence[int],
        *,
        turned: bool,
    ) -> PathLengths:
        """Give the same by so many rays; along the raster if they are not turned against it."""
        geometry, target = self.poses.geometry(number, self.panels[number], pose), self.target
        return disjoint_path_lengths(target.regions, geometry, subrays[number], turned=turned)

    def _compared(
        self, number: int, seen: PathLengths
    ) -> tuple[
        Int64[np.ndarray, "n"], Float32[np.ndarray, "n s k"], Float64[np.ndarray, "n groups"]
    ]:
        """Places of the compared pixels that meet the object, their rays and weights."""
        places = self.places[number][seen.pixels]
        inside = places >= 0
        if inside.all():
            return places, seen.lengths_cm, self.weights[number][places]
        return places[inside], seen.lengths_cm[inside], self.weights[number][places[inside]]


def _pixels_met(target: Target, poses: Poses, number: int, panel: ViewGeometry) -> int:
    """Count pixels of a view that meet the object at rest."""
    geometry = poses.geometry(number, panel, np.zeros(poses.count))
    return len(disjoint_path_lengths(target.regions, geometry).pixels)


def subrays_of(pixels: int, binning: int, rays: int = RAYS) -> int:
    """Rays along each side of a pixel, for about so many to meet an object of so many pixels.

    Examples
    --------
    >>> [subrays_of(pixels, 2) for pixels in (40000, 3000, 10)]
    [2, 3, 8]
    """
    least = max(binning // 2, 2)
    return max(min(isqrt(rays // max(pixels, 1)), MOST_SUBRAYS), least)
