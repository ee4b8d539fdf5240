"""Radiographs and path lengths as a least-squares problem on transmission.

The unknowns are one coefficient for each part and one gain for each view. Pixels whose rays meet
a part enter one by one; all air enters as its number, mean and scatter, so that the cost of a
step does not grow with the frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float64

from xden1k.errors import DataError
from xden1k.rays import PathLengths
from xden1k.values.views import XRayView
from xden_builder.capture.saturation import GainBounds
from xden_builder.fit import kernels
from xden_builder.fit.observed import ViewData
from xden_builder.fit.values import FitSettings

__all__ = ["NOT_KNOWN", "Evaluation", "Fitted", "Problem", "ViewFit", "Weighting"]

NOT_KNOWN: Final[Mapping[str, Any]] = MappingProxyType({})
"""Of any view."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The loss at one point and its derivatives by coefficients and gains.

    Parameters
    ----------
    loss
        Sum of w r².
    gradient
        Shape (K + V,): half the gradient.
    hessian
        Shape (K + V, K + V): JᵀWJ.
    transmissions
        For each view shape (n,): the model without its gain.
    """

    loss: float
    gradient: Float64[np.ndarray, "u"]
    hessian: Float64[np.ndarray, "u u"]
    transmissions: tuple[Float64[np.ndarray, "_n"], ...]


Weighting = Sequence[tuple[Float64[np.ndarray, "_n"], float]]
"""For each view the weight of every pixel, and of one pixel of air."""


@dataclass(frozen=True, eq=False)
class Problem:
    """All views of one object.

    Raises
    ------
    DataError
        If there are no views, or their path lengths are of different numbers of parts.
    """

    views: tuple[ViewData, ...]

    def __post_init__(self) -> None:
        counts = {view.parts for view in self.views}
        if len(counts) != 1:
            raise DataError(f"the views must be of the same parts, got {sorted(counts)} parts")

    @classmethod
    def of(
        cls,
        views: Sequence[tuple[PathLengths, XRayView]],
        settings: FitSettings,
        dark_sd: Mapping[str, float],
        gain_bounds: Mapping[str, GainBounds] = NOT_KNOWN,
    ) -> Problem:
        """Take the used pixels out of all views; what is known of noise and gain by their names."""
        return cls(
            tuple(
                ViewData.of(
                    lengths, view, settings, dark_sd.get(view.name), gain_bounds.get(view.name)
                )
                for lengths, view in views
            )
        )

    @property
    def parts(self) -> int:
        """Number of parts K."""
        return self.views[0].parts

    @cached_property
    def met(self) -> Bool[np.ndarray, "k"]:
        """Whether a usable ray meets the part, shape (K,)."""
        met = np.zeros(self.parts, dtype=np.bool_)
        for view in self.views:
            kernels.met_parts(view.ways, view.usable, met)
        return met

    def bounds(
        self, settings: FitSettings
    ) -> tuple[Float64[np.ndarray, "u"], Float64[np.ndarray, "u"]]:
        """Lowest and highest coefficients and gains.

        They coincide for a part that no usable ray meets (at 0) and for a gain that is fixed or
        that no air tells (at 1). A gain whose air is saturated has bounds of its own.
        """
        upper = np.where(self.met, settings.upper_per_cm, 0.0)
        gains = np.array([_gain_bounds(view, settings) for view in self.views]).T
        return np.append(np.zeros(self.parts), gains[0]), np.append(upper, gains[1])

    def evaluate(self, unknowns: Float64[np.ndarray, "u"], weighting: Weighting) -> Evaluation:
        """Loss and derivatives at the coefficients and gains."""
        size = self.parts + len(self.views)
        gradient, hessian = np.zeros(size), np.zeros((size, size))
        lac, loss, transmissions = unknowns[: self.parts], 0.0, []
        for number, (view, (weights, air_weight)) in enumerate(
            zip(self.views, weighting, strict=True)
        ):
            gain = float(unknowns[self.parts + number])
            slope, curvature = np.zeros(self.parts + 1), np.zeros((self.parts + 1,) * 2)
            transmission = np.zeros(len(view.measured))
            loss += kernels.normal_equations(
                view.ways,
                view.measured,
                weights,
                lac,
                gain,
                transmission,
                slope,
                curvature,
            )
            total = air_weight * view.air.count
            off = gain - view.air.mean
            loss += total * (off**2 + view.air.sd**2)
            slope[-1] += total * off
            curvature[-1, -1] += total
            mine = np.append(np.arange(self.parts), self.parts + number)
            gradient[mine] += slope
            hessian[np.ix_(mine, mine)] += curvature
            transmissions.append(transmission)
        return Evaluation(loss, gradient, hessian, tuple(transmissions))


def _gain_bounds(view: ViewData, settings: FitSettings) -> GainBounds:
    if settings.gain == "fixed":
        return 1.0, 1.0
    if view.gain_bounds is not None:
        return view.gain_bounds
    return (0.0, np.inf) if view.air.count else (1.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class ViewFit:
    """One view at the end of a fit.

    Parameters
    ----------
    number
        Which view.
    view
        What it told.
    gain
        Its open-field factor.
    transmission
        Shape (n,): the model, without the gain.
    weights, air_weight
        Weight of every pixel, and of one pixel of air.
    """

    number: int
    view: ViewData
    gain: float
    transmission: Float64[np.ndarray, "n"]
    weights: Float64[np.ndarray, "n"]
    air_weight: float

    @property
    def residuals(self) -> Float64[np.ndarray, "n"]:
        """Model less measurement."""
        return np.asarray(self.gain * self.transmission - self.view.measured)


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """Where a solver ended: coefficients and gains, the loss there, and with which weights."""

    problem: Problem
    settings: FitSettings
    weighting: Weighting
    unknowns: Float64[np.ndarray, "u"]
    evaluation: Evaluation

    @property
    def lac_per_cm(self) -> Float64[np.ndarray, "k"]:
        """Coefficients, shape (K,); a part that no ray meets has some, too."""
        return self.unknowns[: self.problem.parts]

    @property
    def gain(self) -> Float64[np.ndarray, "v"]:
        """Gains, shape (V,)."""
        return self.unknowns[self.problem.parts :]

    def views(self) -> Iterator[ViewFit]:
        """Take the views one by one."""
        for number, (view, transmission, weights) in enumerate(
            zip(self.problem.views, self.evaluation.transmissions, self.weighting, strict=True)
        ):
            yield ViewFit(number, view, float(self.gain[number]), transmission, *weights)
