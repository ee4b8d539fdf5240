"""From a capture to the pose of its meshes: shadows, shortlist, exact comparison, judgement."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from xden1k.errors import DataError
from xden_builder.capture import Capture
from xden_builder.capture.pose import Candidate, CoarsePose
from xden_builder.capture.saturation import completed
from xden_builder.physics.groups import energy_groups
from xden_builder.physics.source import Tube
from xden_builder.poly.materials.candidates import candidate_table
from xden_builder.registration.body import Body
from xden_builder.registration.contest import told_apart
from xden_builder.registration.exact import Judge
from xden_builder.registration.likeness import Likeness, unlike
from xden_builder.registration.placement import Found, Registration, RigidPlacement
from xden_builder.registration.reduced import USUAL_KEV
from xden_builder.registration.shadow import Shadow, shadow_of
from xden_builder.registration.shortlist import (
    USUAL,
    WIDE,
    Breadth,
    Poses,
    Search,
    shortlist,
    turned_about,
)

__all__ = ["register"]

COARSE_PX, FINE_PX = 80, 240
"""Width of the shadow, in averaged pixels, for many poses and for few."""
CLOSE: Final = 4.0
"""A pose whose loss is more times the least is no longer looked at."""
HOPS, BESIDE = 2, 2
"""Poses beside a converged one that are refined, and that are kept, itself counted."""
SOFT_LOSS: Final = 1.6
"""Where the loss is less times that of the pose, which lies farther than where it should double,
there may be another least one."""
WALL: Final = 5.0
"""Where the loss is more times that of the pose, a line that leads away is not followed on."""
COMPARED: Final = 4
"""Poses that are refined on coarse images."""
TURN_DEG, ROLL_DEG = 30, 15
"""Between turns about an axis, for the two best poses and for the best."""
SOFT: Final = (2.0, 0.004)
"""A turn about an axis whose cost is at most so many times that of the pose, and so much more, may
be right too: few points on few pixels do not tell."""
MOST_ROLLS: Final = 30
FINAL, FINAL_APART = 3, 0.02
"""Poses that are moved on fine images, and by how much of the radius they differ at least."""
DERIVATIVES, MOST_ROUNDS, SETTLED = 2, 4, 0.97
"""Taken before it is asked whether a pose gains, how often, and what is little to gain."""
LISTED: Final = 6
ELSEWHERE: Final = 0.025
"""Of the radius: an equally good pose that is farther makes the pose ambiguous."""
SYMMETRIC: Final = 0.03
"""Of the radius: a turn that moves surfaces less leaves the object where it is."""
APART_SHARE: Final = 0.01
"""Of the radius: poses that are nearer are one."""
GROUPS: Final = 8
NEAR_RAD, NEAR_COUNT = np.radians(30.0), 300
"""Around a pose that a person told."""
SCALE_SHARES, LAST_SCALE_SHARES = (0.08, 0.03, 0.01), (0.01, 0.004, 0.0015)
"""By which a scale that is sought is changed, on coarse images and on fine ones."""
SCALES: Final = (0.49, 2.05)
"""Between 0.5 and 2, and a little for meshes that err themselves."""
WORST_LOSS: Final = 2.4
"""Of a pose that is believed: of 384 right ones of simulated objects six are worse."""
DOUBTED_LOSS: Final = 1.5
"""Of a pose that is looked for again, wider: one right pose of twenty is worse."""
MOST_OUTLINE: Final = 0.12
"""Of a shape that is believed: share of the outline's pixels."""


def register(capture: Capture, order: Sequence[int]) -> Registration:
    """Find where the meshes of an object stand before the scanner, from nothing or from a word.

    Parameters
    ----------
    capture
        Its meshes in any frame; ``pose`` tells what is known, ``mesh_scale`` whether
        their scale between 0.5 and 2 is sought too.
    order
        Which part owns space first.

    Returns
    -------
    Registration
        Deterministic.

    Raises
    ------
    DataError
        If a view shows no shadow or its edge cuts it, the meshes are flat, the scale found lies
        outside 0.5 to 2, or a candidate is asked for that there is not.
    """
    shadows = [
        shadow_of(
            completed(view, capture.at_least.get(view.name))[0], turned=view.name in capture.turned
        )
        for view in capture.fitted_views
    ]
    meshes = [part.mesh for part in capture.parts]
    body = Body.of(meshes, order, _usual_lac_per_cm(capture))
    likeness = Likeness(body)
    candidates, fine = _searched(capture, shadows, body, likeness, USUAL)
    if candidates[0].loss > DOUBTED_LOSS and not isinstance(capture.pose, CoarsePose):
        wider = _searched(capture, shadows, body, likeness, WIDE)
        if wider[0][0].loss < candidates[0].loss:
            candidates, fine = wider
    return _judged(capture, candidates, likeness, body, fine)


def _searched(
    capture: Capture, shadows: Sequence[Shadow], body: Body, likeness: Likeness, breadth: Breadth
) -> tuple[list[Found], Judge]:
    """Find unlike poses, the best first, and what compared them on the finest images."""
    found, search = _coarsely(capture, shadows, body, likeness, breadth)
    fine = Judge.of(capture, shadows, body, FINE_PX, found[0].placement)
    rolled = _soft_turns(found[0], search, body, ROLL_DEG)
    near = [fine.fixed(each) for each in (*(each.placement for each in found), *rolled)]
    best = _all_settled(fine, _unlike(near, likeness, body, FINAL, FINAL_APART))
    if capture.mesh_scale == "unknown":
        best[0] = _rescaled(fine, best[0], body, LAST_SCALE_SHARES)
    beside = _unlike(_hopped(fine, best[0], likeness, body), likeness, body, BESIDE, APART_SHARE)
    rivals = _unlike([*beside, *best[1:]], likeness, body, LISTED, APART_SHARE)
    told = told_apart(capture, body.order, shadows, rivals)
    return _first_of_like([*told, *sorted(near, key=_loss)], likeness, body), fine


def _coarsely(
    capture: Capture, shadows: Sequence[Shadow], body: Body, likeness: Likeness, breadth: Breadth
) -> tuple[list[Found], Search]:
    """Find a few poses on coarse images, the best first, and what the shortlist was made by."""
    poses, search = shortlist(
        shadows,
        body,
        likeness,
        _told_rotations(capture, body),
        scaled=capture.mesh_scale == "unknown",
        breadth=breadth,
    )
    there = [body.of_files(each) for each in poses.placements()]
    judge = Judge.of(capture, shadows, body, COARSE_PX, there[0])
    found = [judge.fixed(each) for each in there]
    found = [*found, *_turned(found, search, body, judge)]
    found = _unlike(found, likeness, body, COMPARED, APART_SHARE)
    found = sorted((judge.refined(each.placement, DERIVATIVES) for each in found), key=_loss)
    if capture.mesh_scale == "unknown":
        found = sorted((_rescaled(judge, each, body, SCALE_SHARES) for each in found), key=_loss)
    return [*_hopped(judge, _settled(judge, found[0]), likeness, body), *found[1:]], search


def _settled(judge: Judge, found: Found) -> Found:
    """Move a pose until that gains little."""
    for _ in range(MOST_ROUNDS):
        ahead = judge.refined(found.placement, DERIVATIVES)
        if ahead.loss > SETTLED * found.loss:
            return min(ahead, found, key=_loss)
        found = ahead
    return found


def _all_settled(judge: Judge, found: Sequence[Found]) -> list[Found]:
    """Move poses, the best first, but not those that are hopeless beside another."""
    settled: list[Found] = []
    for each in found:
        if not settled or each.loss <= CLOSE * min(settled, key=_loss).loss:
            settled.append(_settled(judge, each))
    return sorted(settled, key=_loss)


def _hopped(judge: Judge, found: Found, likeness: Likeness, body: Body) -> list[Found]:
    """Give a converged pose, and those that are reached from beside it, the least loss first.

    Followed are lines along which the images tell the pose least.
    """
    lines = [
        list(_promising(judge, found, _elsewhere(line, found, likeness, body)))
        for line in judge.lines_aside(found)
    ]
    best = sorted((min(line, key=_loss) for line in lines if line), key=_loss)[:HOPS]
    return sorted([found, *(_settled(judge, each) for each in best)], key=_loss)


def _elsewhere(
    line: Sequence[RigidPlacement], found: Found, likeness: Likeness, body: Body
) -> list[RigidPlacement]:
    """Leave out what puts the object where a pose does, because it is symmetric."""
    apart_cm = APART_SHARE * body.radius_cm
    here = found.placement
    return [each for each in line if _distance_cm(here, each, likeness, body) >= apart_cm]


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


def _rescaled(judge: Judge, found: Found, body: Body, shares: Sequence[float]) -> Found:
    """Stretch and shrink about the object's middle, by less and less, while that gains."""
    for share in shares:
        for _ in range(MOST_ROUNDS):
            tries = [
                judge.refined(_stretched(found.placement, 1 + step, body), DERIVATIVES)
                for step in (-share, share)
            ]
            ahead = min(tries, key=_loss)
            if ahead.loss >= found.loss:
                break
            found = ahead
    return found


def _stretched(placement: RigidPlacement, factor: float, body: Body) -> RigidPlacement:
    """Change the scale, the object's middle staying where it is."""
    own = body.placed(placement)
    return body.of_files(replace(own, scale=factor * own.scale))


def _judged(
    capture: Capture, candidates: Sequence[Found], likeness: Likeness, body: Body, fine: Judge
) -> Registration:
    """Choose one of unlike poses, the best first, and say how sure it is."""
    chosen = _chosen(capture, len(candidates))
    best = candidates[0].placement
    outlines = fine.outline_shares(candidates[chosen].placement)
    told = isinstance(capture.pose, Candidate)
    raised = {
        "pose_ambiguous": not told
        and any(
            each.as_good_as(candidates[0])
            and _distance_cm(best, each.placement, likeness, body) > ELSEWHERE * body.radius_cm
            for each in candidates[1:]
        ),
        "pose_not_found": not told and candidates[0].loss > WORST_LOSS,
        "shape_differs": max(outlines.values()) > MOST_OUTLINE,
    }
    _check_scale(candidates[chosen].placement.scale)
    return Registration(
        tuple(candidates),
        _symmetries(best, likeness, body),
        chosen,
        outlines,
        tuple(flag for flag, is_raised in raised.items() if is_raised),
    )


def _symmetries(placement: RigidPlacement, likeness: Likeness, body: Body) -> int:
    """Count the turns about the principal axes that leave the object where it is."""
    here = Poses.of([body.placed(placement)])
    angles = np.radians(np.arange(ROLL_DEG, 360, ROLL_DEG)).tolist()
    turns = [
        turn for axis in range(3) for turn in turned_about(here, body, axis, angles).placements()
    ]
    apart_cm = SYMMETRIC * body.radius_cm
    return sum(likeness.distance_cm(here.placements()[0], turn) < apart_cm for turn in turns)


def _chosen(capture: Capture, count: int) -> int:
    """Index of the candidate that a person chose, or of the best.

    Raises
    ------
    DataError
        If there is none of that number.
    """
    if not isinstance(capture.pose, Candidate):
        return 0
    if capture.pose.number > count:
        raise DataError(
            f"object {capture.object_id}: objects.csv asks for candidate {capture.pose.number} of "
            f"{count} poses that were found"
        )
    return capture.pose.number - 1


def _check_scale(scale: float) -> None:
    least, most = SCALES
    if not least <= scale <= most:
        raise DataError(
            f"the shadows are {scale:.3g} times as large as the meshes' would be; a scale between "
            "0.5 and 2 was expected: check mesh_units in objects.csv"
        )


def _distance_cm(
    one: RigidPlacement, other: RigidPlacement, likeness: Likeness, body: Body
) -> float:
    return likeness.distance_cm(body.placed(one), body.placed(other))


def _loss(found: Found) -> float:
    return found.loss


def _unlike(
    found: Sequence[Found], likeness: Likeness, body: Body, most: int, apart_share: float
) -> list[Found]:
    """Keep the best of poses that are unlike by a share of the radius, the best first."""
    return _first_of_like(sorted(found, key=_loss), likeness, body, most, apart_share)


def _first_of_like(
    found: Sequence[Found],
    likeness: Likeness,
    body: Body,
    most: int = LISTED,
    apart_share: float = APART_SHARE,
) -> list[Found]:
    """Keep the first of poses that are unlike by a share of the radius, in their order."""
    own = [body.placed(each.placement) for each in found]
    return [found[k] for k in unlike(own, likeness, apart_share * body.radius_cm, most)]


def _turned(found: Sequence[Found], search: Search, body: Body, judge: Judge) -> list[Found]:
    """Turn the two best about the body's axes where the shortlist does not tell them."""
    ordered = sorted(found, key=_loss)
    close = [each for each in ordered[:2] if each.loss <= CLOSE * ordered[0].loss]
    turns = [there for each in close for there in _soft_turns(each, search, body, TURN_DEG)]
    return [judge.fixed(there) for there in turns]


def _soft_turns(found: Found, search: Search, body: Body, every_deg: int) -> list[RigidPlacement]:
    """Turn a pose about the principal axes where few points on few pixels do not tell."""
    here = Poses.of([body.placed(found.placement)])
    cost = float(search.judged(here.linear, here.shifts).costs[0])
    angles = np.radians(np.arange(every_deg, 360, every_deg)).tolist()
    kept = []
    for axis in range(3):
        turned = turned_about(here, body, axis, angles)
        turned = search.judged(turned.linear, turned.shifts)
        times, more = SOFT
        kept.append(turned.picked(np.flatnonzero(turned.costs <= times * cost + more)))
    all_of = sorted(
        (
            (cost, placement)
            for each in kept
            for cost, placement in zip(each.costs.tolist(), each.placements(), strict=True)
        ),
        key=lambda pair: pair[0],
    )
    return [body.of_files(placement) for _, placement in all_of[:MOST_ROLLS]]


def _usual_lac_per_cm(capture: Capture) -> Float64[np.ndarray, "k"]:
    """Attenuation that the labels let expect; where they tell little, a middle of what may be."""
    tube = capture.tube or Tube(energy_kev=USUAL_KEV)
    groups = energy_groups(tube, capture.detector, GROUPS)
    light = groups.weights.mean(axis=0)
    found = []
    for part in capture.parts:
        table = candidate_table(part, groups)
        lac = np.log((table.mac_cm2_g @ light) * table.priors[:, 0])
        shares = np.exp(table.log_prior)
        leading = table.leading
        if shares[leading].sum() > 0.5:
            shares = shares * leading
        found.append(np.exp(shares @ lac / shares.sum()))
    return np.array(found)


def _told_rotations(capture: Capture, body: Body) -> Rotation | None:
    """Rotations around the one a person told; None where all there are must be tried."""
    if not isinstance(capture.pose, CoarsePose):
        return None
    ways = np.random.default_rng(0).normal(size=(NEAR_COUNT, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    reach = NEAR_RAD * np.cbrt((np.arange(NEAR_COUNT) + 0.5) / NEAR_COUNT)
    return Rotation.from_rotvec(reach[:, None] * ways) * capture.pose.rotation
