"""Stage 3 of the fit: meshes onto their shadows, in the pose both radiographs agree with best.

Comes from :mod:`start`, leads to :mod:`samples`. Seven unknowns are found by Gauss-Newton steps,
together with the densities and a gain of each view, on images averaged over 8 x 8, 4 x 4 and
2 x 2 pixels (:mod:`pyramid`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float64

from xden1k.values.arrays import Mask
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.poly.model.beam import ViewBeam
from xden_builder.poly.model.frames import POSE_UNKNOWNS, Pose, posed
from xden_builder.poly.model.radiograph import gain_prior
from xden_builder.poly.pyramid import Level, descend
from xden_builder.poly.settings import PolySettings
from xden_builder.poly.start import Guess

__all__ = ["Placement", "PoseFit", "find_pose", "refine_pose"]

BINNINGS: Final = ((8, 2), (4, 1), (2, 1))
"""Pixels averaged along each side, and how often derivatives are taken on such images."""
DENSITY_SHARES: Final = (0.3, 10.0)
"""Least and most density in shares of the first guess: a part that fades away has no pose."""
COARSEST_PX: Final = 32
"""Images are never smaller."""


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Where the object stands before the scanner.

    Parameters
    ----------
    guess
        What it was found with; its densities are those found along with the pose.
    fit
        None where it was not sought.
    geometries
        Of the views, in the frame of the meshes, after the pose.
    """

    guess: Guess
    fit: PoseFit | None
    geometries: tuple[ViewGeometry, ...]


def find_pose(guess: Guess, settings: PolySettings) -> Placement:
    """Move the scanner so that meshes at rest look as the object did, if the pose is sought."""
    scene = guess.scene
    geometries = [view.geometry for view in scene.views]
    if not settings.pose:
        return Placement(guess, None, tuple(geometries))
    fit = refine_pose(
        scene.views,
        scene.saturated,
        [gain_prior(bounds) for bounds in scene.gains],
        scene.outlines.beams,
        scene.meshes,
        scene.order,
        guess.outline_stand_ins.mac_cm2_g,
        guess.density_g_cm3,
    )
    return Placement(
        replace(guess, density_g_cm3=fit.density_g_cm3),
        fit,
        tuple(
            posed(geometry, fit.pose, shifted_rows=number == 1)
            for number, geometry in enumerate(geometries)
        ),
    )


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
    """

    pose: Pose
    sd: Float64[np.ndarray, "7"]
    density_g_cm3: Float64[np.ndarray, "k"]
    gain: Float64[np.ndarray, "v"]
    rms_before: float
    rms_after: float


def refine_pose(
    views: Sequence[XRayView],
    saturated: Sequence[Mask],
    gains: Sequence[tuple[float, float]],
    beams: Sequence[ViewBeam],
    meshes: Sequence[trimesh.Trimesh],
    order: Sequence[int],
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
) -> PoseFit:
    """Find the pose in which meshes and radiographs agree best.

    Parameters
    ----------
    views, saturated, gains, beams
        The radiographs, which of their pixels are known from below alone, means and standard
        deviations of their gains, and what reaches their panels.
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
    parts = len(meshes)
    means = [mean for mean, _ in gains]
    unknowns = np.concatenate([density_g_cm3, means, np.zeros(POSE_UNKNOWNS)])
    others = np.full(len(views) + POSE_UNKNOWNS, np.inf)
    low, high = (
        np.append(share * density_g_cm3, sign * others)
        for share, sign in zip(DENSITY_SHARES, (-1, 1), strict=True)
    )
    coarsest = min(min(view.transmission.shape) for view in views) // COARSEST_PX
    used = [each for each in BINNINGS[:-1] if each[0] <= coarsest] + [BINNINGS[-1]]
    rms_before = None
    for binning, most in used:
        level = Level.of(
            views,
            saturated,
            gains,
            beams,
            meshes,
            order,
            mac_cm2_g,
            origin,
            binning,
            points,
            radius_cm,
        )
        if rms_before is None:
            rms_before = level.rms(unknowns)
        unknowns, hessian = descend(level, unknowns, most, low, high)
    assert rms_before is not None
    told = hessian + 1e-9 * np.diag(hessian.diagonal())
    covariance = np.linalg.pinv(told, hermitian=True)
    return PoseFit(
        pose=origin.moved(unknowns[-POSE_UNKNOWNS:]),
        sd=np.sqrt(covariance.diagonal()[-POSE_UNKNOWNS:].clip(min=0)),
        density_g_cm3=unknowns[:parts],
        gain=unknowns[parts:-POSE_UNKNOWNS],
        rms_before=rms_before,
        rms_after=level.rms(unknowns),
    )
