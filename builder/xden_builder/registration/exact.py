"""Poses judged by the parts' exact path lengths and the tube's spectrum, densities left free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden1k.rays import PathLengths
from xden1k.values.views import ViewGeometry
from xden_builder.capture import Capture
from xden_builder.fit import huber
from xden_builder.poly.descent import descend
from xden_builder.poly.edges import descend_by_edges, edge_doubt, sought_by_edges
from xden_builder.poly.model.frames import Pose, coarse
from xden_builder.poly.model.poses import Poses
from xden_builder.poly.model.radiograph import gain_prior
from xden_builder.poly.model.size import SIZE_SDS_MOST
from xden_builder.poly.pyramid import LOST_FROM, PIXEL_SD, Level, subrays_of
from xden_builder.poly.scene import Scene, set_scene
from xden_builder.poly.settings import PolySettings
from xden_builder.poly.start import first_guess
from xden_builder.poly.target import Averaged, Bounds, Target, Window, window
from xden_builder.registration.body import Body
from xden_builder.registration.middles import own_shifts, room_of
from xden_builder.registration.outlines import OUTLINE_PX, apart_share, lit
from xden_builder.registration.placement import Found, RigidPlacement
from xden_builder.registration.reduced import binning_of, reduced, widest_px
from xden_builder.registration.shadow import Shadow

__all__ = ["COARSE_PX", "Judge", "side_of"]

COARSE_PX: Final = 80
"""Width of the shadow, in averaged pixels, where some poses are compared."""
BINNING: Final = 2
"""Of the pixels that the images are averaged to, but for small shadows."""
SPARSE: Final = 1 / 32
"""Of the square of the width asked for: a thin shadow of no more pixels is small, too."""
STEP_PX: Final = 0.6
"""Of a central difference, in compared pixels: a tenth feels how few rays a pixel has, and leads
into the next of many small troughs."""
FEW_RAYS: Final = 10_000
"""Through the object in a view, about: enough for images of few pixels, and for derivatives."""
FEW_SUBRAYS: Final = 2
"""Along each side of a pixel, at most, where many poses are compared."""
DENSITY_STEPS: Final = 2
LEAST_SEEN: Final = 1e-6
"""Light behind a part that is told from none."""
SHARES: Final = (0.01, 30.0)
"""Least and most density in shares of the expected: a label may call aluminium lead."""
DAMPING: Final = 1e-2
EDGE_SDS: Final = (0.1, 0.03)
"""Of differences of neighbouring pixels' logarithms, one after the other."""
SCALE_SD: Final = 0.05
"""Standard deviation of the logarithm of a scale that is sought, beside what was found before."""


@dataclass(frozen=True, slots=True, eq=False)
class Judge:
    """Radiographs of few pixels, and the parts that are to be laid onto them.

    Parameters
    ----------
    scene
        Of the averaged images, with parts as in the files, but of fewer faces.
    mac_cm2_g, density_g_cm3
        Shapes (K, groups) and (K,): of what each part is taken for.
    body, shadows
        What is laid onto them.
    images
        Those of the scene once more averaged, as they are compared.
    around
        Of each view: rows and columns of the shadow's box among the pixels that are compared.
    shadow_px
        How many of these are in shadow, in all views.
    binning
        Of the scene's images to those that are compared.
    side
        Of the radiographs' pixels to those that are compared.
    size_sd
        Standard deviation of the logarithm of the object's size; 0 where it is not sought.
    scaled
        Whether the scale of the meshes is sought too: a size that is found is taken for theirs.
    subrays, slope_subrays
        Rays along each side of a compared pixel, by view, of images and of derivatives.
    incomplete
        Whether light may be lost in what has no mesh. Where it may, wrong poses leave less too.
    """

    scene: Scene
    mac_cm2_g: Float64[np.ndarray, "k groups"]
    density_g_cm3: Float64[np.ndarray, "k"]
    body: Body
    shadows: tuple[Shadow, ...]
    images: tuple[Averaged, ...]
    around: tuple[Window, ...]
    shadow_px: int
    binning: int
    side: int
    size_sd: float
    scaled: bool
    subrays: tuple[int, ...]
    slope_subrays: tuple[int, ...]
    incomplete: bool

    @classmethod
    def of(
        cls,
        capture: Capture,
        shadows: Sequence[Shadow],
        body: Body,
        wide_px: int,
        likely: RigidPlacement,
        *,
        rays: int = FEW_RAYS,
        sized: bool = False,
        incomplete: bool = False,
    ) -> Judge:
        """Average images until the longest shadow is about so many pixels wide.

        What the labels do not tell of the parts is taken from a likely pose.

        Parameters
        ----------
        capture, shadows, body
            What is compared with what.
        wide_px
            Width of the longest shadow.
        likely
            That pose.
        rays
            Through the object in a view, about.
        sized
            Whether the object's size beside its meshes is sought along with its pose; it is anyhow
            where the capture does not tell their scale.
        incomplete
            As of :class:`Judge`.
        """
        small, space, binning = reduced(capture, body.space, shadows, wide_px)
        scene = set_scene(small, space, PolySettings())
        side = side_of(shadows, wide_px)
        shadow_px = [int(shadow.mask.sum()) for shadow in shadows]
        again = side // binning

        def subrays(count: int) -> tuple[int, ...]:
            return tuple(subrays_of(round(each / side**2), again, count) for each in shadow_px)

        guess = first_guess(scene.moved(likely.moved))
        scaled = capture.scale_sought
        return cls(
            scene,
            guess.outline_stand_ins.mac_cm2_g,
            guess.density_g_cm3,
            body,
            tuple(shadows),
            tuple(
                Averaged.of(view, saturated, again)
                for view, saturated in zip(scene.views, scene.saturated, strict=True)
            ),
            tuple(_around(shadow, side) for shadow in shadows),
            max(round(sum(shadow_px) / side**2), 1),
            again,
            side,
            SCALE_SD if scaled else sized * scene.size_sd,
            scaled,
            subrays(rays),
            subrays(FEW_RAYS),
            incomplete,
        )

    @property
    def quick(self) -> Judge:
        """The same by few rays."""
        few = tuple(min(each, FEW_SUBRAYS) for each in self.subrays)
        return replace(self, subrays=few, slope_subrays=few)

    def exchanged(self, order: Sequence[int]) -> Judge:
        """Take each part for what another, of a number, was taken for."""
        places = list(order)
        return replace(
            self, mac_cm2_g=self.mac_cm2_g[places], density_g_cm3=self.density_g_cm3[places]
        )

    def panel(self, number: int) -> ViewGeometry:
        """Of a view, in compared pixels."""
        return coarse(self.scene.views[number].geometry, self.binning)

    @property
    def pixel_cm(self) -> float:
        """Side of a compared pixel of the first view, on its panel."""
        view = self.scene.views[0].geometry
        return self.binning * float(np.linalg.norm(view.column_step_cm))

    def lac_per_cm(self, found: Found) -> Float64[np.ndarray, "k"]:
        """Give each part the attenuation that explains the images, whatever its label.

        Of what comes through its mean chord, 4 V / S by Cauchy's formula: there alone curves of
        unlike materials that explain one shadow agree. How dark is darker than
        :data:`LEAST_SEEN`, no image tells.

        Parameters
        ----------
        found
            A pose that has moved along a derivative: from what labels let expect, densities alone
            may go the wrong way.
        """
        light = self.scene.outlines.groups.weights.mean(axis=0)
        chords_cm = np.array([4 * abs(mesh.volume) / mesh.area for mesh in self.body.meshes])
        depth = self.mac_cm2_g * (found.density_g_cm3 * chords_cm)[:, None]
        return np.asarray(-np.log(np.exp(-depth) @ light + LEAST_SEEN) / chords_cm)

    def fixed(self, placement: RigidPlacement) -> Found:
        """Find densities, gains and glare in a pose, and what they leave."""
        return self.anew(Found(placement, np.inf, self.density_g_cm3))

    def elsewhere(self, found: Found, placement: RigidPlacement) -> Found:
        """Find them in another pose, of the same size.

        Turned views are moved as in the pose that was found, or shifted onto their shadows if that
        leaves less: moves may have made up for what was wrong with that pose.
        """
        there = replace(found, placement=placement)
        laid = [self.anew(replace(there, moves={}))] if found.moves else []
        return min([self.anew(there), *laid], key=lambda each: each.loss)

    def anew(self, found: Found) -> Found:
        """Find them once more in a pose that was found, of its size and moves."""
        placement = found.placement
        level, density = self._level(placement)
        pose = self._start(level.poses, found)
        lengths = [level.seen(number, pose) for number in range(len(level.target.beams))]
        unknowns = level.target.start(density, np.empty(0))
        low, high = level.target.bounds(density, 0, SHARES)
        growth, moves = found.growth, found.moves
        best = Found(placement, np.inf, density, growth=growth, moves=moves)
        for _ in range(DENSITY_STEPS + 1):
            loss, gradient, curvature = self._evaluated(level, lengths, unknowns)
            if loss < best.loss:
                density, gains = np.split(unknowns, [level.parts])
                best = replace(best, loss=loss, density_g_cm3=density, gains=gains)
            damped = curvature + np.diag(DAMPING * curvature.diagonal() + 1e-9)
            unknowns = (unknowns - np.linalg.solve(damped, gradient)).clip(low, high)
        return best

    def refined(self, found: Found, derivatives: int) -> Found:
        """Move a pose, and change its densities, along so many derivatives at most."""
        placement = found.placement
        level, start, bounds = self.unknowns(found)
        end = descend(level, start, derivatives, *bounds)
        return self.found(level, placement, end.unknowns, end.residuals)

    def loss_as_found(self, found: Found) -> float:
        """Say what a pose leaves with the densities and all else that were found."""
        level, unknowns, _ = self.unknowns(found)
        return self._loss(level.residuals(unknowns), level)

    def edged(self, found: Found) -> Found:
        """Move a pose by what neighbouring pixels differ by, and say what it leaves of that."""
        level, unknowns, bounds = self.unknowns(found)
        unknowns = descend_by_edges(level, unknowns, EDGE_SDS, bounds)
        there = self.found(level, found.placement, unknowns, level.residuals(unknowns))
        return replace(there, edges=edge_doubt(level, unknowns))

    def sought(self, found: Found, reaches: tuple[float, float]) -> Found:
        """Look around a pose by the same, without derivatives; its size stays."""
        level, unknowns, bounds = self.unknowns(found)
        unknowns = sought_by_edges(level, unknowns, EDGE_SDS[-1], reaches, bounds)
        return self.found(level, found.placement, unknowns, level.residuals(unknowns))

    def unknowns(self, found: Found) -> tuple[Level, Float64[np.ndarray, "u"], Bounds]:
        """Give images and parts in a pose, its unknowns, and the least and most of these."""
        level, density = self._level(found.placement)
        pose = self._start(level.poses, found)
        unknowns = level.target.start(found.density_g_cm3, pose)
        if found.gains is not None:
            unknowns[level.parts : len(unknowns) - level.poses.count] = found.gains
        low, high = level.target.bounds(density, level.poses.count, SHARES)
        if level.poses.sized:
            low[-1], high[-1] = -SIZE_SDS_MOST * self.size_sd, SIZE_SDS_MOST * self.size_sd
        if self.incomplete:  # near the source a shadow has no edges, and nothing to explain
            first = len(unknowns) - level.poses.count
            shift, centre_cm = slice(first + 3, first + 6), level.poses.origin.centre_cm
            least_cm, most_cm = room_of(self.shadows, self.body.radius_cm)
            low[shift] = np.minimum(least_cm - centre_cm, unknowns[shift])
            high[shift] = np.maximum(most_cm - centre_cm, unknowns[shift])
        return level, unknowns, (low, high)

    def found(
        self,
        level: Level,
        placement: RigidPlacement,
        unknowns: Float64[np.ndarray, "u"],
        residuals: Sequence[Float64[np.ndarray, "_n"]],
    ) -> Found:
        """Read unknowns at a level of images and parts in a pose."""
        density, gains, pose = np.split(unknowns, [level.parts, len(unknowns) - level.poses.count])
        growth = float(pose[-1]) if level.poses.sized else 0.0
        loss = self._loss(residuals, level)
        there = Found(placement, loss, density, gains=gains, growth=growth)
        if self.scaled:
            there = there.rescaled(np.array(level.poses.origin.centre_cm))
        return there.posed(level.poses, pose)

    def outline_shares(self, found: Found) -> dict[str, float]:
        """Of each view: share of the pixels in either outline that lie well outside the other."""
        level, density = self._level(found.placement)
        pose = self._start(level.poses, found)
        level = replace(level, glare=[np.zeros_like(each) for each in level.glare])
        images = level.images(level.target.start(density, pose))
        px = OUTLINE_PX * BINNING // self.binning
        each = zip(
            level.target.views, self.shadows, level.masks, images, level.measured, strict=True
        )
        return {
            view.name: apart_share(mask, model, seen, lit(shadow), px)
            for view, shadow, mask, model, seen in each
        }

    def _start(self, poses: Poses, found: Found) -> Float64[np.ndarray, "p"]:
        """Unknowns of the poses: at rest, but for turned views.

        These are moved as they were found to be, or shifted onto their shadows.
        """
        own = self.body.placed(found.placement)
        linear, shift = own.scale * own.rotation, own.translation_cm
        start = np.zeros(poses.count)
        start[poses.size_places] = found.growth
        for number, shadow in enumerate(self.shadows):
            if number in found.moves:
                moved = found.moves[number].about(np.array(poses.origin.centre_cm))
                start[poses.places(number)] = moved
            elif shadow.turned:
                more = own_shifts(shadow, self.body.rim_cm, linear[None], shift[None])[0]
                start[poses.places(number)[-3:]] = more
        return start

    def _level(self, placement: RigidPlacement) -> tuple[Level, Float64[np.ndarray, "k"]]:
        """Images and parts in a pose, and densities to start from."""
        scene = self.scene
        target = Target(
            scene.views,
            scene.saturated,
            [gain_prior(bounds) for bounds in scene.gains],
            scene.outlines.beams,
            [placement.moved(region) for region in scene.space.regions],
            self.mac_cm2_g,
        )
        x, y, z = target.centre_cm.tolist()
        poses = Poses(scene.turned, Pose(centre_cm=(x, y, z)), self.size_sd)
        windows = [
            _joined(window(view.geometry, target.points_cm, self.binning), around)
            for view, around in zip(scene.views, self.around, strict=True)
        ]
        level = Level.of(target, poses, windows, self.binning, self.images, self.subrays)
        pitch_cm = min(float(np.linalg.norm(view.geometry.column_step_cm)) for view in scene.views)
        lost_from = LOST_FROM if self.incomplete else np.inf
        level = replace(
            level,
            slope_subrays=self.slope_subrays,
            step_cm=STEP_PX * pitch_cm,
            lost_from=lost_from,
            turned=False,
        )
        return level, self.density_g_cm3

    def _evaluated(
        self, level: Level, lengths: Sequence[PathLengths], unknowns: Float64[np.ndarray, "u"]
    ) -> tuple[float, Float64[np.ndarray, "u"], Float64[np.ndarray, "u u"]]:
        """Loss, and half its derivatives by the densities, the gains and the shares of glare."""
        parts, views = level.parts, len(lengths)
        gradient, curvature = np.zeros(len(unknowns)), np.zeros((len(unknowns),) * 2)
        residuals = []
        for number, each in enumerate(lengths):
            model, by_density = level.image_and_slopes(number, unknowns[:parts], each)
            gain, share = unknowns[[parts + number, parts + views + number]]
            glare = level.glare[number]
            off = (gain * model + share * glare - level.measured[number]) / PIXEL_SD
            residuals.append(off)
            mine = np.where(huber.one_sided(off, level.at_least[number]), off, 0.0)
            slopes = np.column_stack([gain * by_density, model, glare]) / PIXEL_SD
            weighted = slopes * level.weights_of(mine)[:, None]
            own = [*range(parts), parts + number, parts + views + number]
            gradient[own] += weighted.T @ mine
            curvature[np.ix_(own, own)] += weighted.T @ slopes
        return self._loss(residuals, level), gradient, curvature

    def _loss(self, residuals: Sequence[Float64[np.ndarray, "_n"]], level: Level) -> float:
        """Mean over the pixels of the shadows, whatever was compared beside them."""
        counted = (
            np.where(huber.one_sided(off, least), off, 0.0)
            for off, least in zip(residuals, level.at_least, strict=True)
        )
        return sum(level.tempered(off) for off in counted) / self.shadow_px


def side_of(shadows: Sequence[Shadow], wide_px: int) -> int:
    """How many of the radiographs' pixels are a compared one's side, see :meth:`Judge.of`."""
    binning = binning_of(shadows, wide_px)
    pixels = np.mean([shadow.mask.sum() for shadow in shadows]) / binning**2
    small = widest_px(shadows) <= wide_px / BINNING or pixels <= SPARSE * wide_px**2
    return binning if small else BINNING * binning


def _around(shadow: Shadow, binning: int) -> Window:
    """Rows and columns of the shadow's box in an image of averaged pixels."""
    first, last = np.floor(shadow.box_px[:2] / binning), np.ceil(shadow.box_px[2:] / binning)
    (left, top), (right, bottom) = first.astype(int).tolist(), last.astype(int).tolist()
    return slice(max(top, 0), bottom + 1), slice(max(left, 0), right + 1)


def _joined(one: Window, other: Window) -> Window:
    """Give the smallest window that holds both."""
    rows, columns = (
        slice(min(a.start, b.start), max(a.stop, b.stop)) for a, b in zip(one, other, strict=True)
    )
    return rows, columns
