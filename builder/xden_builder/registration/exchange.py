"""Which mesh is which, of parts alike by shape and label that look unlike.

Where a turn lays every part onto one of its kind, two of them may exchange their densities. Kinds
are told by labels while poses are sought, since what is seen in a wrong pose says nothing.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from xden_builder.registration.body import Body
from xden_builder.registration.exact import Judge
from xden_builder.registration.kinds import apart, most_of_rivals
from xden_builder.registration.likeness import Likeness, unlike
from xden_builder.registration.middles import lone_sight
from xden_builder.registration.placement import Found, RigidPlacement
from xden_builder.registration.steps import settled
from xden_builder.registration.turns import symmetric_box_turns, symmetric_turns

__all__ = ["exchanged"]

LOOKS_UNLIKE: Final = 0.2
"""Difference of logarithms of attenuations, and of densities, that is told: legs of one wood differ
by less."""
MOST: Final = 3
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
        Tells them from the best: the same if there are none.
    """
    logs = np.log(judge.lac_per_cm(best))
    if max(np.ptp(logs[likeness.kinds == kind]) for kind in likeness.kinds) < LOOKS_UNLIKE:
        return [], likeness
    here = best.placement
    turns = [
        *symmetric_box_turns(here, likeness, body),
        *symmetric_turns(here, likeness, body),
    ]
    if not turns:
        return [], likeness
    single = Likeness(body, lone_sight(judge.shadows), np.arange(len(logs)))
    is_apart = partial(apart, likeness=single, body=body)
    placements = [here, *turns]
    _, *others = (placements[number] for number in unlike(placements, is_apart, MOST + 1))
    found = []
    for each in others:
        order = _exchange(here, each, likeness, body)
        there = replace(best, placement=each, density_g_cm3=best.density_g_cm3[order])
        as_before = judge.loss_of(replace(there, density_g_cm3=best.density_g_cm3))
        exchanging = judge.exchanged(order)
        there = settled(exchanging, exchanging.refined(there, 1), best)
        off = np.abs(np.log(exchanging.lac_per_cm(there)) - logs).max()
        if off > LOOKS_UNLIKE and there.loss <= most_of_rivals(best) < as_before:
            found.append(there)
    return found, single if found else likeness


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
