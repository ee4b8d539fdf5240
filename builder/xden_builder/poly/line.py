"""The stages of the polychromatic fit in their order."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden_builder.capture import Capture
from xden_builder.capture.space import Space
from xden_builder.poly.estimate import estimate
from xden_builder.poly.judgement import PolyFit, judge
from xden_builder.poly.misfit import as_far_off
from xden_builder.poly.pose import find_pose
from xden_builder.poly.posterior.problem import Mass
from xden_builder.poly.samples import Samples, take_samples
from xden_builder.poly.scale import compare
from xden_builder.poly.scene import set_scene
from xden_builder.poly.settings import PolySettings
from xden_builder.poly.start import first_guess
from xden_builder.poly.weighed import weighed

__all__ = ["fit_poly", "fit_samples", "sampled", "with_mass"]

DEFAULT: Final = PolySettings()


def fit_poly(
    capture: Capture,
    space: Space,
    settings: PolySettings = DEFAULT,
) -> PolyFit:
    """Find densities, materials, pose, gains and stray light of one object.

    Parameters
    ----------
    capture
        With a tube or a photon energy.
    space
        What is each part's.
    settings
        What is modelled.

    Raises
    ------
    DataError
        If the source is not known or outside the tables.
    """
    samples = sampled(capture, space, settings)
    by_images = fit_samples(samples, settings)
    if capture.weighed_mass_g is None:
        return by_images
    volumes_cm3 = samples.size.factor**3 * space.volumes_cm3
    return with_mass(by_images, capture.weighed_mass_g, volumes_cm3)


def sampled(capture: Capture, space: Space, settings: PolySettings = DEFAULT) -> Samples:
    """Go through the stages that a weighed mass does not change: scene, start, pose, samples.

    Raises
    ------
    DataError
        As :func:`fit_poly`.
    """
    scene = set_scene(capture, space, settings)
    guess = first_guess(scene)
    placement = find_pose(guess, settings)
    return take_samples(placement, settings)


def fit_samples(samples: Samples, settings: PolySettings = DEFAULT) -> PolyFit:
    """Go through the stages that follow, by the images alone: estimate, misfit, judgement."""
    solution = estimate(samples, settings)
    looser = as_far_off(solution)
    return judge(solution if looser is None else estimate(samples, looser))


def with_mass(
    by_images: PolyFit,
    mass_g: float,
    volumes_cm3: Float64[np.ndarray, "k"],
) -> PolyFit:
    """Go on from a fit by the images alone, with the mass of a scale: weighed, judgement.

    Parameters
    ----------
    by_images
        Without it.
    mass_g
        On the scale.
    volumes_cm3
        Shape (K,): of the parts, at the size that was found.
    """
    solution = by_images.solution
    volume_sd = solution.scene.walls.mass_sd(volumes_cm3 * solution.density_g_cm3)
    mass = Mass(mass_g, volumes_cm3, volume_sd)
    weighing = compare(
        mass,
        solution.density_g_cm3,
        by_images.covariance,
        by_images.by_size_g_cm3,
        by_images.size.sd,
    )
    ended = weighed(solution, mass)
    contradicted = weighing.contradiction(float(volumes_cm3 @ ended.density_g_cm3))
    return replace(judge(ended, contradicted=contradicted), weighing=weighing)
