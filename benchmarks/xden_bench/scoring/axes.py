"""Whether predictions look as if their axes were exchanged or turned over.

A prediction whose axes are wrong has much of its mass outside the objects, and nearly none after
the right exchange. One that is merely bad fits no better however it is turned.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import permutations, product
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden1k.values.arrays import Grid

__all__ = ["TURNS", "AxesWatch", "Turn"]

OUTSIDE: Final = 0.05
"""An object with a larger share of its mass outside is looked at."""
LOOKED_AT: Final = 12
"""Objects that are turned in all ways, at most: 15 ms each."""
OFTEN: Final = 0.25
"""Share of the objects that must have mass outside: wrong axes show on most."""
BETTER: Final = 0.5
"""A way of turning is told if it leaves less than this share of the mass outside."""


@dataclass(frozen=True, slots=True)
class Turn:
    """One of the ways in which the axes of a cube can be taken.

    Parameters
    ----------
    order
        Axis ``i`` of the result is axis ``order[i]`` of the grid.
    signs
        -1 where that axis runs backwards.
    """

    order: tuple[int, ...]
    signs: tuple[int, ...]

    def __call__(self, grid: Grid) -> Grid:
        """Return a grid with its axes taken so."""
        backwards = tuple(axis for axis, sign in enumerate(self.signs) if sign < 0)
        return np.flip(grid.transpose(self.order), backwards)

    def __str__(self) -> str:
        axes = zip(self.order, self.signs, strict=True)
        return f"({', '.join('-' * (sign < 0) + 'xyz'[axis] for axis, sign in axes)})"

    @property
    def changes(self) -> int:
        """How many axes are elsewhere or backwards."""
        moved = sum(axis != place for place, axis in enumerate(self.order))
        return moved + self.signs.count(-1)


TURNS: Final = tuple(
    sorted(
        (
            Turn(order, signs)
            for order in permutations(range(3))
            for signs in product((1, -1), repeat=3)
        ),
        key=lambda turn: turn.changes,
    )
)
"""All 48, the simplest first: as they are."""


@dataclass(eq=False)
class AxesWatch:
    """Looks at predictions as they come by.

    Examples
    --------
    >>> envelope = np.zeros((4, 4, 4), np.float32)
    >>> envelope[0] = 1
    >>> watch = AxesWatch()
    >>> watch.look(envelope.T, envelope)
    >>> watch.finding()
    'outside the objects lies 75% of the mass, and 0% with the axes taken as (z, y, x)'
    """

    _seen: int = field(default=0, init=False)
    _odd: int = field(default=0, init=False)
    _shares: list[Float64[np.ndarray, "turns"]] = field(default_factory=list, init=False)

    def look(self, grid: Grid, envelope: Grid) -> None:
        """Note how much of a prediction lies outside its object, and would if it were turned.

        Parameters
        ----------
        grid
            Shape (n, n, n): the prediction.
        envelope
            Shape (n, n, n): share of each voxel inside the outer surface.
        """
        self._seen += 1
        mass = grid.sum(dtype=np.float64)
        inside = envelope > 0
        if not mass or 1 - grid[inside].sum(dtype=np.float64) / mass <= OUTSIDE:
            return
        self._odd += 1
        if len(self._shares) < LOOKED_AT:
            kept = (turn(grid)[inside].sum(dtype=np.float64) for turn in TURNS)
            self._shares.append(1 - np.fromiter(kept, np.float64) / mass)

    def finding(self) -> str | None:
        """Say which turn fits far better, if one does."""
        if self._odd <= OFTEN * self._seen:
            return None
        means = np.mean(self._shares, axis=0).round(3)
        best = int(means.argmin())  # the simplest of several
        if means[best] >= BETTER * means[0]:
            return None
        return (
            f"outside the objects lies {means[0]:.0%} of the mass, and {means[best]:.0%} "
            f"with the axes taken as {TURNS[best]}"
        )
