"""Whether views agree on where the object is and how large: whether it moved, or a source is wrong.

Two views that share a pose and a size are fitted as if both were right. Where the object moved
between them, or the scanner file is wrong about one, that fit lies between them, and one more
Gauss-Newton step tells it: of all its unknowns, and of a turn, a shift and a growth that the object
has before one view alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from xden_builder.poly.descent import descend
from xden_builder.poly.model.poses import RIGID, Poses
from xden_builder.poly.pyramid import Level

__all__ = ["Apart", "views_apart"]

OWN_SD: Final = (0.05, 0.05, 0.05, 0.1, 0.1, 0.1, 0.03)
"""Before the images, of what one view alone shows: turn (radians), shift (cm) and growth."""
LEAST_GROWTH, SIGMAS = 0.0035, 3.5
"""From here on views contradict each other. Of 130 objects of scanners a millimetre off, by the
other simulator, none was off by more than 2.9 standard deviations."""
LEAST_TURN_DEG, LEAST_TURN_CM, TURN_SIGMAS = 1.0, 0.1, 6.0
"""The same of how it stands, in degrees and at the rim. Of 236 sound objects of ours and 26 by the
other simulator one was off by more than 1 degree and 6 standard deviations, a paper clip by 0.4
millimetres; of six that were turned by 3 to 8 degrees none by less than 2.2 degrees and 6.9. A
shift tells nothing: what one view knows of it the others do not, or it is the row shift."""
ASKED_SIGMAS: Final = 5.0
"""From here on the turn is found by a descent in which the view has a pose of its own: where light
is believed the less the farther it is off, one step is too short."""
DERIVATIVES: Final = 4
"""Of that descent, at most."""

Unknowns = Float64[np.ndarray, "u"]


class Apart(NamedTuple):
    """How the object is before one view, beside how it is before the others.

    Parameters
    ----------
    view
        Number of the view.
    growth, sd
        Logarithm of the one size over the other, and its standard deviation.
    turn_deg, turn_sds
        By which it stands otherwise, and how many standard deviations that is (Mahalanobis).
    radius_cm
        From the object's middle to its farthest point.
    """

    view: int
    growth: float
    sd: float
    turn_deg: float
    turn_sds: float
    radius_cm: float

    @property
    def contradicts(self) -> bool:
        """Whether views cannot both be as the scanner file has them, and of one pose."""
        grown = abs(self.growth) > max(LEAST_GROWTH, SIGMAS * self.sd)
        turned = self.turn_deg > LEAST_TURN_DEG and self.turn_sds > TURN_SIGMAS
        return grown or (turned and math.radians(self.turn_deg) * self.radius_cm > LEAST_TURN_CM)

    @property
    def most_sds(self) -> float:
        """The larger of the two, in standard deviations."""
        return max(abs(self.growth) / self.sd, self.turn_sds)


def views_apart(
    level: Level,
    unknowns: Unknowns,
    bounds: tuple[Unknowns, Unknowns],
    residuals: Sequence[Float64[np.ndarray, "_n"]],
    slopes: Sequence[Float64[np.ndarray, "_n u"]],
) -> Apart | None:
    """Tell how the object is before one view beside the others, of all the one that differs most.

    Parameters
    ----------
    level, unknowns, residuals
        Where a descent has ended.
    bounds
        Least and most of the unknowns.
    slopes
        Of the residuals of each view, there or nearby.

    Returns
    -------
    Apart or None
        None where the size is not sought, or the object was turned by hand before a view, so that
        it stands nearer to a source or farther off as it likes.
    """
    poses = level.poses
    if not poses.sized or any(poses.turned):
        return None
    first = len(unknowns) - poses.count
    places = [first + place for place in [*range(RIGID), *poses.size_places]]
    level = level.believed(residuals)
    told, weights = level.weighed(residuals)
    gradient, hessian = level.derivatives(unknowns, told, weights, slopes)
    back = np.linalg.pinv(hessian + 1e-9 * np.diag(hessian.diagonal()), hermitian=True)
    found, radius_cm = [], level.target.radius_cm
    each = zip(range(len(slopes)), weights, told, slopes, strict=True)
    others = 1 if len(slopes) == 2 else 0  # of two views, either tells the other
    for view, weight, off, slope in [*each][others:]:
        own = slope[:, places]
        weighted = own * weight[:, None]
        both = weighted.T @ slope
        curvature = weighted.T @ own + np.diag(np.array(OWN_SD) ** -2.0) - both @ back @ both.T
        step = -np.linalg.solve(curvature, weighted.T @ off - both @ back @ gradient)
        covariance = np.linalg.inv(curvature)
        turn, growth, sd = step[:3], float(step[-1]), float(np.sqrt(covariance[-1, -1]))
        turn_sds = float(np.sqrt(turn @ np.linalg.solve(covariance[:3, :3], turn)))
        turn_deg = float(np.degrees(np.linalg.norm(turn)))
        if turn_sds > ASKED_SIGMAS:
            turn_deg = _turn_deg(level, unknowns, bounds, view)
        found.append(Apart(view, growth, sd, turn_deg, turn_sds, radius_cm))
    return max(found, key=lambda one: (one.contradicts, one.most_sds))


def _turn_deg(
    level: Level, unknowns: Unknowns, bounds: tuple[Unknowns, Unknowns], view: int
) -> float:
    """By how much an object that has a pose of its own before a view is turned there."""
    shared = level.poses
    own = Poses(
        tuple(number == view for number in range(len(level.panels))), shared.origin, shared.size_sd
    )
    start, low, high = (_with_own(each, shared, view) for each in (unknowns, *bounds))
    end = descend(replace(level, poses=own), start, DERIVATIVES, low, high).unknowns[-own.count :]
    there, before = (Rotation.from_rotvec(end[at][:3]) for at in (own.places(view), range(RIGID)))
    return float(np.degrees((there * before.inv()).magnitude()))


def _with_own(unknowns: Unknowns, shared: Poses, view: int) -> Unknowns:
    """Give a view the pose that views share as its own, in place of its row shift, if any."""
    rest, poses = unknowns[: -shared.count], unknowns[-shared.count :]
    shifts = shared.places(view)[RIGID:]
    before, after = (shifts[0], shifts[0] + 1) if shifts else (RIGID, RIGID)
    return np.concatenate([rest, poses[:before], poses[:RIGID], poses[after:]])
