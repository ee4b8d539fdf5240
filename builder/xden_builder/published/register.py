"""Where a volume lies in its mesh, how sure that is, and how large both are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Float64

from xden1k.errors import DataError
from xden_builder.published.convention import Convention
from xden_builder.published.orientation import MODES, ORIENTATIONS, Orientation, overlaps
from xden_builder.published.refine import Fit, fit_pair, voxel_affine
from xden_builder.published.shares import BoxShares
from xden_builder.published.sides import six_side_agreement

__all__ = ["Registration", "cm_per_unit", "register"]

OWN_GAIN: Final = 0.03
"""Overlap by which another orientation must be better than the convention to be tried."""
KEPT_LOSS: Final = 0.05
"""Overlap that the convention may lose by after refinement and still be kept."""
ALIKE: Final = 0.01
"""Overlap within which two orientations are one to the object."""
GOOD_SIDES: Final = 0.6
NEAR_BEST: Final = 0.02
MOST_APART: Final = 0.08
"""Share by which the boxes' proportions may differ where voxels are cubes."""
EDGE_VOXELS: Final = 1.0
"""By which a side of the volume's box may be off."""
LACKING: Final = 0.01
"""Of the longest side: what a mesh may lack at an end, such as a bottom that nobody photographed; a
flat object lies on a large one."""
MOST_UNLIKE: Final = 0.05
"""Standard deviation of the logarithms of size / extent up to which a size is the mesh's own."""
FAILED: Final = 0.4
"""Overlap and agreement both below this are no registration."""
UPRIGHT: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From the mesh file's frame, y up, to the object frame, z up."""


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """One volume on its mesh.

    Parameters
    ----------
    affine
        Takes points of the published volume, voxel i being i to i + 1, to the object frame in cm.
    way
        Orientation used.
    iou, six_side
        Overlap of shares, and agreement from six sides.
    meta
        Figures of JSON's types.
    flags
        What to know of it.
    """

    affine: Float64[np.ndarray, "4 4"]
    way: Orientation
    iou: float
    six_side: float
    meta: dict[str, Any]
    flags: tuple[str, ...]


def cm_per_unit(
    extent: Float64[np.ndarray, "3"], size_cm: Float64[np.ndarray, "3"], order: tuple[int, int, int]
) -> float:
    """Scale of a mesh from the published sizes of its box.

    Examples
    --------
    >>> round(cm_per_unit(np.array([2.0, 1.0, 1.0]), np.array([5.0, 10.0, 5.0]), (1, 0, 2)), 6)
    5.0
    """
    return float(np.exp(np.log(size_cm[list(order)] / extent).mean()))


def _apart(
    extent: Float64[np.ndarray, "3"], size_cm: Float64[np.ndarray, "3"], order: tuple[int, int, int]
) -> float:
    """How far the proportions of size and mesh differ."""
    return float(np.log(size_cm[list(order)] / extent).std())


def register(
    mesh: BoxShares,
    volume: BoxShares,
    size_cm: Float64[np.ndarray, "3"],
    convention: Convention,
    longest: int,
) -> Registration:
    """Place a volume on its mesh.

    Parameters
    ----------
    mesh, volume
        To be placed.
    size_cm
        As published, in the release's order.
    convention
        Of the release.
    longest
        Longest side of the volume as published, in voxels.

    Raises
    ------
    DataError
        If the boxes are of other proportions, or the bodies are not alike at all.
    """
    scores = overlaps(mesh, volume)[MODES.index(convention.mode)]
    place = _chosen(mesh, volume, scores, convention)
    way = ORIENTATIONS[place]
    fit, alone = _fitted(mesh, volume, place, convention, longest)
    six_side = six_side_agreement(fit.placed, fit.volume)
    _check(mesh, volume, way, convention.mode, (fit.iou, six_side))
    rival = _unlike(mesh, volume, scores, place, convention.mode)
    scale = cm_per_unit(mesh.extent, size_cm, convention.size_order)
    affine = np.diag([scale, scale, scale, 1.0]) @ voxel_affine(mesh, volume, way, fit)
    affine[:3] = UPRIGHT @ affine[:3]
    meta = {
        "orientation": way.text,
        "mode": convention.mode,
        "mirrored": way.mirrored,
        "iou": round(fit.iou, 4),
        "six_side": round(six_side, 4),
        "symmetry": int((scores > scores[place] - ALIKE).sum()),
        "gap": round(float(scores[place] - np.delete(scores, place).max()), 4),
        "unlike_six_side": None if rival is None else round(_sides(rival), 4),
        "cm_per_unit": scale,
        "volume_to_object_cm": affine.tolist(),
    }
    good = six_side >= GOOD_SIDES or (convention.sure and scores[place] >= scores.max() - NEAR_BEST)
    raised = {
        "registration_poor": not good,
        "orientation_unsure": not convention.sure,
        "orientation_differs": convention.sure and place != convention.place,
        "placed_alone": alone,
        "size_unlike_mesh": _apart(mesh.extent, size_cm, convention.size_order) > MOST_UNLIKE,
    }
    flags = tuple(flag for flag, is_raised in raised.items() if is_raised)
    return Registration(affine, way, fit.iou, six_side, meta, flags)


def _chosen(
    mesh: BoxShares, volume: BoxShares, scores: Float64[np.ndarray, "48"], convention: Convention
) -> int:
    """Index of the orientation: the convention, unless the object contradicts it clearly."""
    own = int(scores.argmax())
    if not convention.sure:
        return own
    if scores[own] - scores[convention.place] <= OWN_GAIN:
        return convention.place
    told, better = (
        fit_pair(mesh, volume, ORIENTATIONS[place], convention.mode).iou
        for place in (convention.place, own)
    )
    return own if better - told > KEPT_LOSS else convention.place


def _fitted(
    mesh: BoxShares, volume: BoxShares, place: int, convention: Convention, longest: int
) -> tuple[Fit, bool]:
    """Fit where all meshes of the release lie, unless the object contradicts that clearly.

    It does not where its mesh then leaves out what the volume shows at its ends, however thin that
    is: a mesh of a can overlaps best where it lies on the drink alone.

    Returns
    -------
    tuple
        The fit, and whether the object contradicts.
    """
    way = ORIENTATIONS[place]
    own = fit_pair(mesh, volume, way, convention.mode)
    known = convention.box_of(mesh.extent, longest)
    if known is None or place != convention.place:
        return own, False
    common = fit_pair(mesh, volume, way, convention.mode, known)
    boxes_apart = [float(np.abs(np.log(fit.factors)).max()) for fit in (own, common)]
    alone = own.iou - common.iou > NEAR_BEST and boxes_apart[0] < boxes_apart[1]
    return (own, True) if alone else (common, False)


def _unlike(
    mesh: BoxShares, volume: BoxShares, scores: Float64[np.ndarray, "48"], place: int, mode: str
) -> Fit | None:
    """Fit in the best orientation that the object tells from the chosen one."""
    unlike = np.flatnonzero(np.abs(scores - scores[place]) > ALIKE)
    if not len(unlike):
        return None
    return fit_pair(mesh, volume, ORIENTATIONS[unlike[scores[unlike].argmax()]], mode)


def _sides(fit: Fit) -> float:
    return six_side_agreement(fit.placed, fit.volume)


def _check(
    mesh: BoxShares, volume: BoxShares, way: Orientation, mode: str, figures: tuple[float, float]
) -> None:
    """Refuse what is no registration."""
    sides = mesh.extent[list(way.axes)]
    lacking = LACKING * float(volume.extent.max())
    least = (volume.extent - EDGE_VOXELS - lacking) / sides
    most = (volume.extent + EDGE_VOXELS) / sides
    apart = float(least.max() / most.min() - 1)
    if mode == "isotropic" and apart > MOST_APART:
        raise DataError(
            f"registration: boxes of mesh and volume must agree within {MOST_APART:.0%}, "
            f"got {apart:.0%} apart"
        )
    if max(figures) < FAILED:
        iou, six_side = figures
        raise DataError(
            f"registration: expected an overlap or an agreement from six sides of {FAILED} at "
            f"least, got {iou:.2f} and {six_side:.2f}: mesh and volume are not of one object"
        )
