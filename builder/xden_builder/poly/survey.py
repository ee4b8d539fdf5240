"""What the labelled parts and the mass of one object say of the beam's hardness.

A beam that is harder than the scanner's file says makes everything look too light, metals far more
so than plastics. Each object is fitted by its images alone behind several extra filters; how far
its labelled parts then lie off what they are made of is a clue (:mod:`hardness` joins those of a
folder).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden1k.values.materials import load_materials
from xden_builder.capture import Capture
from xden_builder.capture.space import Space
from xden_builder.physics.groups import EnergyGroups, energy_groups
from xden_builder.poly.diagnosis import information_shares
from xden_builder.poly.estimate import problem_of
from xden_builder.poly.line import sampled
from xden_builder.poly.materials.composition import composition_sd
from xden_builder.poly.materials.stand_ins import StandIns, loosened, regrouped
from xden_builder.poly.model.walls import Walls
from xden_builder.poly.posterior.problem import Problem, solve
from xden_builder.poly.posterior.trust import USUAL_VEIL
from xden_builder.poly.samples import Samples
from xden_builder.poly.settings import PolySettings

__all__ = ["FILTERS_MM_CU", "Clue", "survey"]

FILTERS_MM_CU: Final = (-0.03, 0.0, 0.04, 0.1, 0.2, 0.35, 0.5)
"""Extra copper that objects are fitted behind."""
SURE: Final = 0.12
"""A density that images and composition leave less sure than this, as a share, is no clue: foams
and composites hardly ever are."""
MOST: Final = 0.5
"""A part known from outlines or from dark samples by more than this is no clue."""
LABEL_SD: Final = MappingProxyType(
    {"metal": 0.02, "liquid": 0.02, "glass": 0.03, "wood": 0.05, "mineral": 0.05, "polymer": 0.08}
)
UNSURE_LABEL_SD: Final = 0.12
NO_LABEL_SD: Final = 0.3
"""How far pigments, fillers and alloys that a label leaves unsaid change the attenuation, and so a
mass by images, by family (assumed)."""
WORTH: Final = 10.0
"""Times as much as usual the samples are worth here: without a label that holds densities, what is
expected of gain and stray light would make everything lighter, by a quarter of a per cent."""
VOLUME_SD: Final = 0.02
"""Of the meshes' volumes, as a share."""


@dataclass(frozen=True, slots=True)
class Clue:
    """How far the density of one material, or the mass, lies off what it should be.

    Parameters
    ----------
    name
        Label of the parts, or ``mass``.
    log_ratio
        Logarithm of fitted over expected, behind each of :data:`FILTERS_MM_CU`.
    sd
        Its standard deviation, if compositions and images err as is assumed.
    own_sd
        What of it is the part's own, however little these err: the material's range of densities,
        and what the meshes' surfaces may be off.
    composition_sd
        What of it compositions make.
    """

    name: str
    log_ratio: tuple[float, ...]
    sd: float
    own_sd: float
    composition_sd: float


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """Densities by the images alone, and their covariance were the samples worth what is usual."""

    problem: Problem
    unknowns: Float64[np.ndarray, "u"]
    covariance: Float64[np.ndarray, "k k"]

    @property
    def density_g_cm3(self) -> Float64[np.ndarray, "k"]:
        return self.unknowns[: self.problem.parts]


def survey(
    capture: Capture,
    space: Space,
    settings: PolySettings,
) -> tuple[Clue, ...]:
    """Find the clues of one object; its labelled parts are taken at their word.

    Parameters
    ----------
    capture
        With a tube.
    space
        What is each part's.
    settings
        What is modelled.

    Raises
    ------
    DataError
        As :func:`xden_builder.poly.line.fit_poly`.
    """
    assert capture.tube is not None
    samples = _as_labelled(sampled(capture, space, settings), settings.composition)
    fits = [
        _fitted(
            samples, energy_groups(capture.tube.behind("Cu", mm / 10), capture.detector), settings
        )
        for mm in FILTERS_MM_CU
    ]
    clues = list(_by_labels(capture, samples.guess.scene.walls, fits))
    if capture.weighed_mass_g is not None:
        clues += _by_mass(capture, samples.size.factor**3 * space.volumes_cm3, fits)
    return tuple(clues)


def _as_labelled(samples: Samples, composition: float) -> Samples:
    """Take each labelled part for its label's material, whatever it looks like."""
    guess = samples.guess
    shares, errors = list(guess.stand_ins.shares), guess.stand_ins.composition_sd.copy()
    for number, part in enumerate(guess.scene.parts):
        if material := load_materials().get(part.material):
            shares[number] = {material.name: 1.0}
            way_sd = float(guess.scene.walls.way_sd[number])
            errors[number] = math.hypot(composition * composition_sd(material), way_sd)
    stand_ins = replace(guess.stand_ins, shares=shares, composition_sd=errors)
    return replace(samples, guess=replace(guess, stand_ins=stand_ins))


def _fitted(samples: Samples, groups: EnergyGroups, settings: PolySettings) -> _Fit:
    """Fit densities that no material's range holds, by a beam of other groups."""
    guess = samples.guess
    stand_ins: StandIns = loosened(regrouped(guess.stand_ins, groups))
    seen = []
    for each in samples.seen:
        beam = each.beam.regrouped(groups)
        weights = beam.weights(each.samples.pixels)
        seen.append(replace(each, beam=beam, samples=replace(each.samples, weights=weights)))
    there = replace(samples, seen=tuple(seen))
    density, veils = guess.density_g_cm3, [USUAL_VEIL] * len(seen)
    problem = problem_of(there, stand_ins, density, veils, None, settings)
    start = problem.prior.mean.copy()
    start[: problem.parts] = density
    minimum = solve(replace(problem, share=min(1.0, WORTH * problem.share)), start)
    covariance = np.linalg.inv(problem.evaluate(minimum.unknowns).hessian)
    return _Fit(problem, minimum.unknowns, covariance[: problem.parts, : problem.parts])


def _by_labels(capture: Capture, walls: Walls, fits: Sequence[_Fit]) -> Iterator[Clue]:
    """Yield a clue for each material whose parts the images tell well."""
    told = fits[FILTERS_MM_CU.index(0.0)]
    found = np.stack([fit.density_g_cm3 for fit in fits])
    sd = np.sqrt(told.covariance.diagonal()) / told.density_g_cm3
    outline, dark = information_shares(told.problem, told.unknowns)
    clear = (sd < SURE) & (outline < MOST) & (dark < MOST)
    for label, parts in _solid_parts(capture).items():
        mine = [part for part in parts if clear[part]]
        if mine:
            material = load_materials()[label]
            nominal = material.density_nominal_g_cm3
            log_ratio = np.log(found[:, mine] / nominal).mean(axis=1)
            surest = mine[int(sd[mine].argmin())]
            range_sd = material.density_sd_g_cm3 / nominal
            own_sd = math.hypot(range_sd, float(walls.way_sd[surest]))
            yield Clue(
                label,
                tuple(log_ratio.tolist()),
                math.hypot(range_sd, float(sd[surest])),
                own_sd,
                told.problem.settings.composition * composition_sd(material),
            )


def _solid_parts(capture: Capture) -> Mapping[str, list[int]]:
    """Numbers of the parts of each material that is named, hollow ones left out."""
    found: dict[str, list[int]] = {}
    for number, part in enumerate(capture.parts):
        if part.material in load_materials() and not part.hollow:
            found.setdefault(part.material, []).append(number)
    return found


def _unsaid(label: str) -> float:
    """How far the attenuation behind a label may be off, as a share of it."""
    if label not in load_materials():
        return NO_LABEL_SD
    return LABEL_SD.get(load_materials()[label].family, UNSURE_LABEL_SD)


def _by_mass(
    capture: Capture, volumes_cm3: Float64[np.ndarray, "k"], fits: Sequence[_Fit]
) -> Iterator[Clue]:
    """Yield a clue if images and labels tell the mass well; of how far they err it says nothing."""
    told, weighed_g = fits[FILTERS_MM_CU.index(0.0)], capture.weighed_mass_g
    log_ratio = [float(np.log(volumes_cm3 @ fit.density_g_cm3 / weighed_g)) for fit in fits]
    masses_g = volumes_cm3 * told.density_g_cm3
    by_label: dict[str, float] = {}
    for part, mass_g in zip(capture.parts, masses_g.tolist(), strict=True):
        by_label[part.material] = by_label.get(part.material, 0.0) + _unsaid(part.material) * mass_g
    sd_g = math.hypot(
        float(np.sqrt(volumes_cm3 @ told.covariance @ volumes_cm3)), *by_label.values()
    )
    sd = math.hypot(sd_g / float(masses_g.sum()), VOLUME_SD)
    if sd < SURE:
        yield Clue("mass", tuple(log_ratio), sd, own_sd=sd, composition_sd=0.0)
