"""How the image of an object changes as it moves, told by the image where it merely slides.

Turned about the source, an object is met by the same rays elsewhere on the panel. So of its six
motions three are slides of one image: for small ones the image's gradient times the way of each
pixel. What is left are turns about two axes across the beam, and the way along it, which change
what the rays pass through.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import isqrt
from typing import Final

import numpy as np
from jaxtyping import Float64, Int64

from xden1k.values.arrays import Vec3
from xden1k.values.views import ViewGeometry
from xden_builder.poly.model.poses import RIGID, Poses

__all__ = ["Gradient", "slopes_by_pose", "turning"]

SMALL_RAD: Final = 1e-6
"""A smaller turn is none."""


@dataclass(frozen=True, slots=True, eq=False)
class Gradient:
    """Slopes of an image where they are not zero.

    Parameters
    ----------
    rows, columns
        Shape (n,): of pixels.
    by_row, by_column
        Shape (n,): change of the pixel's mean by a pixel of way.
    """

    rows: Int64[np.ndarray, "n"]
    columns: Int64[np.ndarray, "n"]
    by_row: Float64[np.ndarray, "n"]
    by_column: Float64[np.ndarray, "n"]

    @classmethod
    def of(
        cls,
        pixels: Int64[np.ndarray, "n"],
        rays: Float64[np.ndarray, "n s"],
        shape: tuple[int, int],
    ) -> Gradient:
        """Take the slopes of an image that is 1 where no pixel is told.

        The mean slope of a pixel is what its rims differ by, and a rim is halfway between the rays
        on either side of it.

        Parameters
        ----------
        pixels
            Flat indices.
        rays
            Transmission along the rays of these pixels, ``s`` a square, row by row.
        shape
            Rows and columns of the image.
        """
        if not len(pixels):
            return cls(*np.zeros((2, 0), dtype=np.int64), *np.zeros((2, 0)))
        row, column = np.divmod(pixels, shape[1])
        first = np.array([row.min(), column.min()]) - 1
        first = first.clip(min=0)
        end = np.minimum([row.max() + 2, column.max() + 2], shape)
        (height, width), side = (end - first).tolist(), isqrt(rays.shape[1])
        fine = np.ones((height, side, width, side))
        fine[row - first[0], :, column - first[1]] = rays.reshape(-1, side, side)
        by_row = np.diff(_rims(fine.mean(axis=3).reshape(height * side, width), side), axis=0)
        by_column = np.diff(_rims(fine.mean(axis=1).reshape(height, width * side).T, side), axis=0)
        rows, columns = np.nonzero((by_row != 0) | (by_column.T != 0))
        return cls(
            rows + first[0], columns + first[1], by_row[rows, columns], by_column[columns, rows]
        )

    def slid(self, ways_px: Float64[np.ndarray, "2 n"]) -> Float64[np.ndarray, "n"]:
        """Change of the image where what it shows goes so far along rows and columns."""
        return np.asarray(-self.by_row * ways_px[0] - self.by_column * ways_px[1])

    def turned(
        self, panel: ViewGeometry, axes: Float64[np.ndarray, "_m 3"]
    ) -> list[Float64[np.ndarray, "n"]]:
        """Give the changes by turns about axes through the source of a cone beam, per radian.

        Parameters
        ----------
        panel
            Where it stands.
        axes
            Unit vectors.
        """
        return [self._carried(panel, np.cross(axis, panel.matrix.T).T) for axis in axes]

    def moved(
        self, panel: ViewGeometry, ways: Float64[np.ndarray, "_m 3"]
    ) -> list[Float64[np.ndarray, "n"]]:
        """Give the changes by shifts before a parallel beam, per cm along unit vectors."""
        still = np.zeros((3, 2))
        return [self._carried(panel, np.column_stack([still, way])) for way in ways]

    def spun(self, panel: ViewGeometry, axis: Vec3, centre_cm: Vec3) -> Float64[np.ndarray, "n"]:
        """Change by turning the object about the line of a parallel beam through a point."""
        spokes = [panel.column_step_cm, panel.row_step_cm, panel.pixel00_cm - centre_cm]
        return self._carried(panel, np.cross(axis, spokes).T)

    def _carried(
        self, panel: ViewGeometry, velocity: Float64[np.ndarray, "3 3"]
    ) -> Float64[np.ndarray, "n"]:
        """Change where the point seen in column c and row r goes by ``velocity @ (c, r, 1)``."""
        told = np.linalg.solve(panel.matrix, velocity)
        seen = np.stack([self.columns, self.rows, np.ones(len(self.rows))])
        column, row, away = told @ seen
        if panel.source_cm is None:
            return self.slid(np.stack([row, column]))
        return self.slid(np.stack([row - self.rows * away, column - self.columns * away]))


def _rims(lines: Float64[np.ndarray, "n m"], side: int) -> Float64[np.ndarray, "_p m"]:
    """Values between the lines of every so many, those at the ends continued."""
    whole = np.concatenate([2 * lines[:1] - lines[1:2], lines, 2 * lines[-1:] - lines[-2:-1]])
    return np.asarray((whole[:-1:side] + whole[1::side]) / 2)


def slopes_by_pose(
    poses: Poses,
    number: int,
    told: ViewGeometry,
    vector: Float64[np.ndarray, "q"],
    gradient: Gradient,
    spread: Callable[[Float64[np.ndarray, "n"]], Float64[np.ndarray, "p"]],
    difference: Callable[[Float64[np.ndarray, "q"]], Float64[np.ndarray, "p"]],
) -> Float64[np.ndarray, "p q"]:
    """Give the derivatives of a view's image by the unknowns of the poses.

    An object that grows about the source looks as before. So one that grows about its middle looks
    as if it came as much of its way nearer.

    Parameters
    ----------
    poses, number, told, vector
        Which view, its panel as told, and where the object stands.
    gradient
        Of the image.
    spread
        Puts values of the gradient's pixels in their places among those that are compared.
    difference
        Derivative of these along a direction of the unknowns, by rendering: turns and growth, or
        shifts alone.
    """
    moves = poses.places(number)
    turns, shifts, slides = moves[: RIGID // 2], moves[RIGID // 2 : RIGID], moves[RIGID:]
    pose, sight = poses.of(number, vector), poses.sight(number, told, vector)
    middle, to_row = np.array(pose.centre_cm) + np.array(pose.shift_cm), told.row_step_cm
    row_cm = float(np.linalg.norm(to_row))
    panel = replace(told, pixel00_cm=told.pixel00_cm + pose.row_shift_cm / row_cm * to_row)
    frame, turn = _across_and_along(sight), turning(np.array(pose.rotation_rad))

    def along(places: Sequence[int], values: Float64[np.ndarray, "m"]) -> Float64[np.ndarray, "p"]:
        direction = np.zeros(poses.count)
        direction[places] = values
        return difference(direction)

    turned = [along(turns, np.linalg.solve(turn, axis)) for axis in frame[:2]]
    grown = [along([place], np.ones(1)) for place in poses.size_places]
    if panel.source_cm is None:
        turned.append(spread(gradient.spun(panel, frame[2], middle)))
        shifted = [spread(each) for each in gradient.moved(panel, frame[:2])]
        shifted.append(np.zeros_like(turned[0]))
    else:
        way_cm = float(np.linalg.norm(sight))
        slid = [spread(each) for each in gradient.turned(panel, frame)]
        turned.append(slid[2])
        # a turn about the source is one about the middle and a shift, across the beam and the axis
        shifted = [(turned[1] - slid[1]) / way_cm, (slid[0] - turned[0]) / way_cm]
        shifted.append(grown[0] / way_cm if grown else along(shifts, frame[2]))
    slopes = np.zeros((len(turned[0]), poses.count))
    slopes[:, turns] = np.stack(turned, axis=1) @ frame @ turn
    slopes[:, shifts] = np.stack(shifted, axis=1) @ frame
    for place in slides:
        slopes[:, place] = spread(gradient.by_row) / row_cm
    for place, each in zip(poses.size_places, grown, strict=True):
        slopes[:, place] = each
    return slopes


def _across_and_along(line: Vec3) -> Float64[np.ndarray, "3 3"]:
    """Give a right-handed frame as rows: two unit vectors across a line, and its own."""
    along = line / np.linalg.norm(line)
    helper = np.eye(3)[int(np.argmin(np.abs(along)))]
    first = np.cross(helper, along)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(along, first), along])


def turning(rotation_rad: Vec3) -> Float64[np.ndarray, "3 3"]:
    """Turn in space by a change of a rotation vector: the left Jacobian of SO(3).

    Examples
    --------
    >>> turning(np.zeros(3)).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    angle = float(np.linalg.norm(rotation_rad))
    cross = np.cross(rotation_rad, np.eye(3)).T
    if angle < SMALL_RAD:
        return np.asarray(np.eye(3) + cross / 2)
    first, second = (1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)
