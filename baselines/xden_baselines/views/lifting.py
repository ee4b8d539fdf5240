"""What several views say of the voxels at an object's surface."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Bool, Float64, Integer, Shaped

from xden1k.access.samples import SampleView
from xden1k.errors import DataError
from xden_baselines.geometry import SKIN, near_surface, voxel_centres_cm
from xden_baselines.views.pictures import Pictures, visible

__all__ = ["Votes", "votes_at_surface", "whole_votes"]

Votes = Float64[np.ndarray, "voxels choices"]


def votes_at_surface(
    sample: SampleView,
    pictures: Pictures,
    said: Iterable[Shaped[np.ndarray, "rows columns choices"]],
    choices: int,
) -> tuple[Bool[np.ndarray, "64 64 64"], Votes]:
    """Add up what the views say where they show a voxel.

    Parameters
    ----------
    sample
        Its envelope.
    pictures
        Of the object.
    said
        Of each view, what share of a vote each choice has at each pixel; nothing where all are 0.
    choices
        How many there are.

    Returns
    -------
    surface
        Voxels near the surface that got a vote.
    votes
        Of each of these in C order, summed over views.

    Raises
    ------
    DataError
        If no view shows any of the surface.
    """
    surface = near_surface(sample)
    points = voxel_centres_cm(sample, surface)
    votes = np.zeros((len(points), choices))
    tolerance_cm = SKIN * sample.voxel_size_cm
    for view, shares in enumerate(said):
        seen, pixels = visible(points, pictures, view, tolerance_cm=tolerance_cm)
        votes[seen] += shares[pixels[:, 0], pixels[:, 1]]
    voted = votes.any(axis=1)
    if not voted.any():
        raise DataError(f"{sample.object_id}: no view shows any of its surface")
    surface[surface] = voted
    return surface, votes[voted]


def whole_votes(
    chosen: Integer[np.ndarray, "rows columns"], choices: int
) -> Bool[np.ndarray, "rows columns choices"]:
    """Give each pixel one vote, for what is chosen there; none where that is no choice."""
    return np.asarray(chosen[..., None] == np.arange(choices))
