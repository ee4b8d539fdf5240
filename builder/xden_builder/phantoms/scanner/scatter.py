"""Object scatter by a kernel model: a broad, smooth veil that follows the object.

Photons scattered once and not attenuated otherwise, T times the optical depth of scattering, are
spread by two Gaussians and scaled. This is the forward model of kernel-based scatter correction
(Ohnesorge, Flohr and Klingenbeck-Regn 1999, doi:10.1007/s003300050710, with -ln T for the depth),
except that the depth counts coherent and incoherent scattering alone, by energy, so that metal
absorbs what it would absorb.

Range: objects of 2 to 60 cm without a grid, some 20 cm from the panel (40 cm and twice the widths
in the large setting), where scatter is a few per cent of the open field. Multiple scattering, the
object's depth and the loss of energy in a collision enter only through the level, which is drawn,
not computed. The widths are assumed. The level is bounded: at most ``MOST_REACHING`` of the
scattered signal reaches the panel, which covers 18 % of all directions from the middle of the
object, forward ones favoured. Thin and small objects do not scatter enough for a level of some per
cent: the bound, drawn as well, rules there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xden1k.values.arrays import Image
from xden_builder.phantoms.scanner.spread import gaussian_spread

__all__ = ["ScatterDraw", "draw_scatter", "scatter_image"]

MOST_REACHING = 0.3


@dataclass(frozen=True, slots=True)
class ScatterDraw:
    """The kernel of one object.

    Parameters
    ----------
    level
        Wanted mean over the object's shadow, in shares of the open field.
    near_cm, far_cm
        Standard deviations on the panel.
    near_share
        Of the narrower Gaussian.
    reaching
        Largest share of the scattered signal that reaches the panel.
    """

    level: float
    near_cm: float
    far_cm: float
    near_share: float
    reaching: float


def draw_scatter(
    rng: np.random.Generator, level: float, near_cm: float, far_cm: float
) -> ScatterDraw:
    """Vary a kernel from object to object: level and bound threefold, widths by a fifth."""
    widths, strength = np.exp(rng.normal(0.0, 0.2, 2)), float(rng.uniform(0.5, 1.5))
    return ScatterDraw(
        level=level * strength,
        near_cm=near_cm * float(widths[0]),
        far_cm=far_cm * float(widths[1]),
        near_share=float(rng.uniform(0.3, 0.7)),
        reaching=MOST_REACHING * strength / 1.5,
    )


def scatter_image(scattered: Image, draw: ScatterDraw, pixel_cm: float) -> Image:
    """Scatter on the panel, in shares of the open field in its middle.

    Parameters
    ----------
    scattered
        Shape (rows, columns): signal each pixel's beam loses by scattering; positive in the
        object's shadow and zero elsewhere.
    draw
        The kernel.
    pixel_cm
        Width of a pixel.
    """
    near, far = (gaussian_spread(scattered, cm / pixel_cm) for cm in (draw.near_cm, draw.far_cm))
    veil = draw.near_share * near + (1 - draw.near_share) * far
    shadow = veil[scattered > 0]
    reaching = min(draw.level / float(shadow.mean()), draw.reaching) if shadow.size else 0.0
    return np.asarray(reaching * veil, dtype=np.float32)
