"""Materials of parts, and what the material library says of their density."""

from __future__ import annotations

from statistics import median

from xden1k.errors import DataError
from xden1k.predictor import Examples, SampleView
from xden1k.values.materials import families, load_materials
from xden1k.values.types import Part

__all__ = [
    "check_target",
    "density_range_g_cm3",
    "material_of",
    "nominal_densities_g_cm3",
]

GAS_G_CM3 = 0.005
"""Nothing solid or liquid is lighter."""


def check_target(of: Examples | SampleView) -> None:
    """Refuse targets other than true densities, which the material library's are.

    Raises
    ------
    DataError
        If the target is another.
    """
    if of.target != "density":
        raise DataError(
            "the densities of the material library are true ones: expected the target "
            f"'density', got {of.target!r}"
        )


def material_of(part: Part) -> str | None:
    """Return the material of a part, or its family; None where it is unknown or a gas."""
    if not part.material or density_range_g_cm3(part.material)[0] < GAS_G_CM3:
        return None
    return part.material


def density_range_g_cm3(material: str) -> tuple[float, float]:
    """Return the library's low and high for a material, or those of all of a family.

    Raises
    ------
    DataError
        If the library has neither.

    Examples
    --------
    >>> density_range_g_cm3("steel"), density_range_g_cm3("wood")
    ((7.75, 7.9), (0.1, 1.0))
    """
    library = load_materials()
    if material in library:
        known = [library[material]]
    else:
        known = [each for each in library.bases.values() if each.family == material]
    if not known:
        raise DataError(f"the material library has no {material!r}")
    lows = [each.density_low_g_cm3 for each in known]
    return min(lows), max(each.density_high_g_cm3 for each in known)


def nominal_densities_g_cm3(sample: SampleView) -> list[float]:
    """Return the usual density of each part's material; of a family, the median of its members.

    Needs ``MATERIALS``.

    Raises
    ------
    DataError
        If a part has no material, or the library does not know it.
    """
    labels = [material.lower() for material in sample.part_materials]
    if unknown := sorted({*labels} - {*load_materials().labels, *families()}):
        raise DataError(f"{sample.object_id}: the material table has no {unknown}")
    return list(map(_nominal_g_cm3, labels))


def _nominal_g_cm3(label: str) -> float:
    library = load_materials()
    if label in library.labels:
        return library[label].density_nominal_g_cm3
    bases = library.bases.values()
    return median(one.density_nominal_g_cm3 for one in bases if one.family == label)
