"""What the panel of one view would read on average, before noise."""

from __future__ import annotations

from dataclasses import dataclass

from xden1k.values.arrays import Image

__all__ = ["Signal"]


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """Expected signal of one view, exposure error and noise apart.

    Parameters
    ----------
    values
        Shape (rows, columns): 1 is the open field in the middle of the panel.
    mean_kev
        Shape (rows, columns): mean energy of the signal, by which quanta are counted.
    scatter_share
        Scatter over all signal in the object's shadow.
    """

    values: Image
    mean_kev: Image
    scatter_share: float
