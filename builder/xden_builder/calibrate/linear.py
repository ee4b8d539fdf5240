"""The fit of the spectrum near its answer, where it is linear: what it leaves open, what is off.

A reading that is off moves the spectrum towards itself, so that its own residual tells little. What
tells is by how much the answer would rather have it off: a shift of its own is added to the
unknowns, and divided by its standard deviation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float64
from scipy.linalg import block_diag, solve_triangular

from xden_builder.calibrate.light import LitImage
from xden_builder.calibrate.told import Wedge

__all__ = ["Linear", "Off", "covariance", "suspects"]

FAR: Final = 0.3
"""Relative thickness: nothing is linear farther off."""


@dataclass(frozen=True, slots=True, eq=False)
class Linear:
    """One image.

    Parameters
    ----------
    image
        Its readings.
    residuals
        Shape (n,): measured less expected, in independent standard deviations.
    errors
        Shape (n, n): lower factor of the covariance of the readings.
    by_terms, by_own
        Shapes (n, terms) and (n, own): derivatives of what is expected by the unknowns of all
        images, and by those of this one.
    by_thickness
        Shape (n,): the same by the relative thickness of each reading's step.
    """

    image: LitImage
    residuals: Float64[np.ndarray, "n"]
    errors: Float64[np.ndarray, "n n"]
    by_terms: Float64[np.ndarray, "n terms"]
    by_own: Float64[np.ndarray, "n own"]
    by_thickness: Float64[np.ndarray, "n"]

    def weighed(self, of_readings: Float64[np.ndarray, "n *_m"]) -> Float64[np.ndarray, "n *_m"]:
        """Give readings in independent standard deviations."""
        return np.asarray(solve_triangular(self.errors, of_readings, lower=True))


@dataclass(frozen=True, slots=True)
class Off:
    """A step, or a whole wedge, that is not as the other readings say.

    Parameters
    ----------
    wedge, step
        Which; no step of a whole wedge.
    sds
        By how many standard deviations.
    thicker
        By which share of its thickness it seems thicker than told: a step along the derivatives,
        good to a half of itself, since the spectrum that was found has been led astray by it.
    """

    wedge: Wedge
    step: int | None
    sds: float
    thicker: float

    @property
    def place(self) -> str:
        """Name it, for people."""
        step = "" if self.step is None else f": step {self.step + 1}"
        return f"{self.wedge.scan}: {self.wedge.material.name}{step}"

    @property
    def is_near(self) -> bool:
        """Whether it is off by so little that all is linear, and this one the culprit."""
        return abs(self.thicker) < FAR


def covariance(
    images: Sequence[Linear],
    terms_sd: Float64[np.ndarray, "terms"],
    own_sd: Float64[np.ndarray, "own"],
) -> Float64[np.ndarray, "u u"]:
    """Of the terms, then of each image's own unknowns, with their priors' standard deviations."""
    rows, terms = _rows(images), np.append(terms_sd, np.tile(own_sd, len(images)))
    return np.asarray(np.linalg.inv(rows.T @ rows + np.diag(terms**-2.0)))


def suspects(images: Sequence[Linear], left: Float64[np.ndarray, "u u"]) -> list[Off]:
    """Say of each wedge and step how far it is off what all other readings say, the farthest first.

    Parameters
    ----------
    images
        All.
    left
        Their :func:`covariance`.
    """
    rows, residuals = _rows(images), np.concatenate([each.residuals for each in images])
    ends = np.cumsum([len(each.residuals) for each in images])[:-1]
    found = []
    for wedge, step, chosen in _steps(images):
        moved = np.concatenate(
            [
                each.weighed(np.where(mine, each.by_thickness, 0.0))
                for each, mine in zip(images, np.split(chosen, ends), strict=True)
            ]
        )
        absorbed = moved @ rows
        free = moved @ moved - absorbed @ left @ absorbed
        if free > 0:
            towards = float(moved @ residuals)
            found.append(Off(wedge, step, abs(towards) / free**0.5, towards / free))
    return sorted(found, key=lambda off: -off.sds)


def _rows(images: Sequence[Linear]) -> Float64[np.ndarray, "n u"]:
    terms = np.concatenate([each.weighed(each.by_terms) for each in images])
    return np.hstack([terms, block_diag(*(each.weighed(each.by_own) for each in images))])


def _steps(
    images: Sequence[Linear],
) -> Iterator[tuple[Wedge, int | None, np.ndarray]]:
    """Yield each wedge, and each step of it, with which readings of all images are its own."""
    readings = [
        (None if reading.wedge < 0 else each.image.image.wedges[reading.wedge], reading.step)
        for each in images
        for reading in each.image.image.readings
    ]
    wedges = {_key(wedge): wedge for wedge, _ in readings if wedge is not None}
    own = np.array([None if wedge is None else _key(wedge) for wedge, _ in readings], dtype=object)
    steps = np.array([step for _, step in readings])
    for key, wedge in wedges.items():
        mine = np.array([each == key for each in own])
        yield wedge, None, mine
        for step in np.unique(steps[mine]).tolist():
            yield wedge, step, mine & (steps == step)


def _key(wedge: Wedge) -> tuple[str, str, tuple[float, ...]]:
    """Tell by what stays the same of a wedge that is seen in several views."""
    return wedge.scan, wedge.material.name, tuple(wedge.thickness_cm)
