"""How the network of the surface is trained."""

from __future__ import annotations

from dataclasses import dataclass

from xden1k.errors import DataError

__all__ = ["Settings"]


@dataclass(frozen=True, slots=True)
class Settings:
    """How the network is trained.

    Parameters
    ----------
    views
        Pictures of each object that are learned from.
    epochs
        Passes through them where no budget is given.
    batch
        Pictures at each step.
    learning_rate
        Of Adam at the first step; it falls to nothing along half a cosine.
    held_out
        Share of the training objects, drawn by the seed, that choose the epoch and are not learned
        from. The dataset's split ``val`` is not touched.
    patience
        Epochs without a better one after which training ends.
    threads
        Of torch. Sums are split among them: results are the same only for the same number.
    device
        ``cpu`` or ``cuda``.

    Raises
    ------
    DataError
        If a value is out of its range.
    """

    views: int = 3
    epochs: int = 10
    batch: int = 8
    learning_rate: float = 2e-3
    held_out: float = 0.1
    patience: int = 5
    threads: int = 1
    device: str = "cpu"

    def __post_init__(self) -> None:
        for name in ("views", "epochs", "batch", "learning_rate", "patience", "threads"):
            if not getattr(self, name) > 0:
                raise DataError(f"{name} must be positive, got {getattr(self, name)}")
        if not 0 < self.held_out < 1:
            raise DataError(f"held_out must lie between 0 and 1, got {self.held_out}")
