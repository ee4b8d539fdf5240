"""How a network is trained."""

from __future__ import annotations

from dataclasses import dataclass

from xden1k.errors import DataError
from xden_baselines.xfield.sizes import SIZES

__all__ = ["Settings"]


@dataclass(frozen=True, slots=True)
class Settings:
    """How a network is trained.

    Parameters
    ----------
    size
        A name in :data:`xden_baselines.xfield.sizes.SIZES`.
    epochs
        Passes through the training objects where no budget is given.
    batch
        Objects at each step.
    queries
        Points of each object at each step.
    learning_rate
        Of AdamW after the warm-up; it falls to a hundredth along half a cosine.
    weight_decay
        Of AdamW.
    held_out
        Share of the training objects, drawn by the seed, that choose the epoch and are not learned
        from. The dataset's split ``val`` is not touched.
    mirrored
        Whether training objects are mirrored at random along x and y, radiographs included.
    jitter_deg, jitter_shift, jitter_scale, jitter_gain
        Standard deviations of the errors that each radiograph is given in training, since no scan
        is as well aligned with its mesh as a simulation: turned about its middle, in degrees;
        shifted, as a share of the crop; enlarged; brightened.
    threads
        Of torch. Sums are split among them: results are the same only for the same number.
    device
        ``cpu`` or ``cuda``.

    Raises
    ------
    DataError
        If a value is out of its range.
    """

    size: str = "tiny"
    epochs: int = 80
    batch: int = 8
    queries: int = 384
    learning_rate: float = 2e-3
    weight_decay: float = 0.01
    held_out: float = 0.05
    mirrored: bool = True
    jitter_deg: float = 0.3
    jitter_shift: float = 0.005
    jitter_scale: float = 0.01
    jitter_gain: float = 0.02
    threads: int = 1
    device: str = "cpu"

    def __post_init__(self) -> None:
        if self.size not in SIZES:
            raise DataError(f"size must be one of {list(SIZES)}, got {self.size!r}")
        for name in ("epochs", "batch", "queries", "learning_rate", "threads"):
            if not getattr(self, name) > 0:
                raise DataError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("weight_decay", "jitter_deg", "jitter_shift", "jitter_scale", "jitter_gain"):
            if not 0 <= getattr(self, name) < 10:
                raise DataError(f"{name} must lie between 0 and 10, got {getattr(self, name)}")
        if not 0 < self.held_out < 1:
            raise DataError(f"held_out must lie between 0 and 1, got {self.held_out}")
