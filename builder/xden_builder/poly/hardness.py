"""What all objects of a folder share: a filter, and how far images and compositions err."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden1k.values.materials import load_materials
from xden_builder.poly.settings import PolySettings
from xden_builder.poly.survey import FILTERS_MM_CU, Clue

__all__ = ["Hardness", "join", "pilots"]

PILOTS: Final = 40
"""Objects that are asked, at most: a hundred parts tell a filter to a few thousandths of a
millimetre."""

STEP_MM: Final = 0.002
GRID_MM: Final = np.arange(FILTERS_MM_CU[0], FILTERS_MM_CU[-1] + STEP_MM / 2, STEP_MM)
TOLD_RIGHT: Final = ((0.6, 0.01), (0.4, 0.15))
"""Before any image: share and standard deviation in mm of copper of files that are right but for
rounding and a few kV, and of those that leave a filter out."""
ASTRAY_SHARE: Final = 0.25
ASTRAY_SD: Final = 0.35
"""Share of clues that lead astray (labels that err or leave a grade unsaid, pores), and how far:
half of them farther, by Cauchy's distribution, since a label may be off by any factor."""
SCALES: Final = np.geomspace(0.1, 10**0.5, 16)
AS_ASSUMED: Final = 10
"""What errors may be as multiples of those assumed, and which of these is 1."""
SCALE_SD: Final = 0.7
"""Standard deviation of the logarithm of either multiple before any image (assumed): two or three
clues leave it above 0.6, twenty do not."""
SURVEY_SD_MM: Final = 0.002
"""What the clues of all objects err by together, with no label to hold densities: of simulated
folders filters come out 0.002 mm too thick in the mean, however many objects are asked."""
CLEARLY_SD: Final = 3.0
CLEARLY_MM: Final = 0.02
"""A filter is said to be missing if it is this many deviations from none, and this thick."""
PLASTICS: Final = frozenset({"polymer"})
FULL_DENSITY: Final = frozenset({"metal", "glass", "liquid"})
"""Families of materials whose parts are of their full density, if no hollow is drawn full."""
FAR_OFF: Final = 0.3
"""Logarithm of the densities of such parts over those of their labels, in the median of a folder,
that no beam makes: of 15 simulated scanners it is within 0.1, where images are square roots or
decimal logarithms -0.4 and -0.7."""
TOO_LIGHT: Final = 0.15
"""The same of plastics, where nothing else tells, and lighter alone: pigments and flame retardants
make them darker. Of 43 simulated scanners it is 0 to 0.28; a power of 0.75 makes it -0.18."""
USUAL: Final = (0.7, 1.5)
"""Multiples of the errors assumed that are not worth a word."""
TUBE_SHARES: Final = np.linspace(0.1, 0.9, 9)
TWO_TUBES: Final = 12.0
"""Logarithm of how much likelier two filters must make the clues than one."""
APART_MM: Final = 0.05
LEAST_OBJECTS: Final = 3
"""Two tubes are said where their filters differ by so much, and each has so many objects."""
LEAST_PLASTICS: Final = 4
"""Clues: of fewer, half may be of parts with pores."""


@dataclass(frozen=True, slots=True)
class Hardness:
    """What objects of a folder share: a filter, and how far images and compositions err.

    Parameters
    ----------
    filter_mm_cu, sd_mm_cu
        Extra copper that explains the images, and its standard deviation; negative where less
        filters it than told.
    clues, objects
        How many it rests on, of how many objects.
    two_tubes_mm_cu
        Two filters that explain the images far better than one, if there are such.
    image_scale
        How far images err, as a multiple of what is assumed: root mean square of what is possible,
        taken for 1 at most in :meth:`applied`.
    composition_scale
        How far compositions do, likewise.
    label_ratio
        Density by the images over that of the label, in the median of :data:`FULL_DENSITY` parts,
        behind the filter that brings it nearest to 1; 1 where there are fewer than three objects
        with such.
    plastics_ratio
        The same of four clues of plastics or more, where there are fewer than three objects with
        any of those; else 1.
    rests_on
        Labels without whose clues, each by itself, the told filter would explain the images, if it
        does not; ``mass`` stands for masses on a scale.
    """

    filter_mm_cu: float
    sd_mm_cu: float
    clues: int
    objects: int
    two_tubes_mm_cu: tuple[float, float] | None
    image_scale: float
    composition_scale: float
    label_ratio: float = 1.0
    plastics_ratio: float = 1.0
    rests_on: tuple[str, ...] = ()

    def applied(self, settings: PolySettings) -> PolySettings:
        """Return the settings by which the objects of the folder are fitted.

        Errors may become smaller than assumed, not larger: where labels lie farther off, it is the
        labels and what they leave unsaid, and images that counted for less would believe them.
        Images may move a density between the materials that remain by as much more as the square of
        the larger multiple is smaller. An object whose residuals are unlike those of sound ones may
        err by as much as is assumed.
        """
        images, compositions = (min(scale, 1.0) for scale in self._scales)
        larger = max(images, compositions)
        return replace(
            settings,
            extra_filter_mm_cu=self.filter_mm_cu,
            filter_sd_mm_cu=self.sd_mm_cu,
            composition=compositions * settings.composition,
            model_share=images * settings.model_share,
            stray_share=images * settings.stray_share,
            clear_floor=images * settings.clear_floor,
            most_image_errors=1 / images,
            mixture_share=min(settings.mixture_share / larger**2, 1.0),
        )

    @property
    def contradicts(self) -> bool:
        """Whether the told filter does not explain the images."""
        return _is_clear(self.filter_mm_cu, self.sd_mm_cu)

    @property
    def no_filter_explains(self) -> bool:
        """Whether labelled parts stay far off all together: the images are not what was told."""
        return bool(abs(np.log(self.label_ratio)) > FAR_OFF)

    @property
    def plastics_are_light(self) -> bool:
        """Whether plastics, which alone tell, are lighter than pores in some of them make them."""
        return bool(np.log(self.plastics_ratio) < -TOO_LIGHT)

    @property
    def errs_as_assumed(self) -> bool:
        """Whether images and compositions err about as far as is assumed."""
        return USUAL[0] <= min(self._scales) and not self.errs_farther

    @property
    def errs_farther(self) -> bool:
        """Whether either errs clearly farther than is assumed."""
        return max(self._scales) > USUAL[1]

    @property
    def _scales(self) -> tuple[float, float]:
        return self.image_scale, self.composition_scale


def pilots(object_ids: Iterable[str]) -> list[str]:
    """Choose objects by the checksums of their ids: as good as at random, and ever the same."""
    mixed = sorted(object_ids, key=lambda object_id: hashlib.sha256(object_id.encode()).digest())
    return sorted(mixed[:PILOTS])


def join(clues: Mapping[str, Sequence[Clue]], *, calibrated: bool = False) -> Hardness:
    """Weigh all clues together, by Bayes' rule on a grid of filters and multiples of the errors.

    Each clue is normally distributed about 0 at the right filter, or one of those that lead
    astray. Where errors are small, so are those of the filter, and clues of aluminium, whose range
    of densities is narrow, tell more of it than those of plastics. Compositions err by kinds of
    materials, images by what is seen of a part: clues of a single kind tell what both make
    together, and hardly which.

    Parameters
    ----------
    clues
        By object; without any, the told filter is believed as far as before any image, and errors
        are as assumed.
    calibrated
        Whether the told filter was measured, so that none can have been left out.
    """
    count, used = sum(map(len, clues.values())), sum(map(bool, clues.values()))
    log_prior = _log_prior(TOLD_RIGHT[:1] if calibrated else TOLD_RIGHT)
    if not count:
        sd = float(np.sqrt(_chance(log_prior) @ GRID_MM**2))
        return Hardness(0.0, round(sd, 4), 0, 0, None, 1.0, 1.0)
    usual = -0.5 * (np.log(SCALES) / SCALE_SD) ** 2
    log_posterior = log_prior + usual[:, None, None] + usual[:, None]
    by_object, by_label = [], dict[str, float | Float64[np.ndarray, "c i f"]]()
    for mine in filter(None, clues.values()):
        said = [_log_likelihood(clue) for clue in mine]
        for clue, one in zip(mine, said, strict=True):
            by_label[clue.name] = by_label.get(clue.name, 0.0) + one
        log_posterior += sum(said)
        by_object.append(sum(each[AS_ASSUMED, AS_ASSUMED] for each in said))
    chance = _chance(log_posterior)
    compositions, images = (chance.sum(axis=others) for others in ((1, 2), (0, 2)))
    mean, sd = _filter_of(chance)
    rests_on: tuple[str, ...] = ()
    if _is_clear(mean, sd):
        left = {name: _filter_of(_chance(log_posterior - one)) for name, one in by_label.items()}
        rests_on = tuple(sorted(name for name, found in left.items() if not _is_clear(*found)))
    two_tubes = _two_tubes(np.array(by_object))
    of_solids, of_plastics = _label_ratios(clues)
    return Hardness(
        filter_mm_cu=round(mean, 4),
        sd_mm_cu=round(sd, 4),
        clues=count,
        objects=used,
        two_tubes_mm_cu=two_tubes,
        image_scale=round(float(np.sqrt(images @ SCALES**2)), 3),
        composition_scale=round(float(np.sqrt(compositions @ SCALES**2)), 3),
        label_ratio=round(of_solids, 3),
        plastics_ratio=round(of_plastics, 3),
        rests_on=rests_on,
    )


def _filter_of(chance: Float64[np.ndarray, "compositions images filters"]) -> tuple[float, float]:
    """Mean and standard deviation in millimetres of copper."""
    filters = chance.sum(axis=(0, 1))
    mean = float(filters @ GRID_MM)
    return mean, float(np.sqrt(filters @ (GRID_MM - mean) ** 2 + SURVEY_SD_MM**2))


def _is_clear(filter_mm_cu: float, sd_mm_cu: float) -> bool:
    """Whether a filter is not as it was told."""
    return abs(filter_mm_cu) > max(CLEARLY_SD * sd_mm_cu, CLEARLY_MM)


def _label_ratios(clues: Mapping[str, Sequence[Clue]]) -> tuple[float, float]:
    """Return how far off parts are together that hold no air, or else plastics."""
    solids = _off(clues, FULL_DENSITY)
    if sum(map(bool, solids)) >= LEAST_OBJECTS:
        return _together(solids), 1.0
    plastics = _off(clues, PLASTICS)
    return 1.0, _together(plastics) if sum(map(len, plastics)) >= LEAST_PLASTICS else 1.0


def _off(
    clues: Mapping[str, Sequence[Clue]], families: Collection[str]
) -> list[list[tuple[float, ...]]]:
    """Return how far off the parts of some families are behind each filter, by object."""
    library = load_materials()
    return [
        [
            clue.log_ratio
            for clue in mine
            if clue.name in library and library[clue.name].family in families
        ]
        for mine in clues.values()
    ]


def _together(off: Sequence[Sequence[tuple[float, ...]]]) -> float:
    """Return how far off their median is behind the kindest filter, as a factor."""
    middles = np.median([each for mine in off for each in mine], axis=0)
    curve = np.interp(GRID_MM, FILTERS_MM_CU, middles)
    return float(np.exp(curve[np.abs(curve).argmin()]))


def _chance(log_posterior: Float64[np.ndarray, "*n"]) -> Float64[np.ndarray, "*n"]:
    chance = np.exp(log_posterior - log_posterior.max())
    return np.asarray(chance / chance.sum())


def _log_likelihood(clue: Clue) -> Float64[np.ndarray, "compositions images filters"]:
    off = np.interp(GRID_MM, FILTERS_MM_CU, clue.log_ratio)
    image_variance = max(clue.sd**2 - clue.own_sd**2 - clue.composition_sd**2, 0.0)
    sd = np.sqrt(
        clue.own_sd**2
        + (SCALES[:, None, None] * clue.composition_sd) ** 2
        + SCALES[:, None] ** 2 * image_variance
    )
    right = (1 - ASTRAY_SHARE) * _normal(off, sd)
    return np.asarray(np.log(right + ASTRAY_SHARE * _cauchy(off, np.hypot(sd, ASTRAY_SD))))


def _log_prior(shares: Sequence[tuple[float, float]]) -> Float64[np.ndarray, "filters"]:
    chance = sum(share * _normal(GRID_MM, np.float64(sd)) for share, sd in shares)
    return np.asarray(np.log(np.maximum(chance, np.finfo(float).tiny)))


def _normal(
    off: Float64[np.ndarray, "*#n"], sd: Float64[np.ndarray, "*#n"] | np.float64
) -> Float64[np.ndarray, "*n"]:
    return np.asarray(np.exp(-0.5 * (off / sd) ** 2) / sd)


def _cauchy(
    off: Float64[np.ndarray, "*#n"], half_width: Float64[np.ndarray, "*#n"]
) -> Float64[np.ndarray, "*n"]:
    """As high beside :func:`_normal` as it should be."""
    return np.asarray(np.sqrt(2 / np.pi) / (half_width * (1 + (off / half_width) ** 2)))


def _two_tubes(curves: Float64[np.ndarray, "objects filters"]) -> tuple[float, float] | None:
    """Find two filters of which each object has either, if that explains the clues far better.

    Of all objects any share may have the one.
    """
    one = float(curves.sum(axis=0).max())
    few = np.arange(0, len(GRID_MM), 5)
    best, found = one + TWO_TUBES, None
    for first in few:
        for second in few[GRID_MM[few] > GRID_MM[first] + APART_MM]:
            pair = curves[:, [first, second]]
            least = min(np.bincount(pair.argmax(axis=1), minlength=2))
            either = pair[:, :, None] + np.log([TUBE_SHARES, 1 - TUBE_SHARES])
            both = float(np.logaddexp(either[:, 0], either[:, 1]).sum(axis=0).max())
            if least >= LEAST_OBJECTS and both > best:
                best, found = both, (float(GRID_MM[first]), float(GRID_MM[second]))
    return found
