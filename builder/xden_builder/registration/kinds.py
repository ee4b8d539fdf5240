"""Found poses as one list: which are unlike, the best first."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Final

import numpy as np

from xden_builder.registration.body import Body
from xden_builder.registration.likeness import Likeness, unlike
from xden_builder.registration.placement import Found, RigidPlacement

__all__ = [
    "APART_SHARE",
    "CLOSE",
    "FINAL_APART",
    "apart",
    "close_to_best",
    "elsewhere",
    "first_of_like",
    "listed_of",
    "loss_of",
    "most_of_rivals",
    "unlike_of",
]

APART_SHARE: Final = 0.01
"""Of the radius: poses that are nearer are one."""
FINAL_APART: Final = 0.02
"""The same of those that are moved on fine images."""
ELSEWHERE, ELSEWHERE_CM = (0.005, 0.025), 0.05
"""Least and most of the radius, and in cm between these, half a millimetre as `evaluate` lets pass:
where a twentieth of a part is farther off, it is another pose."""
RIVAL: Final = (1.3, 0.02)
"""A pose whose loss is at most so many times the least, and so much more, may be right too."""
CLOSE: Final = 3.0
"""A pose whose loss is more times the least is no longer looked at."""


def apart(
    one: RigidPlacement,
    other: RigidPlacement,
    likeness: Likeness,
    body: Body,
    share: float = APART_SHARE,
) -> bool:
    """Whether two poses of the files' frame put the object apart by a share of its radius."""
    return likeness.apart(body.placed(one), body.placed(other), share * body.radius_cm)


def elsewhere(one: RigidPlacement, other: RigidPlacement, likeness: Likeness, body: Body) -> bool:
    """Whether poses put a twentieth of a part elsewhere."""
    share = float(np.clip(ELSEWHERE_CM / body.radius_cm, *ELSEWHERE))
    return apart(one, other, likeness.listing, body, share)


def loss_of(found: Found) -> float:
    """Give what poses are sorted by."""
    return found.loss


def most_of_rivals(best: Found) -> float:
    """Loss up to which a pose may be right as well as the best."""
    times, more = RIVAL
    return times * best.loss + more


def unlike_of(
    found: Sequence[Found],
    likeness: Likeness,
    body: Body,
    most: int,
    apart_share: float = APART_SHARE,
) -> list[Found]:
    """Keep the best of poses that are unlike by a share of the radius, the best first."""
    return first_of_like(sorted(found, key=loss_of), likeness, body, most, apart_share)


def first_of_like(
    found: Sequence[Found],
    likeness: Likeness,
    body: Body,
    most: int,
    apart_share: float = APART_SHARE,
) -> list[Found]:
    """Keep the first of poses that are unlike by a share of the radius, in their order."""
    own = [body.placed(each.placement) for each in found]
    is_apart = partial(likeness.apart, least_cm=apart_share * body.radius_cm)
    return [found[k] for k in unlike(own, is_apart, most)]


def listed_of(found: Sequence[Found], likeness: Likeness, body: Body, most: int) -> list[Found]:
    """Keep the first of poses that are unlike, or put a part's end elsewhere, in their order."""

    def is_apart(one: RigidPlacement, other: RigidPlacement) -> bool:
        return apart(one, other, likeness, body) or elsewhere(one, other, likeness, body)

    return [found[k] for k in unlike([each.placement for each in found], is_apart, most)]


def close_to_best(found: Sequence[Found], times: float = CLOSE) -> list[Found]:
    """Leave out hopeless poses; the least loss first."""
    ordered = sorted(found, key=loss_of)
    return [each for each in ordered if each.loss <= times * ordered[0].loss]
