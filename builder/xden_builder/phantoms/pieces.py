"""What an archetype is made of before materials are drawn: named solids, disjoint."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from manifold3d import Manifold

from xden1k.errors import DataError

__all__ = ["Archetype", "Build", "Piece", "disjoint", "moved"]


@dataclass(frozen=True, eq=False)
class Piece:
    """One part of an object as shape and function; its material is drawn later, by role.

    Parameters
    ----------
    name
        Unique in its object.
    role
        What the part is for, such as ``shaft`` or ``shell``: a key of the catalogue's materials.
    solid
        The shape, cm.
    """

    name: str
    role: str
    solid: Manifold


Build = Callable[[np.random.Generator, float], list[Piece]]
"""An archetype: random numbers and the object's longest side in cm to its pieces.

Pieces come strongest first: each owns what it shares with those after it. The object stands as it
would rest, z up; a long one lies along x.
"""


@dataclass(frozen=True, slots=True)
class Archetype:
    """How one kind of object is built, and the roles its parts may have.

    Parameters
    ----------
    build
        Makes the pieces.
    roles
        Separated by spaces; some objects may lack some of them.
    """

    build: Build
    roles: str


def moved(pieces: Sequence[Piece], move: Callable[[Manifold], Manifold]) -> list[Piece]:
    """Turn or shift all pieces alike."""
    return [replace(piece, solid=move(piece.solid)) for piece in pieces]


def disjoint(pieces: Sequence[Piece]) -> list[Piece]:
    """Cut from each piece what earlier ones own, exactly.

    Raises
    ------
    DataError
        If nothing of a piece is left.
    """
    owned, cut = Manifold(), []
    for piece in pieces:
        rest = piece.solid - owned
        if rest.is_empty():
            raise DataError(f"part {piece.name} lies wholly inside stronger parts")
        cut.append(replace(piece, solid=rest))
        owned += piece.solid
    return cut
