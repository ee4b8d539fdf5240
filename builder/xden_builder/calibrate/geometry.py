"""Sources and panels from balls at known places: a bundle adjustment from the told geometry.

Cho et al. (2005, doi:10.1118/1.1869652) and Noo et al. (2000, doi:10.1088/0031-9155/45/11/327)
solve for one view in closed form, from circles of balls. Here both views and the place of the
phantom are one least-squares problem, which any arrangement of balls can feed and whose covariance
is at hand.

Images tell directions of rays only: a panel twice as far with pixels twice as wide gives the same.
So the width of a pixel is the maker's, and the distance follows. Nor do they tell where the object
frame lies: phantom and scanner are each told to some standard deviation, and where both are off
alike the answer lies between by these.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float64
from scipy.optimize import least_squares, linear_sum_assignment
from scipy.spatial.transform import Rotation

from xden1k.errors import DataError
from xden1k.values.arrays import Points
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.calibrate.balls import shadow_centres
from xden_builder.calibrate.told import ToldBalls

__all__ = ["TOLD_WITHIN_CM", "GeometryFit", "ViewFit", "fit_geometry", "source_moved_cm"]

TOLD_WITHIN_CM: Final = 0.5
"""Standard deviation of what is told of a source and of a panel's middle, along each axis."""
TOLD_WITHIN_DEG: Final = 1.0
"""Of a panel, about each axis."""
CENTRE_SD_PX: Final = 0.01
"""Of the centre of a shadow, before the residuals tell."""
MOST_RMS_PX: Final = 0.5
"""Above it the balls are not where the table says."""
LOOKED_INTO_PX: Final = 0.1
TIMES_BETTER: Final = 3.0
ENOUGH_BALLS: Final = 8
"""From the first of these on it is asked whether one ball is elsewhere: whether the others, if
there are enough, lie so many times nearer to their shadows without it. Of 5 or 6 balls, noise alone
makes one seem so."""
ROUNDS: Final = 3
"""Of matching shadows with balls and fitting."""
_OF_VIEW: Final = 9

Unknowns = Float64[np.ndarray, "u"]
Columns = Float64[np.ndarray, "balls 2"]


@dataclass(frozen=True, slots=True, eq=False)
class ViewFit:
    """One view.

    Parameters
    ----------
    geometry
        As found.
    source_sd_cm, panel_sd_cm
        Standard deviation of the source, and of the panel's middle, along each axis, in the frame
        of the phantom.
    panel_sd_deg
        Of the panel about each axis, likewise.
    seen, expected
        Column and row of each shadow.
    """

    geometry: ViewGeometry
    source_sd_cm: tuple[float, ...]
    panel_sd_cm: tuple[float, ...]
    panel_sd_deg: tuple[float, ...]
    seen: Columns
    expected: Columns

    @property
    def rms_px(self) -> float:
        """Root mean square distance of shadows from where they are expected."""
        return float(np.sqrt(((self.seen - self.expected) ** 2).sum(axis=1).mean()))


@dataclass(frozen=True, slots=True, eq=False)
class GeometryFit:
    """Both views, by name, and where the phantom stood."""

    views: Mapping[str, ViewFit]
    shift_cm: tuple[float, ...]
    rotation_deg: tuple[float, ...]


def fit_geometry(balls: ToldBalls, views: Mapping[str, XRayView]) -> GeometryFit:
    """Fit sources, panels and the phantom's place to the shadows of balls.

    Parameters
    ----------
    balls
        Which stand still for all views.
    views
        Radiographs with the told geometry.

    Raises
    ------
    DataError
        If a beam is parallel, a view shows another number of balls, or they are not where the
        table says; one line that names scan and view.
    """
    seen = {name: _shadows(balls, name, view) for name, view in views.items()}
    told = {name: view.geometry for name, view in views.items()}
    unknowns = np.zeros(6 + _OF_VIEW * len(views))
    for _ in range(ROUNDS):
        problem = _Problem(balls, told, _matched(balls, told, seen, unknowns))
        unknowns, covariance = problem.solve(unknowns)
    fit = problem.fit(unknowns, covariance)
    _refuse_ball(problem, unknowns)
    for name, view in fit.views.items():
        if view.rms_px > MOST_RMS_PX:
            raise DataError(
                f"{balls.scan}/{name}: shadows lie {view.rms_px:.2g} pixels from where the table "
                "has the balls: is it another phantom, or does it stand otherwise?"
            )
    return fit


def source_moved_cm(told: ViewGeometry, found: ViewGeometry) -> float:
    """Return how far a source was found from where it was told."""
    assert told.source_cm is not None
    assert found.source_cm is not None
    return float(np.linalg.norm(found.source_cm - told.source_cm))


def _refuse_ball(problem: _Problem, unknowns: Unknowns) -> None:
    """Refuse a ball that alone keeps the others from their places: a fit without each tells."""
    whole = problem.rms_px(unknowns)
    if whole <= LOOKED_INTO_PX or len(problem.balls.centres_cm) < ENOUGH_BALLS:
        return
    found = []
    for ball in range(len(problem.balls.centres_cm)):
        others = problem.without(ball)
        found.append(others.rms_px(others.solve(unknowns)[0]))
    worst = int(np.argmin(found))
    if found[worst] < whole / TIMES_BETTER:
        raise DataError(
            f"{problem.balls.scan}: shadows lie {whole:.2g} pixels from where the table has the "
            f"balls, and {found[worst]:.2g} without ball {worst + 1} of it: is that its place?"
        )


def _shadows(balls: ToldBalls, name: str, view: XRayView) -> Columns:
    where, geometry = f"{balls.scan}/{name}", view.geometry
    if geometry.source_cm is None:
        raise DataError(f"{where}: balls calibrate a cone beam, got a parallel one")
    depth = float(geometry.project(np.zeros((1, 3)))[0, 2])
    pixel_cm = float(np.linalg.norm(geometry.column_step_cm))
    found = shadow_centres(view, balls.diameter_cm / depth / pixel_cm)
    if len(found) != len(balls.centres_cm):
        raise DataError(
            f"{where}: {len(found)} shadows of balls found, expected {len(balls.centres_cm)}"
        )
    return found


def _matched(
    balls: ToldBalls,
    told: Mapping[str, ViewGeometry],
    seen: Mapping[str, Columns],
    unknowns: Unknowns,
) -> dict[str, Columns]:
    """Put the shadows of each view in the order of the balls: the least distances in all.

    What all shadows are off by together does not count.
    """
    expected = _Problem(balls, told, seen).expected(unknowns)
    ordered = {}
    for name, centres in seen.items():
        places = expected[name] - expected[name].mean(axis=0)
        away = (centres - centres.mean(axis=0))[:, None] - places
        shadow, ball = linear_sum_assignment((away**2).sum(axis=2))
        ordered[name] = centres[shadow[np.argsort(ball)]]
    return ordered


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """Least squares over the phantom's place, then source, panel and turn of each view.

    Everything is a step from what is told; the panel turns about its middle.
    """

    balls: ToldBalls
    told: Mapping[str, ViewGeometry]
    seen: Mapping[str, Columns]

    @property
    def prior_sd(self) -> Unknowns:
        """Standard deviations of all unknowns, cm and radians, about 0."""
        place = [np.deg2rad(self.balls.placed_within_deg)] * 3 + [self.balls.placed_within_cm] * 3
        view = [TOLD_WITHIN_CM] * 6 + [np.deg2rad(TOLD_WITHIN_DEG)] * 3
        return np.array(place + view * len(self.told))

    def placed(self, unknowns: Unknowns) -> Points:
        """Centres of the balls in the object frame."""
        turn = Rotation.from_rotvec(unknowns[:3]).as_matrix()
        return np.asarray(self.balls.centres_cm @ turn.T + unknowns[3:6])

    def geometries(self, unknowns: Unknowns) -> dict[str, ViewGeometry]:
        """Place the views."""
        return {
            name: _moved(geometry, unknowns[6 + _OF_VIEW * at :][:_OF_VIEW])
            for at, (name, geometry) in enumerate(self.told.items())
        }

    def expected(self, unknowns: Unknowns) -> dict[str, Columns]:
        """Column and row of the middle of each shadow."""
        points, radius_cm = self.placed(unknowns), self.balls.diameter_cm / 2
        return {
            name: _shadow_middles(geometry, points, radius_cm)
            for name, geometry in self.geometries(unknowns).items()
        }

    def residuals(self, unknowns: Unknowns) -> Float64[np.ndarray, "m"]:
        """Distances of the shadows, then the priors, over their standard deviations."""
        expected = self.expected(unknowns)
        off = [((self.seen[name] - expected[name]) / CENTRE_SD_PX).ravel() for name in self.told]
        return np.concatenate([*off, unknowns / self.prior_sd])

    def rms_px(self, unknowns: Unknowns) -> float:
        """Root mean square distance of all shadows from where they are expected."""
        expected = self.expected(unknowns)
        off = np.concatenate([self.seen[name] - expected[name] for name in self.told])
        return float(np.sqrt((off**2).sum(axis=1).mean()))

    def without(self, ball: int) -> _Problem:
        """Leave a ball out."""
        balls = replace(self.balls, centres_cm=np.delete(self.balls.centres_cm, ball, axis=0))
        seen = {name: np.delete(centres, ball, axis=0) for name, centres in self.seen.items()}
        return _Problem(balls, self.told, seen)

    def solve(self, start: Unknowns) -> tuple[Unknowns, Float64[np.ndarray, "v v"]]:
        """Find the most likely unknowns, and the views' covariance, scaled by the residuals."""
        found = least_squares(self.residuals, start, x_scale=self.prior_sd)
        if not found.success:
            raise DataError(f"{self.balls.scan}: the fit of the geometry did not settle")
        shadows = found.fun[: -len(start)]
        scale = max(float((shadows**2).sum()) / (len(shadows) - len(start) + 6), 1.0)
        information = found.jac.T @ found.jac
        information += (1 / scale - 1) * found.jac[: len(shadows)].T @ found.jac[: len(shadows)]
        # of the views alone: where the phantom stands, it defines the frame
        return found.x, np.linalg.inv(information[6:, 6:])

    def fit(self, unknowns: Unknowns, covariance: Float64[np.ndarray, "v v"]) -> GeometryFit:
        """Put the answer together."""
        sd, expected = np.sqrt(np.diag(covariance)), self.expected(unknowns)
        views = {
            name: ViewFit(
                geometry,
                tuple(sd[start : start + 3].tolist()),
                tuple(sd[start + 3 : start + 6].tolist()),
                tuple(np.rad2deg(sd[start + 6 : start + 9]).tolist()),
                self.seen[name],
                expected[name],
            )
            for start, (name, geometry) in zip(
                range(0, len(sd), _OF_VIEW), self.geometries(unknowns).items(), strict=True
            )
        }
        turn, shift = np.rad2deg(unknowns[:3]).tolist(), unknowns[3:6].tolist()
        return GeometryFit(views, tuple(shift), tuple(turn))


def _moved(geometry: ViewGeometry, steps: Unknowns) -> ViewGeometry:
    """Move a source and a panel, and turn the panel about its middle."""
    assert geometry.source_cm is not None
    turn = Rotation.from_rotvec(steps[6:]).as_matrix()
    rows, columns = geometry.shape
    to_middle = (columns - 1) / 2 * geometry.column_step_cm + (rows - 1) / 2 * geometry.row_step_cm
    return replace(
        geometry,
        source_cm=geometry.source_cm + steps[:3],
        pixel00_cm=geometry.pixel00_cm + to_middle + steps[3:6] - turn @ to_middle,
        column_step_cm=turn @ geometry.column_step_cm,
        row_step_cm=turn @ geometry.row_step_cm,
    )


def _shadow_middles(geometry: ViewGeometry, points_cm: Points, radius_cm: float) -> Columns:
    """Middle of the ellipse that each ball's shadow is.

    The rays that touch a ball of radius r around c, the source at the origin, are a cone; cut by
    the panel it is an ellipse, whose middle is the image of another point than c:
    c - r² n / (c n), n being the panel's normal.
    """
    normal = np.cross(geometry.column_step_cm, geometry.row_step_cm)
    normal /= np.linalg.norm(normal)
    along = (points_cm - geometry.source_cm) @ normal
    middles = points_cm - radius_cm**2 * normal / along[:, None]
    return geometry.project(middles)[:, :2]
