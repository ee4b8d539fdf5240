"""Stage 5 of the fit: densities and materials, in turn, until the materials stay as they are.

Comes from :mod:`samples`, leads to :mod:`judgement`; once more if :mod:`misfit` says so, and by way
of :mod:`weighed`, if the object was on a scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float64

from xden1k.rays import PathLengths
from xden1k.values.arrays import Image
from xden_builder.fit.levenberg import Minimum
from xden_builder.poly.materials.candidates import CandidateTable
from xden_builder.poly.materials.evidence import MaterialPosterior, Radiographs, weigh_materials
from xden_builder.poly.materials.stand_ins import StandIns, loosened, mixtures
from xden_builder.poly.model.radiograph import model_image
from xden_builder.poly.model.stray import SCATTERS, WIDTHS, StrayShapes, stray_light
from xden_builder.poly.posterior.problem import Mass, Problem, solve
from xden_builder.poly.posterior.trust import USUAL_VEIL, Veil, sample_sd
from xden_builder.poly.samples import Samples, Seen
from xden_builder.poly.scene import Scene
from xden_builder.poly.settings import PolySettings

__all__ = ["Solution", "estimate", "problem_of", "veils_of"]

SWEEPS: Final = 3
"""Rounds of densities and materials, at most."""


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Where the fit ended.

    Parameters
    ----------
    samples
        What was fitted to.
    posteriors
        How probable each candidate of each part is.
    problem, minimum
        The last one solved, and its solution.
    """

    samples: Samples
    posteriors: tuple[MaterialPosterior, ...]
    problem: Problem
    minimum: Minimum

    @property
    def seen(self) -> tuple[Seen, ...]:
        """The fitted views."""
        return self.samples.seen

    @property
    def scene(self) -> Scene:
        """The object before the fit."""
        return self.samples.guess.scene

    @property
    def density_g_cm3(self) -> Float64[np.ndarray, "k"]:
        """Most probable density of each part."""
        return self.minimum.unknowns[: self.problem.parts]

    @property
    def factors(self) -> Float64[np.ndarray, "k"]:
        """What each part's attenuation coefficients are, as multiples of the library's."""
        return self.problem.factors(self.minimum.unknowns)

    @property
    def seen_density_g_cm3(self) -> Float64[np.ndarray, "k"]:
        """Density of each part that the images see, were its coefficients the library's."""
        return np.asarray(self.density_g_cm3 * self.factors)

    def image(self, number: int, lengths: PathLengths) -> Image:
        """Model image of a view: direct beam and stray light, with the gain.

        Parameters
        ----------
        number
            Of the view.
        lengths
            In the refined pose, of as many rays a pixel as are to be averaged.
        """
        seen, stand_ins = self.seen[number], self.problem.stand_ins
        return model_image(
            seen.view,
            seen.beam,
            lengths,
            seen.smooth,
            stand_ins.mac_cm2_g,
            stand_ins.scattering_cm2_g,
            self.seen_density_g_cm3,
            self.nuisances(number),
            self.reaches_cm(number),
            seen.glare,
        )

    def nuisances(self, number: int) -> Float64[np.ndarray, "4"]:
        """Gain, near scatter, far scatter and glare of a view."""
        return self.minimum.unknowns[self.problem.nuisances(number)]

    def reaches_cm(self, number: int) -> tuple[float, float]:
        """Return the standard deviations of near and far scatter on a view's panel."""
        wider = np.exp(self.minimum.unknowns[self.problem.widths])
        near, far = (wider * self.seen[number].reaches_cm).tolist()
        return near, far


def estimate(samples: Samples, settings: PolySettings) -> Solution:
    """Fit densities, weigh materials, and again, until no part changes what it most probably is.

    At first densities may leave their materials' ranges, so that stray light and gain need not
    make up for a wrong label.

    Parameters
    ----------
    samples
        What is fitted to, and where from.
    settings
        What is modelled.
    """
    density, light = samples.guess.density_g_cm3, samples.guess.scene.light
    parts = len(light.tables)
    best = samples.guess.choice
    now = loosened(samples.guess.stand_ins)
    problem = problem_of(samples, now, density, [USUAL_VEIL] * len(samples.seen), None, settings)
    nuisances = problem.prior.mean[parts:]
    for _ in range(SWEEPS):
        minimum = solve(problem, np.concatenate([density, nuisances]))
        nuisances = minimum.unknowns[parts:]
        posteriors, density = _weigh(problem, minimum, light.tables, settings)
        now = mixtures(light.tables, posteriors, settings.mixture_share)
        problem = problem_of(samples, now, density, veils_of(problem, minimum), None, settings)
        chosen = [int(np.argmax(each.probability)) for each in posteriors]
        if chosen == best:
            break
        best = chosen
    minimum = solve(problem, np.concatenate([density, nuisances]))
    return Solution(samples, posteriors, problem, minimum)


def veils_of(problem: Problem, minimum: Minimum) -> list[Veil]:
    """Near and far scatter of each view."""
    unknowns = minimum.unknowns
    widths = unknowns[problem.widths]
    views = range(len(problem.views))
    return [Veil(unknowns[problem.nuisances(number)][1:][:SCATTERS], widths) for number in views]


def problem_of(
    samples: Samples,
    stand_ins: StandIns,
    density: Float64[np.ndarray, "k"],
    veils: Sequence[Veil],
    mass: Mass | None,
    settings: PolySettings,
) -> Problem:
    """Work out stray light and standard deviations at some densities and scatter."""
    seen, scene = samples.seen, samples.guess.scene
    share = _share([~each.samples.at_least for each in seen], len(scene.parts), settings)
    density = density.clip(stand_ins.low_g_cm3, stand_ins.high_g_cm3)
    strays = [
        StrayShapes(
            stray_light(
                each.view,
                each.beam,
                each.smooth,
                stand_ins.mac_cm2_g,
                stand_ins.scattering_cm2_g,
                density,
                each.samples.pixels,
                each.samples.measured,
                np.outer(each.reaches_cm, np.exp(WIDTHS)).ravel().tolist(),
                each.glare,
            )
        )
        for each in seen
    ]
    sds = [
        sample_sd(
            each.samples,
            each.lengths,
            each.blocks,
            each.beam,
            stand_ins.mac_cm2_g,
            density,
            stray,
            veil,
            each.noise_sd,
            settings,
        )
        for each, stray, veil in zip(seen, strays, veils, strict=True)
    ]
    views = [each.samples for each in seen]
    gains = [each.gain for each in seen]
    return Problem(views, strays, sds, gains, share, stand_ins, scene.batches, mass, settings)


def _share(counted: Sequence[Bool[np.ndarray, "_n"]], parts: int, settings: PolySettings) -> float:
    """Share of an independent observation that each counted sample of the views is worth."""
    worth = settings.worth_a_part * parts * len(counted) / 2
    return min(1.0, worth / max(sum(int(each.sum()) for each in counted), 1))


def _weigh(
    problem: Problem,
    minimum: Minimum,
    tables: Sequence[CandidateTable],
    settings: PolySettings,
) -> tuple[tuple[MaterialPosterior, ...], Float64[np.ndarray, "k"]]:
    """Weigh the materials part by part, each with the outcome of those before.

    Air tells the light, which is known here, so that what meets the object is worth all that the
    images are.
    """
    unknowns, views = minimum.unknowns, range(len(problem.views))
    met = [each.meets.any(axis=1) & ~each.at_least for each in problem.views]
    scene = Radiographs(
        problem.views,
        problem.sds,
        [problem.stray_light(unknowns, number) for number in views],
        [float(unknowns[problem.nuisances(number)][0]) for number in views],
        _share(met, problem.parts, settings),
    )
    seen = unknowns[: problem.parts] * problem.factors(unknowns)
    macs = problem.stand_ins.mac_cm2_g.copy()
    found = []
    for part, table in enumerate(tables):
        posterior = weigh_materials(scene, part, seen, macs, table)
        seen[part] = posterior.probability @ posterior.seen_g_cm3
        weights = posterior.probability * posterior.seen_g_cm3
        macs[part] = weights @ table.mac_cm2_g / weights.sum()
        found.append(posterior)
    return tuple(found), seen
