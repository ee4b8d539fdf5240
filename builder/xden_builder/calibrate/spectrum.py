"""The spectrum that explains all readings: voltage, aluminium and copper, beside the stray light.

A scintillator of another thickness than assumed, K escape and the angle of the anode harden or
soften the spectrum as filters do, so that filters take their place: they are *effective*.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float64
from scipy.optimize import least_squares

from xden1k.errors import DataError
from xden_builder.calibrate.light import STRAY_TERMS, LitImage, light_up
from xden_builder.calibrate.readings import ImageReadings
from xden_builder.physics.source import Tube
from xden_builder.physics.spectrum.tables import TABLE_KV
from xden_builder.poly.model.radiograph import GAIN

__all__ = ["SPECTRUM_TERMS", "SpectrumFit", "StrayLight", "fit_spectrum"]

SPECTRUM_TERMS: Final = ("kv", "Al", "Cu")
"""Unknowns of the spectrum; filters in cm."""
PRIOR_SD: Final = (3.0, 0.3, 0.03)
"""Around what is told: generators, what the tube and its housing filter, plates nobody told of."""
STRAY_PRIOR: Final = ((0.05, 0.2), (0.05, 0.2), (0.02, 0.05), (0.0, 0.01))
"""Mean and standard deviation of each of :data:`STRAY_TERMS`; none is negative."""
RELATIVE_SD: Final = 0.005
"""Of a reading: thickness, density and evenness of the steps."""
ABSOLUTE_SD: Final = 3e-5
STRAY_SHAPE_SD: Final = 0.01
"""Of stray light, whose shapes are assumed."""
FIRST_STRAY: Final = 0.02
"""In shares of the open field, before the first fit."""
PASSES: Final = 2
"""Shapes and weights depend on the spectrum a little; later passes change nothing."""
AT_PRIOR: Final = 0.7
"""An unknown whose standard deviation is above this share of its prior's was not measured."""
SMALL_GAIN: Final = 1e-5
"""Relative, of the sum of squares: far below what a standard deviation changes."""
MOST_STEPS: Final = 300
_STEP: Final = 1e-2
"""Of differences, in standard deviations of the prior."""

Unknowns = Float64[np.ndarray, "u"]


@dataclass(frozen=True, slots=True, eq=False)
class StrayLight:
    """Gain and stray light of one image.

    Parameters
    ----------
    name
        Of the image.
    gain
        Exposure over that of the open field.
    amplitudes, sds
        Of :data:`STRAY_TERMS`.
    mean_share
        Mean stray light behind the steps, in shares of the open field.
    """

    name: str
    gain: float
    amplitudes: tuple[float, ...]
    sds: tuple[float, ...]
    mean_share: float


@dataclass(frozen=True, slots=True, eq=False)
class SpectrumFit:
    """What the readings say of the spectrum.

    Parameters
    ----------
    tube
        With the fitted voltage and filters.
    sd
        Of :data:`SPECTRUM_TERMS`.
    at_prior
        Those of them that the readings leave where they were told.
    stray
        Of each image.
    expected
        Transmission that the fit gives each reading, per image.
    rms
        Root mean square of the weighted residuals; 1 is what is assumed of steps and stray light.
    """

    tube: Tube
    sd: tuple[float, ...]
    at_prior: tuple[str, ...]
    stray: tuple[StrayLight, ...]
    expected: tuple[Float64[np.ndarray, "_n"], ...]
    rms: float


def fit_spectrum(images: Sequence[ImageReadings], told: Tube, scintillator: str) -> SpectrumFit:
    """Fit spectrum, gains and stray light to all readings together.

    Parameters
    ----------
    images
        Of one tube.
    told
        Where the fit starts, and the middle of its priors.
    scintillator
        ``CsI`` or ``GOS``; empty: caesium iodide is assumed.

    Raises
    ------
    DataError
        If the tube is not polychromatic, its voltage outside the tables, or no fit is found.
    """
    if told.kv is None:
        raise DataError("scanner.toml: tube.kv is missing: wedges calibrate a tube's spectrum")
    if not TABLE_KV[0] <= told.kv <= TABLE_KV[-1]:
        low, high = TABLE_KV[0], TABLE_KV[-1]
        raise DataError(f"scanner.toml: tube.kv must be {low:g} to {high:g}, got {told.kv:g}")
    lit = tuple(light_up(image, told, scintillator or "CsI") for image in images)
    tube, stray = told, tuple(np.full(len(image.readings), FIRST_STRAY) for image in images)
    for _ in range(PASSES):
        problem = _Problem(lit, told, tuple(each.stray(tube) for each in lit), stray)
        unknowns, covariance = problem.solve(tube)
        tube, stray = problem.tube(unknowns), problem.stray(unknowns)
    return problem.fit(unknowns, np.sqrt(np.diag(covariance)))


_OF_IMAGE: Final = 1 + len(STRAY_TERMS)
"""Unknowns of an image: its gain, and its stray light."""


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """Least squares over :data:`SPECTRUM_TERMS`, then gain and stray light of each image.

    Parameters
    ----------
    images
        All readings.
    told
        In the middle of the priors.
    shapes
        Of the stray light of each image.
    stray
        As far as it is known, for the weights.
    """

    images: tuple[LitImage, ...]
    told: Tube
    shapes: tuple[Float64[np.ndarray, "_n terms"], ...]
    stray_before: tuple[Float64[np.ndarray, "_n"], ...]

    @property
    def prior(self) -> tuple[Unknowns, Unknowns]:
        """Means and standard deviations."""
        of_image = (GAIN, *STRAY_PRIOR)
        told = list(zip(_spectrum(self.told), PRIOR_SD, strict=True))
        mean, sd = np.array(told + list(of_image) * len(self.images)).T
        return mean, sd

    @property
    def bounds(self) -> tuple[Unknowns, Unknowns]:
        """Voltages of the tables, gains near 1, nothing negative."""
        low = [TABLE_KV[0], 0.0, 0.0] + [0.5, 0.0, 0.0, 0.0, 0.0] * len(self.images)
        high = [TABLE_KV[-1], np.inf, np.inf] + [2.0] + [np.inf] * 4
        high = high[:3] + high[3:] * len(self.images)
        return np.array(low), np.array(high)

    def tube(self, unknowns: Unknowns) -> Tube:
        """Return the tube of some unknowns; a filter of nothing is left out."""
        kv, *filters = unknowns[: len(SPECTRUM_TERMS)].tolist()
        found = dict(self.told.filtration_cm) | dict(zip(SPECTRUM_TERMS[1:], filters, strict=True))
        return replace(self.told, kv=kv, filtration_cm={k: v for k, v in found.items() if v > 0})

    def of_image(self, unknowns: Unknowns, place: int) -> Float64[np.ndarray, "terms"]:
        """Gain and stray light of an image."""
        return unknowns[_own(place)]

    def stray(self, unknowns: Unknowns) -> tuple[Float64[np.ndarray, "_n"], ...]:
        """Stray light of each reading."""
        return tuple(
            shapes @ self.of_image(unknowns, at)[1:] for at, shapes in enumerate(self.shapes)
        )

    def expected(self, unknowns: Unknowns) -> tuple[Float64[np.ndarray, "_n"], ...]:
        """Transmission of each reading."""
        tube, stray = self.tube(unknowns), self.stray(unknowns)
        return tuple(
            self.of_image(unknowns, at)[0] * (image.direct(tube) + stray[at])
            for at, image in enumerate(self.images)
        )

    def residuals(self, unknowns: Unknowns) -> Float64[np.ndarray, "m"]:
        """Subtract what is expected, over its standard deviation; then the priors."""
        mean, sd = self.prior
        off = [
            (image.transmission - expected) / deviation
            for image, expected, deviation in zip(
                self.images, self.expected(unknowns), self.deviations(), strict=True
            )
        ]
        return np.concatenate([*off, (unknowns - mean) / sd])

    def deviations(self) -> list[Float64[np.ndarray, "_n"]]:
        """Give the standard deviation of each reading, errors of the model included."""
        return [
            np.sqrt(
                (RELATIVE_SD * image.transmission) ** 2
                + ABSOLUTE_SD**2
                + (STRAY_SHAPE_SD * stray) ** 2
                + image.sd**2
            )
            for image, stray in zip(self.images, self.stray_before, strict=True)
        ]

    def solve(self, start: Tube) -> tuple[Unknowns, Float64[np.ndarray, "u u"]]:
        """Find the most likely unknowns and their covariance."""
        first, sd = self.prior
        first[: len(SPECTRUM_TERMS)] = _spectrum(start)
        low, high = self.bounds
        inner = np.clip(first, low + 1e-6, high - 1e-6)
        found = least_squares(
            self.residuals,
            inner,
            self.jacobian,
            bounds=(low, high),
            x_scale=sd,
            ftol=SMALL_GAIN,
            max_nfev=MOST_STEPS,
        )
        if not found.success:
            raise DataError("the fit of the spectrum did not settle: look at the steps' places")
        return found.x, np.linalg.inv(found.jac.T @ found.jac)

    def jacobian(self, unknowns: Unknowns) -> Float64[np.ndarray, "m u"]:
        """Differentiate the residuals: by differences for the spectrum, else exact."""
        count, deviations = len(SPECTRUM_TERMS), self.deviations()
        by_spectrum = self._spectrum_slopes(unknowns)
        images = []
        for at, (shapes, expected) in enumerate(
            zip(self.shapes, self.expected(unknowns), strict=True)
        ):
            gain = self.of_image(unknowns, at)[0]
            slopes = np.zeros((len(expected), len(unknowns)))
            slopes[:, :count] = by_spectrum[at]
            slopes[:, _own(at)] = np.column_stack([expected / gain, gain * shapes])
            images.append(-slopes / deviations[at][:, None])
        return np.concatenate([*images, np.diag(1 / self.prior[1])])

    def _spectrum_slopes(self, unknowns: Unknowns) -> list[Float64[np.ndarray, "_n terms"]]:
        """Differentiate what is expected, to the inner side of the bounds."""
        high, steps = self.bounds[1], _STEP * self.prior[1]
        steps = np.where(unknowns + steps > high, -steps, steps)
        here, moves = self.expected(unknowns), np.diag(steps)[: len(SPECTRUM_TERMS)]
        there = [self.expected(unknowns + move) for move in moves]
        return [
            np.stack([(t[at] - h) / move.sum() for t, move in zip(there, moves, strict=True)], 1)
            for at, h in enumerate(here)
        ]

    def fit(self, unknowns: Unknowns, sds: Unknowns) -> SpectrumFit:
        """Put the answer together."""
        count = len(SPECTRUM_TERMS)
        readings = self.residuals(unknowns)[: -len(unknowns)]
        return SpectrumFit(
            tube=self.tube(unknowns),
            sd=tuple(sds[:count].tolist()),
            at_prior=tuple(
                term
                for term, sd, prior in zip(SPECTRUM_TERMS, sds, PRIOR_SD, strict=False)
                if sd > AT_PRIOR * prior
            ),
            stray=tuple(
                StrayLight(
                    image.image.name,
                    float(gain),
                    tuple(amplitudes),
                    tuple(self.of_image(sds, at)[1:].tolist()),
                    float(stray.mean()),
                )
                for at, (image, stray) in enumerate(
                    zip(self.images, self.stray(unknowns), strict=True)
                )
                for gain, *amplitudes in [self.of_image(unknowns, at).tolist()]
            ),
            expected=self.expected(unknowns),
            rms=float(np.sqrt((readings**2).mean())),
        )


def _own(place: int) -> slice:
    """Places of an image's gain and stray light among the unknowns."""
    start = len(SPECTRUM_TERMS) + place * _OF_IMAGE
    return slice(start, start + _OF_IMAGE)


def _spectrum(tube: Tube) -> tuple[float, ...]:
    """Values of :data:`SPECTRUM_TERMS`."""
    assert tube.kv is not None
    return tube.kv, *(tube.filtration_cm.get(name, 0.0) for name in SPECTRUM_TERMS[1:])
