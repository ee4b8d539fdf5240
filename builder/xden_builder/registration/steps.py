"""Moves of single poses on exact images: down, and over to the next trough."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Final

from xden_builder.registration.around import Around
from xden_builder.registration.body import Body
from xden_builder.registration.exact import Judge
from xden_builder.registration.kinds import apart, loss_of, most_of_rivals
from xden_builder.registration.likeness import Likeness
from xden_builder.registration.placement import Found, RigidPlacement
from xden_builder.registration.turns import box_turned, lowest_beside, same_share

__all__ = [
    "DERIVATIVES",
    "all_settled",
    "hopped",
    "settled",
    "settled_if_hopeful",
]

CLOSE, CLOSE_UNMOVED = 2.0, 1.5
"""A pose whose loss is more times that of a settled one, and than that was before, is not moved."""
HOPE: Final = 2.0
"""A pose is not moved on that would be no rival if it gained so many times as much as it just did.
"""
HOPEFUL: Final = 2.5
"""Times the loss of the best: of 75 turned poses none that left more after a derivative, and one
that left twice as much, came down to less than that."""
MOST_BESIDE: Final = 2
PROMISING: Final = (1.02, 0.001)
"""Turns beside a converged pose that are moved, and of how many times its loss, and so much more.
"""
DERIVATIVES, MOST_MOVES, SETTLED = 2, 8, 0.97
"""Taken on coarse images, at most on fine ones, and what is little to gain by one."""


def settled(judge: Judge, found: Found, best: Found | None = None) -> Found:
    """Move a pose, whose loss was rendered, until that gains little or it will be no rival."""
    for _ in range(MOST_MOVES):
        ahead = judge.refined(found, 1)
        gained = found.loss - ahead.loss
        if ahead.loss > SETTLED * found.loss:
            return min(ahead, found, key=loss_of)
        if best is not None and ahead.loss - HOPE * gained > most_of_rivals(best):
            return ahead
        found = ahead
    return found


def settled_if_hopeful(judge: Judge, found: Found, best: Found) -> Found:
    """Do the same of a pose that has moved along a derivative, if it came near the best by that."""
    return settled(judge, found, best) if found.loss <= HOPEFUL * best.loss else found


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

    What is nearly round or flat has several least losses in a row, and derivatives lead to the
    nearest. Followed are small turns about each principal axis and those of the box, all else
    following.
    """
    around = Around.of(judge, found)
    here = around.fixed(found.placement)
    lines = [lowest_beside(around.fixed, here, axis, judge.pixel_cm, body) for axis in range(3)]
    least = _least_of_lines(lines)
    times, more = PROMISING
    near = [each for each in least if each.loss <= times * found.loss + more]
    boxed = box_turned(partial(_either, judge, around), here, likeness, body)
    beside = [judge.refined(each, 1) for each in near]
    beside += [judge.refined(each, DERIVATIVES) for each in boxed]
    strict = likeness.strict
    there = [
        settled_if_hopeful(judge, each, found)
        if each.loss <= SETTLED * found.loss
        or apart(found.placement, each.placement, strict, body, same_share(body))
        else each  # it came back
        for each in beside
    ]
    return sorted([found, *there], key=loss_of)


def _least_of_lines(lines: Sequence[Sequence[Found]]) -> list[Found]:
    """Give the least losses of all lines, and the least of each.

    Along an axis that hardly turns anything several seem to leave less, all of which go back.
    """
    least = sorted((each for line in lines for each in line), key=loss_of)[:MOST_BESIDE]
    of_each = [min(line, key=loss_of) for line in lines if line]
    return [*least, *(each for each in of_each if each not in least)]


def _either(judge: Judge, around: Around, placement: RigidPlacement) -> Found:
    """Judge a pose with all else following a little, or with densities alone, which may swap."""
    anew = judge.elsewhere(around.found, placement)
    return min(around.fixed(placement), anew, key=loss_of)
