"""What an object may consist of, and who says so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from jaxtyping import UInt8
from numpy import ndarray

from xden1k.errors import DataError

__all__ = ["MAX_CANDIDATES", "Candidate", "MaterialProposer", "Picture", "Range", "check_density"]

MAX_CANDIDATES = 5
"""As many materials as NeRF2Physics asks for."""

Range = tuple[float, float]
"""Low and high."""
Picture = UInt8[ndarray, "rows columns 3"]
"""An RGB picture."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A material that an object may consist of.

    Parameters
    ----------
    name
        In plain words, lower case.
    density_g_cm3
        Low and high, at most 25, which is beyond the densest element.
    thickness_cm
        Low and high of the walls or layers it is found in, at most 1000.

    Raises
    ------
    DataError
        If a range is not 0 < low <= high within its bound.

    Examples
    --------
    >>> Candidate("steel", density_g_cm3=(7.75, 8.05), thickness_cm=(0.1, 0.3)).name
    'steel'
    """

    name: str
    density_g_cm3: Range
    thickness_cm: Range

    def __post_init__(self) -> None:
        check_density(self.name, self.density_g_cm3)
        _check_range(f"{self.name}: thickness_cm", self.thickness_cm, 1000.0)


@runtime_checkable
class MaterialProposer(Protocol):
    """Proposes what an object may consist of."""

    @property
    def source(self) -> str:
        """Who proposes, as a row says it: ``material prior of the training split``."""
        ...

    @property
    def fallbacks(self) -> int:
        """How often another source had to answer in its place, so far."""
        ...

    def propose(
        self, object_id: str, category: str, picture: Picture | None = None
    ) -> tuple[Candidate, ...]:
        """Give one to five candidates of different names.

        Parameters
        ----------
        object_id
            For messages; no answer depends on it.
        category
            The category's name, or a caption.
        picture
            A view of the object, for those who look at it.
        """
        ...


def check_density(name: str, density_g_cm3: Range) -> None:
    """Raise a DataError unless 0 < low <= high <= 25 g/cm³."""
    _check_range(f"{name}: density_g_cm3", density_g_cm3, 25.0)


def _check_range(what: str, value: Range, most: float) -> None:
    """Raise a DataError unless 0 < low <= high <= most."""
    low, high = value
    if not 0 < low <= high <= most:
        raise DataError(f"{what} must be 0 < low <= high <= {most:g}, got {low:g} to {high:g}")
