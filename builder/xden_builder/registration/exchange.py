"""Which mesh is which, of parts alike by shape and label that look unlike.

Where a turn lays every part onto one of its kind, two of them may exchange their densities. Kinds
are told by labels while poses are sought, since what is seen in a wrong pose says nothing.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float64, Int
from scipy.optimize import linear_sum_assignment

from xden_builder.registration.body import Body
from xden_builder.registration.exact import Judge
from xden_builder.registration.kinds import most_of_rivals
from xden_builder.registration.likeness import Likeness
from xden_builder.registration.middles import lone_sight
from xden_builder.registration.placement import Found, RigidPlacement
from xden_builder.registration.steps import settled
from xden_builder.registration.turns import symmetric_box_turns, symmetric_turns

__all__ = ["exchanged"]

LOOKS_UNLIKE: Final = 0.2
"""Difference of logarithms of attenuations that is told: legs of one wood differ by less."""
MOST, TRIED = 3, 12
"""Exchanges that are judged, and turns that make one of them: the least loss is taken."""
FAR: Final = 1e9


def exchanged(
    judge: Judge, best: Found, likeness: Likeness, body: Body
) -> tuple[list[Found], Likeness]:
    """Give poses in which parts of one kind stand in each other's place, with other densities.

    Parameters
    ----------
    judge, best
        A settled pose, and what judged it.
    likeness
        Takes parts of like labels for one kind.
    body
        The object.

    Returns
    -------
    list of Found
        Those that explain the images about as well; mostly none.
    Likeness
        Tells them from the best: by labels, and by what is seen.
    """
    logs = np.log(judge.lac_per_cm(best))
    kinds = _split(likeness.kinds, logs)
    if kinds.max() == likeness.kinds.max():
        return [], likeness
    here = best.placement
    turns = [
        *symmetric_box_turns(here, likeness, body),
        *symmetric_turns(here, likeness, body),
    ]
    alike: dict[tuple[int, ...], list[RigidPlacement]] = {}
    for turn in turns:
        alike.setdefault(tuple(_exchange(here, turn, likeness, body)), []).append(turn)
    found = []
    for order in [each for each in alike if _apart(logs[[*each]], logs)][:MOST]:
        exchanging, density = judge.exchanged(order), best.density_g_cm3[[*order]]
        there = min(
            (replace(best, placement=turn, density_g_cm3=density) for turn in alike[order][:TRIED]),
            key=exchanging.loss_as_found,
        )
        there = settled(exchanging, exchanging.refined(there, 1), best)
        as_before = judge.loss_as_found(replace(there, density_g_cm3=best.density_g_cm3))
        is_rival = there.loss <= most_of_rivals(best) < as_before
        if is_rival and _apart(np.log(exchanging.lac_per_cm(there)), logs):
            found.append(there)
    return found, Likeness(body, lone_sight(judge.shadows), kinds)


def _apart(one: Float64[np.ndarray, "k"], other: Float64[np.ndarray, "k"]) -> bool:
    """Whether a part looks unlike in two poses, by logarithms of its attenuation."""
    return bool(np.abs(one - other).max() > LOOKS_UNLIKE)


def _split(kinds: Int[np.ndarray, "k"], logs: Float64[np.ndarray, "k"]) -> Int[np.ndarray, "k"]:
    """Part each kind where its members look unlike; gives numbers from 0.

    Examples
    --------
    >>> _split(np.array([0, 0, 1, 0]), np.array([0.0, 0.5, 3.0, 0.1])).tolist()
    [0, 1, 2, 0]
    """
    finer, count = np.empty_like(kinds), -1
    for kind in np.unique(kinds):
        first = -np.inf
        members = np.flatnonzero(kinds == kind)
        for place in members[np.argsort(logs[members])].tolist():
            if logs[place] - first > LOOKS_UNLIKE:
                first, count = logs[place], count + 1
            finer[place] = count
    return finer


def _exchange(
    here: RigidPlacement, turned: RigidPlacement, likeness: Likeness, body: Body
) -> list[int]:
    """Say in which part's place each part comes to stand, of its kind, by centroids and sizes."""
    centroids_cm = np.array([mesh.centroid for mesh in body.space.meshes])
    sizes_cm = np.cbrt([abs(mesh.volume) for mesh in body.space.meshes])
    back_cm = (turned.apply(centroids_cm) - here.translation_cm) @ here.rotation / here.scale
    away_cm = np.linalg.norm(back_cm[:, None] - centroids_cm, axis=2)
    costs = away_cm + np.abs(sizes_cm[:, None] - sizes_cm)
    unlike_kinds = likeness.kinds[:, None] != likeness.kinds
    _, order = linear_sum_assignment(np.where(unlike_kinds, FAR, costs))
    return [int(place) for place in order]
