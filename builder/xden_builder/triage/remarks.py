"""What is to be said of a whole folder: a line for each thing that all objects show together."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from xden_builder.poly.hardness import Hardness
from xden_builder.triage.findings import Findings
from xden_builder.triage.flags import Severity
from xden_builder.triage.sizes import FolderSize, middle_of

__all__ = ["FolderRemark", "folder_remarks"]

SAID: Final[Mapping[Severity, str]] = {
    "needs_you": "needs you",
    "information": "for information",
}
MOST: Final = 0.0145
"""From here on sizes end at what they may be."""
CLEARLY_APART: Final = 0.0025
"""Before one view and the others; of the objects of a sound folder it is 0.0001 in the median."""
FEWEST_UNLIKE: Final = 3
"""Objects with unlikely densities, so that it is not their labels."""
LINEAR: Final = "quantity, polarity, bits and dark in scanner.toml, and that the images are linear"


@dataclass(frozen=True, slots=True)
class FolderRemark:
    """Something that all objects of a folder show together.

    Parameters
    ----------
    severity
        As of flags.
    text
        One line: what it is, and what to do.
    """

    severity: Severity
    text: str

    def __str__(self) -> str:
        return f"{SAID[self.severity]}: {self.text}"


def folder_remarks(
    beam: Hardness | None, size: FolderSize | None, judged: Sequence[Findings] = ()
) -> Iterator[FolderRemark]:
    """Say what the objects of a folder show together, if it is not as it was told.

    Parameters
    ----------
    beam, size
        That were found for all; None where none was.
    judged
        What was found of each.
    """
    yield from _of_energy(judged)
    yield from _of_views(judged)
    if beam is not None:
        yield from _of_filter(beam)
        yield from _of_errors(beam)
    if size is not None:
        yield from _of_size(size)


def _of_energy(judged: Sequence[Findings]) -> Iterator[FolderRemark]:
    """Say that most objects' densities do not go with their labels, if it is so."""
    unlike = sum(
        any(remark.flag == "unlike_material" for remark in findings.remarks) for findings in judged
    )
    if unlike >= max(FEWEST_UNLIKE, len(judged) / 2):
        yield FolderRemark(
            "needs_you",
            f"{unlike} of {len(judged)} objects have densities that do not go with their labels: "
            "check energy_kev in scanner.toml, the mean energy of the beam (about half of the "
            "tube's kV), or tell the tube in its place ([tube] kv and filtration)",
        )


def _of_views(judged: Sequence[Findings]) -> Iterator[FolderRemark]:
    """Say that all objects are larger, or smaller, before one view than before the others."""
    growths: dict[str, list[float]] = {}
    for apart in (findings.apart for findings in judged):
        if apart is not None:
            growths.setdefault(apart["view"], []).append(math.exp(apart["growth"]))
    for view, factors in growths.items():
        size = middle_of(factors)
        if size is not None and size.off_by(CLEARLY_APART):
            larger = "larger" if size.factor > 1 else "smaller"
            yield FolderRemark(
                "needs_you",
                f"the objects are at least {abs(size.factor - 1):.1%} {larger} before {view} than "
                f"before the other views, all of them alike ({size.objects} objects, ± "
                f"{size.sd:.2%}): check source_cm, column_step_cm and row_step_cm of each view in "
                "scanner.toml; which of them is wrong the images do not tell",
            )


def _of_filter(beam: Hardness) -> Iterator[FolderRemark]:
    """Say what the images tell of the beam's filter, if it is not as it was told."""
    if beam.two_tubes_mm_cu is not None:
        one, other = beam.two_tubes_mm_cu
        yield FolderRemark(
            "needs_you",
            f"the objects do not agree on one filter: {one:.2f} mm Cu more than told explains "
            f"some, {other:.2f} mm the others (were there two tubes or filters? give each its own "
            "capture folder)",
        )
        return
    if beam.no_filter_explains:
        yield FolderRemark(
            "needs_you",
            f"behind any filter metals, glass and liquids show {beam.label_ratio:.2f} times the "
            f"density of their labels or farther off (check [tube] kv and filtration, {LINEAR}; "
            "or the labels of these are wrong)",
        )
    if beam.plastics_are_light:
        yield FolderRemark(
            "needs_you",
            f"plastics show {beam.plastics_ratio:.2f} times the density of their labels, and there "
            f"is hardly a metal, glass or liquid to compare (check {LINEAR}; right if most of them "
            "are foamed or hollow: say so in parts.csv)",
        )
    if beam.contradicts:
        more = "more" if beam.filter_mm_cu > 0 else "less"
        alone = ""
        if beam.rests_on:
            alone = f"; without {' or '.join(map(_name_of, beam.rests_on))} it would: check these"
        yield FolderRemark(
            "needs_you",
            f"the told filter does not explain these images: {abs(beam.filter_mm_cu):.2f} ± "
            f"{beam.sd_mm_cu:.2f} mm Cu {more} would, and was reckoned with (check [tube] kv and "
            f"filtration in scanner.toml, and that the images are linear{alone})",
        )


def _name_of(clue: str) -> str:
    return "the masses" if clue == "mass" else f"the parts labelled {clue}"


def _of_errors(beam: Hardness) -> Iterator[FolderRemark]:
    """Say how far images and compositions err, if it is not as is assumed."""
    if beam.errs_as_assumed:
        return
    so = (
        "deviations are not larger for what errs more; labels err here, or are of substances not "
        f"in the library, or scanner.toml is wrong (check filtration, {LINEAR})"
        if beam.errs_farther
        else "deviations are the smaller for it"
    )
    yield FolderRemark(
        "information",
        f"by labelled parts, images err {beam.image_scale:.2f} and compositions "
        f"{beam.composition_scale:.2f} times as far as is assumed; {so}",
    )


def _of_size(size: FolderSize) -> Iterator[FolderRemark]:
    """Say that all objects are of another size than their meshes, if they are."""
    if size.contradicts:
        larger = "larger" if size.factor > 1 else "smaller"
        least = "at least " if abs(size.factor - 1) > MOST else ""
        yield FolderRemark(
            "needs_you",
            f"the objects are {least}{abs(size.factor - 1):.1%} {larger} than their meshes, all of "
            f"them alike ({size.objects} objects, ± {size.sd:.2%}), and masses change by three "
            "times that: check source_cm, column_step_cm and row_step_cm in scanner.toml, and how "
            "the meshes were scaled",
        )
