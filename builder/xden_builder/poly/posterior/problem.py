"""Densities, gains and stray light by maximum a posteriori, materials given."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Float64, Int64

from xden_builder.capture.saturation import MOST_GAIN
from xden_builder.fit import huber
from xden_builder.fit.levenberg import Minimum, minimise
from xden_builder.fit.problem import Evaluation
from xden_builder.poly.materials.stand_ins import StandIns
from xden_builder.poly.model.pixels import ViewPixels
from xden_builder.poly.model.stray import GLARE, NO_STRAY, SCATTERS, WIDTHS, StrayShapes
from xden_builder.poly.settings import PolySettings

__all__ = ["MASS_SD_SHARE", "NUISANCES", "Box", "Mass", "Problem", "solve"]

GAIN_RANGE: Final = (0.5, MOST_GAIN)
"""Least and most of a view's gain."""
SCATTER: Final = (0.08, 0.1, 0.0, 0.6)
"""Mean, standard deviation, least and most of the amplitudes of a view's scatter, near and far."""
WIDTH: Final = (0.0, 0.3, float(WIDTHS[0]), float(WIDTHS[-1]))
"""Mean, standard deviation, least and most of the logarithm of a width of scatter over the assumed
one."""
NUISANCES: Final = 4
FIXED_SD: Final = 1e-6
OFF: Final = (0.0, 1.0, -3.0, 3.0)
"""Mean, standard deviation, least and most of how far a batch's coefficients are off."""
MASS_SD_SHARE: Final = 0.005
"""Of a weighed mass over that of the meshes: a scale is better, volumes are not."""
MOST_STEPS: Final = 30


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """Prior of some unknowns: independent normal distributions between bounds."""

    mean: Float64[np.ndarray, "u"]
    sd: Float64[np.ndarray, "u"]
    low: Float64[np.ndarray, "u"]
    high: Float64[np.ndarray, "u"]


@dataclass(frozen=True, slots=True, eq=False)
class Mass:
    """A weighed mass, and the volume of each part.

    Parameters
    ----------
    mass_g
        On the scale.
    volumes_cm3
        Shape (K,).
    volume_sd
        How far these leave a mass off where surfaces may be off, as a share of it.
    """

    mass_g: float
    volumes_cm3: Float64[np.ndarray, "k"]
    volume_sd: float = 0.0

    @property
    def sd(self) -> float:
        """Standard deviation of the mass on the scale over that of the meshes, as a share."""
        return math.hypot(MASS_SD_SHARE, self.volume_sd)


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything the posterior depends on.

    Unknowns: K densities; of each view the gain and three amplitudes of stray light; of each batch
    of material how far its coefficients are off, in standard deviations; and how wide near and far
    scatter are in all views. The images tell a density times such a coefficient, the ranges of the
    materials and a scale tell densities.

    Parameters
    ----------
    views
        Samples.
    strays
        Shapes of the stray light at each sample.
    sds
        Standard deviation of each sample.
    gains
        Mean and standard deviation of the gain of each view.
    share
        Of an independent observation that a sample is worth.
    stand_ins
        What the parts are taken for.
    batches
        Shape (K,): which batch of material each part is of, numbered from 0.
    mass
        From a scale, if any.
    settings
        Which unknowns are free.
    """

    views: Sequence[ViewPixels]
    strays: Sequence[StrayShapes]
    sds: Sequence[Float64[np.ndarray, "_n"]]
    gains: Sequence[tuple[float, float]]
    share: float
    stand_ins: StandIns
    batches: Int64[np.ndarray, "k"]
    mass: Mass | None
    settings: PolySettings

    @property
    def parts(self) -> int:
        """Number of parts K."""
        return len(self.stand_ins.mean_g_cm3)

    @cached_property
    def prior(self) -> Box:
        """Prior of all unknowns."""
        stray = [SCATTER, SCATTER, GLARE] if self.settings.stray else [NO_STRAY] * 3
        each = np.array([each for gain in self.gains for each in (self._gain(*gain), *stray)]).T
        parts = self.stand_ins
        densities = (parts.mean_g_cm3, parts.sd_g_cm3, parts.low_g_cm3, parts.high_g_cm3)
        off = np.tile(np.array([OFF]).T, int(self.batches.max()) + 1)
        width = WIDTH if self.settings.stray else (0.0, FIXED_SD, *WIDTH[2:])
        widths = np.tile(np.array([width]).T, SCATTERS)
        together = zip(densities, each, off, widths, strict=True)
        return Box(*(np.concatenate(columns) for columns in together))

    def _gain(self, mean: float, sd: float) -> tuple[float, float, float, float]:
        return mean, sd if self.settings.gain else FIXED_SD, *GAIN_RANGE

    def nuisances(self, number: int) -> slice:
        """Places of a view's gain and amplitudes among the unknowns."""
        start = self.parts + number * NUISANCES
        return slice(start, start + NUISANCES)

    @property
    def off(self) -> slice:
        """Places of the batches' coefficients among the unknowns."""
        return slice(self.parts + len(self.views) * NUISANCES, -SCATTERS)

    @property
    def widths(self) -> slice:
        """Places of the logarithms of the scatter's widths among the unknowns."""
        return slice(-SCATTERS, None)

    def factors(self, unknowns: Float64[np.ndarray, "u"]) -> Float64[np.ndarray, "k"]:
        """Return what each part's attenuation coefficients are to be multiplied by."""
        return np.asarray(1 + self.stand_ins.composition_sd * unknowns[self.off][self.batches])

    def image(
        self, unknowns: Float64[np.ndarray, "u"], number: int
    ) -> tuple[Float64[np.ndarray, "_n"], Float64[np.ndarray, "_n u"]]:
        """Transmission of one view's samples, and its derivatives by all unknowns."""
        mine = self.nuisances(number)
        gain, *amplitudes = unknowns[mine]
        density, factors = unknowns[: self.parts], self.factors(unknowns)
        direct, slopes = self.views[number].predict(self.stand_ins.mac_cm2_g, density * factors)
        shapes = self.strays[number].at(unknowns[self.widths])
        light = direct + shapes @ np.array(amplitudes)
        jacobian = np.zeros((len(direct), len(unknowns)))
        jacobian[:, : self.parts] = gain * slopes * factors
        by_batch = np.eye(len(unknowns[self.off]))[self.batches]
        jacobian[:, self.off] = (
            gain * slopes @ ((density * self.stand_ins.composition_sd)[:, None] * by_batch)
        )
        jacobian[:, mine] = np.column_stack([light, gain * shapes])
        wider = self.strays[number].slopes(unknowns[self.widths])
        jacobian[:, self.widths] = gain * wider * amplitudes[:SCATTERS]
        return gain * light, jacobian

    def stray_light(
        self, unknowns: Float64[np.ndarray, "u"], number: int
    ) -> Float64[np.ndarray, "_n"]:
        """Stray light at one view's samples, with the gain."""
        gain, *amplitudes = unknowns[self.nuisances(number)]
        shapes = self.strays[number].at(unknowns[self.widths])
        return np.asarray(gain * (shapes @ np.array(amplitudes)))

    def scaled(
        self, unknowns: Float64[np.ndarray, "u"], number: int
    ) -> tuple[Float64[np.ndarray, "_n"], Float64[np.ndarray, "_n u"], Float64[np.ndarray, "_n"]]:
        """Residuals in standard deviations, their derivatives, and the weight of each sample.

        A sample that is known from below alone has no residual, and no weight, where the model is
        brighter.
        """
        image, jacobian = self.image(unknowns, number)
        sd, view = self.sds[number], self.views[number]
        residuals = (image - view.measured) / sd
        counts = huber.one_sided(residuals, view.at_least)
        weights = np.where(counts, self.share * huber.weights(residuals), 0.0)
        return np.where(counts, residuals, 0.0), jacobian / sd[:, None], weights

    def evaluate(self, unknowns: Float64[np.ndarray, "u"]) -> Evaluation:
        """Twice minus the logarithm of the posterior without norms, and half its derivatives."""
        off = (unknowns - self.prior.mean) / self.prior.sd
        loss = float(off @ off)
        gradient, hessian = off / self.prior.sd, np.diag(self.prior.sd**-2.0)
        for number in range(len(self.views)):
            residuals, jacobian, weights = self.scaled(unknowns, number)
            loss += self.share * huber.tempered(residuals)
            weighted = jacobian * weights[:, None]
            gradient = gradient + weighted.T @ residuals
            hessian = hessian + weighted.T @ jacobian
        if self.mass is not None:
            slope = np.zeros(len(unknowns))
            slope[: self.parts] = self.mass.volumes_cm3 / (self.mass.sd * self.mass.mass_g)
            miss = float(slope @ unknowns) - 1 / self.mass.sd
            loss += miss**2
            gradient, hessian = gradient + miss * slope, hessian + np.outer(slope, slope)
        return Evaluation(loss, gradient, hessian, ())


def solve(problem: Problem, start: Float64[np.ndarray, "u"]) -> Minimum:
    """Find the most probable unknowns."""
    prior = problem.prior
    return minimise(problem.evaluate, start, prior.low, prior.high, MOST_STEPS)
