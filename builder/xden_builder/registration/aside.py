"""Moves that images hardly tell: along them lie other poses of least loss, if there are any."""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Float64

from xden_builder.poly.model.poses import RIGID

__all__ = ["moves_aside"]

SOFTEST: Final = 2
"""Ways that are followed, of six."""
REACHES: Final = (1.5, 3.0, 4.5, 6.0, 7.5)
"""In moves that would double the loss if it grew as it begins to."""
FARTHEST: Final = 0.4
"""Of the radius."""


def moves_aside(
    curvature: Float64[np.ndarray, "u u"], loss: float, first: int, radius_cm: float
) -> Float64[np.ndarray, "lines moves 6"]:
    """Give moves to either side along the softest ways of a pose.

    What is nearly round or nearly flat has several least losses in a row, and derivatives lead to
    the nearest. The row follows the eigenvectors of least curvature, where rotations are measured
    at the rim and all other unknowns, densities and gains, adapt.

    Parameters
    ----------
    curvature, loss
        Half the second derivatives of the loss, and the loss itself, at a least one.
    first
        Place of the pose's three rotations (radians) and three shifts (cm) among the unknowns.
    radius_cm
        Of the object.

    Returns
    -------
    ndarray
        One line to each side of each way; along a line, the shortest move first.

    Examples
    --------
    >>> stiff = np.diag([1.0, 1.0, 1.0, 1.0, 0.25, 1.0])
    >>> np.abs(moves_aside(stiff, 0.01, 0, 1.0)[0, 0]).round(6).tolist()
    [0.0, 0.0, 0.0, 0.0, 0.3, 0.0]
    """
    own = np.arange(first, first + RIGID)
    others = np.setdiff1d(np.arange(len(curvature)), own)
    follow = np.linalg.lstsq(curvature[np.ix_(others, others)], curvature[np.ix_(others, own)])[0]
    alone = curvature[np.ix_(own, own)] - curvature[np.ix_(own, others)] @ follow
    unit = np.repeat([1 / radius_cm, 1.0], RIGID // 2)
    stiffness, ways = np.linalg.eigh(alone * np.outer(unit, unit))
    doubling_cm = np.sqrt(loss / stiffness[:SOFTEST].clip(min=1e-9))
    reach_cm = np.outer(doubling_cm, REACHES).clip(max=FARTHEST * radius_cm)
    moves = reach_cm[:, :, None] * (unit[:, None] * ways[:, :SOFTEST]).T[:, None]
    return np.concatenate([moves, -moves])
