"""Where the polychromatic fit starts: materials by label, or by the attenuation alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float64

from xden1k.rays import path_lengths
from xden1k.values.views import XRayView
from xden_builder.fit import fit_lac
from xden_builder.poly.beam import EnergyGroups
from xden_builder.poly.candidates import CandidateTable
from xden_builder.poly.pose import binned, coarse

__all__ = ["first_choice"]

CLEAR: Final = 0.5
"""A candidate more probable than this before any X-ray is started with."""
UNKNOWN_PER_CM: Final = 0.2
"""Attenuation of a part that no ray meets."""
SPREAD: Final = 0.3
"""Of the logarithm of a coarse attenuation, about that of its material."""


def first_choice(
    views: Sequence[XRayView],
    meshes: Sequence[trimesh.Trimesh],
    order: Sequence[int],
    groups: EnergyGroups,
    tables: Sequence[CandidateTable],
    binning: int,
) -> list[int]:
    """Index of the candidate that each part is taken for at first.

    A part without a telling label is taken for what attenuates as a coarse monochromatic fit says.
    """
    attenuation = _attenuation_per_cm(views, meshes, order, binning)
    open_field = groups.weights.mean(axis=0)
    choice = []
    for table, seen_per_cm in zip(tables, attenuation.tolist(), strict=True):
        expected = (table.mac_cm2_g @ open_field) * table.priors[:, 0]
        misfit = np.log(expected / max(seen_per_cm, 1e-3)) / SPREAD
        score = table.log_prior - 0.5 * misfit**2
        clear = table.log_prior[0] > np.log(CLEAR)
        choice.append(0 if clear else int(np.argmax(score)))
    return choice


def _attenuation_per_cm(
    views: Sequence[XRayView],
    meshes: Sequence[trimesh.Trimesh],
    order: Sequence[int],
    binning: int,
) -> Float64[np.ndarray, "k"]:
    """One coefficient for each part, from averaged images."""
    pairs = []
    for view in views:
        image, mask = binned(view, binning)
        small = XRayView(view.name, image, mask, coarse(view.geometry, binning))
        pairs.append((path_lengths(meshes, order, small.geometry), small))
    return np.asarray(np.nan_to_num(fit_lac(pairs).lac_per_cm, nan=UNKNOWN_PER_CM))
