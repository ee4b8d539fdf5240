"""From a capture to the pose of its meshes: shadows, shortlist, exact comparison, judgement."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float64

from xden1k.errors import DataError
from xden_builder.capture import Capture
from xden_builder.capture.pose import CoarsePose
from xden_builder.capture.saturation import completed
from xden_builder.capture.space import Space
from xden_builder.physics.groups import energy_groups
from xden_builder.physics.source import Tube
from xden_builder.poly.materials.candidates import candidate_table
from xden_builder.registration.around import Around
from xden_builder.registration.ball import ball_turns, is_ball
from xden_builder.registration.body import Body
from xden_builder.registration.closely import told_closely
from xden_builder.registration.coarse_pose import (
    around_told,
    told_placement,
    told_rotations,
)
from xden_builder.registration.contest import told_by_labels
from xden_builder.registration.exact import COARSE_PX, Judge, side_of
from xden_builder.registration.exchange import exchanged
from xden_builder.registration.kinds import (
    CLOSE,
    FINAL_APART,
    close_to_best,
    listed_of,
    loss_of,
    most_of_rivals,
    unlike_of,
)
from xden_builder.registration.likeness import Likeness
from xden_builder.registration.middles import lone_sight, scales_to_sizes
from xden_builder.registration.mirror import as_itself, mirrored
from xden_builder.registration.missing import told_by_edges
from xden_builder.registration.placement import Found, Registration, RigidPlacement
from xden_builder.registration.reduced import USUAL_KEV
from xden_builder.registration.rotations import spread_rotations
from xden_builder.registration.shadow import Shadow, shadow_of
from xden_builder.registration.shortlist import (
    USUAL,
    WIDE,
    Breadth,
    Search,
    finer_search,
    laid_upon_content,
    shortlist,
)
from xden_builder.registration.steps import (
    DERIVATIVES,
    all_settled,
    hopped,
    settled,
    settled_if_hopeful,
)
from xden_builder.registration.turns import least_turns, same_share, slightly_turned
from xden_builder.registration.verdict import judged

__all__ = ["register"]

TINY_PX, MIDDLE_PX, FINE_PX, FINEST_PX = 40, 140, 240, 480
"""Width of the shadow, in averaged pixels, for many poses, for few, and for one."""
LONG_STEP: Final = 3
"""From coarse pixels to fine ones: images between are used where it would be longer."""
SOME, COMPARED, FINAL = 8, 5, 4
"""Poses that are refined on the first, on the next two, and on the last of them."""
EVENED: Final = 0.5
"""How far clouds of points distrust labels: share of what is usual among the parts."""
ROUGH_DEG, FINE_DEG = 15, 5
"""Between turns about an axis, on tiny images and on fine ones."""
TURNS, HARDLY_CLOSE = 4, 5.0
"""Turns of the best that are followed, itself counted; neither of these nor of poses that have
hardly moved one whose loss is more times the least."""
HOPS, WORTH_ANOTHER = 3, 0.85
"""How often it is looked beside the best, and share of its loss that must be left for once more."""
MANY_RAYS: Final = 30_000
"""Through the object in a view, on fine images: by a third of them a hinge leaves twice as much."""
LISTED, LAID = 6, 60
"""Poses that are handed on, and where a part may have no mesh those that are moved first, by either
of two images."""
GROUPS: Final = 8
"""Of energy, of the attenuation that labels let expect."""
DOUBTED_LOSS, HOPELESS_LOSS = 1.5, 6.0
"""Of a pose that is not believed: two of 262 right ones of simulated objects are worse; and of one
on coarse images that is not moved on before it is looked for again.
"""
MIRRORED: Final = 0.4
"""Of the loss of a pose that is not believed: a mirror image that leaves less is the object."""
SOUGHT_AGAIN_LOSS: Final = 0.4
"""Of a pose that is looked for again among more poses: of 130 objects of another simulator three
left more, all wrong; a spanner of ours left 0.415 where it was 15 mm off, and 0.39 in its place."""
REJUDGED_LOSS: Final = 0.75
"""Of poses that are judged once more on the finest images."""
FEW_ROTATIONS: Final = 1000
LEAST_FACTOR: Final = 0.4
"""Of shadows beside those of the meshes, which are in another unit, or of another object."""


def register(capture: Capture, space: Space) -> Registration:
    """Find where the meshes of an object stand before the scanner, from nothing or from a word.

    Parameters
    ----------
    capture
        Its meshes in any frame; ``pose`` tells what is known, ``mesh_scale`` whether
        their scale between 0.5 and 2 is sought too.
    space
        What is each part's.

    Returns
    -------
    Registration
        Deterministic.

    Raises
    ------
    DataError
        If a view shows no shadow or its edge cuts it, the meshes are flat or far larger than the
        shadows, the scale found lies outside 0.5 to 2, or a candidate is asked for that there is
        not.
    """
    shadows = [
        shadow_of(
            *completed(view, capture.at_least.get(view.name)), turned=view.name in capture.turned
        )
        for view in capture.fitted_views
    ]
    body = Body.of(space, _usual_lac_per_cm(capture))
    if not capture.scale_sought:
        _refuse_too_large(shadows, body)
    likeness = Likeness(body, lone_sight(shadows))
    fine = _searched(capture, shadows, body, likeness)
    doubted, found = fine.doubted, fine.found
    if not doubted:
        others, finer = exchanged(fine.judge, found[0], likeness, body)
        found = around_told(capture.pose, [*found, *others])
        likeness = finer if any(each in others for each in found) else likeness
    told = told_closely(capture, space, found, doubted=doubted)
    unlike = listed_of(told, likeness, body, LISTED)
    if not doubted:
        unlike = told_by_labels(capture, space, shadows, unlike)
    return judged(
        capture, unlike, fine.judge, likeness, body, doubted=doubted, is_mirrored=fine.mirrored
    )


def _searched(capture: Capture, shadows: Sequence[Shadow], body: Body, likeness: Likeness) -> _Fine:
    """Find unlike poses.

    Where even the best leaves much, meshes may be of the other hand. Or a part may have no
    mesh: its shadow leads all others astray. So they are looked for once more by what neighbouring
    pixels differ by, unless a scale is sought or a view was turned: both are led by the boxes
    around the shadows.
    """
    there = _searched_complete(capture, shadows, body, likeness)
    if there.doubted and not isinstance(capture.pose, CoarsePose):
        there = _or_mirrored(capture, shadows, body, likeness, there)
        if there.mirrored or not there.doubted:
            return there
    boxed = capture.scale_sought or any(shadow.turned for shadow in shadows)
    if boxed or not there.doubted:
        return there
    clouded, best = body.evened(EVENED), there.found[0].placement
    judge = _judge(capture, shadows, body, FINE_PX, best, incomplete=True)
    told = told_rotations(capture.pose)
    laid = laid_upon_content(shadows, clouded, likeness, LAID, told).placements()
    poses = [*(each.placement for each in there.found), *map(body.of_files, laid)]
    again = told_by_edges(capture, shadows, body, likeness, poses, judge)
    again = around_told(capture.pose, again)
    if there.judge.anew(again[0]).loss > DOUBTED_LOSS:
        return _Fine(again, judge)
    nothing_lost = _Coarse(again, finer_search(shadows, clouded))
    plain = _finely(capture, shadows, body, likeness, nothing_lost)
    return min(there, plain, key=lambda each: each.found[0].loss)


def _or_mirrored(
    capture: Capture, shadows: Sequence[Shadow], body: Body, likeness: Likeness, there: _Fine
) -> _Fine:
    """Ask whether the mirror image of the meshes has a pose that is believed, and leaves far less.

    An object that is its own mirror image stands there itself, turned: then that is its pose.
    """
    other, space = mirrored(capture, body.space)
    image = Body.of(space, body.lac_per_cm)
    seen = _searched_complete(other, shadows, image, Likeness(image, lone_sight(shadows))).found[0]
    if seen.loss >= min(DOUBTED_LOSS, MIRRORED * there.found[0].loss):
        return there
    judge = there.judge
    itself = [judge.refined(judge.fixed(each), DERIVATIVES) for each in as_itself(seen, body)]
    best = settled(judge, min(itself, key=loss_of))
    if best.loss > max(most_of_rivals(seen), MIRRORED * there.found[0].loss):
        return there._replace(mirrored=True)
    listed = listed_of([best, *there.found], likeness, body, LISTED)
    return there._replace(found=sorted(listed, key=loss_of))


def _searched_complete(
    capture: Capture, shadows: Sequence[Shadow], body: Body, likeness: Likeness
) -> _Fine:
    """Find unlike poses of an object all of whose parts have meshes.

    Where the best leaves much, they are looked for once more, among more poses, by clouds of points
    that do not believe any label.
    """

    def coarsely(evened: float, breadth: Breadth) -> _Coarse:
        return _coarsely(capture, shadows, body.evened(evened), likeness, breadth)

    coarse = coarsely(EVENED, USUAL)
    told = isinstance(capture.pose, CoarsePose)
    hopeless = coarse.found[0].loss > HOPELESS_LOSS
    if hopeless and not told:
        coarse = min(coarse, coarsely(1.0, WIDE), key=lambda each: each.found[0].loss)
    there = _finely(capture, shadows, body, likeness, coarse)
    if there.found[0].loss > SOUGHT_AGAIN_LOSS and not hopeless and not told:
        wider = coarsely(1.0, WIDE)
        if wider.found[0].loss < most_of_rivals(coarse.found[0]):
            again = _finely(capture, shadows, body, likeness, wider)
            better, other = sorted((there, again), key=lambda each: each.found[0].loss)
            return _with_rival(better, other.found[0], likeness, body)
    return there


def _with_rival(better: _Fine, other: Found, likeness: Likeness, body: Body) -> _Fine:
    """List the best of another search too, judged by the images of the better one."""
    judge = better.judge
    stayed = settled(judge, judge.anew(other))
    first = sorted([better.found[0], stayed], key=loss_of)
    listed = listed_of([*first, *better.found[1:]], likeness, body, LISTED)
    return better._replace(found=listed)


def _finely(
    capture: Capture,
    shadows: Sequence[Shadow],
    body: Body,
    likeness: Likeness,
    coarse: _Coarse,
) -> _Fine:
    """Move poses on fine images, and tell them apart."""
    found, around = coarse.found, partial(around_told, capture.pose)
    fine = _judge(capture, shadows, body, FINE_PX, found[0].placement)
    near = [fine.anew(each) for each in found]
    near += _told_exactly(capture, fine, min(near, key=loss_of))
    best = all_settled(fine, unlike_of(near, likeness, body, FINAL, FINAL_APART))
    best = sorted(around([*best, *_turned(fine, best[0], coarse, likeness, body)]), key=loss_of)
    for _ in range(HOPS):
        before = best[0].loss
        best = sorted(around([*hopped(fine, best[0], likeness, body), *best[1:]]), key=loss_of)
        if best[0].loss > WORTH_ANOTHER * before:
            break
    listed = listed_of(around([*best, *sorted(near, key=loss_of)]), likeness, body, LISTED)
    if not REJUDGED_LOSS < listed[0].loss <= HOPELESS_LOSS:
        return _Fine(listed, fine)
    return _on_finest(capture, shadows, body, likeness, listed)


def _told_exactly(capture: Capture, fine: Judge, best: Found) -> list[Found]:
    """Give the pose that a person told, where it explains the images as only a copied one does."""
    if not isinstance(capture.pose, CoarsePose):
        return []
    told = told_placement(capture.pose, best.placement.scale)
    most = max(DOUBTED_LOSS, min(CLOSE * best.loss, HOPELESS_LOSS))
    try:
        there = fine.refined(fine.fixed(told), DERIVATIVES)
    except DataError:  # behind the source, or through the panel
        return []
    return [there] if there.loss < most else []


def _on_finest(
    capture: Capture,
    shadows: Sequence[Shadow],
    body: Body,
    likeness: Likeness,
    listed: Sequence[Found],
) -> _Fine:
    """Judge poses that leave much once more, on images of half the pixel where there are any.

    Thin metal is nothing but rim: what rays miss of it in a large pixel is no fault of the pose,
    and may have led beside it.
    """
    finest = _judge(capture, shadows, body, FINEST_PX, listed[0].placement)
    fixed = [finest.anew(each) for each in listed]
    tried = [*fixed, *slightly_turned(finest, fixed[0], body)]
    there = sorted((finest.refined(each, DERIVATIVES) for each in tried), key=loss_of)
    return _Fine(listed_of(there, likeness, body, LISTED), finest)


def _judge(
    capture: Capture,
    shadows: Sequence[Shadow],
    body: Body,
    wide_px: int,
    likely: RigidPlacement,
    *,
    incomplete: bool = False,
) -> Judge:
    """Compare fine images; the size beside the meshes follows."""
    return Judge.of(
        capture,
        shadows,
        body,
        wide_px,
        likely,
        rays=MANY_RAYS,
        sized=True,
        incomplete=incomplete,
    )


class _Fine(NamedTuple):
    """Unlike poses, the best first, and what compared them."""

    found: list[Found]
    judge: Judge
    mirrored: bool = False
    """Whether the meshes' mirror image fits far better."""

    @property
    def doubted(self) -> bool:
        """Whether even the best leaves much, or did before some of it was explained away."""
        return self.judge.incomplete or self.found[0].loss > DOUBTED_LOSS


class _Coarse(NamedTuple):
    """Few poses, the best first, and what found them by points."""

    found: list[Found]
    search: Search


def _coarsely(
    capture: Capture, shadows: Sequence[Shadow], body: Body, likeness: Likeness, breadth: Breadth
) -> _Coarse:
    """Find a few poses on coarse images."""
    scaled = capture.scale_sought
    told = told_rotations(capture.pose)
    poses, search = shortlist(shadows, body, likeness, told, scaled=scaled, breadth=breadth)
    there = [body.of_files(each) for each in poses.placements()]
    tiny = Judge.of(capture, shadows, body, TINY_PX, there[0])
    found = sorted((tiny.refined(tiny.fixed(each), 1) for each in there), key=loss_of)
    turned = partial(tiny.elsewhere, found[0])
    found = [*found, *least_turns(turned, found[0], search, likeness, body, ROUGH_DEG)]
    found = around_told(capture.pose, found)
    found = close_to_best(unlike_of(found, likeness, body, SOME), HARDLY_CLOSE)
    found = sorted((tiny.refined(each, DERIVATIVES) for each in found), key=loss_of)
    judge = tiny
    for wide_px in _coarse_widths(shadows):
        if side_of(shadows, wide_px) != judge.side:
            likely = found[0].placement
            judge = Judge.of(capture, shadows, body, wide_px, likely)
            found = [judge.anew(each) for each in found]
        found = close_to_best(unlike_of(found, likeness, body, COMPARED))
        found = sorted((judge.refined(each, DERIVATIVES) for each in found), key=loss_of)
    return _Coarse(found, search)


def _coarse_widths(shadows: Sequence[Shadow]) -> Iterator[int]:
    """Yield widths of the shadow for some poses; a middle one before a long step to fine ones."""
    yield COARSE_PX
    if side_of(shadows, COARSE_PX) > LONG_STEP * side_of(shadows, FINE_PX):
        yield MIDDLE_PX


def _turned(
    judge: Judge, best: Found, coarse: _Coarse, likeness: Likeness, body: Body
) -> list[Found]:
    """Turn a settled pose about its axes, and go down from where the loss is less than beside.

    All else follows each turn, by few rays to find them and by all before they move.
    """
    judged = Around.of(judge.quick, best).fixed
    here = judged(best.placement)
    if is_ball(body, likeness):
        turns = [judged(each) for each in ball_turns(judge, best)]
    else:
        turns = least_turns(judged, here, coarse.search, likeness.strict, body, FINE_DEG)
    turns = close_to_best([here, *turns], HARDLY_CLOSE)
    turns = unlike_of(turns, likeness.strict, body, TURNS, same_share(body))
    moved = [each for each in turns if each is not here]
    if not moved:
        return []
    there, followed = [best], Around.of(judge, best).fixed
    for each in moved:
        rendered = judge.refined(followed(each.placement), 1)
        there.append(settled_if_hopeful(judge, rendered, min(there, key=loss_of)))
    return there[1:]


def _refuse_too_large(shadows: Sequence[Shadow], body: Body) -> None:
    """Refuse meshes that cast no shadow so small, however they lie; smaller ones may be a part."""
    rotations = spread_rotations(FEW_ROTATIONS).as_matrix()
    tiny = 1 / body.radius_cm  # however large they are, that is before the source
    factor = tiny * float(scales_to_sizes(shadows, tiny * body.rim_cm, rotations).max())
    if factor < LEAST_FACTOR:
        raise DataError(
            f"the shadows are at most {factor:.2g} times as large as those of the meshes would be, "
            "however they lie: check mesh_units in objects.csv"
        )


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
