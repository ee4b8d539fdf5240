"""How a network is made and trained."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from xden1k.errors import DataError
from xden1k.values.types import FIELD_SIZE

if TYPE_CHECKING:
    from xden_baselines.pixie.networks import Size

__all__ = ["COARSEST", "TURNS", "Settings"]

TURNS = ("none", "mirrored", "cube")

COARSEST = 16
"""Fewest voxels along an edge that both networks can work with."""


@dataclass(frozen=True, slots=True)
class Settings:
    """How a network is made and trained.

    Parameters
    ----------
    size
        ``cpu`` (0.4 million weights) or ``full`` (53 million, with the family head).
    resolution
        Voxels along each edge of the grid: 16, 32 or 64.
    epochs
        Passes through the training objects where no budget is given.
    batch
        Objects at each step.
    learning_rate
        Of Adam at the first step; it falls to nothing along half a cosine.
    held_out
        Share of the training objects, drawn by the seed, that choose the epoch and are not learned
        from. The dataset's split ``val`` is not touched.
    patience
        Epochs without a better one after which training ends.
    turned
        How training objects are turned at random: ``none``, ``mirrored`` (x and y turned round) or
        ``cube`` (any of the 48 ways in which a cube fits into itself).
    threads
        Of torch. Sums are split among them: results are the same only for the same number.
    device
        ``cpu`` or ``cuda``.

    Raises
    ------
    DataError
        If a value is out of its range.
    """

    size: Size = "cpu"
    resolution: int = 32
    epochs: int = 30
    batch: int = 4
    learning_rate: float = 3e-3
    held_out: float = 0.1
    patience: int = 10
    turned: str = "cube"
    threads: int = 1
    device: str = "cpu"

    def __post_init__(self) -> None:
        if self.size not in ("cpu", "full"):
            raise DataError(f"size must be cpu or full, got {self.size!r}")
        if self.turned not in TURNS:
            raise DataError(f"turned must be one of {TURNS}, got {self.turned!r}")
        if self.resolution < COARSEST or FIELD_SIZE % self.resolution:
            raise DataError(f"resolution must be 16, 32 or 64, got {self.resolution}")
        for name in ("epochs", "batch", "learning_rate", "patience", "threads"):
            if not getattr(self, name) > 0:
                raise DataError(f"{name} must be positive, got {getattr(self, name)}")
        if not 0 < self.held_out < 1:
            raise DataError(f"held_out must lie between 0 and 1, got {self.held_out}")
