"""What the objects of a release say together: its axes, its sizes, and its effective beam."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import chain, product
from typing import Any, Final, TypeAlias

import numpy as np
from jaxtyping import Float64

from xden_builder.published.beam import Beam, PartRays, fitted_depth
from xden_builder.published.convention import Convention, vote
from xden_builder.published.hypotheses import families_of, hypotheses, usual_families
from xden_builder.published.likelihood import log_evidence
from xden_builder.published.register import cm_per_unit
from xden_builder.published.survey import PartSeen, Survey

__all__ = ["BeamFit", "ReleaseFit", "fit_release", "part_rays", "voxels_cm"]

FILTERS_MM_AL: Final = (1.5, 2.5, 4.0, 7.0, 12.0, 20.0)
STRAYS: Final = (0.0, 0.02, 0.04)
KNEES: Final = (1.2, 1.5, 1.9)
SPREADS: Final = (0.8, 1.0, 1.25)
USUAL_MM_AL: Final = 4.0
USUAL_LOG_SD: Final = 0.5
"""Filtration of a 100 kV tube before any X-ray: 2.5 mm is the least that IEC 60601-1-3 asks for,
and few add more than as much again (assumed). Parts alone hardly tell 4 from 20 mm."""
USUAL_KNEE: Final = 1.5
USUAL_SPREAD: Final = 1.0
FIT_LOG_SD: Final = 0.2
"""Knee and spread of the paper's fit to radiographs of a simulated scanner, and how far another
scanner's may lie off (assumed)."""
AXES: Final[tuple[tuple[int, ...], ...]] = ((0, 1), (0, 2), (1, 2))
"""What is tried for the beam; radiographs were taken along two axes of the volume."""
UP: Final = 1
"""Axis of the meshes that points up, by glTF."""
LYING_LOG: Final = -3.0
"""Logarithm of how much less likely it is that a radiograph was taken along it: things stand before
a scanner as they stand on a table (assumed)."""
START: Final = (4.0, 0.0)
"""Filter and stray light with which the axes are chosen."""
LIKELY: Final = 0.03
"""Beams that are less probable beside the best are not reckoned with."""
MOST_PARTS: Final = 600
"""Parts that are asked: of 105 one draw in ten finds 2.5 mm in place of 4, of 416 none."""
LOT: Final = 50
"""Parts that are asked before beams are dropped."""
LOTS_FOR_AXES: Final = 3
HOPELESS: Final = 12.0
"""Logarithm by which a beam is behind the best when no more parts are asked about it."""

_Asked: TypeAlias = tuple[PartSeen, Float64[np.ndarray, "3"]]
"""A part, and the sides of its voxels in cm."""


@dataclass(frozen=True, slots=True)
class BeamFit:
    """The beam that explains the parts best.

    Parameters
    ----------
    beam
        It.
    evidence, runner_up
        Logarithm of its posterior probability, and of the best with another filter.
    runner_up_filter_mm_al
        That filter.
    parts
        How many were asked.
    likely
        Beams that remain possible, itself the first, and their probabilities, whose sum is 1.
    """

    beam: Beam
    evidence: float
    runner_up: float
    runner_up_filter_mm_al: float
    parts: int
    likely: tuple[tuple[Beam, float], ...]


@dataclass(frozen=True, slots=True)
class ReleaseFit:
    """All that holds for the whole release.

    Parameters
    ----------
    convention
        Of axes and sizes.
    beam
        Of the radiographs behind the coefficients.
    """

    convention: Convention
    beam: BeamFit

    def to_json(self) -> dict[str, Any]:
        """Return values of JSON's types."""
        return {"convention": self.convention.to_json(), "beam": asdict(self.beam)}

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> ReleaseFit:
        """Read what :meth:`to_json` gave."""
        told = values["beam"]
        likely = tuple((_beam(each), share) for each, share in told["likely"])
        beam = BeamFit(**{**told, "beam": _beam(told["beam"]), "likely": likely})
        return cls(Convention.from_json(values["convention"]), beam)


def _beam(values: dict[str, Any]) -> Beam:
    return Beam(**{**values, "axes": tuple(values["axes"])})


def fit_release(surveys: Sequence[Survey]) -> ReleaseFit:
    """Fit axes, sizes and beam to what all objects say.

    Raises
    ------
    DataError
        If there is no object.
    """
    convention = vote(surveys)
    return ReleaseFit(convention, _fit_beam(surveys, convention))


def voxels_cm(survey: Survey, convention: Convention) -> Float64[np.ndarray, "3"]:
    """Sides of a voxel: the box of the volume is that of the mesh."""
    extent = np.array(survey.mesh_extent)
    scale = cm_per_unit(extent, np.array(survey.size_cm), convention.size_order)
    axes = list(convention.orientation.axes)
    sides = scale * extent[axes] / np.array(survey.volume_extent)
    return sides if convention.mode == "stretched" else np.full(3, np.exp(np.log(sides).mean()))


def part_rays(part: PartSeen, sides_cm: Float64[np.ndarray, "3"], axes: Sequence[int]) -> PartRays:
    """Rays through a part along some axes of the volume."""
    chosen, sides = list(axes), sides_cm[list(axes), None]
    areas = sides_cm.prod() / sides_cm[chosen]
    paths = np.array(part.paths_voxels)[chosen]
    rays = (np.array(part.rays)[chosen] * areas)[:, None] * np.ones_like(paths)
    others = np.exp(-np.array(part.others_voxels_per_cm)[chosen] * sides)
    volume_cm3 = float(part.filled_voxels * sides_cm.prod())
    weights = (rays / rays.sum()).ravel()
    narrow_cm = 1 / np.average(1 / _narrow_cm(part, sides_cm)[chosen], weights=rays[:, 0])
    return PartRays((paths * sides).ravel(), others.ravel(), weights, volume_cm3, float(narrow_cm))


def _narrow_cm(part: PartSeen, sides_cm: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "3"]:
    """Width of the shadow along each axis of the volume, where it is narrower."""
    across = np.stack([np.delete(sides_cm, axis) for axis in range(3)])
    return np.asarray((np.array(part.chords_voxels) * across).min(axis=1))


def _fit_beam(surveys: Sequence[Survey], convention: Convention) -> BeamFit:
    """Choose the beam of the most evidence: first where it ran, then how hard it is."""
    lots = _lots(surveys, convention)
    ran = _ran(list(chain.from_iterable(lots[:LOTS_FOR_AXES])), convention)
    total = {beam: _log_prior(beam) for beam in _beams(ran)}
    for lot in lots:
        total = _still_possible(_weighed(total, lot, ran))
    best = max(total, key=lambda beam: total[beam])
    second = _best_of_another_filter(total, best)
    asked = sum(map(len, lots))
    return BeamFit(
        best, total[best], total[second], second.filter_mm_al, asked, likely_beams(total)
    )


def _beams(ran: tuple[int, ...]) -> Iterator[Beam]:
    """All that are tried along some axes."""
    for filter_mm_al, stray, knee, spread in product(FILTERS_MM_AL, STRAYS, KNEES, SPREADS):
        yield Beam(filter_mm_al, stray, knee, spread, ran)


def _still_possible(total: Mapping[Beam, float]) -> dict[Beam, float]:
    """Beams that are not hopeless, and in any case the best of another filter than the best's."""
    best = max(total, key=lambda beam: total[beam])
    second = _best_of_another_filter(total, best)
    least = total[best] - HOPELESS
    return {beam: log for beam, log in total.items() if log > least or beam == second}


def _best_of_another_filter(total: Mapping[Beam, float], best: Beam) -> Beam:
    others = [beam for beam in total if beam.filter_mm_al != best.filter_mm_al]
    return max(others, key=lambda beam: total[beam])


def likely_beams(total: Mapping[Beam, float]) -> tuple[tuple[Beam, float], ...]:
    """Beams that remain possible and their probabilities, the likeliest first.

    Parameters
    ----------
    total
        Logarithm of the posterior probability of each, up to a constant.

    Examples
    --------
    >>> soft, hard = (Beam(filter_mm_al, 0.0, 1.5, 1.0, (0, 2)) for filter_mm_al in (2.5, 4.0))
    >>> [(beam.filter_mm_al, round(share, 2)) for beam, share in likely_beams({soft: -9, hard: -8})]
    [(4.0, 0.73), (2.5, 0.27)]
    """
    best = max(total.values())
    ordered = sorted(total, key=lambda beam: -total[beam])
    shares = {beam: math.exp(total[beam] - best) for beam in ordered}
    kept = {beam: share for beam, share in shares.items() if share >= LIKELY}
    return tuple((beam, share / sum(kept.values())) for beam, share in kept.items())


def _ran(asked: Sequence[_Asked], convention: Convention) -> tuple[int, ...]:
    """Axes along which the radiographs were taken, by the half of the parts least hidden."""
    clear = np.array([part_rays(*one, axes=range(3)).clear for one in asked])
    seen = [asked[place] for place in np.flatnonzero(clear >= np.median(clear)).tolist()]

    def evidence(axes: tuple[int, ...]) -> float:
        start = {beam: _log_prior(beam) for beam in _beams(axes) if _light(beam) == START}
        lying = any(convention.orientation.axes[axis] == UP for axis in axes)
        return max(_weighed(start, seen, axes).values()) + LYING_LOG * lying

    return max(AXES, key=evidence)


def _light(beam: Beam) -> tuple[float, float]:
    """Filter and stray light: beams that share them share what a perfect fit finds."""
    return beam.filter_mm_al, beam.stray


def _weighed(
    total: Mapping[Beam, float], lot: Sequence[_Asked], axes: tuple[int, ...]
) -> dict[Beam, float]:
    """Log posterior of each beam after some more parts."""
    sums = dict(total)
    for part, sides in lot:
        rays = part_rays(part, sides, axes)
        tried = hypotheses(families_of(part.name), usual_families(part.category))
        for beam in sums:
            depth = fitted_depth(rays, tried, *_light(beam))
            sums[beam] += log_evidence(part.lac_per_cm, rays, tried, depth, beam)
    return sums


def _log_prior(beam: Beam) -> float:
    """Logarithm of how probable a beam is before any part is asked, up to a constant."""
    off = (
        math.log(beam.filter_mm_al / USUAL_MM_AL) / USUAL_LOG_SD,
        math.log(beam.knee / USUAL_KNEE) / FIT_LOG_SD,
        math.log(beam.spread / USUAL_SPREAD) / FIT_LOG_SD,
    )
    return -(math.hypot(*off) ** 2) / 2


def _lots(surveys: Sequence[Survey], convention: Convention) -> list[list[_Asked]]:
    """Parts and the sides of their voxels, in lots that are each spread over the release."""
    every = [(part, survey) for survey in surveys for part in survey.parts]
    chosen = every[:: math.ceil(len(every) / MOST_PARTS)]
    asked = [(part, voxels_cm(survey, convention)) for part, survey in chosen]
    count = math.ceil(len(asked) / LOT)
    return [asked[first::count] for first in range(count)]
