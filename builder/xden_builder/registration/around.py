"""Poses around a settled one, each judged by one rendering while all else follows linearly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial.transform import Rotation

from xden_builder.poly.model.poses import RIGID
from xden_builder.poly.pyramid import Level
from xden_builder.poly.target import Bounds
from xden_builder.registration.exact import Judge
from xden_builder.registration.placement import Found, RigidPlacement

__all__ = ["Around"]

DAMPING: Final = 1e-2


@dataclass(frozen=True, slots=True, eq=False)
class Around:
    """What turns of a settled pose would leave once all other unknowns had followed.

    A turn of a nearly round object about its axis changes its images little, and takes with it
    shifts, other turns, size, densities, gains and glare. They follow by the derivatives of the
    settled pose: one rendering tells of a turn what many would if it were refined.

    Parameters
    ----------
    judge
        Compares images.
    found
        The settled pose.
    level
        Its images.
    start
        Shape (u,): its unknowns.
    slopes
        Of each view, shape (pixels, u): derivatives of its residuals by them.
    bounds
        Shape (u,) each: least and most unknowns.
    """

    judge: Judge
    found: Found
    level: Level
    start: Float64[np.ndarray, "u"]
    slopes: Sequence[Float64[np.ndarray, "_n u"]]
    bounds: Bounds

    @classmethod
    def of(cls, judge: Judge, found: Found) -> Around:
        """Take derivatives at a settled pose."""
        level, start, bounds = judge.unknowns(found)
        return cls(judge, found, level, start, level.residuals_and_slopes(start)[1], bounds)

    def fixed(self, placement: RigidPlacement) -> Found:
        """Judge a pose: how all else follows, and what that would leave, which is not rendered.

        The prior only damps how far unknowns follow: it draws none of them to its mean.
        """
        at = self._at(placement)
        fixed = self.level.residuals(at)
        precision = self.level.precision
        gradient, curvature = np.zeros(len(at)), np.diag(precision)
        for (counts, off), slope in zip(self.level.counted(fixed), self.slopes, strict=True):
            weighted = slope * (self.level.share * counts * self.level.weights_of(off))[:, None]
            gradient += weighted.T @ off
            curvature += weighted.T @ slope
        scale = 1 / np.sqrt(curvature.diagonal().clip(min=1e-12))
        damped = curvature * np.outer(scale, scale) + DAMPING * np.eye(len(scale))
        wanted = at - scale * np.linalg.solve(damped, scale * gradient)
        step = wanted.clip(*self.bounds) - at
        residuals = [off + slope @ step for off, slope in zip(fixed, self.slopes, strict=True)]
        there = self._followed(at, step)
        return self.judge.found(self.level, self.found.placement, there, residuals)

    def _followed(
        self, at: Float64[np.ndarray, "u"], step: Float64[np.ndarray, "u"]
    ) -> Float64[np.ndarray, "u"]:
        """Take a step from a pose: it turns what is turned already."""
        there, pose_at = at + step, len(at) - self.level.poses.count
        for turned, shifted in self._rigid_places():
            turn = Rotation.from_rotvec(step[pose_at:][turned])
            before = Rotation.from_rotvec(at[pose_at:][turned])
            there[pose_at + turned] = (turn * before).as_rotvec()
            there[pose_at + shifted] = turn.apply(at[pose_at:][shifted]) + step[pose_at:][shifted]
        return np.asarray(there)

    def _rigid_places(self) -> list[tuple[Int64[np.ndarray, "3"], Int64[np.ndarray, "3"]]]:
        """Places of the turns and shifts among the unknowns of the poses, those shared once."""
        poses = self.level.poses
        each = {tuple(poses.places(number)[:RIGID]) for number in range(len(poses.turned))}
        halves = (np.split(np.array(places), 2) for places in sorted(each))
        return [(turned, shifted) for turned, shifted in halves]

    def _at(self, placement: RigidPlacement) -> Float64[np.ndarray, "u"]:
        """Unknowns that put the object there and are else those of the settled pose."""
        poses = self.level.poses
        pose_at = len(self.start) - poses.count
        here, centre = self.found.placement, np.array(poses.origin.centre_cm)
        own, start = self.start[pose_at:].copy(), self.start[pose_at:]
        if self.judge.scaled:
            grown = placement.scale / here.scale
            here = here.enlarged(grown, centre)
            own[poses.size_places] += np.log(grown)
        turn = placement.rotation @ here.rotation.T
        shift = placement.translation_cm - turn @ (here.translation_cm - centre) - centre
        for turned, shifted in self._rigid_places():
            first = Rotation.from_rotvec(start[turned])
            own[turned] = (first * Rotation.from_matrix(turn)).as_rotvec()
            own[shifted] = first.apply(shift) + start[shifted]
        return np.concatenate([self.start[:pose_at], own])
