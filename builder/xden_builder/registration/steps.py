"""Moves of single poses on exact images: down, and over to the next trough."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

from xden_builder.registration.body import Body
from xden_builder.registration.exact import Judge
from xden_builder.registration.kinds import apart, loss_of, most_of_rivals
from xden_builder.registration.likeness import Likeness
from xden_builder.registration.placement import Found, RigidPlacement

__all__ = ["DERIVATIVES", "all_settled", "hopped", "rescaled", "settled"]

CLOSE, CLOSE_UNMOVED = 2.0, 1.5
"""A pose whose loss is more times that of a settled one, and than that was before, is not moved."""
HOPE: Final = 2.0
"""A pose is not moved on that would be no rival if it gained so many times as much as it just did.
"""
HOPS: Final = 2
"""Poses beside a converged one that are refined."""
SOFT_LOSS: Final = 1.6
"""Where the loss is less times that of the pose, which lies farther than where it should double,
there may be another least one."""
WALL: Final = 5.0
"""Where the loss is more times that of the pose, a line that leads away is not followed on."""
DERIVATIVES, MOST_MOVES, SETTLED = 2, 8, 0.97
"""Taken on coarse images, at most on fine ones, and what is little to gain by one."""
MOST_ROUNDS: Final = 4
"""Changes of a scale by one share."""


def settled(judge: Judge, found: Found, best: Found | None = None) -> Found:
    """Move a pose until that gains little, or it will be no rival to a better one."""
    for _ in range(MOST_MOVES):
        ahead = judge.refined(found, 1)
        gained = found.loss - ahead.loss
        if ahead.loss > SETTLED * found.loss:
            return min(ahead, found, key=loss_of)
        if best is not None and ahead.loss - HOPE * gained > most_of_rivals(best):
            return ahead
        found = ahead
    return found


def all_settled(judge: Judge, found: Sequence[Found]) -> list[Found]:
    """Move poses, the best first, but not those that are hopeless beside another."""
    there = [settled(judge, found[0])]
    for each in found[1:]:
        best = min(there, key=loss_of)
        if each.loss <= max(CLOSE * best.loss, CLOSE_UNMOVED * found[0].loss):
            there.append(settled(judge, each, best))
    return sorted(there, key=loss_of)


def hopped(judge: Judge, found: Found, likeness: Likeness, body: Body) -> list[Found]:
    """Give a converged pose, and those that are reached from beside it, the least loss first.

    Followed are lines along which the images tell the pose least.
    """
    lines = [
        list(_promising(judge, found, _elsewhere(line, found, likeness, body)))
        for line in judge.lines_aside(found)
    ]
    best = sorted((min(line, key=loss_of) for line in lines if line), key=loss_of)[:HOPS]
    return sorted([found, *(settled(judge, each, found) for each in best)], key=loss_of)


def _elsewhere(
    line: Sequence[RigidPlacement], found: Found, likeness: Likeness, body: Body
) -> list[RigidPlacement]:
    """Leave out what puts the object where a pose does, because it is symmetric."""
    return [each for each in line if apart(found.placement, each, likeness, body)]


def _promising(judge: Judge, found: Found, line: Sequence[RigidPlacement]) -> Iterator[Found]:
    """Yield poses on a line from a pose where the loss falls again, or has hardly grown."""
    before = found
    for placement in line:
        here = judge.fixed(placement)
        if here.loss < max(before.loss, SOFT_LOSS * found.loss):
            yield here
        if here.loss > WALL * found.loss:
            return
        before = here


def rescaled(judge: Judge, found: Found, body: Body, shares: Sequence[float]) -> Found:
    """Stretch and shrink about the object's middle, by less and less, while that gains."""
    for share in shares:
        for _ in range(MOST_ROUNDS):
            tries = [
                judge.refined(
                    replace(found, placement=_stretched(found.placement, 1 + step, body)),
                    DERIVATIVES,
                )
                for step in (-share, share)
            ]
            ahead = min(tries, key=loss_of)
            if ahead.loss >= found.loss:
                break
            found = ahead
    return found


def _stretched(placement: RigidPlacement, factor: float, body: Body) -> RigidPlacement:
    """Change the scale, the object's middle staying where it is."""
    own = body.placed(placement)
    return body.of_files(replace(own, scale=factor * own.scale))
