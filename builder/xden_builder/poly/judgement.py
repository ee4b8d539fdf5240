"""Stage 6 of the fit: densities, how sure they are, and what to beware of.

Comes from :mod:`estimate` by way of :mod:`diagnosis`; the object is assembled from it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float64

from xden1k.values.materials import families, load_materials
from xden1k.values.types import DensitySource
from xden_builder.fit.density import PartDensity
from xden_builder.poly.diagnosis import Diagnosis, diagnose
from xden_builder.poly.estimate import Solution
from xden_builder.poly.model.radiograph import TERMS, WIDTH_TERMS
from xden_builder.poly.model.size import Size
from xden_builder.poly.pose import PoseFit
from xden_builder.poly.posterior.problem import NUISANCES
from xden_builder.poly.scale import Weighing

__all__ = ["PolyFit", "PolyPart", "judge"]

UNCERTAIN: Final = 0.06
"""Of a density: of those with a larger standard deviation one in ten or more is off by a tenth."""
MOST: Final = 0.5
TOLD: Final = 0.5
"""Less of a prior's variance taken away by the images leaves the density the prior's."""
DOUBTED: Final = 0.5
"""A label less probable than this is doubted, if the images made it less probable."""
UNSTABLE_SHARE: Final = 0.1
UNSTABLE_SDS: Final = 2.0
"""Views apart by more, of the density and in standard deviations, are flagged."""
VIEW_SHARE: Final = 1.0
"""Of the difference between the views. Their standard error is half of it, if both are equally
good; but one difference tells it badly (Student's distribution of one degree of freedom: 68 % are
within 1.8 of it)."""
LOWERED: Final = 0.99
"""Of the probability before the images: less is not rounding."""
HELD_SDS: Final = 1.0
"""An end of a range that holds densities off by less is no news: their deviations say so."""
HARDLY_THERE: Final = 0.1
"""A part whose density is below this share of the least that its label means is not there, it
seems, or hollow."""
LIGHT_G_CM3: Final = 0.1
"""Of what has no label: foams alone are lighter."""
TOP: Final = 3


@dataclass(frozen=True, slots=True)
class PolyPart(PartDensity):
    """What is known of one part; its density may come from a weighed mass, too.

    Parameters
    ----------
    materials
        The most probable candidates: name, whether solid, probability.
    """

    materials: tuple[tuple[str, bool, float], ...]


@dataclass(frozen=True, slots=True, eq=False)
class PolyFit:
    """Result of the polychromatic fit.

    Parameters
    ----------
    solution
        Where it ended.
    parts
        In the order of the capture's.
    covariance, fitted
        Shape (K, K): of the densities, in g²/cm⁶; and the share of it that images, priors and scale
        leave together, with what they contradict each other by.
    by_size_g_cm3
        Shape (K,): the share of it that comes with the object's size, for one that is one standard
        deviation larger.
    weighing
        The mass on the scale and that by images alone; None where the object was not weighed.
    """

    solution: Solution
    parts: tuple[PolyPart, ...]
    covariance: Float64[np.ndarray, "k k"]
    fitted: Float64[np.ndarray, "k k"]
    by_size_g_cm3: Float64[np.ndarray, "k"]
    weighing: Weighing | None = None

    @property
    def pose(self) -> PoseFit | None:
        """Of the object; None where it was not sought."""
        return self.solution.samples.pose

    @property
    def size(self) -> Size:
        """Of the object, beside its meshes; the scene's have it."""
        return self.solution.samples.size

    @property
    def views_at_bound(self) -> tuple[str, ...]:
        """Names of the views whose gain or stray light ended at the end of its range."""
        found = _at_bound(self.solution)
        return tuple(
            seen.view.name
            for number, seen in enumerate(self.solution.seen)
            if found[self.solution.problem.nuisances(number)].any()
        )

    def report(self, names: Sequence[str]) -> dict[str, Any]:
        """Give what ``meta`` keeps, parts by their names, in JSON's types."""
        solution, pose = self.solution, self.pose
        return {
            "views": {
                seen.view.name: dict(zip(TERMS, solution.nuisances(number).tolist(), strict=True))
                | dict(zip(WIDTH_TERMS, solution.reaches_cm(number), strict=True))
                | {"samples": len(seen.samples.pixels)}
                for number, seen in enumerate(solution.seen)
            },
            "pose": None
            if pose is None
            else pose.to_dict([seen.view.name for seen in solution.seen]),
            "materials": {
                name: [list(each) for each in part.materials]
                for name, part in zip(names, self.parts, strict=True)
            },
            "composition": dict(zip(names, solution.factors.tolist(), strict=True)),
            "stand_ins": {
                name: dict(shares)
                for name, shares in zip(names, solution.problem.stand_ins.shares, strict=True)
            },
            "image_errors": solution.problem.settings.image_errors,
            "weighing": None if self.weighing is None else self.weighing.to_dict(),
            "iterations": solution.minimum.iterations,
            "converged": solution.minimum.converged,
            "loss": solution.minimum.evaluation.loss,
        }


def judge(solution: Solution, *, contradicted: float = 0.0) -> PolyFit:
    """Say how sure each density is, and why it may be wrong.

    The variance has five sources: images, priors and scale (from the curvature of the posterior);
    the choice between materials; the disagreement of the views; and the beam's filter and the size
    of the meshes, each of which moves all parts together.

    Parameters
    ----------
    solution
        Where the fit ended.
    contradicted
        Share by which the mass on the scale, if the fit knows it, contradicts the images: either
        may be wrong, so that all densities may be off by it together.
    """
    known, density = diagnose(solution), solution.density_g_cm3
    parts = solution.scene.parts
    extra = known.between_g_cm3**2 + (VIEW_SHARE * known.apart_g_cm3) ** 2 * known.told_by_images
    fitted = known.covariance + contradicted**2 * np.outer(density, density)
    covariance = fitted + np.diag(extra)
    for together in (known.by_filter_g_cm3, known.by_size_g_cm3):
        covariance = covariance + np.outer(together, together)
    sd = np.sqrt(covariance.diagonal())
    raised = _raised(known, density, sd, _held_sds(solution, sd), solution.minimum.converged)
    found = []
    for number, (part, source) in enumerate(zip(parts, _sources(known), strict=True)):
        materials = _materials(solution, number)
        flags = {name for name, which in raised.items() if which[number]}
        flags |= _material_flags(part.material, *_probabilities(solution, number))
        if not part.hollow and _porous(solution, number, density[number] + sd[number]):
            flags |= {"porous"}
        if not part.hollow and _hardly_there(part.material, density[number], sd[number]):
            flags |= {"hardly_there"}
        found.append(
            PolyPart(
                float(density[number]), float(sd[number]), source, tuple(sorted(flags)), materials
            )
        )
    return PolyFit(solution, tuple(found), covariance, fitted, known.by_size_g_cm3)


def _raised(
    known: Diagnosis,
    density: Float64[np.ndarray, "k"],
    sd: Float64[np.ndarray, "k"],
    held_sds: Float64[np.ndarray, "k"],
    converged: bool,
) -> dict[str, Bool[np.ndarray, "k"]]:
    """Which parts each flag is raised for."""
    apart, clear = known.apart_g_cm3, np.maximum(known.outline_share, known.dark_share) <= MOST
    return {
        "hidden": ~known.met,
        "prior_dominated": known.told_by_images < TOLD,
        "uncertain": sd > UNCERTAIN * density,
        "edge_only": known.outline_share > MOST,
        "starved": known.dark_share > MOST,
        "unstable": (apart > UNSTABLE_SHARE * density)
        & (apart > UNSTABLE_SDS * known.apart_sd_g_cm3),
        "at_bound": (held_sds > HELD_SDS) & clear,
        "at_range_end": (held_sds <= HELD_SDS) & clear,
        "not_converged": np.full(len(density), not converged),
    }


def _at_bound(solution: Solution) -> Bool[np.ndarray, "u"]:
    """Which unknowns ended at the end of their range; no stray light at all is no such end."""
    problem, unknowns = solution.problem, solution.minimum.unknowns
    found = (unknowns <= problem.prior.low) | (unknowns >= problem.prior.high)
    for number in range(len(problem.views)):
        stray = problem.nuisances(number).start + 1 + np.arange(NUISANCES - 1)
        found[stray] &= problem.settings.stray & (unknowns[stray] > 0)
    return found


def _held_sds(solution: Solution, sd: Float64[np.ndarray, "k"]) -> Float64[np.ndarray, "k"]:
    """How far densities would go if a bound that one of them ended at were not there.

    One Gauss-Newton step of it and of all unknowns that ended at none.

    Returns
    -------
    Float64[np.ndarray, "k"]
        For each part the farthest of the densities, in their standard deviations; not a number for
        those that ended at no bound.
    """
    parts, unknowns, here = len(sd), solution.minimum.unknowns, solution.minimum.evaluation
    prior = solution.problem.prior
    ended = (unknowns <= prior.low) | (unknowns >= prior.high)
    held = np.full(parts, np.nan)
    for part in np.flatnonzero(ended[:parts]):
        free = ~ended
        free[part] = True
        step = np.zeros(len(unknowns))
        step[free] = -np.linalg.solve(here.hessian[np.ix_(free, free)], here.gradient[free])
        held[part] = (abs(step[:parts]) / sd).max()
    return held


def _porous(solution: Solution, number: int, most_g_cm3: float) -> bool:
    """Whether a part is foamed or hollow: more likely than not, or too light for its material.

    Parameters
    ----------
    solution, number
        Of the part.
    most_g_cm3
        Its density may be this.
    """
    table, chance = solution.scene.light.tables[number], solution.posteriors[number].probability
    pores = sum(
        share
        for each, share in zip(table.candidates, chance.tolist(), strict=True)
        if not each.solid
    )
    _, after = _probabilities(solution, number)
    likeliest = max(after, key=after.__getitem__)
    low_g_cm3 = load_materials()[likeliest].density_low_g_cm3
    return bool(pores > MOST or (after[likeliest] > MOST and most_g_cm3 < low_g_cm3))


def _hardly_there(label: str, density_g_cm3: float, sd_g_cm3: float) -> bool:
    """Whether a part is of hardly anything, for what it is labelled as."""
    if not label:  # a deviation holds all that it may be
        return density_g_cm3 + sd_g_cm3 < LIGHT_G_CM3
    return density_g_cm3 + 2 * sd_g_cm3 < HARDLY_THERE * _least_g_cm3(label)


@cache
def _least_g_cm3(label: str) -> float:
    """Least density that a label means."""
    library = load_materials().values()
    return min(each.density_low_g_cm3 for each in library if each.called(label))


def _sources(known: Diagnosis) -> Iterator[DensitySource]:
    for images, scale in zip(known.told_by_images, known.told_by_scale, strict=True):
        if scale > TOLD:
            yield "weighed"
        else:
            yield "xray" if images >= TOLD else "prior"


def _materials(solution: Solution, number: int) -> tuple[tuple[str, bool, float], ...]:
    """Return the most probable candidates of a part."""
    table, chance = solution.scene.light.tables[number], solution.posteriors[number].probability
    best = np.argsort(-chance, kind="stable")[:TOP].tolist()
    return tuple(
        (table.candidates[each].material, table.candidates[each].solid, float(chance[each]))
        for each in best
    )


def _probabilities(solution: Solution, number: int) -> tuple[dict[str, float], dict[str, float]]:
    """Probability of each material, solid or not, before the images and with them."""
    table, chance = solution.scene.light.tables[number], solution.posteriors[number].probability
    before: dict[str, float] = {}
    after: dict[str, float] = {}
    for candidate, log_prior, share in zip(
        table.candidates, table.log_prior.tolist(), chance.tolist(), strict=True
    ):
        name = candidate.material
        before[name] = before.get(name, 0.0) + math.exp(log_prior)
        after[name] = after.get(name, 0.0) + share
    return before, after


def _material_flags(label: str, before: dict[str, float], after: dict[str, float]) -> set[str]:
    """``material_guessed`` without a material's name, ``label_doubted`` if no grade of it fits."""
    if not label or label in families():
        return {"material_guessed"}
    meant = [name for name in after if load_materials()[name].called(label)]
    likely, was_likely = (sum(chance[name] for name in meant) for chance in (after, before))
    doubted = likely < DOUBTED and likely < LOWERED * was_likely
    return {"label_doubted"} if doubted else set()
