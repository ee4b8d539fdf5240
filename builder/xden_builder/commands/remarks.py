"""What a run says of a whole folder: a line for each thing that all objects show together."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from xden_builder.pipeline.outcomes import BuildReport
    from xden_builder.poly.hardness import Hardness
    from xden_builder.triage.sizes import FolderSize

__all__ = ["errors_said_of", "folder_remarks", "said_of", "size_said_of"]

LINEAR: Final = "quantity, polarity, bits and dark in scanner.toml, and that the images are linear"


def folder_remarks(report: BuildReport) -> Iterator[str]:
    """Say what the objects of a folder show together, if it is not as it was told."""
    if report.beam is not None:
        yield from filter(None, (said_of(report.beam), errors_said_of(report.beam)))
    if report.size is not None and (said := size_said_of(report.size)):
        yield said


def said_of(beam: Hardness) -> str:
    """Say what the images tell of the beam's filter, if it is not as it was told."""
    if beam.two_tubes_mm_cu is not None:
        one, other = beam.two_tubes_mm_cu
        return (
            f"needs you: the objects do not agree on one filter: {one:.2f} mm Cu more than told "
            f"explains some, {other:.2f} mm the others (were there two tubes or filters? give each "
            "its own capture folder)"
        )
    if beam.no_filter_explains:
        return (
            f"needs you: behind any filter labelled parts show {beam.label_ratio:.2f} times the "
            f"density of their materials (check {LINEAR})"
        )
    if not beam.contradicts:
        return ""
    more = "more" if beam.filter_mm_cu > 0 else "less"
    return (
        f"needs you: the told filter does not explain these images: {abs(beam.filter_mm_cu):.2f} ± "
        f"{beam.sd_mm_cu:.2f} mm Cu {more} would, and was reckoned with (check [tube] kv and "
        "filtration in scanner.toml, and that the images are linear)"
    )


def errors_said_of(beam: Hardness) -> str:
    """Say how far labelled parts are off their materials, if it is not as is assumed."""
    if beam.errs_as_assumed:
        return ""
    so = (
        "; deviations stay as they are: labels err here, or are of substances not in the library, "
        f"or scanner.toml is wrong (check filtration, {LINEAR})"
    )
    return (
        f"for information: labelled parts lie {beam.error_scale:.2f} times as far off their "
        "materials as is assumed"
        + (", and deviations are the smaller for it" if beam.error_scale < 1 else so)
    )


def size_said_of(size: FolderSize) -> str:
    """Say that all objects are of another size than their meshes, if they are."""
    if not size.contradicts:
        return ""
    larger = "larger" if size.factor > 1 else "smaller"
    return (
        f"needs you: the objects are {abs(size.factor - 1):.1%} {larger} than their meshes, all of "
        f"them alike ({size.objects} objects, ± {size.sd:.1%}), which changes masses by three "
        "times that: check source_cm, column_step_cm and row_step_cm in scanner.toml, or how the "
        "meshes were scaled"
    )
