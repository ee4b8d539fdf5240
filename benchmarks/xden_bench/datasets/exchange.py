"""Radiographs of another object: whose an object gets, and how they come to lie where its own do.

Needs the extra ``build``.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import binary_dilation

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.values.arrays import Mask
from xden1k.values.types import DensityObject
from xden1k.values.views import ViewGeometry, XRayView
from xden_bench.datasets.disturbances import (
    Disturbance,
    Views,
    resampled,
    shadow_of,
    square_around,
)

__all__ = ["Exchanged"]

SHOWN: Final = 0.01
"""Transmission by which an object is darker than what is beside it, if it is shown."""
COARSE_PX: Final = 64
"""Pixels across that window, in which a method may see it."""
MARGIN: Final = 0.05
"""Of the window around a projected cube, where methods look, as a share of its side."""


@dataclass(frozen=True, slots=True)
class Exchanged(Disturbance):
    """Replaced by another object's, at the receiver's scale.

    The square that encloses the giver's cube in its image comes to lie where the receiver's is, so
    that sizes do not give the exchange away; what is beyond the giver's image repeats its edge.

    Parameters
    ----------
    folder
        The dataset.
    givers
        Whose radiographs each object gets.
    left_out
        Objects that no other's radiographs show anything of.
    """

    folder: DatasetFolder
    givers: Mapping[str, str]
    left_out: Collection[str] = ()

    @classmethod
    def drawn(cls, folder: DatasetFolder, splits: Sequence[str], seed: int) -> Exchanged:
        """Draw who gets whose, within each split: each gives once, none to itself.

        Two objects exchange givers where one would be shown nothing: a radiograph that is hardly
        darker on it than beside it, of which no method could say anything. Where no exchange
        helps, it gets what another has too; and is left out if nobody's shows anything of it.

        Raises
        ------
        DataError
            If a split has a single object, or none that is shown anything.
        """
        rng, givers, left_out = np.random.default_rng(seed), dict[str, str](), list[str]()
        for split in splits:
            ids = sorted(folder.ids(split))
            shown = _shown(folder, ids, rng)
            if not shown:
                raise DataError(f"{folder.root}: the split {split} has nobody to exchange with")
            givers |= shown
            left_out += [one for one in ids if one not in shown]
        return cls(folder, givers, tuple(left_out))

    @property
    def words(self) -> str:
        """Clause of which radiographs are the subject."""
        without = (
            f" (left out, for want of any that show something of them: {', '.join(self.left_out)})"
            if self.left_out
            else ""
        )
        return f"are those of another object of the split, at the scale of its own{without}"

    def __call__(self, obj: DensityObject, rng: np.random.Generator) -> Views:
        """Return the radiographs of the giver, as if they were of the receiver's size."""
        giver = self.folder.object(self.givers[obj.object_id])
        pairs = zip(giver.views, obj.views, strict=True)
        return tuple(_in_place_of(giver, theirs, obj, own) for theirs, own in pairs)


def _shown(folder: DatasetFolder, ids: Sequence[str], rng: np.random.Generator) -> dict[str, str]:
    """Draw a giver for each object of a split of which one shows anything."""
    order = [ids[place] for place in rng.permutation(len(ids))]
    givers = dict(zip(order, [*order[1:], order[0]], strict=True)) if len(ids) > 1 else {}
    for one in ids if givers else ():
        if not _is_shown(folder, one, givers[one]):
            others = [ids[place] for place in rng.permutation(len(ids)) if ids[place] != one]
            if not _exchanged(folder, givers, one, others):
                _borrow(folder, givers, one, others)
    return givers


def _in_place_of(
    giver: DensityObject, theirs: XRayView, receiver: DensityObject, own: XRayView
) -> XRayView:
    """Show the giver where, and as large as, the receiver is."""
    centre, side = square_around(giver, theirs.geometry)
    own_centre, own_side = square_around(receiver, own.geometry)
    scale = side / own_side
    return resampled(theirs, scale, centre - scale * own_centre, own)


def _is_shown(folder: DatasetFolder, receiver_id: str, giver_id: str) -> bool:
    """Whether a giver's radiographs are darker on the receiver than beside it, and than air.

    Beside it in the whole image, and in the window around its cube; seen in coarse pixels, which
    hold some of both at its rim. An overexposed shadow may be brighter than air should be.
    """
    receiver, giver = folder.object(receiver_id), folder.object(giver_id)
    for theirs, own in zip(giver.views, receiver.views, strict=True):
        new, window = _in_place_of(giver, theirs, receiver, own), _window(receiver, own.geometry)
        coarse = max(1, round(np.count_nonzero(window.any(axis=0)) / COARSE_PX))
        shadow = binary_dilation(shadow_of(receiver, own.geometry), iterations=coarse)
        for where in (~shadow, ~shadow & window):
            on, beside = (new.transmission[new.valid & mask] for mask in (shadow, where))
            if on.size and beside.size and not on.mean() < min(np.median(beside), 1) - SHOWN:
                return False
    return True


def _exchanged(
    folder: DatasetFolder, givers: dict[str, str], blind: str, others: Sequence[str]
) -> bool:
    """Let an object that is shown nothing take the giver of the first other with which that helps.

    Returns
    -------
    bool
        Whether there is one.
    """
    for other in (other for other in others if other in givers):
        theirs, own = givers[other], givers[blind]
        if blind == theirs or other == own:
            continue
        if _is_shown(folder, blind, theirs) and _is_shown(folder, other, own):
            givers[blind], givers[other] = theirs, own
            return True
    return False


def _borrow(
    folder: DatasetFolder, givers: dict[str, str], blind: str, others: Sequence[str]
) -> None:
    """Give an object that is shown nothing what another has too, or leave it out."""
    shown = next((other for other in others if _is_shown(folder, blind, other)), None)
    if shown is None:
        del givers[blind]
    else:
        givers[blind] = shown


def _window(obj: DensityObject, geometry: ViewGeometry) -> Mask:
    """Pixels of the square around the projected cube, with a margin."""
    centre, sides = square_around(obj, geometry)
    rows, columns = (
        np.abs(np.arange(size) - middle) <= (1 + MARGIN) / 2 * side
        for size, middle, side in zip(geometry.shape, centre, sides, strict=True)
    )
    return np.asarray(np.logical_and.outer(rows, columns))
