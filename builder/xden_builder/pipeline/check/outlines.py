"""Outlines of the parts against the shadows in the radiographs: which picture is of which view."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Final, NamedTuple

import numpy as np
import trimesh
from jaxtyping import Float32
from scipy.ndimage import binary_dilation

from xden1k.rays import path_lengths
from xden1k.values.arrays import Image, Mask
from xden1k.values.views import XRayView
from xden_builder.audit.air import (
    BORDERS,
    OPAQUE,
    border_air,
    corner_ratio,
    falls_off,
    uneven_air,
)
from xden_builder.capture.saturation import completed, gain_bounds
from xden_builder.poly.model.frames import any_of, binned, coarse
from xden_builder.poly.model.stray import coarse_binning
from xden_builder.reconstruct.plausible import SHADOW_DEPTH

__all__ = ["Lengths", "Outline", "air_level", "contradictions", "outline", "shadow_lengths"]

FAR_BETTER: Final = 0.15
"""Of the area that outline and shadow share: so much more of it is no accident of the pose."""
ALIKE: Final = 0.5
"""And at least so much is shared."""
ALIKE_SHARE: Final = 0.03
"""Of that area: explanations that differ by less explain alike."""
NEARBY: Final = (-2, 0, 2)
"""Large pixels by which an object may lie beside its place, more than pose errors make."""
AROUND: Final = np.ones((3, 3))
"""Large pixels that an outline may lie off, and be drawn alike."""
MOST_BESIDE: Final = 0.5
"""Of a shadow, beside the parts."""
MARGIN_CM: Final = 0.5
"""On the panel: a shadow as near to the parts may be theirs, in another pose."""
SUBRAYS: Final = 3
"""Rays along each side of a large pixel, so that a sheet that stands edge on is met."""
FAINT: Final = 0.05
"""Quantile of the air's transmission beside the parts: the middle of what hardly attenuates, such
as a block of foam, is darker, and that of air seldom."""
LIT: Final = 0.98
"""Quantile of the transmission that is air's where no light reaches the borders."""
DIMMEST, BRIGHTEST = 0.8, 1.25
"""Transmission of air by an open field of the same exposure: within a few per cent of 1."""
LEAST_RMS_PX: Final = 3.0
"""From the middle of an outline, in large pixels: of smaller ones the rim is too much."""
DEEP, DEEPER = 3 * SHADOW_DEPTH, 6 * SHADOW_DEPTH
"""Of a shadow, in the median: that of a round body ends where it is less deep than SHADOW_DEPTH,
within 4 and 1 % of its width then. The first tells its length, the second its form."""
FLIPS: Final[tuple[tuple[str, Callable[[Mask], Mask]], ...]] = (
    ("mirrored left to right", lambda mask: mask[:, ::-1]),
    ("mirrored top to bottom", lambda mask: mask[::-1]),
    ("turned upside down", lambda mask: mask[::-1, ::-1]),
    ("turned by a quarter clockwise", lambda mask: np.rot90(mask)),
    ("turned by a quarter counter-clockwise", lambda mask: np.rot90(mask, -1)),
    ("of exchanged rows and columns", lambda mask: mask.T),
    ("of exchanged rows and columns, upside down", lambda mask: mask[::-1, ::-1].T),
)
"""What undoes it, by how a picture may have been turned over."""


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """One view in large pixels.

    Parameters
    ----------
    name
        The view's.
    drawn
        Shape (rows, columns): where the parts are.
    shadow
        The same: where the radiograph is darker than air.
    near
        The same: on the parts or close to them.
    air
        Median transmission along each border of the panel that no part reaches, by its name.
    brightest
        Transmission of air along the brightest border, or of the brightest pixels where all
        are dim; None where air is saturated or at no border.
    depth
        By how much the shadow is darker than air, in the median.
    corners
        Transmission of air in the corners over that at the middles of borders; None where that is
        not told.
    faint
        Whether the parts are darker than air, which no pixel need be enough to be a shadow.
    """

    name: str
    drawn: Mask
    shadow: Mask
    near: Mask
    air: Mapping[str, float] = field(default_factory=dict)
    brightest: float | None = None
    depth: float = 1.0
    faint: bool = False
    corners: float | None = None


def air_level(image: Float32[np.ndarray, "rows columns"], other: Mask) -> float:
    """Return the median transmission of what is no part, and known; 1 where nothing is."""
    return 1.0 if other.all() else float(np.median(image[~other]))


def outline(
    view: XRayView, at_least: Image | None, meshes: Sequence[trimesh.Trimesh]
) -> tuple[Outline, float]:
    """Reduce a view to outlines, and give its air's level.

    Parameters
    ----------
    view
        The radiograph.
    at_least
        As of :class:`xden_builder.capture.Capture`.
    meshes
        Of the parts, before the scanner.
    """
    whole, saturated = completed(view, at_least)
    binning = coarse_binning(view.geometry.shape)
    geometry = coarse(view.geometry, binning)
    image, known = binned(whole, binning)
    lengths = path_lengths(meshes, range(len(meshes)), geometry, SUBRAYS)
    drawn = np.zeros(geometry.shape, dtype=np.bool_)
    drawn.flat[lengths.pixels] = True
    bounds = gain_bounds(view, at_least)
    level = air_level(image, drawn | ~known) if bounds is None else bounds[0]
    margin = int(np.ceil(MARGIN_CM / np.linalg.norm(geometry.column_step_cm)))
    near = binary_dilation(drawn, np.ones((3, 3)), margin)
    shadow = known & ~any_of(saturated, binning) & (image < level - SHADOW_DEPTH)
    air = border_air(image, drawn, known)
    brightest = max(air.values(), default=None) if bounds is None else None
    if brightest is not None and brightest < DIMMEST:
        brightest = float(np.quantile(image[known], LIT))
    depth = level - float(np.median(image[shadow])) if shadow.any() else 0.0
    faint = _is_faint(image[known & drawn], image[known & ~near])
    corners = corner_ratio(image, drawn, known) if bounds is None else None
    return Outline(view.name, drawn, shadow, near, air, brightest, depth, faint, corners), level


def _is_faint(drawn: Float32[np.ndarray, "_"], air: Float32[np.ndarray, "_"]) -> bool:
    """Whether the middle of what is drawn is darker than nearly all of the air."""
    return bool(drawn.size and air.size and np.median(drawn) < np.quantile(air, FAINT))


class Lengths(NamedTuple):
    """How long a shadow is beside the outline of the parts.

    Parameters
    ----------
    ratio
        Of the one over the other.
    aspect
        Of that ratio along columns over that along rows; None where the outline is too narrow, or
        the shadow too faint.
    """

    ratio: float
    aspect: float | None


def shadow_lengths(view: Outline) -> Lengths | None:
    """Compare a shadow with the outline of the parts; None where nothing tells it.

    By the root mean square distance from the middle, which a thin end hardly moves. A shadow that
    reaches a border may go on beyond it, and a faint one beyond where it is told from air.
    """
    masks = (view.drawn, view.shadow)
    if view.depth < DEEP or any(_touches_border(mask) or not mask.any() for mask in masks):
        return None
    drawn, seen = (np.argwhere(mask).std(axis=0) for mask in masks)
    whole = float(np.linalg.norm(drawn))
    if whole < LEAST_RMS_PX:
        return None
    ratio, aspect = float(np.linalg.norm(seen)) / whole, None
    if view.depth >= DEEPER and min(*seen, *drawn) >= LEAST_RMS_PX:
        down, across = seen / drawn
        aspect = float(down / across)
    return Lengths(ratio, aspect)


def _touches_border(mask: Mask) -> bool:
    return any(bool(mask[border].any()) for border in BORDERS.values())


def contradictions(pa: Outline, lat: Outline, *, turned: bool = False) -> Iterator[str]:
    """Say what outlines and shadows of an object cannot both be.

    Views that are exchanged or turned over are said only where the shadow then fits far better:
    objects that look alike from both sides say nothing. Where the object was turned by hand before
    ``lat``, its parts may lie elsewhere there, and only ``pa`` is asked.
    """
    told = (pa,) if turned else (pa, lat)
    unseen = [view.name for view in told if not view.drawn.any()]
    if unseen:
        yield f"the parts lie outside of view {unseen[0]}; check mesh_units and its geometry"
        return
    if exposed := [said for view in (pa, lat) for said in _exposed(view)]:
        yield from exposed
        return
    if blank := [view for view in (pa, lat) if not view.shadow.any()]:
        for view in [each for each in blank if not each.faint][:1]:
            yield f"view {view.name} shows no shadow at all: air where the parts are drawn"
        return
    for view in (pa, lat):
        yield from _collimated(view)
    fallen = [said for view in (pa, lat) for said in _falls_off(view)]
    yield from fallen
    found = [said for view in (pa, lat) for said in _uneven(view)]
    found = found or (_turned(told) if turned else _mixed_up(pa, lat))
    if not fallen:
        found = found or [said for view in told for said in _beside(view)]
    yield from found


def _collimated(view: Outline) -> Iterator[str]:
    """Say that borders let no light through."""
    dark = [name for name, level in view.air.items() if level < OPAQUE]
    if dark:
        yield (
            f"no light comes through at the {' and '.join(dark)} of {view.name}: if a collimator "
            f"or a holder is in the picture, mark it in ignore_{view.name}.png"
        )


def _exposed(view: Outline) -> Iterator[str]:
    """Say that air is not as bright as the open field."""
    level = view.brightest
    if level is not None and not DIMMEST <= level <= BRIGHTEST:
        told = f"{level:.2g}"
        if DIMMEST <= float(told) <= BRIGHTEST:  # never the limit itself
            told = f"{level:.6g}"
        yield (
            f"air in {view.name} has a transmission of {told}, expected {DIMMEST:g} to "
            f"{BRIGHTEST:g}: the picture was taken with another exposure than its flat, or has "
            "other bits (an export of 8 or 12 bits beside a flat of 16)"
        )


def _uneven(view: Outline) -> Iterator[str]:
    """Say that an open field is not of this picture: air is brighter at one border."""
    for found in uneven_air(view.air):
        yield (
            f"air in {view.name} has a transmission of {found.level:.2f} at its {found.one} and of "
            f"{found.other_level:.2f} at its {found.other}: the picture or its flat is turned over "
            "or mirrored, the flat is of another view or setting, or the values are not linear in "
            "photons (a gamma, a stretched 8 bit export, a painted background)"
        )


def _falls_off(view: Outline) -> Iterator[str]:
    """Say that an open field was not divided away: air is other in the corners."""
    if view.corners is not None and falls_off(view.corners):
        word = "darker" if view.corners < 1 else "brighter"
        yield (
            f"air in {view.name} is {abs(1 - view.corners):.1%} {word} in the corners than at the "
            "middles of the borders: the picture was not divided by an open field (give `flat`, an "
            "image of it, in place of a constant), or by another one's; or something stands there"
        )


def _mixed_up(pa: Outline, lat: Outline) -> list[str]:
    """Say which pictures are exchanged or turned over, by the fewest mistakes that explain them."""
    over = _turned((pa, lat))
    if pa.drawn.shape != lat.drawn.shape:
        return over
    swapped = (replace(pa, shadow=lat.shadow), replace(lat, shadow=pa.shadow))
    given, turned = (_mean(share, pa, lat) for share in (_as_it_is, _best))
    exchanged, both = (_mean(share, *swapped) for share in (_as_it_is, _best))
    if not _far_better(exchanged, given) or exchanged < turned - ALIKE_SHARE:
        if not _far_better(both, given) or both < turned + ALIKE_SHARE:
            return over
        exchanged = both
    said = (
        f"the pictures of {pa.name} and {lat.name} seem exchanged: the parts' outlines share "
        f"{exchanged:.0%} of their area with the shadows then, {given:.0%} as it is"
    )
    as_good = len(over) == 1 and exchanged < turned + ALIKE_SHARE
    return [f"{over[0]}; or {said}" if as_good else said]


def _turned(views: Iterable[Outline]) -> list[str]:
    """Say which pictures are turned over, and how: every way that explains it alike."""
    return [said for view in views for said in _turned_view(view)]


def _turned_view(view: Outline) -> Iterator[str]:
    given, best = _as_it_is(view), _best(view)
    if not _far_better(best, given):
        return
    ways = [
        name for name, back in _turned_over(view) if _shared(view.drawn, back) > best - ALIKE_SHARE
    ]
    yield (
        f"the picture of {view.name} seems {' or '.join(ways)}: the parts' outline shares "
        f"{best:.0%} of its area with the shadow then, {given:.0%} as it is"
    )


def _beside(view: Outline) -> Iterator[str]:
    share = float((view.shadow & ~view.near).sum() / view.shadow.sum())
    if share > MOST_BESIDE:
        yield (
            f"{share:.0%} of the shadow in {view.name} lies beside the parts: is it this object's, "
            "has every part a mesh, are mesh_units and geometry right, and is what is not of it, "
            f"as a table or a letter, marked in ignore_{view.name}.png?"
        )


def _far_better(one: float, other: float) -> bool:
    return one >= ALIKE and one - other > FAR_BETTER


def _mean(share: Callable[[Outline], float], pa: Outline, lat: Outline) -> float:
    return (share(pa) + share(lat)) / 2


def _as_it_is(view: Outline) -> float:
    """Return the share as the picture is, the object a little beside its place if need be."""
    moved = (np.roll(view.shadow, shift, (0, 1)) for shift in product(NEARBY, NEARBY))
    return max(_shared(view.drawn, shadow) for shadow in moved)


def _best(view: Outline) -> float:
    """Return the largest share over all ways to turn a picture over, and none."""
    flipped = [_shared(view.drawn, back) for _, back in _turned_over(view)]
    return max(_as_it_is(view), *flipped)


def _turned_over(view: Outline) -> list[tuple[str, Mask]]:
    """Return the shadow turned back, in every way that leaves a picture its shape."""
    found = ((name, np.asarray(flip(view.shadow))) for name, flip in FLIPS)
    return [(name, shadow) for name, shadow in found if shadow.shape == view.drawn.shape]


def _shared(one: Mask, other: Mask) -> float:
    """Area that goes together as a share of the area of either.

    What lies next to the other goes with it: a thin thing that lies a pixel off would share nothing
    with itself.
    """
    apart = (one & ~binary_dilation(other, AROUND)) | (other & ~binary_dilation(one, AROUND))
    return 1.0 - float(apart.sum() / max((one | other).sum(), 1))
