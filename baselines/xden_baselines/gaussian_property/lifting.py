"""From answers about regions of pictures to votes of points and parts in 3D."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Int64
from scipy.spatial import KDTree

from xden1k.values.arrays import Points
from xden_baselines.gaussian_property.library import ClosedList
from xden_baselines.gaussian_property.regions import Segmentation
from xden_baselines.gaussian_property.voters import Answer, Voter
from xden_baselines.gaussian_property.voting import Ballots, cast, new_ballots, winners
from xden_baselines.views.pictures import Pictures, visible

__all__ = ["Judged", "chosen_views", "judge", "vote_of_parts", "vote_of_points", "with_hidden"]

VIEWS = 10
"""As many as the original segments and shows to the model."""


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """A view, cut into regions, and what each of them is made of.

    Parameters
    ----------
    view
        Which of the pictures.
    segmentation
        See :mod:`.regions`.
    answers
        For each region, from the first.
    """

    view: int
    segmentation: Segmentation
    answers: tuple[Answer, ...]

    def weights(self, *, weighted: bool) -> np.ndarray:
        """Return the weight of each answer: its confidence, or 1; 0 where there is none."""
        plain = [0.0 if one.silent else 1.0 for one in self.answers]
        return np.array([one.confidence for one in self.answers] if weighted else plain)

    @property
    def materials(self) -> Int64[np.ndarray, "regions"]:
        """Material of each answer."""
        return np.array([one.material for one in self.answers], dtype=np.int64)


def chosen_views(pictures: Pictures) -> Pictures:
    """Return ten views, or all if there are fewer: every so many, by where the cameras are.

    The order in which the pictures come does not matter.
    """
    places = np.array([camera.camera_to_world[:3].ravel() for camera in pictures.cameras])
    order = np.lexsort(places.T)
    every = np.linspace(0, len(order) - 1, min(VIEWS, len(order))).round().astype(int)
    return pictures.take(order[every].tolist())


def judge(
    object_id: str, pictures: Pictures, segmentations: Sequence[Segmentation], voter: Voter
) -> tuple[Judged, ...]:
    """Have the regions of every view judged.

    Raises
    ------
    ChatError
        If a chat model is asked and does not answer.
    """
    return tuple(
        Judged(view, cut, voter.vote(object_id, pictures.colors[view], cut))
        for view, cut in enumerate(segmentations)
    )


def vote_of_points(
    points_cm: Points,
    pictures: Pictures,
    judged: Sequence[Judged],
    materials: ClosedList,
    *,
    tolerance_cm: float,
    weighted: bool = False,
) -> Ballots:
    """Let each point collect the answers to the regions in which views see it.

    Parameters
    ----------
    points_cm
        At the surface.
    pictures, judged
        The views, and what was said of them.
    materials
        The closed list.
    tolerance_cm
        How far behind the surface that a view sees a point may lie.
    weighted
        Whether a vote counts by its confidence; else as one.
    """
    ballots = new_ballots(len(points_cm), materials)
    for one in judged:
        seen, pixels = visible(points_cm, pictures, one.view, tolerance_cm=tolerance_cm)
        region = one.segmentation[pixels[:, 0], pixels[:, 1]]
        points, which = np.flatnonzero(seen)[region > 0], region[region > 0] - 1
        cast(ballots, points, one.materials[which], one.weights(weighted=weighted)[which])
    return ballots


def vote_of_parts(
    parts: int,
    shown: Sequence[Int64[np.ndarray, "_"]],
    judged: Sequence[Judged],
    materials: ClosedList,
) -> Ballots:
    """Let each part collect the answers of the views that show it.

    Parameters
    ----------
    parts
        How many there are.
    shown
        For each view, the index of the part that each of its regions is.
    judged, materials
        What was said of the views, and the closed list.
    """
    ballots = new_ballots(parts, materials)
    for one, which in zip(judged, shown, strict=True):
        cast(ballots, which, one.materials, one.weights(weighted=False))
    return ballots


def with_hidden(ballots: Ballots, meshes: Sequence[trimesh.Trimesh]) -> Ballots:
    """Give each part without a vote those of the parts nearest to its surface.

    Each corner of a hidden part takes a vote for what the nearest corner of a part that was seen
    is made of.

    Raises
    ------
    ValueError
        If no part has a vote.
    """
    chosen = winners(ballots)
    known = np.flatnonzero(chosen >= 0).tolist()
    corners = np.concatenate([np.asarray(meshes[part].vertices) for part in known])
    of_corner = np.repeat(chosen[known], [len(meshes[part].vertices) for part in known])
    tree, filled = KDTree(corners), ballots.copy()
    for part in np.flatnonzero(chosen < 0).tolist():
        _, nearest = tree.query(np.asarray(meshes[part].vertices))
        np.add.at(filled[part], of_corner[nearest], 1)
    return filled
