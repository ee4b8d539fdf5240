"""Meshes onto their shadows: the pose that both radiographs agree with best.

Seven unknowns are found by Gauss-Newton steps, together with the densities and a gain of each
view, on images averaged over 8 x 8, 4 x 4 and 2 x 2 pixels. Derivatives by pose are central
differences of whole renderings, since outlines move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float, Float64

from xden1k.arrays import Mask
from xden1k.rays import path_lengths
from xden1k.views import ViewGeometry, XRayView
from xden_builder.fit.box import box_minimum
from xden_builder.fit.problem import Evaluation
from xden_builder.poly import kernels
from xden_builder.poly.beam import ViewBeam
from xden_builder.poly.pose import POSE_UNKNOWNS, Pose, binned, coarse, posed
from xden_builder.poly.settings import HUBER

__all__ = ["PoseFit", "refine_pose"]

ROTATION_SD: Final = 0.03
SHIFT_SD_CM: Final = 0.3
ROW_SHIFT_SD_CM: Final = 0.05
"""How far meshes and images are expected to disagree: 2 degrees, 3 mm, half a millimetre."""
STEPS_CM: Final = 0.02
"""Of a central difference at full resolution, times the binning; rotations move the rim as far."""
PIXEL_SD: Final = 0.05
BINNINGS: Final = ((8, 4), (4, 3), (2, 2))
"""Pixels averaged along each side, and Gauss-Newton steps on such images."""
DENSITY_SHARES: Final = (0.3, 10.0)
"""Least and most density in shares of the first guess: a part that fades away has no pose."""
COARSEST_PX: Final = 32
"""Images are never smaller."""
FIRST_DAMPING: Final = 1e-3
MOST_TRIES: Final = 5
SETTLED_SHARE: Final = 1e-3
"""Of the loss: a step that gains less ends a resolution."""
WORTH: Final = 400.0
"""Independent observations that all pixels together are worth: their errors hang together."""
GAIN_SD: Final = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class PoseFit:
    """Result of :func:`refine_pose`.

    Parameters
    ----------
    pose
        The best one.
    sd
        Shape (7,): its standard deviation, radians and cm.
    density_g_cm3, gain
        Fitted along with it, coarsely.
    rms_before, rms_after
        Root mean square residual of transmission on the coarsest and the finest images used.
    steps
        Gauss-Newton steps in all.
    """

    pose: Pose
    sd: Float64[np.ndarray, "7"]
    density_g_cm3: Float64[np.ndarray, "k"]
    gain: Float64[np.ndarray, "v"]
    rms_before: float
    rms_after: float
    steps: int


def refine_pose(
    views: Sequence[XRayView],
    beams: Sequence[ViewBeam],
    meshes: Sequence[trimesh.Trimesh],
    order: Sequence[int],
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
) -> PoseFit:
    """Find the pose in which meshes and radiographs agree best.

    Parameters
    ----------
    views, beams
        The radiographs, and what reaches their panels.
    meshes, order
        Parts and their ownership, as of :func:`xden1k.rays.path_lengths`.
    mac_cm2_g
        Shape (K, groups): of the material each part is taken for.
    density_g_cm3
        Shape (K,): to start from. Densities move freely here, so that a wrong material does not
        turn the object.
    """
    points = np.concatenate([np.asarray(mesh.vertices) for mesh in meshes])
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    radius_cm = float(np.linalg.norm(points - centre, axis=1).max())
    x, y, z = centre.tolist()
    origin = Pose(centre_cm=(x, y, z))
    parts, unknowns = (
        len(meshes),
        np.concatenate([density_g_cm3, np.ones(len(views)), np.zeros(POSE_UNKNOWNS)]),
    )
    others = np.full(len(views) + POSE_UNKNOWNS, np.inf)
    low, high = (
        np.append(share * density_g_cm3, sign * others)
        for share, sign in zip(DENSITY_SHARES, (-1, 1), strict=True)
    )
    rms, steps = [], 0
    finest = min(min(view.transmission.shape) for view in views) // COARSEST_PX
    for binning, most in BINNINGS:
        if 1 < binning <= finest or binning == BINNINGS[-1][0]:
            level = _Level.of(
                views, beams, meshes, order, mac_cm2_g, origin, binning, points, radius_cm
            )
            rms.append(level.rms(unknowns))
            unknowns, here, taken = _descend(level, unknowns, most, low, high)
            steps += taken
    rms.append(level.rms(unknowns))
    told = here.hessian + 1e-9 * np.diag(here.hessian.diagonal())
    covariance = np.linalg.pinv(told, hermitian=True)
    return PoseFit(
        pose=origin.moved(unknowns[-POSE_UNKNOWNS:]),
        sd=np.sqrt(covariance.diagonal()[-POSE_UNKNOWNS:].clip(min=0)),
        density_g_cm3=unknowns[:parts],
        gain=unknowns[parts:-POSE_UNKNOWNS],
        rms_before=rms[0],
        rms_after=rms[-1],
        steps=steps,
    )


def _descend(
    level: _Level,
    unknowns: Float64[np.ndarray, "u"],
    most: int,
    low: Float64[np.ndarray, "u"],
    high: Float64[np.ndarray, "u"],
) -> tuple[Float64[np.ndarray, "u"], Evaluation, int]:
    """Take damped Gauss-Newton steps; a try that fails costs two renderings, no derivative."""
    damping, steps = FIRST_DAMPING, 0
    here = level.evaluate(unknowns)
    for _ in range(most):
        for _ in range(MOST_TRIES):
            ahead = _ahead(unknowns, here, damping, low, high)
            loss = level.loss(ahead)
            if loss < here.loss:
                break
            damping *= 10
        else:
            break
        steps += 1
        gained = here.loss - loss
        damping = max(damping / 10, 1e-6)
        unknowns, here = ahead, level.evaluate(ahead)
        if gained < SETTLED_SHARE * here.loss:
            break
    return unknowns, here, steps


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


@dataclass(frozen=True, slots=True, eq=False)
class _Level:
    """One resolution of the pyramid: what is compared, and how it is rendered."""

    meshes: Sequence[trimesh.Trimesh]
    order: Sequence[int]
    beams: Sequence[ViewBeam]
    mac_cm2_g: Float64[np.ndarray, "k groups"]
    origin: Pose
    binning: int
    masks: Sequence[Mask]
    measured: Sequence[Float64[np.ndarray, "_p"]]
    radius_cm: float

    @classmethod
    def of(
        cls,
        views: Sequence[XRayView],
        beams: Sequence[ViewBeam],
        meshes: Sequence[trimesh.Trimesh],
        order: Sequence[int],
        mac_cm2_g: Float64[np.ndarray, "k groups"],
        origin: Pose,
        binning: int,
        points: Float[np.ndarray, "n 3"],
        radius_cm: float,
    ) -> _Level:
        """Average images, and compare them around the object."""
        masks, measured = [], []
        for view in views:
            image, known = binned(view, binning)
            mask = np.zeros_like(known)
            window = _window(view.geometry, points, binning)
            mask[window] = known[window]
            masks.append(mask)
            measured.append(image[mask].astype(np.float64))
        return cls(meshes, order, beams, mac_cm2_g, origin, binning, masks, measured, radius_cm)

    @property
    def parts(self) -> int:
        return len(self.meshes)

    def evaluate(self, unknowns: Float64[np.ndarray, "u"]) -> Evaluation:
        """Sum of squares, large ones tempered, with priors; and half its derivatives."""
        mean, precision = self._prior()
        gradient, hessian = (unknowns - mean) * precision, np.diag(precision)
        loss = float(gradient @ (unknowns - mean))
        for number, seen in enumerate(self.measured):
            model, jacobian = self._view(unknowns, number)
            residuals, scaled = (model - seen) / PIXEL_SD, jacobian / PIXEL_SD
            loss += self._tempered(residuals)
            share = self._share * HUBER / np.maximum(np.abs(residuals), HUBER)
            weighted = scaled * share[:, None]
            gradient = gradient + weighted.T @ residuals
            hessian = hessian + weighted.T @ scaled
        return Evaluation(loss, gradient, hessian, ())

    def loss(self, unknowns: Float64[np.ndarray, "u"]) -> float:
        """Sum of :meth:`evaluate` alone."""
        mean, precision = self._prior()
        squares = float(((unknowns - mean) ** 2 * precision).sum())
        return squares + sum(map(self._tempered, self._residuals(unknowns)))

    def _tempered(self, residuals: Float64[np.ndarray, "n"]) -> float:
        size = np.abs(residuals)
        squares = np.where(size <= HUBER, size**2, 2 * HUBER * size - HUBER**2)
        return self._share * float(squares.sum())

    @property
    def _share(self) -> float:
        return min(1.0, WORTH / max(sum(map(len, self.measured)), 1))

    def _residuals(self, unknowns: Float64[np.ndarray, "u"]) -> list[Float64[np.ndarray, "_n"]]:
        """Model less measurement of each view, in standard deviations."""
        density, gains, pose = self._split(unknowns)
        return [
            (gain * self._render(number, density, pose, slopes=False)[0] - seen) / PIXEL_SD
            for number, (seen, gain) in enumerate(zip(self.measured, gains.tolist(), strict=True))
        ]

    def rms(self, unknowns: Float64[np.ndarray, "u"]) -> float:
        """Root mean square residual of transmission."""
        return PIXEL_SD * float(np.sqrt((np.concatenate(self._residuals(unknowns)) ** 2).mean()))

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
        views = len(self.beams)
        sds = [ROTATION_SD] * 3 + [SHIFT_SD_CM] * 3 + [ROW_SHIFT_SD_CM]
        sd = np.concatenate([np.full(self.parts, np.inf), np.full(views, GAIN_SD), sds])
        mean = np.concatenate([np.zeros(self.parts), np.ones(views), np.zeros(POSE_UNKNOWNS)])
        return mean, sd**-2.0

    def _view(
        self, unknowns: Float64[np.ndarray, "u"], number: int
    ) -> tuple[Float64[np.ndarray, "_p"], Float64[np.ndarray, "_p u"]]:
        """Image of a view, and its derivatives by all unknowns."""
        density, gains, pose = self._split(unknowns)
        gain = gains[number]
        model, slopes = self._render(number, density, pose, slopes=True)
        jacobian = np.zeros((len(model), len(unknowns)))
        jacobian[:, : self.parts] = gain * slopes
        jacobian[:, self.parts + number] = model
        reach = STEPS_CM * self.binning
        deltas = np.array([reach / self.radius_cm] * 3 + [reach] * 4)
        for index in range(POSE_UNKNOWNS if number == 1 else POSE_UNKNOWNS - 1):
            delta = np.zeros(POSE_UNKNOWNS)
            delta[index] = deltas[index]
            ahead, behind = (
                self._render(number, density, there, slopes=False)[0]
                for there in (pose + delta, pose - delta)
            )
            place = self.parts + len(gains) + index
            jacobian[:, place] = gain * (ahead - behind) / (2 * deltas[index])
        return gain * model, jacobian

    def _render(
        self,
        number: int,
        density: Float64[np.ndarray, "k"],
        pose: Float64[np.ndarray, "7"],
        *,
        slopes: bool,
    ) -> tuple[Float64[np.ndarray, "_p"], Float64[np.ndarray, "_p k"]]:
        """Transmission of the compared pixels, and its derivatives by density if wanted."""
        beam, mask = self.beams[number], self.masks[number]
        geometry = posed(beam.geometry, self.origin.moved(pose), shifted_rows=number == 1)
        lengths = path_lengths(
            self.meshes, self.order, coarse(geometry, self.binning), max(self.binning // 2, 2)
        )
        count, rays, parts = lengths.lengths_cm.shape
        transmission, slope = np.empty(count), np.empty((count if slopes else 0, parts))
        kernels.predict(
            lengths.lengths_cm,
            np.full(count, rays),
            self.mac_cm2_g,
            density,
            beam.weights(lengths.pixels, self.binning),
            transmission,
            slope,
        )
        image = np.ones(mask.shape)
        image.flat[lengths.pixels] = transmission
        if not slopes:
            return image[mask], slope
        places = np.cumsum(mask) - 1
        inside = mask.flat[lengths.pixels]
        compared = np.zeros((int(mask.sum()), parts))
        compared[places[lengths.pixels[inside]]] = slope[inside]
        return image[mask], compared


def _window(
    geometry: ViewGeometry, points: Float[np.ndarray, "n 3"], binning: int
) -> tuple[slice, slice]:
    """Rows and columns of the binned image around the object, and some air."""
    places = coarse(geometry, binning).project(points)[:, 1::-1]
    margin = 0.08 * np.ptp(places, axis=0).max() + 4
    low = np.floor(places.min(axis=0) - margin).astype(int).clip(min=0)
    high = (np.ceil(places.max(axis=0) + margin).astype(int) + 1).clip(min=0)
    return slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1]))
