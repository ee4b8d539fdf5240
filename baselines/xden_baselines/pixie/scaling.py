"""Densities as a network learns them: log10, the usual range of the training split as -1 to 1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from xden1k.errors import DataError

__all__ = ["LogScale"]

NARROWEST = 0.1
"""Training densities closer together than this factor of 10 are spread out to it."""
MARGIN = 0.25
"""How far beyond -1 and 1 a prediction may go, in the scaled unit."""


@dataclass(frozen=True, slots=True)
class LogScale:
    """What -1 and 1 stand for.

    Parameters
    ----------
    low, high
        log10 of a density in g/cm³.

    Raises
    ------
    DataError
        If ``high`` is not above ``low``.

    Examples
    --------
    >>> scale = LogScale(-1.0, 1.0)
    >>> scale.density_g_cm3(scale.scaled(torch.tensor([0.1, 1.0, 10.0]))).tolist()
    [0.10000000149011612, 1.0, 10.0]
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise DataError(f"log10 densities must rise, got {self.low} and {self.high}")

    @classmethod
    def of(cls, densities_g_cm3: Float[np.ndarray, "values"]) -> LogScale:
        """Percentiles 1 and 99 of positive densities, at least a tenth of a decade apart."""
        low, high = np.percentile(np.log10(densities_g_cm3), (1, 99))
        spread = max(0.0, NARROWEST - (high - low)) / 2
        return cls(float(low - spread), float(high + spread))

    def scaled(self, density_g_cm3: Float[Tensor, "*n"]) -> Float[Tensor, "*n"]:
        """Scale positive densities."""
        return self.scaled_log10(density_g_cm3.log10())

    def scaled_log10(self, log10_g_cm3: Float[Tensor, "*n"]) -> Float[Tensor, "*n"]:
        """Scale densities given by their logarithm."""
        return (log10_g_cm3 - self.low) * (2 / (self.high - self.low)) - 1

    def density_g_cm3(self, scaled: Float[Tensor, "*n"]) -> Float[Tensor, "*n"]:
        """Undo :meth:`scaled`, after cutting what lies far outside the training split's range."""
        inside = scaled.clamp(-1 - MARGIN, 1 + MARGIN)
        return torch.pow(10.0, self.low + (inside + 1) * ((self.high - self.low) / 2))
