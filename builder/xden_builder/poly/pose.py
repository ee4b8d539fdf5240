"""Meshes onto their shadows: the rigid pose of an object and the relative height of its views.

Shifts of both images across the beam are translations of the object, but for one: rows of the two
views may disagree. That makes seven unknowns. They are found by Gauss-Newton steps together with
the densities and a gain of each view, on images averaged over 4 x 4 and then 2 x 2 pixels.
Derivatives by pose are central differences of whole renderings, since outlines move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float, Float64
from scipy.spatial.transform import Rotation

from xden1k.arrays import Image, Mask, Vec3
from xden1k.rays import path_lengths
from xden1k.views import ViewGeometry, XRayView
from xden_builder.fit.box import box_minimum
from xden_builder.poly import kernels
from xden_builder.poly.beam import ViewBeam
from xden_builder.poly.settings import HUBER

__all__ = ["POSE_UNKNOWNS", "Pose", "PoseFit", "binned", "coarse", "posed", "refine_pose"]

POSE_UNKNOWNS: Final = 7
ROTATION_SD: Final = 0.03
SHIFT_SD_CM: Final = 0.3
ROW_SHIFT_SD_CM: Final = 0.05
"""How far meshes and images are expected to disagree: 2 degrees, 3 mm, half a millimetre."""
STEPS_CM: Final = 0.02
"""Of a central difference at full resolution, times the binning; rotations move the rim as far."""
PIXEL_SD: Final = 0.01
MOST_STEPS: Final = 6
SETTLED_CM: Final = 0.002
WORTH: Final = 400.0
"""Independent observations that all pixels together are worth: their errors hang together."""


@dataclass(frozen=True, slots=True)
class Pose:
    """How the object stands on the scanner, against the frame of its meshes.

    A point x of a mesh stands at R (x - centre) + centre + shift.

    Parameters
    ----------
    rotation_rad
        Rotation vector.
    shift_cm
        Translation.
    row_shift_cm
        By which the second view's panel is displaced along its rows' step, beside the file's word.
    """

    rotation_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shift_cm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    row_shift_cm: float = 0.0

    @property
    def vector(self) -> Float64[np.ndarray, "7"]:
        """All seven unknowns."""
        return np.array([*self.rotation_rad, *self.shift_cm, self.row_shift_cm])

    @classmethod
    def of(cls, vector: Float[np.ndarray, "7"]) -> Pose:
        """Take the unknowns back."""
        rx, ry, rz, x, y, z, row = vector.tolist()
        return cls((rx, ry, rz), (x, y, z), row)


@dataclass(frozen=True, slots=True, eq=False)
class PoseFit:
    """Result of :func:`refine_pose`.

    Parameters
    ----------
    pose, centre_cm
        The best one, and what it turns about.
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
    centre_cm: Vec3
    sd: Float64[np.ndarray, "7"]
    density_g_cm3: Float64[np.ndarray, "k"]
    gain: Float64[np.ndarray, "v"]
    rms_before: float
    rms_after: float
    steps: int


def posed(
    geometry: ViewGeometry, pose: Pose, centre_cm: Vec3, *, shifted_rows: bool
) -> ViewGeometry:
    """Move a scanner so that meshes at rest look like meshes in a pose.

    Parameters
    ----------
    geometry
        Where the scanner file says the panel is.
    pose
        Of the object.
    centre_cm
        What it turns about.
    shifted_rows
        Whether the row shift is this view's.
    """
    back = Rotation.from_rotvec(pose.rotation_rad).as_matrix().T

    def point(place: Vec3) -> Vec3:
        return np.asarray(back @ (place - centre_cm - np.array(pose.shift_cm)) + centre_cm)

    row = geometry.row_step_cm
    slide = pose.row_shift_cm * row / np.linalg.norm(row) if shifted_rows else np.zeros(3)
    return replace(
        geometry,
        pixel00_cm=point(geometry.pixel00_cm + slide),
        column_step_cm=back @ geometry.column_step_cm,
        row_step_cm=back @ row,
        source_cm=None if geometry.source_cm is None else point(geometry.source_cm),
        direction=None if geometry.direction is None else back @ geometry.direction,
    )


def coarse(geometry: ViewGeometry, binning: int) -> ViewGeometry:
    """Return the same panel with ``binning * binning`` pixels read as one; a rest is left out."""
    half = (binning - 1) / 2
    return replace(
        geometry,
        pixel00_cm=geometry.pixel00_cm + half * (geometry.column_step_cm + geometry.row_step_cm),
        column_step_cm=binning * geometry.column_step_cm,
        row_step_cm=binning * geometry.row_step_cm,
        shape=(geometry.shape[0] // binning, geometry.shape[1] // binning),
    )


def binned(view: XRayView, binning: int) -> tuple[Image, Mask]:
    """Average transmission over the valid pixels of each bin, and say which bins have any."""
    rows, columns = (size // binning for size in view.transmission.shape)
    cut = (slice(rows * binning), slice(columns * binning))
    shape = (rows, binning, columns, binning)
    valid = view.valid[cut].reshape(shape)
    values = np.where(view.valid, view.transmission, 0)[cut].reshape(shape)
    counts = valid.sum(axis=(1, 3))
    mean = values.sum(axis=(1, 3), dtype=np.float64) / np.maximum(counts, 1)
    return np.where(counts, mean, 1.0).astype(np.float32), counts > 0


@dataclass(frozen=True, slots=True, eq=False)
class _Level:
    """One resolution of the pyramid: what is compared, and how it is rendered."""

    meshes: Sequence[trimesh.Trimesh]
    order: Sequence[int]
    beams: Sequence[ViewBeam]
    mac_cm2_g: Float64[np.ndarray, "k groups"]
    centre_cm: Vec3
    binning: int
    images: Sequence[Image]
    masks: Sequence[Mask]
    windows: Sequence[tuple[slice, slice]]

    def render(
        self, density: Float64[np.ndarray, "k"], pose: Pose, *, slopes: bool
    ) -> tuple[list[Float64[np.ndarray, "_p"]], list[Float64[np.ndarray, "_p k"]]]:
        """Transmission, and its derivatives by density, of the compared pixels of each view."""
        models, derivatives = [], []
        for number in range(len(self.beams)):
            model, slope = self.render_view(number, density, pose, slopes=slopes)
            models.append(model)
            derivatives.append(slope)
        return models, derivatives

    def render_view(
        self, number: int, density: Float64[np.ndarray, "k"], pose: Pose, *, slopes: bool
    ) -> tuple[Float64[np.ndarray, "_p"], Float64[np.ndarray, "_p k"]]:
        """Give the same of one view."""
        beam, window = self.beams[number], self.windows[number]
        geometry = posed(beam.geometry, pose, self.centre_cm, shifted_rows=number == 1)
        lengths = path_lengths(self.meshes, self.order, coarse(geometry, self.binning), 2)
        count, rays, parts = lengths.lengths_cm.shape
        transmission = np.empty(count)
        slope = np.empty((count if slopes else 0, parts))
        kernels.predict(
            lengths.lengths_cm,
            np.full(count, rays),
            self.mac_cm2_g,
            density,
            beam.weights(lengths.pixels, self.binning),
            transmission,
            slope,
        )
        image = np.ones(lengths.shape)
        image.flat[lengths.pixels] = transmission
        mask = self.masks[number][window]
        if not slopes:
            return image[window][mask], slope
        every = np.zeros((*lengths.shape, parts))
        every.reshape(-1, parts)[lengths.pixels] = slope
        return image[window][mask], every[window][mask]

    def measured(self) -> list[Float64[np.ndarray, "_p"]]:
        """Transmission of the compared pixels of each view."""
        return [
            image[window][mask[window]].astype(np.float64)
            for image, mask, window in zip(self.images, self.masks, self.windows, strict=True)
        ]


def refine_pose(
    views: Sequence[XRayView],
    beams: Sequence[ViewBeam],
    meshes: Sequence[trimesh.Trimesh],
    order: Sequence[int],
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
    binnings: Sequence[int] = (4, 2),
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
    binnings
        Pixels averaged along each side, from coarse to fine.
    """
    points = np.concatenate([np.asarray(mesh.vertices) for mesh in meshes])
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    radius = float(np.linalg.norm(points - centre, axis=1).max())
    start = np.concatenate([density_g_cm3, np.ones(len(views)), np.zeros(POSE_UNKNOWNS)])
    state = _State(start, np.zeros(POSE_UNKNOWNS), [], 0)
    for binning in binnings:
        images = [binned(view, binning) for view in views]
        level = _Level(
            meshes,
            order,
            beams,
            mac_cm2_g,
            centre,
            binning,
            [image for image, _ in images],
            [mask for _, mask in images],
            [_window(beam.geometry, points, binning) for beam in beams],
        )
        state = _settle(level, state, radius)
    parts = len(meshes)
    return PoseFit(
        pose=Pose.of(state.unknowns[-POSE_UNKNOWNS:]),
        centre_cm=centre,
        sd=state.sd,
        density_g_cm3=state.unknowns[:parts],
        gain=state.unknowns[parts:-POSE_UNKNOWNS],
        rms_before=state.rms[0],
        rms_after=state.rms[-1],
        steps=state.steps,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    unknowns: Float64[np.ndarray, "u"]
    sd: Float64[np.ndarray, "7"]
    rms: list[float]
    steps: int


def _window(
    geometry: ViewGeometry, points: Float[np.ndarray, "n 3"], binning: int
) -> tuple[slice, slice]:
    """Rows and columns of the binned image around the object, and some air."""
    places = coarse(geometry, binning).project(points)[:, 1::-1]
    margin = 0.08 * np.ptp(places, axis=0).max() + 4
    low = np.floor(places.min(axis=0) - margin).astype(int).clip(min=0)
    high = np.ceil(places.max(axis=0) + margin).astype(int) + 1
    return slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1]))


def _settle(level: _Level, state: _State, radius_cm: float) -> _State:
    """Take damped Gauss-Newton steps at one resolution until the pose stands still."""
    measured = level.measured()
    unknowns, rms, steps = state.unknowns, list(state.rms), state.steps
    parts, views = len(level.meshes), len(level.beams)
    prior_sd = np.concatenate(
        [
            np.full(parts, np.inf),
            np.full(views, 0.05),
            np.full(3, ROTATION_SD),
            np.full(3, SHIFT_SD_CM),
            [ROW_SHIFT_SD_CM],
        ]
    )
    prior_mean = np.concatenate([np.zeros(parts), np.ones(views), np.zeros(POSE_UNKNOWNS)])
    lower = np.concatenate([np.zeros(parts), np.full(views + POSE_UNKNOWNS, -np.inf)])
    delta = STEPS_CM * level.binning * np.array([1 / radius_cm] * 3 + [1.0] * 4)
    share = min(1.0, WORTH / max(sum(len(each) for each in measured), 1))

    def loss_of(point: Float64[np.ndarray, "u"]) -> float:
        models, _ = level.render(point[:parts], Pose.of(point[-POSE_UNKNOWNS:]), slopes=False)
        gains = point[parts : parts + views]
        total = float((((point - prior_mean) / prior_sd) ** 2).sum())
        for model, seen, gain in zip(models, measured, gains.tolist(), strict=True):
            total += share * float(_huber((gain * model - seen) / PIXEL_SD).sum())
        return total

    loss = loss_of(unknowns)
    damping = 1e-3
    hessian = np.eye(len(unknowns))
    for _ in range(MOST_STEPS):
        hessian, gradient, squares = _normal(level, unknowns, measured, delta, share)
        rms.append(squares)
        hessian += np.diag(1 / prior_sd**2)
        gradient += (unknowns - prior_mean) / prior_sd**2
        moved = False
        for _ in range(4):
            scale = 1 / np.sqrt(np.maximum(np.diag(hessian), 1e-12))
            scaled = hessian * np.outer(scale, scale) + damping * np.eye(len(scale))
            step = scale * box_minimum(
                scaled, scale * gradient, (lower - unknowns) / scale, np.full(len(scale), np.inf)
            )
            steps += 1
            ahead = unknowns + step
            new = loss_of(ahead)
            if new < loss:
                unknowns, loss, moved = ahead, new, True
                damping = max(damping / 10, 1e-6)
                break
            damping *= 10
        pose_step = np.abs(step[-POSE_UNKNOWNS:]) * np.array([radius_cm] * 3 + [1.0] * 4)
        if not moved or pose_step.max() < SETTLED_CM * level.binning:
            break
    scale = 1 / np.sqrt(np.maximum(np.diag(hessian), 1e-12))
    covariance = np.linalg.pinv(hessian * np.outer(scale, scale)) * np.outer(scale, scale)
    sd = np.sqrt(np.diag(covariance)[-POSE_UNKNOWNS:].clip(min=0))
    return _State(unknowns, sd, rms, steps)


def _huber(residuals: Float64[np.ndarray, "n"]) -> Float64[np.ndarray, "n"]:
    size = np.abs(residuals)
    return np.where(size <= HUBER, size**2, 2 * HUBER * size - HUBER**2)


def _normal(
    level: _Level,
    unknowns: Float64[np.ndarray, "u"],
    measured: Sequence[Float64[np.ndarray, "_p"]],
    delta: Float64[np.ndarray, "7"],
    share: float,
) -> tuple[Float64[np.ndarray, "u u"], Float64[np.ndarray, "u"], float]:
    """Hessian, half the gradient and the root mean square residual."""
    parts, views = len(level.meshes), len(level.beams)
    density, pose = unknowns[:parts], unknowns[-POSE_UNKNOWNS:]
    models, slopes = level.render(density, Pose.of(pose), slopes=True)
    hessian, gradient = np.zeros((len(unknowns),) * 2), np.zeros(len(unknowns))
    squares, count = 0.0, 0
    for number, (model, slope, seen) in enumerate(zip(models, slopes, measured, strict=True)):
        gain = unknowns[parts + number]
        jacobian = np.zeros((len(seen), len(unknowns)))
        jacobian[:, :parts] = gain * slope
        jacobian[:, parts + number] = model
        for index in range(POSE_UNKNOWNS if number == 1 else POSE_UNKNOWNS - 1):
            ends = []
            for sign in (1, -1):
                there = pose.copy()
                there[index] += sign * delta[index]
                ends.append(level.render_view(number, density, Pose.of(there), slopes=False)[0])
            jacobian[:, parts + views + index] = gain * (ends[0] - ends[1]) / (2 * delta[index])
        residuals = (gain * model - seen) / PIXEL_SD
        weights = share * np.minimum(1, HUBER / np.maximum(np.abs(residuals), 1e-12))
        weighted = jacobian * (weights / PIXEL_SD)[:, None]
        hessian += weighted.T @ jacobian / PIXEL_SD
        gradient += weighted.T @ residuals
        squares += float(((gain * model - seen) ** 2).sum())
        count += len(seen)
    return hessian, gradient, float(np.sqrt(squares / max(count, 1)))
