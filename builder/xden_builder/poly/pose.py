"""Stage 3 of the fit: meshes onto their shadows, in the poses the radiographs agree with best.

Comes from :mod:`start`, leads to :mod:`samples`. The unknowns of the poses (seven for two views
that share one) and the size of the object beside its meshes are found by Gauss-Newton steps,
together with the densities, a gain and a share of glare of each view, on images averaged over
8 x 8, 4 x 4 and 2 x 2 pixels (:mod:`pyramid`), the middle ones where the first leave much or a view
was turned. Where the last of them leave much, something may have no mesh, and it is gone on by what
neighbouring pixels differ by (:mod:`edges`), where no view was turned also from the pose of the
files, from which the light itself may have led away. Turned views are laid onto their shadows one
by one before (:mod:`alignment`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import cycle, islice
from typing import Any, Final

import numpy as np
import trimesh
from jaxtyping import Float64

from xden1k.values.arrays import Mask
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.poly.alignment import aligned
from xden_builder.poly.apart import Apart, views_apart
from xden_builder.poly.descent import Descent, descend
from xden_builder.poly.edges import descend_by_edges, edge_doubt, sought_by_edges
from xden_builder.poly.model.beam import ViewBeam
from xden_builder.poly.model.frames import Pose
from xden_builder.poly.model.poses import RIGID, Poses
from xden_builder.poly.model.radiograph import gain_prior
from xden_builder.poly.model.size import SIZE_SDS_MOST, Size
from xden_builder.poly.model.stray import GLARE, NO_STRAY
from xden_builder.poly.pyramid import LOST_FROM, RAYS, Level
from xden_builder.poly.remains import all_left, doubt, much_left
from xden_builder.poly.settings import PolySettings
from xden_builder.poly.start import Guess
from xden_builder.poly.sureness import Sureness, how_sure
from xden_builder.poly.target import Bounds, Target, Window, window

__all__ = ["Placement", "PoseFit", "find_pose", "refine_pose"]

BINNINGS: Final = ((8, 2), (4, 2), (2, 5))
"""Pixels averaged along each side, and how often derivatives are taken on such images."""
TURNED_BINNINGS: Final = ((8, 3), (4, 3), (2, 4))
"""The same where a view has a pose of its own, farther off."""
SMALL_PX: Final = 384
"""Of images that are smaller half as many pixels are averaged, where no view was turned."""
SCANNER_SD: Final = 0.001
"""Relative, of a size by a scanner whose distances are as told: half a millimetre in half a metre
(assumed)."""
COARSE_RAYS: Final = 10_000
"""Through the object in a view, about, on all images but the last, unless a view was turned."""
LAST_RAYS: Final = 90_000
"""Through the object in a view, about, on the last images: thin metal is missed by a third of them.
"""
EDGE_SDS, LAST_EDGE_SD = (0.05, 0.02, 0.01), 0.004
"""Of differences of neighbouring pixels' logarithms where something may have no mesh, one after the
other, and of those that the best pose ends with."""
REACHES: Final = ((0.02, 0.003), (0.05, 0.001), (0.01, 0.001))
"""How far it is looked around that pose and how closely, one after the other: radians, and as a
share of the radius."""
LOOKS, MORE_LOOKS = 2, 8
"""How often, while that leaves less: by the first of them; and by all by turns where very much is
left."""
FEW_EDGES: Final = 0.6
"""What neighbouring pixels may differ by (:func:`xden_builder.poly.edges.edge_doubt`) where light
has led near the right pose already, whatever it leaves: nowhere else is begun then."""
VERY_MUCH: Final = 4.0
"""Times what is much."""
COARSEST_PX: Final = 32
"""Images are never smaller."""


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Where the object stands before the scanner.

    Parameters
    ----------
    guess
        What it was found with, at the object's size; its densities are those found along with it.
    fit
        None where it was not sought.
    size
        Of the object, beside its meshes.
    geometries
        Of the views, in the frame of the meshes, after the pose.
    """

    guess: Guess
    fit: PoseFit | None
    size: Size
    geometries: tuple[ViewGeometry, ...]


def find_pose(guess: Guess, settings: PolySettings, *, begun_again: bool = True) -> Placement:
    """Move the scanner so that meshes at rest look as the object did, if the pose is sought.

    They are given its size, if that is sought. ``begun_again`` as of :func:`refine_pose`.
    """
    scene = guess.scene
    geometries = [view.geometry for view in scene.views]
    untold = Size(1.0, float(np.hypot(scene.size_sd, scene.scale_sd)), np.zeros(3))
    if not settings.pose:
        return Placement(guess, None, untold, tuple(geometries))
    fit = refine_pose(
        scene.views,
        scene.saturated,
        [gain_prior(bounds) for bounds in scene.gains],
        scene.outlines.beams,
        scene.space.regions,
        guess.outline_stand_ins.mac_cm2_g,
        guess.density_g_cm3,
        scene.turned,
        size_sd=settings.size * scene.size_sd,
        glare=GLARE if settings.stray else NO_STRAY,
        begun_again=begun_again,
    )
    size = untold
    if fit.size is not None:
        size = replace(fit.size, sd=float(np.hypot(fit.size.sd, scene.scale_sd)))
    return Placement(
        replace(
            guess,
            scene=scene.moved(size.enlarged),
            density_g_cm3=fit.density_g_cm3 / size.factor,
        ),
        fit,
        size,
        tuple(
            fit.poses.placed(number, geometry, fit.unknowns)
            for number, geometry in enumerate(geometries)
        ),
    )


@dataclass(frozen=True, slots=True, eq=False)
class PoseFit:
    """Result of :func:`refine_pose`.

    Parameters
    ----------
    poses, unknowns
        The object's, and the best values of their unknowns.
    covariance
        Of the unknowns, radians and cm.
    density_g_cm3, gain
        Fitted along with it, coarsely, and for ways through the meshes as they are.
    rms_before, rms_after
        Root mean square residual of transmission on the coarsest and the finest images used.
    doubt, left
        What the finest leave, as of :mod:`xden_builder.poly.remains`, the latter by the usual
        scale: light that may be lost in what has no mesh hardly counts.
    edges
        What neighbouring pixels of the finest differ by, and light that the model lacks, as of
        :func:`xden_builder.poly.edges.edge_doubt`.
    apart
        How the object is before one view beside how it is before the others, as of
        :func:`xden_builder.poly.apart.views_apart`; None where that does not tell.
    growth_by_light
        Logarithm of the size that light alone would have, where differences of pixels tell it.
    """

    poses: Poses
    unknowns: Float64[np.ndarray, "p"]
    covariance: Float64[np.ndarray, "p p"]
    density_g_cm3: Float64[np.ndarray, "k"]
    gain: Float64[np.ndarray, "v"]
    rms_before: float
    rms_after: float
    doubt: float
    left: float
    edges: float
    apart: Apart | None = None
    growth_by_light: float | None = None

    @property
    def sd(self) -> Float64[np.ndarray, "p"]:
        """Standard deviations of the unknowns, radians and cm."""
        return np.asarray(np.sqrt(self.covariance.diagonal().clip(min=0)))

    def how_sure(self, meshes: Sequence[trimesh.Trimesh]) -> Sureness:
        """Tell how far the shared pose may be off, by parts at rest."""
        places = [*self.poses.places(self._telling)[:RIGID], *self.poses.size_places]
        covariance = np.zeros((RIGID + 1, RIGID + 1))
        own = np.arange(len(places))
        covariance[np.ix_(own, own)] = self.covariance[np.ix_(places, places)]
        return how_sure(meshes, np.array(self.poses.origin.centre_cm), covariance)

    @property
    def pose(self) -> Pose:
        """Pose that views share, and the row shift of the second if it is one of them."""
        return self.poses.of(self._telling, self.unknowns)

    @property
    def size(self) -> Size | None:
        """Of the object, beside its meshes; None where it was not sought."""
        if not self.poses.sized:
            return None
        (place,) = self.poses.size_places
        factor, centre_cm = np.exp(self.unknowns[place]), np.array(self.poses.origin.centre_cm)
        light = self.growth_by_light
        by_light = None if light is None else float(np.exp(light))
        sd = float(np.hypot(self.sd[place], SCANNER_SD))
        return Size(float(factor), sd, centre_cm, by_light)

    @property
    def _telling(self) -> int:
        """Number of the view that shows all of the shared pose."""
        return 0 if self.poses.turned[1] else 1

    def to_dict(self, names: Sequence[str]) -> dict[str, Any]:
        """Values for JSON: the shared pose, and those of all views if that does not tell them.

        Parameters
        ----------
        names
            Of the views.
        """
        each = {name: self._values(number) for number, name in enumerate(names)}
        apart = {}
        if (one := self.apart) is not None:
            apart = {"apart": one._asdict() | {"view": names[one.view]}}
        told = self.poses.turned == (False, False)
        return (
            self._values(self._telling)
            | {"rms_before": self.rms_before, "rms_after": self.rms_after}
            | apart
            | ({} if told else {"views": each})
        )

    def _values(self, number: int) -> dict[str, Any]:
        """Pose in a view, and standard deviations of its unknowns."""
        sd = self.sd[self.poses.places(number)]
        return self.poses.of(number, self.unknowns).to_dict() | {"sd": sd.tolist()}


def refine_pose(
    views: Sequence[XRayView],
    saturated: Sequence[Mask],
    gains: Sequence[tuple[float, float]],
    beams: Sequence[ViewBeam],
    regions: Sequence[trimesh.Trimesh],
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
    turned: Sequence[bool] = (),
    *,
    size_sd: float = 0.0,
    glare: tuple[float, float, float, float] = GLARE,
    begun_again: bool = True,
) -> PoseFit:
    """Find the pose in which meshes and radiographs agree best.

    Parameters
    ----------
    views, saturated, gains, beams
        The radiographs, which of their pixels are known from below alone, means and standard
        deviations of their gains, and what reaches their panels.
    regions
        What is each part's: they share no space.
    mac_cm2_g
        Shape (K, groups): of the material each part is taken for.
    density_g_cm3
        Shape (K,): to start from. Densities move freely here, so that a wrong material does not
        turn the object.
    turned
        By view: whether the object was turned by hand before it; none by default.
    size_sd
        Standard deviation of the logarithm of the object's size over that of its meshes; with 0 it
        is no unknown.
    glare
        Mean, standard deviation, least and most of the share of a view's light that spreads.
    begun_again
        Whether a descent that leaves much is begun once more at the pose of the files, where no
        view was turned, and its end looked around without derivatives.
    """
    target = Target(views, saturated, gains, beams, regions, mac_cm2_g, glare)
    x, y, z = target.centre_cm.tolist()
    poses = Poses(tuple(turned) or (False,) * len(views), Pose(centre_cm=(x, y, z)), size_sd)
    starts = [target.start(density_g_cm3, np.zeros(poses.count))]
    if any(poses.turned):
        starts = aligned(target, poses, density_g_cm3)
    low, high = target.bounds(density_g_cm3, poses.count)
    if poses.sized:
        low[-1], high[-1] = -SIZE_SDS_MOST * size_sd, SIZE_SDS_MOST * size_sd
    best = rms_before = None
    unturned, left_much = not any(poses.turned), True
    binnings = _binnings(views, not unturned)
    for number, (binning, most) in enumerate(binnings, start=1):
        last = number == len(binnings)
        if unturned and not left_much and not last:
            continue
        rays = LAST_RAYS if last else COARSE_RAYS if unturned else RAYS
        level = _level(target, poses, starts[0], binning, rays, last=last)
        if best is not None and unturned:
            believed = level.believed(level.residuals(starts[0]))
            starts = [min(starts[0], _as_told(starts[0], poses), key=believed.loss_at)]
        ends = [descend(level, start, most, low, high) for start in starts]
        if rms_before is None:
            rms_before = level.rms(ends[0].before)
        best = min(ends, key=lambda end: level.loss(end.unknowns, end.residuals))
        starts = [best.unknowns]
        left_much = much_left(level, best.unknowns, best.residuals)
    assert best is not None
    assert rms_before is not None
    growth_by_light = None
    if left_much:
        growth_by_light = float(best.unknowns[-1]) if poses.sized else None
        told = _as_told(best.unknowns, poses) if begun_again and unturned else None
        coarse = [binning for binning, _ in binnings[:-1]]
        levels = [_level(target, poses, starts[0], each, RAYS, last=False) for each in coarse]
        best = _by_edges([*levels, level], best, told, (low, high))
    unknowns, there, _, residuals, slopes = best
    told = there.hessian + 1e-9 * np.diag(there.hessian.diagonal())
    covariance = np.linalg.pinv(told, hermitian=True)
    return PoseFit(
        poses=poses,
        unknowns=unknowns[-poses.count :],
        covariance=covariance[-poses.count :, -poses.count :],
        density_g_cm3=unknowns[: len(regions)],
        gain=unknowns[len(regions) :][: len(views)],
        rms_before=rms_before,
        rms_after=level.rms(residuals),
        doubt=doubt(level, unknowns, residuals),
        left=all_left(level, unknowns, residuals),
        edges=edge_doubt(level, unknowns),
        apart=views_apart(level, unknowns, (low, high), residuals, slopes),
        growth_by_light=growth_by_light,
    )


def _level(
    target: Target,
    poses: Poses,
    unknowns: Float64[np.ndarray, "u"],
    binning: int,
    rays: int,
    *,
    last: bool,
) -> Level:
    """Average the images, and say how they are compared.

    On the last ones light may be lost, and images are believed as far as they are explained; not
    before: far off, an object's own shadow seems another's. Before, differences are forward ones.
    """
    windows = _windows(target, poses, unknowns[-poses.count :], binning)
    level = Level.of(target, poses, windows, binning, rays=rays)
    if last:
        return replace(level, lost_from=LOST_FROM, weighs=True)
    return replace(level, forward=True)


def _by_edges(
    levels: Sequence[Level],
    end: Descent,
    told: Float64[np.ndarray, "u"] | None,
    bounds: Bounds,
) -> Descent:
    """Go on by differences of neighbouring pixels, from an end and, if it is told, another pose.

    From that on the last two images and on the last three: a thin object is lost by the latter, one
    that is far off by the former; and, since all these lead away from where it was found already,
    by small differences of the last images alone. Then it is looked around the best without
    derivatives; poses that are only told from each other, for which no other is told, are left
    where these led. Where differences are few at the end already, it is gone on from there alone,
    on the last images.
    """
    level, starts = levels[-1], [(end.unknowns, levels[-2:])]
    ends = [end.unknowns]
    differing = partial(edge_doubt, level)
    if differing(end.unknowns) < FEW_EDGES:
        starts, told = [(end.unknowns, [level])], None
    if told is not None:
        ends.append(descend_by_edges(level, told, EDGE_SDS[-1:], bounds))
        starts += [(told, levels[-2:])]
        starts += [(told, levels[-3:])] if len(levels) > 2 else []
    for unknowns, finer in starts:
        for each in finer:
            unknowns = descend_by_edges(each, unknowns, EDGE_SDS, bounds)
        ends.append(unknowns)
    best = min(ends, key=differing)
    if told is not None:
        very_much = much_left(level, end.unknowns, end.residuals, VERY_MUCH)
        reaches, looks = (REACHES, MORE_LOOKS) if very_much else (REACHES[:1], LOOKS)
        best = _looked_around(levels, best, bounds, reaches, looks)
    best = min(best, descend_by_edges(level, best, [LAST_EDGE_SD], bounds), key=differing)
    residuals, slopes = level.residuals_and_slopes(best)
    there = level.believed(residuals).evaluate(best, residuals, slopes)
    return Descent(best, there, end.before, residuals, slopes)


def _looked_around(
    levels: Sequence[Level],
    best: Float64[np.ndarray, "u"],
    bounds: Bounds,
    reaches: Sequence[tuple[float, float]],
    looks: int,
) -> Float64[np.ndarray, "u"]:
    """Look around a pose without derivatives, so often at most, until no reach leaves less."""
    level, in_vain = levels[-1], 0
    least = edge_doubt(level, best)
    for reach in islice(cycle(reaches), looks):
        around = sought_by_edges(levels[-2:][0], best, EDGE_SDS[1], reach, bounds)
        ahead = descend_by_edges(level, around, EDGE_SDS[1:], bounds)
        left = edge_doubt(level, ahead)
        if left < least:
            best, least, in_vain = ahead, left, 0
        else:
            in_vain += 1
        if in_vain == len(reaches):
            break
    return best


def _as_told(unknowns: Float64[np.ndarray, "u"], poses: Poses) -> Float64[np.ndarray, "u"]:
    """Go back to the pose of the files: coarse images lead astray what is thin or not all there."""
    return np.concatenate([unknowns[: -poses.count], np.zeros(poses.count)])


def _binnings(views: Sequence[XRayView], turned: bool) -> list[tuple[int, int]]:
    """Binnings for images of a size, and how often derivatives are taken on each."""
    binnings: Sequence[tuple[int, int]] = TURNED_BINNINGS if turned else BINNINGS
    smallest = min(min(view.transmission.shape) for view in views)
    if smallest < SMALL_PX and not turned:
        binnings = tuple((binning // 2, most) for binning, most in binnings)
    coarsest = smallest // COARSEST_PX
    return [each for each in binnings[:-1] if each[0] <= coarsest] + [binnings[-1]]


def _windows(
    target: Target, poses: Poses, vector: Float64[np.ndarray, "p"], binning: int
) -> list[Window]:
    """Where each view is expected to show the object: as told, or as far as is found if turned."""
    return [
        window(
            poses.geometry(number, view.geometry, vector) if turned else view.geometry,
            target.points_cm,
            binning,
        )
        for number, (view, turned) in enumerate(zip(target.views, poses.turned, strict=True))
    ]
