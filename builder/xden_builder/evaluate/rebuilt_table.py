"""Tables of rebuilt folders: how far they are off, how sure, and where the error sits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Final

import numpy as np
from jaxtyping import Bool, Float64

from xden_builder.evaluate.cells import HEADERS, error_cells, share_cell, table
from xden_builder.evaluate.rebuilt import RebuiltObject, RebuiltPart, RebuiltSet
from xden_builder.evaluate.run import PartCheck
from xden_builder.evaluate.table import FAR_OFF

__all__ = ["rebuilt_markdown", "rebuilt_row", "where_rows"]

UNTOLD_OFF: Final = 0.1
"""A density without a flag should not be off by a larger share."""
MOST_MATERIALS: Final = 12

Shares = Float64[np.ndarray, "parts"]


def rebuilt_markdown(sets: Mapping[str, RebuiltSet]) -> str:
    """Write all tables: a row for each set and, of several, one for all; then where errors sit."""
    pooled = tuple(chain.from_iterable(each.objects for each in sets.values()))
    if not pooled:
        return "0 rebuilt objects.\n"
    rows = [rebuilt_row(name, each.objects) for name, each in sets.items() if each.objects]
    rows += [rebuilt_row("all", pooled)] if len(rows) > 1 else []
    sections = [
        f"{len(pooled)} rebuilt objects, {sum(len(each.parts) for each in pooled)} parts. Means "
        "over objects, medians in brackets.",
        table(
            (
                *("set", "objects", *HEADERS),
                *(f"off > {FAR_OFF:.0%}", "of these flagged"),
                f"unflagged off > {UNTOLD_OFF:.0%}",
                *("X-ray parts", "within 1 sd", "within 2 sd"),
            ),
            rows,
        ),
        "Where the error sits: materials by their share of the mean density MAE.",
        table(
            ("material", "parts", "share of MAE", "mean off", "labels"),
            where_rows(pooled)[:MOST_MATERIALS],
        ),
    ]
    return "\n\n".join(sections) + "\n"


def rebuilt_row(name: str, objects: Sequence[RebuiltObject]) -> list[str]:
    """Write one row: errors of objects, flags and standard deviations of parts."""
    checks = [part.check for each in objects for part in each.parts]
    off = np.abs(_relative(checks))
    flagged = np.array([bool(check.flags) for check in checks])
    seen = [check for check in checks if check.source in ("xray", "weighed")]
    deviations = np.abs([(c.density_g_cm3 - c.truth_g_cm3) / c.sd_g_cm3 for c in seen])
    return [
        name,
        str(len(objects)),
        *error_cells([each.errors for each in objects]),
        str((off > FAR_OFF).sum()),
        share_cell(flagged[off > FAR_OFF]),
        _count_of(off[~flagged] > UNTOLD_OFF),
        str(len(seen)),
        share_cell(deviations <= 1),
        share_cell(deviations <= 2),
    ]


def where_rows(objects: Sequence[RebuiltObject]) -> list[list[str]]:
    """Materials, the worst first: parts, share of the mean density MAE, mean error, labels."""
    parts: dict[str, list[RebuiltPart]] = {}
    for part in chain.from_iterable(each.parts for each in objects):
        parts.setdefault(part.material, []).append(part)
    errors = {material: sum(map(_density_error, found)) for material, found in parts.items()}
    total = sum(errors.values()) or 1.0
    return [
        [
            material,
            str(len(parts[material])),
            f"{100 * errors[material] / total:.1f} %",
            f"{100 * float(_relative([p.check for p in parts[material]]).mean()):+.1f} %",
            ", ".join(sorted({part.label or "none" for part in parts[material]})),
        ]
        for material in sorted(errors, key=lambda each: (-errors[each], each))
    ]


def _density_error(part: RebuiltPart) -> float:
    """Give what a part adds to its object's density MAE, g/cm³."""
    return part.volume_share * abs(part.check.density_g_cm3 - part.check.truth_g_cm3)


def _relative(checks: Sequence[PartCheck]) -> Shares:
    return np.array([check.density_g_cm3 / check.truth_g_cm3 - 1 for check in checks])


def _count_of(yes: Bool[np.ndarray, "parts"]) -> str:
    return f"{yes.sum()} of {yes.size}"
