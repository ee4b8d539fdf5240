"""Cells and tables in Markdown, as every evaluation writes them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from tabulate import tabulate

from xden_builder.evaluate.quality import Quality
from xden_builder.evaluate.truth import Errors

__all__ = ["HEADERS", "error_cells", "reprojection_cells", "share_cell", "table"]

HEADERS: Final = ("density MAE, g/cm³", "mass error, %", "centre of mass L1, mm")
"""Of :func:`error_cells`."""


def table(headers: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Write a table: the first column to the left, all others to the right."""
    aligned = ["left", *["right"] * (len(headers) - 1)]
    text: str = tabulate(
        list(rows), headers=headers, tablefmt="github", disable_numparse=True, colalign=aligned
    )
    return text


def error_cells(errors: Sequence[Errors]) -> list[str]:
    """Write means over objects, medians in brackets."""
    density, mass, com = np.array(
        [(e.density_mae_g_cm3, e.mass_ape, e.com_l1_cm) for e in errors]
    ).T
    return [
        f"{density.mean():.3f} ({np.median(density):.3f})",
        f"{100 * mass.mean():.1f} ({100 * np.median(mass):.1f})",
        f"{10 * com.mean():.2f} ({10 * np.median(com):.2f})",
    ]


def reprojection_cells(qualities: Sequence[Quality]) -> list[str]:
    """Write mean and standard deviation of the errors of -ln T: on the object, then beside it."""
    numbers = np.array(
        [
            [view.attenuation_mae for view in quality.views]
            + [view.background_attenuation_mae for view in quality.views]
            for quality in qualities
        ]
    )
    means, sds = np.nanmean(numbers, axis=0), np.nanstd(numbers, axis=0)
    return [f"{mean:.3f} ± {sd:.3f}" for mean, sd in zip(means, sds, strict=True)]


def share_cell(yes: np.ndarray) -> str:
    """Write which share is true; ``none`` of nothing."""
    return f"{100 * yes.mean():.1f} %" if yes.size else "none"
