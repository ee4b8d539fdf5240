"""What a method may look at, and the track that follows from it."""

from __future__ import annotations

import enum
from collections.abc import Iterable
from typing import Literal, get_args

from xden1k.errors import XDenError

__all__ = ["INPUTS", "TRACKS", "Modality", "ModalityError", "Track", "track_of"]

Track = Literal["geometry", "rgb", "rgb_parts", "xray"]
TRACKS: tuple[Track, ...] = get_args(Track)
"""Each track may look at what the earlier ones see and more; rows of two are never ranked
together."""


class ModalityError(XDenError):
    """A method touched something it did not declare that it reads."""


class Modality(enum.Flag):
    """The inputs of a method. A submission names them in ``inputs``.

    Examples
    --------
    >>> (Modality.GEOMETRY | Modality.CATEGORY).inputs
    ('mesh', 'text')
    """

    NONE = 0
    GEOMETRY = enum.auto()
    """``mesh``: the closed outer surface, its scale, and the envelope grid."""
    RGB = enum.auto()
    """``rgb``: posed colour pictures, masks and depth."""
    PARTS = enum.auto()
    """``parts``: which part is where, and so also which cavities are empty."""
    CATEGORY = enum.auto()
    """``text``: the category's name or a caption. Makes no track of its own; the row prints it."""
    XRAY = enum.auto()
    """``xray``: the two radiographs."""
    MATERIALS = enum.auto()
    """``materials``: the named material of each part, as captures and the dataset state it. Makes
    no track; the name all but tells the density, so who reads it is printed without a rank."""
    TRUTH = enum.auto()
    """``truth``: the answers. Makes no track; who reads it is an oracle, printed without a rank."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Its names in a submission's meta data."""
        return tuple(name for name, flag in _BY_INPUT.items() if flag in self)

    @classmethod
    def of_inputs(cls, inputs: Iterable[str]) -> Modality:
        """Return the modality that a submission's ``inputs`` stand for.

        Examples
        --------
        >>> Modality.of_inputs(["xray"])
        <Modality.XRAY: 16>
        """
        joined = cls.NONE
        for name in inputs:
            joined |= _BY_INPUT[name]
        return joined


_BY_INPUT = {
    "mesh": Modality.GEOMETRY,
    "rgb": Modality.RGB,
    "parts": Modality.PARTS,
    "text": Modality.CATEGORY,
    "xray": Modality.XRAY,
    "materials": Modality.MATERIALS,
    "truth": Modality.TRUTH,
}
INPUTS = tuple(_BY_INPUT)
"""Every name that may stand in a submission's ``inputs``."""


def track_of(reads: Modality) -> Track:
    """Return the narrowest track in which a method that reads this may run.

    X-rays lead to ``xray``, else part ids to ``rgb_parts`` (with or without pictures), else
    pictures to ``rgb``, else ``geometry``.

    Examples
    --------
    >>> track_of(Modality.GEOMETRY | Modality.PARTS)
    'rgb_parts'
    """
    if Modality.XRAY in reads:
        return "xray"
    if Modality.PARTS in reads:
        return "rgb_parts"
    return "rgb" if Modality.RGB in reads else "geometry"
