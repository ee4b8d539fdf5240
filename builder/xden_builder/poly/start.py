"""Stage 2 of the fit: each part taken for one material, by its label or by its attenuation.

Comes from :mod:`scene`, leads to :mod:`pose`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden1k.rays import path_lengths
from xden1k.values.views import XRayView
from xden_builder.fit import fit_lac
from xden_builder.poly.materials.stand_ins import StandIns, certain
from xden_builder.poly.model.frames import any_of, binned, coarse
from xden_builder.poly.model.stray import coarse_binning
from xden_builder.poly.scene import Scene

__all__ = ["Guess", "first_guess"]

CLEAR: Final = 0.5
"""A base whose grades together are more probable than this before any X-ray is started with."""
UNKNOWN_PER_CM: Final = 0.2
"""Attenuation of a part that no ray meets."""
SPREAD: Final = 0.3
"""Of the logarithm of a coarse attenuation, about that of its material."""


@dataclass(frozen=True, slots=True, eq=False)
class Guess:
    """What the fit starts from.

    Parameters
    ----------
    scene
        The object.
    choice
        Index of the candidate that each part is taken for.
    stand_ins, outline_stand_ins
        Those candidates, in the energy groups of densities and of outlines.
    density_g_cm3
        Shape (K,).
    """

    scene: Scene
    choice: list[int]
    stand_ins: StandIns
    outline_stand_ins: StandIns
    density_g_cm3: Float64[np.ndarray, "k"]


def first_guess(scene: Scene) -> Guess:
    """Take each part for its label's material, at the density that usually has.

    Which grade of it, or which material at all where no label tells, a coarse monochromatic fit
    says: the one that attenuates so.
    """
    attenuation = _attenuation_per_cm(scene)
    open_field = scene.light.groups.weights.mean(axis=0)
    choice = []
    for table, seen_per_cm in zip(scene.light.tables, attenuation.tolist(), strict=True):
        expected = (table.mac_cm2_g @ open_field) * table.priors[:, 0]
        misfit = np.log(expected / max(seen_per_cm, 1e-3)) / SPREAD
        score = table.log_prior - 0.5 * misfit**2
        leading = table.leading
        clear = np.exp(table.log_prior[leading]).sum() > CLEAR
        choice.append(int(np.argmax(np.where(leading | (not clear), score, -np.inf))))
    taken_for, for_outlines = (
        certain(light.tables, choice) for light in (scene.light, scene.outlines)
    )
    return Guess(scene, choice, taken_for, for_outlines, taken_for.mean_g_cm3)


def _attenuation_per_cm(scene: Scene) -> Float64[np.ndarray, "k"]:
    """One coefficient for each part, from averaged images of the object as it was told to lie."""
    binning = coarse_binning(scene.views[0].geometry.shape)
    pairs, bounds = [], {}
    each_view = zip(scene.views, scene.turned, scene.saturated, scene.gains, strict=True)
    for view, turned, saturated, gain in each_view:
        if turned:  # how it lies there is not known yet
            continue
        image, mask = binned(view, binning)
        mask &= ~any_of(saturated, binning)
        if gain is not None:
            bounds[view.name] = gain
        if not mask.any():
            continue
        small = XRayView(view.name, image, mask, coarse(view.geometry, binning))
        pairs.append((path_lengths(scene.space.meshes, scene.space.order, small.geometry), small))
    if not pairs:
        return np.full(len(scene.parts), UNKNOWN_PER_CM)
    fit = fit_lac(pairs, gain_bounds=bounds)
    return np.asarray(np.nan_to_num(fit.lac_per_cm, nan=UNKNOWN_PER_CM))
