"""From answers to materials and densities: majorities, and confidence-weighted counts."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int64

from xden_baselines.gaussian_property.library import ClosedList

__all__ = [
    "Ballots",
    "cast",
    "expected_density_g_cm3",
    "middle_density_g_cm3",
    "new_ballots",
    "winners",
]

Ballots = Int64[np.ndarray, "voters materials"]
"""Votes of each point or part for each material, in millionths: whole numbers add up alike in any
order, so the order of the views cannot matter."""

UNIT = 1_000_000
PRIOR_VOTES = 1.0
"""Votes that the training split's shares are worth."""


def new_ballots(voters: int, materials: ClosedList) -> Ballots:
    """No vote yet."""
    return np.zeros((voters, len(materials)), dtype=np.int64)


def cast(
    ballots: Ballots,
    voters: Int64[np.ndarray, "votes"],
    materials: Int64[np.ndarray, "votes"],
    weights: Float[np.ndarray, "votes"],
) -> None:
    """Add votes: a voter may come more than once."""
    np.add.at(ballots, (voters, materials), np.rint(UNIT * weights).astype(np.int64))


def winners(ballots: Ballots) -> Int64[np.ndarray, "voters"]:
    """Material with most votes, of several the first of the list; -1 without a vote.

    Examples
    --------
    >>> winners(np.array([[0, 2, 1], [1, 0, 1], [0, 0, 0]])).tolist()
    [1, 0, -1]
    """
    return np.where(ballots.any(axis=1), ballots.argmax(axis=1), -1)


def middle_density_g_cm3(
    chosen: Int64[np.ndarray, "voters"], materials: ClosedList
) -> Float[np.ndarray, "voters"]:
    """Middle of the range of each voter's material, none of them -1."""
    return np.asarray(materials.middles_g_cm3[chosen])


def expected_density_g_cm3(
    ballots: Ballots, materials: ClosedList
) -> tuple[Float[np.ndarray, "voters"], Float[np.ndarray, "voters"]]:
    """Mean and standard deviation of each voter's density, its votes taken as Dirichlet counts.

    The prior is :data:`PRIOR_VOTES` votes in the shares of the training split, each material's
    range is uniform, and the variance is that within the materials and between them (law of total
    variance). Without a vote the prior is all there is.
    """
    counts = ballots / UNIT + PRIOR_VOTES * materials.shares
    shares = counts / counts.sum(axis=1, keepdims=True)
    middles, ranges = materials.middles_g_cm3, materials.ranges_g_cm3
    within = (ranges[:, 1] - ranges[:, 0]) ** 2 / 12
    mean = shares @ middles
    variance = shares @ (within + middles**2) - mean**2
    return mean, np.sqrt(variance.clip(min=0))
