"""From no pose at all to a dozen unlike ones, by few points on few pixels.

Rotations are spread evenly over all there are; each is shifted until its shadows lie where the
measured ones do. The best few hundred follow the derivatives on very coarse images, the best few
dozen of those on finer ones, together with their half turns, which outlines hardly tell apart.
Where a part may have no mesh, each is shifted until it looks like some of what is seen, and stays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from jaxtyping import Float32, Float64, Int64
from scipy.spatial.transform import Rotation

from xden_builder.registration.body import Body
from xden_builder.registration.camera import Camera, Features, Rotations, Shifts, rendered, seen
from xden_builder.registration.content import shifts_to_content
from xden_builder.registration.costs import Explained, explained, explained_in_part
from xden_builder.registration.likeness import Likeness, unlike
from xden_builder.registration.middles import (
    lone_sight,
    own_shifts,
    scales_to_sizes,
    shifts_to_middles,
)
from xden_builder.registration.placement import RigidPlacement
from xden_builder.registration.rotations import spread_rotations
from xden_builder.registration.shadow import Shadow

__all__ = [
    "USUAL",
    "WIDE",
    "Breadth",
    "Poses",
    "Search",
    "distinct",
    "finer_search",
    "half_turns",
    "laid_upon_content",
    "round_axis",
    "shortlist",
    "turned_about",
]

BATCH: Final = 512
COARSE_PX, FINE_PX = 16, 36
"""Pixels along the longer side of a shadow."""
COARSE_CELLS, FINE_CELLS = 16, 28
"""Of the clouds, along each axis."""
COARSE_STEPS, FINE_STEPS = 3, 4
DISTINCT_RAD: Final = np.radians(6.0)
ROUND_RAD: Final = np.radians([25, 70, 115, 160]).tolist()
"""Turns about an axis that leave only what is round where it was."""
MOST_SHIFTING: Final = 3
"""Views that say where an object is by what they show of it: pairs of places in each are combined.
"""
LEADING: Final = 6
"""How many are half turned too."""
APART_SHARE: Final = 0.015
"""Of the radius: poses that are nearer are one."""
STEP_PX: Final = 0.5
"""Of derivatives, and by how much more the first damping is than none."""
FIRST_DAMPING: Final = 1e-2
LONGEST_STEP: Final = 0.25
"""Of the radius."""


@dataclass(frozen=True, slots=True)
class Breadth:
    """How many poses are tried.

    Parameters
    ----------
    spread
        Rotations to begin with.
    first, second, last
        Poses that are kept for the coarse images, for the finer ones, and in the end.
    """

    spread: int
    first: int
    second: int
    last: int


USUAL: Final = Breadth(4608, 320, 50, 14)
"""Begins with rotations within 13 degrees of any there is, 7 in the mean."""
WIDE: Final = Breadth(4608, 640, 100, 20)
"""For an object that was hardly found."""


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Many poses: a point x stands at L x + shift, L a rotation times a scale.

    Parameters
    ----------
    linear
        Shape (b, 3, 3).
    shifts
        Shape (b, 3), cm.
    costs
        Shape (b,): share of the shadows' features that is not explained.
    """

    linear: Rotations
    shifts: Shifts
    costs: Float64[np.ndarray, "b"]

    def __len__(self) -> int:
        return len(self.linear)

    def picked(self, numbers: Sequence[int] | Int64[np.ndarray, "_n"]) -> Poses:
        """Pick some of them, in an order."""
        which = np.asarray(numbers, dtype=np.int64)
        return Poses(self.linear[which], self.shifts[which], self.costs[which])

    def best_first(self) -> Poses:
        """All of them."""
        return self.picked(np.argsort(self.costs, kind="stable"))

    def placements(self) -> list[RigidPlacement]:
        """As placements of the body's own frame."""
        scales = np.cbrt(np.linalg.det(self.linear))
        return [
            RigidPlacement(linear / scale, shift, scale)
            for linear, shift, scale in zip(self.linear, self.shifts, scales.tolist(), strict=True)
        ]

    @classmethod
    def of(cls, placements: Sequence[RigidPlacement]) -> Poses:
        """Read what :meth:`placements` gives; the costs are not known."""
        linear = np.array([each.scale * each.rotation for each in placements])
        shifts = np.array([each.translation_cm for each in placements])
        return cls(linear.reshape(-1, 3, 3), shifts.reshape(-1, 3), np.full(len(linear), np.nan))


class Search:
    """A body before its shadows, at one resolution."""

    def __init__(self, shadows: Sequence[Shadow], body: Body, cells: int, wide_px: int) -> None:
        self.shadows, self.rim_cm = shadows, body.rim_cm
        self.cameras = [Camera.of(shadow, wide_px) for shadow in shadows]
        self.cloud, self.radius_cm = body.cloud(cells), body.radius_cm
        self.seen, self.sight = seen(self.cameras), lone_sight(shadows)
        self.step_cm = STEP_PX * min(camera.pixel_cm for camera in self.cameras)

    def judged(
        self,
        linear: Rotations,
        shifts: Shifts,
        by: Callable[[Features, Float32[np.ndarray, "n"]], Explained] = explained,
    ) -> Poses:
        """Work out the costs of poses."""
        costs = [
            by(self._render(linear[start:][:BATCH], shifts[start:][:BATCH]), self.seen).costs
            for start in range(0, len(linear), BATCH)
        ]
        return Poses(linear, shifts, np.concatenate([np.empty(0), *costs]))

    def led_to_content(self, linear: Rotations, shifts: Shifts) -> Poses:
        """Shift poses, unless they are better as they are, to where they explain what is seen.

        The boxes around the shadows play no part, and neither has all that is seen to be explained.
        """
        told = self.cameras[:MOST_SHIFTING]
        tries = [
            self.judged(linear, each, explained_in_part)
            for each in (shifts, *shifts_to_content(told, self.cloud, linear, shifts))
        ]
        costs, found = (
            np.array(each) for each in zip(*((t.costs, t.shifts) for t in tries), strict=True)
        )
        best = costs.argmin(axis=0), np.arange(len(linear))
        return Poses(linear, found[best], costs[best])

    def _render(self, linear: Rotations, shifts: Shifts) -> Float32[np.ndarray, "b n"]:
        each = [shifts + own_shifts(shadow, self.rim_cm, linear, shifts) for shadow in self.shadows]
        return rendered(self.cameras, self.cloud, linear, each)

    def descended(self, poses: Poses, steps: int, *, scaled: bool) -> Poses:
        """Follow the derivatives from all poses at once (Levenberg-Marquardt)."""
        linear, shifts = poses.linear, poses.shifts
        images = self._render(linear, shifts)
        costs, gains = explained(images, self.seen)
        damping = np.full(len(linear), FIRST_DAMPING)
        for _ in range(steps):
            slopes = self._slopes(linear, shifts, images, gains, scaled=scaled)
            off = gains[:, None] * images - self.seen
            moves = _step(slopes, off, damping).clip(
                -LONGEST_STEP * self.radius_cm, LONGEST_STEP * self.radius_cm
            )
            new_linear, new_shifts = self._moved(linear, shifts, moves)
            new_images = self._render(new_linear, new_shifts)
            there = explained(new_images, self.seen)
            better = there.costs < costs
            linear = np.where(better[:, None, None], new_linear, linear)
            shifts = np.where(better[:, None], new_shifts, shifts)
            images = np.where(better[:, None], new_images, images)
            costs = np.where(better, there.costs, costs)
            gains = np.where(better, there.gains, gains)
            damping = np.where(better, damping / 5, damping * 10)
        return Poses(linear, shifts, costs)

    def _slopes(
        self,
        linear: Rotations,
        shifts: Shifts,
        images: Float32[np.ndarray, "b n"],
        gains: Float64[np.ndarray, "b"],
        *,
        scaled: bool,
    ) -> Float32[np.ndarray, "b u n"]:
        """Take derivatives by the moves of :meth:`_moved`, in cm of the rim, and by the gain."""
        slopes = []
        for number in range(7 if scaled else 6):
            moves = np.zeros((len(linear), 7))
            moves[:, number] = self.step_cm
            ahead = self._render(*self._moved(linear, shifts, moves))
            slopes.append(gains[:, None] * (ahead - images) / self.step_cm)
        return np.stack([*slopes, images], axis=1, dtype=np.float32)

    def _moved(
        self, linear: Rotations, shifts: Shifts, moves: Float64[np.ndarray, "b u"]
    ) -> tuple[Rotations, Shifts]:
        """Turn, shift, and scale where there is a seventh move; turns and scales as the rim's.

        Nothing is shifted along a lone view's beam.
        """
        turns = Rotation.from_rotvec(moves[:, :3] / self.radius_cm).as_matrix()
        growth = np.exp(moves[:, 6:7, None] / self.radius_cm) if moves.shape[1] > 6 else 1.0
        along = moves[:, 3:6]
        if self.sight is not None:
            along = along - np.outer(along @ self.sight, self.sight)
        return growth * (turns @ linear), shifts + along


def _step(
    slopes: Float32[np.ndarray, "b u n"],
    off: Float64[np.ndarray, "b n"],
    damping: Float64[np.ndarray, "b"],
) -> Float64[np.ndarray, "b m"]:
    """Damped Gauss-Newton steps, without that of the gain."""
    curvature = (slopes @ slopes.transpose(0, 2, 1)).astype(np.float64)
    gradient = np.einsum("bun,bn->bu", slopes, off)
    own = np.einsum("buu->bu", curvature)
    damped = curvature + (damping[:, None] * own + 1e-9)[:, :, None] * np.eye(own.shape[1])
    return -np.linalg.solve(damped, gradient[..., None])[:, :-1, 0]


def shortlist(
    shadows: Sequence[Shadow],
    body: Body,
    likeness: Likeness,
    rotations: Rotation | None = None,
    *,
    scaled: bool = False,
    breadth: Breadth = USUAL,
) -> tuple[Poses, Search]:
    """Find a dozen unlike poses among which is the right one.

    Parameters
    ----------
    shadows
        Of all views.
    body, likeness
        What is searched for, and how far apart its poses are.
    rotations
        To begin with; all there are by default.
    scaled
        Whether the scale is sought too.
    breadth
        How many are tried.

    Returns
    -------
    poses
        The best first.
    search
        At the finer resolution.
    """
    everywhere = rotations is None
    linear = (spread_rotations(breadth.spread) if rotations is None else rotations).as_matrix()
    if scaled:
        linear = scales_to_sizes(shadows, body.rim_cm, linear)[:, None, None] * linear
    coarse, fine = _coarse_search(shadows, body), finer_search(shadows, body)
    first = coarse.judged(linear, shifts_to_middles(shadows, body.rim_cm, linear)).best_first()
    axis = round_axis(body, likeness)
    some = range(breadth.first) if axis is None else distinct(first, breadth.first, axis)
    second = _winnowed(coarse, first.picked(some[: len(first)]), COARSE_STEPS, scaled=scaled)
    second = second.picked(distinct(second, breadth.second, axis))
    if everywhere:
        second = _joined(second, half_turns(second.picked(range(min(LEADING, len(second)))), body))
    last = _winnowed(fine, second, FINE_STEPS, scaled=scaled)
    is_apart = partial(likeness.apart, least_cm=APART_SHARE * body.radius_cm)
    kept = unlike(last.placements(), is_apart, breadth.last)
    return last.picked(kept), fine


def _coarse_search(shadows: Sequence[Shadow], body: Body) -> Search:
    """Give the search at the coarser of two resolutions."""
    return Search(shadows, body, COARSE_CELLS, COARSE_PX)


def finer_search(shadows: Sequence[Shadow], body: Body) -> Search:
    """Give the search at the finer of two resolutions."""
    return Search(shadows, body, FINE_CELLS, FINE_PX)


def laid_upon_content(
    shadows: Sequence[Shadow],
    body: Body,
    likeness: Likeness,
    most: int,
    rotations: Rotation | None = None,
) -> Poses:
    """Lay a body of which a part may be missing upon what it resembles, in all rotations.

    On very coarse images and on finer ones: small meshes beside a large shadow are no peak of their
    own on the former. Nothing moves them on: derivatives lead to what the missing part has made.

    Parameters
    ----------
    shadows
        Of all views, none of which was turned.
    body, likeness
        What is searched for, and how far apart its poses are.
    most
        How many poses of unlike rotation are given by either images, the best first.
    rotations
        In which it is laid; all there are by default.
    """
    linear = (spread_rotations(USUAL.spread) if rotations is None else rotations).as_matrix()
    shifts = shifts_to_middles(shadows, body.rim_cm, linear)
    axis = round_axis(body, likeness)

    def laid(search: Search) -> Poses:
        poses = search.led_to_content(linear, shifts).best_first()
        return poses.picked(distinct(poses, most, axis))

    return _joined(laid(_coarse_search(shadows, body)), laid(finer_search(shadows, body)))


def _winnowed(search: Search, poses: Poses, steps: int, *, scaled: bool) -> Poses:
    """Follow the derivatives: all poses for a step, then the better half; the best first."""
    begun = search.descended(poses, 1, scaled=scaled).best_first()
    better = begun.picked(range((len(begun) + 1) // 2))
    return search.descended(better, steps - 1, scaled=scaled).best_first()


def round_axis(body: Body, likeness: Likeness) -> Float64[np.ndarray, "3"] | None:
    """Give the principal axis about which a body can be turned and stays where it is."""
    here = Poses(np.eye(3)[None], np.zeros((1, 3)), np.zeros(1))
    least_cm = APART_SHARE * body.radius_cm
    for axis, along in enumerate(body.spin[1]):
        turned = turned_about(here, body, axis, ROUND_RAD).placements()
        if not any(likeness.apart(here.placements()[0], turn, least_cm) for turn in turned):
            return np.asarray(along)
    return None


def distinct(poses: Poses, most: int, axis: Float64[np.ndarray, "3"] | None) -> Sequence[int]:
    """Pick the first of each bundle of rotations; of what is round, of directions of its axis.

    Turned about itself it looks the same: the best poses of a bowl all were it upside down.
    """
    rotations = Rotation.from_matrix(poses.linear)
    ways = None if axis is None else rotations.apply(axis)

    def nearest_rad(kept: list[int], number: int) -> float:
        if ways is None:
            return float((rotations[kept].inv() * rotations[number]).magnitude().min())
        return float(np.arccos((ways[kept] @ ways[number]).clip(-1, 1)).min())

    kept: list[int] = []
    for number in range(len(poses)):
        if len(kept) == most:
            break
        if not kept or nearest_rad(kept, number) >= DISTINCT_RAD:
            kept.append(number)
    return kept


def half_turns(poses: Poses, body: Body) -> Poses:
    """Poses turned by half about each principal axis of the body, through its middle."""
    turned = [turned_about(poses, body, axis, [np.pi]) for axis in range(3)]
    return Poses(
        np.concatenate([each.linear for each in turned]),
        np.concatenate([each.shifts for each in turned]),
        np.concatenate([each.costs for each in turned]),
    )


def turned_about(poses: Poses, body: Body, axis: int, angles_rad: Sequence[float]) -> Poses:
    """Poses turned about a principal axis of the body's volume by some angles, pose by pose."""
    middle, axes = body.spin
    turns = Rotation.from_rotvec(np.outer(angles_rad, axes[axis])).as_matrix()
    linear = (poses.linear[:, None] @ turns).reshape(-1, 3, 3)
    each = np.repeat(np.arange(len(poses)), len(turns))
    shifts = poses.shifts[each] + (poses.linear[each] - linear) @ middle
    return Poses(linear, shifts, np.full(len(linear), np.nan))


def _joined(one: Poses, other: Poses) -> Poses:
    return Poses(
        np.concatenate([one.linear, other.linear]),
        np.concatenate([one.shifts, other.shifts]),
        np.concatenate([one.costs, other.costs]),
    )
