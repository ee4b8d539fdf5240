"""The spectrum that explains all readings, by tube and panel, beside the stray light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np
from jaxtyping import Float64
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares, nnls

from xden1k.errors import DataError
from xden_builder.calibrate.light import LitImage, PlateStray, light_up
from xden_builder.calibrate.linear import Linear, covariance, suspects
from xden_builder.calibrate.readings import ImageReadings
from xden_builder.calibrate.response import PROBES, Response, Term, terms_of
from xden_builder.physics.spectrum.tables import TABLE_KV
from xden_builder.poly.model.radiograph import GAIN
from xden_builder.poly.model.stray import WIDTHS

__all__ = ["FAR_SDS", "SpectrumFit", "StrayLight", "fit_spectrum"]

STRAY_PRIOR: Final = ((0.05, 0.2), (0.05, 0.2), (0.02, 0.05), (0.0, 0.01))
"""Mean and standard deviation of each shape; none is negative."""
NEAR_WIDTH_SD: Final = 0.3
"""Of the logarithm of the near scatter's width, in each image (assumed)."""
RELATIVE_SD: Final = 0.005
"""Of a reading: thickness, density and evenness of the steps."""
ABSOLUTE_SD: Final = 3e-5
STRAY_SHAPE_SD: Final = 0.05
STRAY_SHAPE_CM: Final = 3.0
"""Of stray light, whose shapes are assumed: by which share it errs, and how far on the panel two
steps may be apart and err alike. So a step leans on the lead beside it."""
FIRST_STRAY: Final = 0.02
"""In shares of the open field, before the first fit."""
PASSES: Final = 2
"""Shapes and weights depend on the spectrum a little; later passes change nothing."""
AT_PRIOR: Final = 0.7
"""An unknown whose standard deviation is above this share of its prior's was not measured."""
FAR_SDS: Final = 3.0
"""One that ends so many of its prior's standard deviations from what was told is of another tube or
panel."""
DOUBTED: Final = 4.0
"""Times as far is what was told believed to be off then, where readings are asked whether they
contradict each other."""
SMALL_GAIN: Final = 1e-5
"""Relative, of the sum of squares: far below what a standard deviation changes."""
MOST_STEPS: Final = 300
MOST_RMS_SD: Final = 3.0
"""Of the readings of one image, and between two images of one plate: beyond it no spectrum explains
them, and not one beam."""
MOST_OFF_SD: Final = 6.0
"""Of one step or wedge from what all other readings say. Of sound wedges the farthest is 2 off, of
a step told 4 % too thick 9, of copper told as brass 9."""
OF_WORST: Final = 0.25
"""Of how far the worst wedge is off: others that are as far may be the culprit, too."""
EXPECTED: Final = (
    "expected this material, these thicknesses, filters of the told metals, and one tube for all "
    "images"
)
MOST_GAIN_SDS: Final = 4.0
"""A gain farther off was made by another exposure than the flat's."""
SAME_SD: Final = 0.002
"""Of a reading against that of the same step in another image."""
_STEP: Final = 1e-3
"""Of differences, in standard deviations of the prior."""

Unknowns = Float64[np.ndarray, "u"]
Readings = Float64[np.ndarray, "n"]


@dataclass(frozen=True, slots=True, eq=False)
class StrayLight:
    """Gain and stray light of one image.

    Parameters
    ----------
    name
        Of the image.
    gain
        Exposure over that of the open field.
    amplitudes
        Of :data:`xden_builder.calibrate.light.STRAY_TERMS`.
    mean_share
        Mean stray light behind the steps, in shares of the open field.
    """

    name: str
    gain: float
    amplitudes: tuple[float, ...]
    mean_share: float


@dataclass(frozen=True, slots=True, eq=False)
class SpectrumFit:
    """What the readings say of the spectrum.

    Parameters
    ----------
    response
        Tube and panel as fitted.
    terms, sd
        What was unknown of both, and the standard deviations it is left with.
    probe_sd
        Of the transmission of each of :data:`PROBES`, as a share of it.
    stray
        Of each image.
    expected, expected_sd
        Transmission that the fit gives each reading, per image, and how far readings may lie off
        it: by noise, and by what is assumed of steps and stray light.
    rms
        Root mean square of the weighted residuals; 1 is what is assumed of steps and stray light.
    """

    response: Response
    terms: tuple[Term, ...]
    sd: tuple[float, ...]
    probe_sd: tuple[float, ...]
    stray: tuple[StrayLight, ...]
    expected: tuple[Float64[np.ndarray, "_n"], ...]
    expected_sd: tuple[Float64[np.ndarray, "_n"], ...]
    rms: float

    @property
    def at_prior(self) -> tuple[Term, ...]:
        """Those of the unknowns that the readings leave where they were."""
        found = zip(self.terms, self.response.known(self.terms).tolist(), self.sd, strict=True)
        return tuple(
            term
            for term, value, sd in found
            if sd > AT_PRIOR * term.sd and abs(value - term.mean) <= term.sd
        )

    @property
    def elsewhere(self) -> tuple[Term, ...]:
        """Those that are far from what was told."""
        return _elsewhere(self.terms, self.response.known(self.terms))


def fit_spectrum(images: Sequence[ImageReadings], told: Response) -> SpectrumFit:
    """Fit spectrum, gains and stray light to all readings together.

    Parameters
    ----------
    images
        Of one tube.
    told
        Where the fit starts, and the middle of its priors.

    Raises
    ------
    DataError
        If the tube is not polychromatic, its voltage outside the tables, or no fit is found.
    """
    _refuse_unknown_voltage(told.tube.kv)
    terms, lit = terms_of(told), tuple(light_up(image, told) for image in images)
    found, stray = told, tuple(np.full(len(image.readings), FIRST_STRAY) for image in images)
    widths = np.zeros(len(images))
    for _ in range(PASSES):
        shapes = tuple(each.stray(found) for each in lit)
        errors = tuple(
            np.linalg.cholesky(_covariance(*pair)) for pair in zip(lit, stray, strict=True)
        )
        problem = _Problem(lit, told, terms, shapes, errors)
        values = problem.solve(found, widths)
        widths = values[len(terms) :]
        found = problem.response(values)
        stray = tuple(at.stray for at in problem.lights(values))
    return problem.fit(values)


def _elsewhere(terms: Sequence[Term], values: Unknowns) -> tuple[Term, ...]:
    pairs = zip(terms, values.tolist(), strict=True)
    return tuple(term for term, value in pairs if abs(value - term.mean) > FAR_SDS * term.sd)


def _refuse_unknown_voltage(kv: float | None) -> None:
    if kv is None:
        raise DataError("scanner.toml: tube.kv is missing: wedges calibrate a tube's spectrum")
    low, high = TABLE_KV[0], TABLE_KV[-1]
    if not low <= kv <= high:
        raise DataError(f"scanner.toml: tube.kv must be {low:g} to {high:g}, got {kv:g}")


def _covariance(
    image: LitImage, stray: Readings, relative_sd: float = RELATIVE_SD
) -> Float64[np.ndarray, "n n"]:
    """Errors of readings and of the model: those of steps alone, those of stray light alike."""
    own = (relative_sd * image.transmission) ** 2 + ABSOLUTE_SD**2 + image.sd**2
    apart = np.linalg.norm(image.places_cm[:, None] - image.places_cm, axis=2) / STRAY_SHAPE_CM
    alike = STRAY_SHAPE_SD**2 * np.outer(stray, stray) * np.exp(-(apart**2) / 2)
    return np.asarray(alike + np.diag(own))


@dataclass(frozen=True, slots=True, eq=False)
class _Light:
    """Gain and stray light of an image, behind which the spectrum stands.

    Parameters
    ----------
    direct, shapes
        Transmission of each reading, and the shapes of its stray light.
    amounts
        Of all of them, in the units of the image; the first is the gain.
    residuals
        Of readings and priors, in independent standard deviations.
    """

    direct: Readings
    shapes: Float64[np.ndarray, "n terms"]
    amounts: Float64[np.ndarray, "_a"]
    residuals: Float64[np.ndarray, "_m"]

    @property
    def gain(self) -> float:
        return float(self.amounts[0])

    @property
    def amplitudes(self) -> Float64[np.ndarray, "terms"]:
        """Of the shapes, in shares of the open field."""
        return np.asarray(self.amounts[1:] / self.gain)

    @property
    def stray(self) -> Readings:
        """Stray light of each reading, in shares of the open field."""
        return np.asarray(self.shapes @ self.amplitudes)

    @property
    def expected(self) -> Readings:
        """Transmission of each reading."""
        return np.asarray(self.gain * (self.direct + self.stray))


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """Least squares over the unknowns of tube and panel, then the width of each image's scatter.

    What else is unknown of each image, its gain and stray light, is linear and found beside them.

    Parameters
    ----------
    images
        All readings.
    told, terms
        Tube and panel, and what is unknown of them.
    shapes, errors
        Of the stray light of each image, and of its readings.
    """

    images: tuple[LitImage, ...]
    told: Response
    terms: tuple[Term, ...]
    shapes: tuple[PlateStray, ...]
    errors: tuple[Float64[np.ndarray, "_n _n"], ...]

    @property
    def prior(self) -> tuple[Unknowns, Unknowns]:
        """Means and standard deviations."""
        widths = [(0.0, NEAR_WIDTH_SD)] * len(self.images)
        mean, sd = np.array([*((term.mean, term.sd) for term in self.terms), *widths]).T
        return mean, sd

    @property
    def bounds(self) -> tuple[Unknowns, Unknowns]:
        """Least and most."""
        widths = [(WIDTHS[0], WIDTHS[-1])] * len(self.images)
        low, high = np.array([*((term.low, term.high) for term in self.terms), *widths]).T
        return low, high

    def response(self, values: Unknowns) -> Response:
        """Tube and panel."""
        return self.told.having(self.terms, values[: len(self.terms)])

    def lights(self, values: Unknowns) -> list[_Light]:
        """Find gain and stray light of each image behind a spectrum."""
        response, widths = self.response(values), values[len(self.terms) :].tolist()
        return [
            _light(image.direct(response), shapes.at(width), errors, image.transmission)
            for image, shapes, errors, width in zip(
                self.images, self.shapes, self.errors, widths, strict=True
            )
        ]

    def residuals(self, values: Unknowns) -> Float64[np.ndarray, "m"]:
        """Of all images, then of the priors."""
        mean, sd = self.prior
        return np.concatenate([*(at.residuals for at in self.lights(values)), (values - mean) / sd])

    def slopes(self, values: Unknowns) -> Float64[np.ndarray, "m u"]:
        """Differentiate the residuals, to the inner side of the bounds."""
        here, steps = self.residuals(values), self._steps(values)
        there = [self.residuals(values + move) for move in np.diag(steps)]
        return np.stack([(each - here) / step for each, step in zip(there, steps, strict=True)], 1)

    def solve(self, start: Response, widths: Float64[np.ndarray, "images"]) -> Unknowns:
        """Find the most likely tube and panel, and widths of scatter."""
        low, high = self.bounds
        found = least_squares(
            self.residuals,
            np.clip(np.append(start.known(self.terms), widths), low + 1e-6, high - 1e-6),
            self.slopes,
            bounds=(low, high),
            x_scale=self.prior[1],
            ftol=SMALL_GAIN,
            max_nfev=MOST_STEPS,
        )
        if not found.success:
            raise DataError("the fit of the spectrum did not settle: look at the steps' places")
        return np.asarray(found.x)

    def fit(self, values: Unknowns) -> SpectrumFit:
        """Put the answer together."""
        lights = self.lights(values)
        for (one, image), (other, again) in combinations(zip(lights, self.images, strict=True), 2):
            _refuse_two_beams(one, image, other, again)
        for at, image in zip(lights, self.images, strict=True):
            _refuse_other_exposure(at, image)
        near, left = self._left(values, lights)
        told_wrong = _elsewhere(self.terms, values[: len(self.terms)])
        _refuse_unexplained(*(self._doubting(values) if told_wrong else (near, left)))
        of_terms = left[: len(self.terms), : len(self.terms)]
        off = np.concatenate(
            [
                at.residuals[: len(each.transmission)]
                for at, each in zip(lights, self.images, strict=True)
            ]
        )
        return SpectrumFit(
            response=self.response(values),
            terms=self.terms,
            sd=tuple(np.sqrt(np.diag(of_terms)).tolist()),
            probe_sd=self._probe_sd(values, of_terms),
            stray=tuple(
                StrayLight(
                    each.image.name, at.gain, tuple(at.amplitudes.tolist()), float(at.stray.mean())
                )
                for at, each in zip(lights, self.images, strict=True)
            ),
            expected=tuple(at.expected for at in lights),
            expected_sd=tuple(np.linalg.norm(errors, axis=1) for errors in self.errors),
            rms=float(np.sqrt((off**2).mean())),
        )

    def _doubting(self, values: Unknowns) -> tuple[list[Linear], Float64[np.ndarray, "u u"]]:
        """Fit again, believing less of what was told: if wrong, it pulls all readings off."""
        terms = tuple(replace(term, sd=DOUBTED * term.sd) for term in self.terms)
        doubting = replace(self, terms=terms)
        found = doubting.solve(self.response(values), values[len(terms) :])
        return doubting._left(found, doubting.lights(found))

    def _left(
        self, values: Unknowns, lights: Sequence[_Light]
    ) -> tuple[list[Linear], Float64[np.ndarray, "u u"]]:
        """Return the problem near its answer, and the covariance of what is unknown."""
        near = self._linear(values, lights)
        own_sd = np.array([GAIN, *STRAY_PRIOR, (0.0, NEAR_WIDTH_SD)]).T[1]
        return near, covariance(near, self.prior[1][: len(self.terms)], own_sd)

    def _linear(self, values: Unknowns, lights: Sequence[_Light]) -> list[Linear]:
        """Differentiate what is expected of each image, gain and stray light being free."""
        count = len(self.terms)
        steps, widths = self._steps(values)[:count], values[count:].tolist()
        here = self.response(values)
        moved = [
            self.response(np.append(each, values[count:]))
            for each in values[:count] + np.diag(steps)
        ]
        found = []
        for image, at, shapes, errors, width in zip(
            self.images, lights, self.shapes, self.errors, widths, strict=True
        ):
            slopes = [at.gain * (image.direct(each) - at.direct) for each in moved]
            wider = (shapes.at(width + _STEP) - shapes.at(width)) @ at.amplitudes / _STEP
            found.append(
                Linear(
                    image,
                    -at.residuals[: len(at.direct)],
                    errors,
                    np.transpose(slopes) / steps,
                    np.column_stack([at.direct, at.shapes, at.gain * wider]),
                    at.gain * image.by_thickness(here),
                )
            )
        return found

    def _steps(self, values: Unknowns) -> Unknowns:
        high, steps = self.bounds[1], _STEP * self.prior[1]
        return np.where(values + steps > high, -steps, steps)

    def _probe_sd(
        self, values: Unknowns, covariance: Float64[np.ndarray, "terms terms"]
    ) -> tuple[float, ...]:
        """Carry what is left unknown on to the transmission of the probes."""
        known = values[: len(self.terms)]
        steps = self._steps(values)[: len(known)]
        here, *there = (
            np.array([self.told.having(self.terms, each).log_transmission(p) for p in PROBES])
            for each in (known, *(known + np.diag(steps)))
        )
        slopes = np.stack(
            [(each - here) / step for each, step in zip(there, steps, strict=True)], 1
        )
        return tuple(np.sqrt(np.diag(slopes @ covariance @ slopes.T)).tolist())


def _refuse_unexplained(near: Sequence[Linear], left: Float64[np.ndarray, "u u"]) -> None:
    """Refuse readings that lie off by far more than steps and stray light err; name the worst."""
    found = suspects(near, left)
    wedges = [off for off in found if off.step is None]
    rms = max(float(np.sqrt((each.residuals**2).mean())) for each in near)
    if rms > MOST_RMS_SD:
        worst = [off.place for off in wedges if off.sds > OF_WORST * wedges[0].sds]
        raise DataError(
            f"{' and '.join(worst)}: readings lie {rms:.1f} sd off what any spectrum lets pass: "
            f"{EXPECTED}"
        )
    off = next((off for off in found if off.is_near), None)
    if off is not None and off.sds > MOST_OFF_SD:
        raise DataError(
            f"{off.place} lies {off.sds:.1f} sd off what all other readings say, as if it were "
            f"some {abs(off.thicker):.0%} {'thicker' if off.thicker > 0 else 'thinner'}: {EXPECTED}"
        )


def _refuse_other_exposure(at: _Light, image: LitImage) -> None:
    mean, sd = GAIN
    if abs(at.gain - mean) > MOST_GAIN_SDS * sd:
        raise DataError(
            f"{image.image.name}: was exposed {at.gain:.2f} times as much as its flat, expected "
            f"{mean - MOST_GAIN_SDS * sd:.2g} to {mean + MOST_GAIN_SDS * sd:.2g} times"
        )


def _refuse_two_beams(one: _Light, image: LitImage, other: _Light, again: LitImage) -> None:
    """Refuse one plate's images if its steps let other shares pass; their errors are the same."""
    both = sorted(image.steps.keys() & again.steps.keys())
    if not both:
        return
    here, there = ([each.steps[step] for step in both] for each in (image, again))
    off = (image.transmission / one.gain - one.direct - one.stray)[here]
    off -= (again.transmission / other.gain - other.direct - other.stray)[there]
    covariance = _covariance(image, one.stray, SAME_SD)[np.ix_(here, here)]
    covariance += _covariance(again, other.stray, SAME_SD)[np.ix_(there, there)]
    sds = float(np.sqrt(off @ np.linalg.solve(covariance, off) / len(off)))
    if sds > MOST_RMS_SD:
        raise DataError(
            f"{image.image.name} and {again.image.name}: the same steps differ by {sds:.1f} sd: "
            "expected one tube, one voltage and one filter for all images"
        )


def _light(
    direct: Readings,
    shapes: Float64[np.ndarray, "n terms"],
    errors: Float64[np.ndarray, "n n"],
    transmission: Readings,
) -> _Light:
    """Find the most likely gain and stray light, none of it negative."""
    design = np.column_stack([direct, shapes])
    mean, sd = np.array([GAIN, *STRAY_PRIOR]).T
    weighted = solve_triangular(errors, np.column_stack([design, transmission]), lower=True)
    rows = np.concatenate([weighted[:, :-1], np.diag(1 / sd)])
    wanted = np.concatenate([weighted[:, -1], mean / sd])
    amounts = nnls(rows, wanted)[0]
    return _Light(direct, shapes, amounts, rows @ amounts - wanted)
