"""Which of the poses that were found is used, and how sure it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden1k.errors import DataError
from xden_builder.capture import Capture
from xden_builder.capture.pose import Candidate
from xden_builder.registration.body import Body
from xden_builder.registration.coarse_pose import told_one
from xden_builder.registration.exact import Judge
from xden_builder.registration.kinds import elsewhere
from xden_builder.registration.likeness import Likeness
from xden_builder.registration.middles import lone_sight
from xden_builder.registration.placement import Found, Registration, RigidPlacement
from xden_builder.registration.steps import settled
from xden_builder.registration.turns import symmetric_turns

__all__ = ["judged"]

SCALES: Final = (0.49, 2.05)
"""Between 0.5 and 2, and a little for meshes that err themselves."""
LOOKS_ALIKE: Final = 0.1
"""Logarithm of attenuations, of parts that images can hardly tell apart."""
MOST_OUTLINE: Final = 0.12
"""Of a shape that is believed: share of the outline's pixels."""


def judged(
    capture: Capture,
    candidates: Sequence[Found],
    judge: Judge,
    likeness: Likeness,
    body: Body,
    *,
    doubted: bool,
    is_mirrored: bool,
) -> Registration:
    """Choose one of unlike poses, and say how sure it is.

    Parameters
    ----------
    capture
        What a person told of the pose.
    candidates, judge
        Unlike poses, the best first, and what compared them.
    likeness, body
        How far apart poses are, and of what.
    doubted
        Whether even the best leaves much.
    is_mirrored
        Whether the mirror image of the meshes fits far better.

    Raises
    ------
    DataError
        If the scale found lies outside 0.5 to 2, or a candidate is asked for that there is not.
    """
    told, named = _told(capture, candidates, body), isinstance(capture.pose, Candidate)
    chosen = told or 0
    best = candidates[0].placement
    outlines = judge.outline_shares(candidates[chosen])
    raised = {
        "pose_ambiguous": told is None and _is_ambiguous(candidates, judge, likeness, body),
        "pose_not_found": not named and doubted,
        "shape_differs": max(outlines.values()) > MOST_OUTLINE,
    }
    if not named and is_mirrored:
        raised = {"mirrored": True}
    _check_scale(candidates[chosen].placement.scale)
    return Registration(
        tuple(candidates),
        len(symmetric_turns(best, likeness, body)),
        chosen,
        outlines,
        tuple(flag for flag, is_raised in raised.items() if is_raised),
    )


def _is_ambiguous(
    candidates: Sequence[Found], judge: Judge, likeness: Likeness, body: Body
) -> bool:
    """Whether one as good as the first puts parts elsewhere, by labels and by what is seen."""
    best = candidates[0].placement
    rivals = [
        each.placement
        for each in candidates[1:]
        if each.as_good_as(candidates[0]) and elsewhere(best, each.placement, likeness, body)
    ]
    if not rivals:
        return False
    seen = _as_seen(judge, best, body)
    return any(elsewhere(best, each, *seen) for each in rivals)


def _as_seen(judge: Judge, best: RigidPlacement, body: Body) -> tuple[Likeness, Body]:
    """Take parts for one kind that look alike: one of four legs may have no label.

    Where something may have no mesh, what parts look like says little.
    """
    there = settled(judge, judge.fixed(best))
    seen = body if judge.incomplete else replace(body, lac_per_cm=_joined(judge.lac_per_cm(there)))
    return Likeness(seen, lone_sight(judge.shadows)), seen


def _joined(lac_per_cm: Float64[np.ndarray, "k"]) -> Float64[np.ndarray, "k"]:
    """Give those the same value that differ by little; spectra differ by materials.

    Examples
    --------
    >>> _joined(np.array([1.30, 0.20, 1.24])).round(2).tolist()
    [1.27, 0.2, 1.27]
    >>> _joined(np.array([1.0, 1.08, 1.16, 1.24])).round(2).tolist()
    [1.04, 1.04, 1.2, 1.2]
    """
    logs = np.log(lac_per_cm)
    kinds, least = np.empty(len(logs), dtype=np.int64), -np.inf
    for place in np.argsort(logs).tolist():
        least = least if logs[place] - least <= LOOKS_ALIKE else logs[place]
        kinds[place] = np.searchsorted(np.sort(logs), least)
    return np.exp([logs[kinds == kind].mean() for kind in kinds])


def _told(capture: Capture, candidates: Sequence[Found], body: Body) -> int | None:
    """Index of the candidate that a person chose, by its number or its pose; None where nobody did.

    Raises
    ------
    DataError
        If there is none of that number.
    """
    if not isinstance(capture.pose, Candidate):
        return told_one(capture.pose, candidates, body)
    if capture.pose.number > len(candidates):
        raise DataError(
            f"objects.csv, pose: candidate {capture.pose.number} was asked for, and the poses that "
            f"were found are {len(candidates)}; look at the page of `xden-build align`"
        )
    return capture.pose.number - 1


def _check_scale(scale: float) -> None:
    least, most = SCALES
    if not least <= scale <= most:
        raise DataError(
            f"the shadows are {scale:.3g} times as large as the meshes' would be; a scale between "
            "0.5 and 2 was expected: check mesh_units in objects.csv"
        )
