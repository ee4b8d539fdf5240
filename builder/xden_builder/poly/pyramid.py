"""One resolution of the search for the pose: what is compared, how it is rendered, the steps.

Derivatives by pose are central differences of whole renderings, since outlines move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Float64

from xden1k.rays import PathLengths, path_lengths
from xden1k.values.arrays import Mask
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.fit import huber
from xden_builder.fit.box import box_minimum
from xden_builder.fit.problem import Evaluation
from xden_builder.poly.model.beam import ViewBeam
from xden_builder.poly.model.direct import transmissions, transmissions_and_slopes
from xden_builder.poly.model.frames import POSE_UNKNOWNS, Pose, any_of, binned, coarse, posed

__all__ = ["Level", "descend"]

ROTATION_SD: Final = 0.03
SHIFT_SD_CM: Final = 0.3
ROW_SHIFT_SD_CM: Final = 0.05
"""How far meshes and images are expected to disagree: 2 degrees, 3 mm, half a millimetre."""
STEPS_CM: Final = 0.02
"""Of a central difference at full resolution, times the binning; rotations move the rim as far."""
PIXEL_SD: Final = 0.05
WORTH: Final = 400.0
"""Independent observations that all pixels together are worth: their errors hang together."""
FIRST_DAMPING: Final = 1e-3
MOST_STEPS: Final = 5
"""Between two derivatives."""
SETTLED_SHARE: Final = 1e-3
"""Of the loss: a step that gains less ends a resolution."""


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """Images averaged over ``binning * binning`` pixels, compared around the object.

    Unknowns: K densities, a gain of each view, and the pose.
    """

    meshes: Sequence[trimesh.Trimesh]
    order: Sequence[int]
    beams: Sequence[ViewBeam]
    mac_cm2_g: Float64[np.ndarray, "k groups"]
    origin: Pose
    binning: int
    masks: Sequence[Mask]
    measured: Sequence[Float64[np.ndarray, "_p"]]
    at_least: Sequence[Bool[np.ndarray, "_p"]]
    gains: Sequence[tuple[float, float]]
    radius_cm: float

    @classmethod
    def of(
        cls,
        views: Sequence[XRayView],
        saturated: Sequence[Mask],
        gains: Sequence[tuple[float, float]],
        beams: Sequence[ViewBeam],
        meshes: Sequence[trimesh.Trimesh],
        order: Sequence[int],
        mac_cm2_g: Float64[np.ndarray, "k groups"],
        origin: Pose,
        binning: int,
        points: Float[np.ndarray, "n 3"],
        radius_cm: float,
    ) -> Level:
        """Average images, and compare them around the object; parameters as of ``refine_pose``."""
        masks, measured, at_least = [], [], []
        for view, full in zip(views, saturated, strict=True):
            image, known = binned(view, binning)
            mask = np.zeros_like(known)
            window = _window(view.geometry, points, binning)
            mask[window] = known[window]
            masks.append(mask)
            measured.append(image[mask].astype(np.float64))
            at_least.append(any_of(full, binning)[mask])
        return cls(
            meshes,
            order,
            beams,
            mac_cm2_g,
            origin,
            binning,
            masks,
            measured,
            at_least,
            gains,
            radius_cm,
        )

    @property
    def parts(self) -> int:
        """Number of parts K."""
        return len(self.meshes)

    def evaluate(
        self,
        unknowns: Float64[np.ndarray, "u"],
        residuals: Sequence[Float64[np.ndarray, "_n"]],
        slopes: Sequence[Float64[np.ndarray, "_n u"]],
    ) -> Evaluation:
        """Sum of squares, large ones tempered, with priors; and half its derivatives."""
        mean, precision = self._prior()
        gradient, hessian = (unknowns - mean) * precision, np.diag(precision)
        loss = float(gradient @ (unknowns - mean))
        for each, slope, at_least in zip(residuals, slopes, self.at_least, strict=True):
            counts = huber.one_sided(each, at_least)
            off = np.where(counts, each, 0.0)
            loss += self._share * huber.tempered(off)
            weighted = slope * (self._share * counts * huber.weights(off))[:, None]
            gradient = gradient + weighted.T @ off
            hessian = hessian + weighted.T @ slope
        return Evaluation(loss, gradient, hessian, ())

    @property
    def _share(self) -> float:
        return min(1.0, WORTH / max(sum(map(len, self.measured)), 1))

    def residuals(self, unknowns: Float64[np.ndarray, "u"]) -> list[Float64[np.ndarray, "_n"]]:
        """Model less measurement of each view, in standard deviations."""
        density, gains, pose = self._split(unknowns)
        return [
            (gain * self._image(number, density, pose) - seen) / PIXEL_SD
            for number, (seen, gain) in enumerate(zip(self.measured, gains.tolist(), strict=True))
        ]

    def rms(self, unknowns: Float64[np.ndarray, "u"]) -> float:
        """Root mean square residual of transmission, saturated pixels left out."""
        residuals = np.concatenate(self.residuals(unknowns))
        told = residuals[~np.concatenate(self.at_least)]
        return PIXEL_SD * float(np.sqrt((told**2).mean())) if told.size else 0.0

    def _split(
        self, unknowns: Float64[np.ndarray, "u"]
    ) -> tuple[Float64[np.ndarray, "k"], Float64[np.ndarray, "v"], Float64[np.ndarray, "7"]]:
        """Densities, gains and pose."""
        return (
            unknowns[: self.parts],
            unknowns[self.parts : -POSE_UNKNOWNS],
            unknowns[-POSE_UNKNOWNS:],
        )

    def _prior(self) -> tuple[Float64[np.ndarray, "u"], Float64[np.ndarray, "u"]]:
        """Means, and one over the variances."""
        gain_means, gain_sds = np.array(self.gains).T
        sds = [ROTATION_SD] * 3 + [SHIFT_SD_CM] * 3 + [ROW_SHIFT_SD_CM]
        sd = np.concatenate([np.full(self.parts, np.inf), gain_sds, sds])
        mean = np.concatenate([np.zeros(self.parts), gain_means, np.zeros(POSE_UNKNOWNS)])
        return mean, sd**-2.0

    def slopes(self, unknowns: Float64[np.ndarray, "u"]) -> list[Float64[np.ndarray, "_n u"]]:
        """Take the derivatives of the residuals of each view by all unknowns."""
        return [self._slopes(unknowns, number) / PIXEL_SD for number in range(len(self.beams))]

    def _slopes(
        self, unknowns: Float64[np.ndarray, "u"], number: int
    ) -> Float64[np.ndarray, "_p u"]:
        """Take the derivatives of the image of a view."""
        density, gains, pose = self._split(unknowns)
        gain = gains[number]
        model, slopes = self._image_and_slopes(number, density, pose)
        jacobian = np.zeros((len(model), len(unknowns)))
        jacobian[:, : self.parts] = gain * slopes
        jacobian[:, self.parts + number] = model
        reach = STEPS_CM * self.binning
        deltas = np.array([reach / self.radius_cm] * 3 + [reach] * 4)
        for index in range(POSE_UNKNOWNS if number == 1 else POSE_UNKNOWNS - 1):
            delta = np.zeros(POSE_UNKNOWNS)
            delta[index] = deltas[index]
            ahead, behind = (
                self._image(number, density, there) for there in (pose + delta, pose - delta)
            )
            place = self.parts + len(gains) + index
            jacobian[:, place] = gain * (ahead - behind) / (2 * deltas[index])
        return jacobian

    def _image(
        self, number: int, density: Float64[np.ndarray, "k"], pose: Float64[np.ndarray, "7"]
    ) -> Float64[np.ndarray, "_p"]:
        """Transmission of the compared pixels of a view."""
        lengths = self._lengths(number, pose)
        beam = self.beams[number]
        seen = transmissions(lengths, beam, self.mac_cm2_g, density, self.binning)
        return self._compared(number, lengths, seen)

    def _image_and_slopes(
        self, number: int, density: Float64[np.ndarray, "k"], pose: Float64[np.ndarray, "7"]
    ) -> tuple[Float64[np.ndarray, "_p"], Float64[np.ndarray, "_p k"]]:
        """Give the same, and its derivatives by density."""
        lengths, mask = self._lengths(number, pose), self.masks[number]
        beam = self.beams[number]
        seen, slopes = transmissions_and_slopes(
            lengths, beam, self.mac_cm2_g, density, self.binning
        )
        places = np.cumsum(mask) - 1
        inside = mask.flat[lengths.pixels]
        compared = np.zeros((int(mask.sum()), self.parts))
        compared[places[lengths.pixels[inside]]] = slopes[inside]
        return self._compared(number, lengths, seen), compared

    def _lengths(self, number: int, pose: Float64[np.ndarray, "7"]) -> PathLengths:
        """Path lengths of a view's bins, the object in a pose."""
        there = self.origin.moved(pose)
        geometry = posed(self.beams[number].geometry, there, shifted_rows=number == 1)
        rays = max(self.binning // 2, 2)
        return path_lengths(self.meshes, self.order, coarse(geometry, self.binning), rays)

    def _compared(
        self, number: int, lengths: PathLengths, transmission: Float64[np.ndarray, "n"]
    ) -> Float64[np.ndarray, "_p"]:
        """Pick the compared pixels of a view, in which what no ray meets is 1."""
        image = np.ones(self.masks[number].shape)
        image.flat[lengths.pixels] = transmission
        return np.asarray(image[self.masks[number]])


def _window(
    geometry: ViewGeometry, points: Float[np.ndarray, "n 3"], binning: int
) -> tuple[slice, slice]:
    """Rows and columns of the binned image around the object, and some air."""
    places = coarse(geometry, binning).project(points)[:, 1::-1]
    margin = 0.08 * np.ptp(places, axis=0).max() + 4
    low = np.floor(places.min(axis=0) - margin).astype(int).clip(min=0)
    high = (np.ceil(places.max(axis=0) + margin).astype(int) + 1).clip(min=0)
    return slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1]))


def descend(
    level: Level,
    unknowns: Float64[np.ndarray, "u"],
    most: int,
    low: Float64[np.ndarray, "u"],
    high: Float64[np.ndarray, "u"],
) -> tuple[Float64[np.ndarray, "u"], Float64[np.ndarray, "u u"]]:
    """Take damped Gauss-Newton steps, and give half the curvature there too.

    Derivatives cost a dozen times as much as residuals, so several steps share them.
    """
    residuals, damping = level.residuals(unknowns), FIRST_DAMPING
    for _ in range(most):
        slopes = level.slopes(unknowns)
        here = first = level.evaluate(unknowns, residuals, slopes)
        for _ in range(MOST_STEPS):
            ahead = _ahead(unknowns, here, damping, low, high)
            seen = level.residuals(ahead)
            then = level.evaluate(ahead, seen, slopes)
            if then.loss >= here.loss:
                damping *= 10
                continue
            gained = here.loss - then.loss
            unknowns, residuals, here = ahead, seen, then
            damping = max(damping / 10, 1e-6)
            if gained < SETTLED_SHARE * here.loss:
                break
        if first.loss - here.loss < SETTLED_SHARE * here.loss:
            break
    return unknowns, here.hessian


def _ahead(
    unknowns: Float64[np.ndarray, "u"],
    here: Evaluation,
    damping: float,
    low: Float64[np.ndarray, "u"],
    high: Float64[np.ndarray, "u"],
) -> Float64[np.ndarray, "u"]:
    """Solve between bounds, with each unknown scaled to unit curvature."""
    scale = 1 / np.sqrt(here.hessian.diagonal().clip(min=1e-12))
    scaled = here.hessian * np.outer(scale, scale) + damping * np.eye(len(scale))
    step = box_minimum(
        scaled, scale * here.gradient, (low - unknowns) / scale, (high - unknowns) / scale
    )
    return np.asarray((unknowns + scale * step).clip(low, high))
