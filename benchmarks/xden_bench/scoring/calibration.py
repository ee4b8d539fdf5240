"""Does a method know its own errors? Metrics of submissions that give a standard deviation.

Pure functions of one object, over the domain of :mod:`xden_bench.scoring.metrics`.
"""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
from jaxtyping import Float64
from scipy.special import erf

from xden1k.values.arrays import Grid

__all__ = ["density_crps_g_cm3", "density_within", "score_sd"]


def density_crps_g_cm3(truth: Grid, guess: Grid, sd: Grid, envelope: Grid) -> float:
    """Mean continuous ranked probability score of normal predictions inside the outer surface.

    Each voxel predicts the normal distribution of mean ``guess`` and standard deviation ``sd``:
    ``sd (z erf(z / sqrt(2)) + 2 phi(z) - 1 / sqrt(pi))`` with ``z = (truth - guess) / sd`` and phi
    the standard normal density (Gneiting & Raftery, 2007, doi:10.1198/016214506000001437), weighted
    as in :func:`density_mae_g_cm3`. With ``sd`` 0 it is that MAE; a proper score, so that no other
    ``sd`` than the one a method believes in pays.

    Parameters
    ----------
    truth, guess
        Shape (x, y, z), g/cm³, voxel means.
    sd
        Shape (x, y, z), g/cm³: standard deviation of ``guess``.
    envelope
        Shape (x, y, z), 0 to 1.

    Examples
    --------
    >>> one = np.ones((1, 1, 1))
    >>> density_crps_g_cm3(one, 3 * one, 0 * one, one)
    2.0
    >>> round(density_crps_g_cm3(one, one, one, one), 4)
    0.2337
    """
    error, spread, share = _inside(truth, guess, sd, envelope)
    z = np.divide(error, spread, out=np.zeros_like(error), where=spread > 0)
    score = error * erf(z / sqrt(2)) + spread * (sqrt(2 / pi) * np.exp(-(z**2) / 2) - 1 / sqrt(pi))
    score = np.where(spread > 0, score, np.abs(error))
    return float(share @ score / share.sum())


def density_within(truth: Grid, guess: Grid, sd: Grid, envelope: Grid, sds: float) -> float:
    """Share of the volume inside the outer surface where ``|guess - truth| <= sds * sd``.

    For normal errors of the stated deviation 0.683 within one and 0.954 within two. Neither more
    nor less is better: wide deviations hold everything. An ``sd`` of 0 holds the exact value.

    Parameters
    ----------
    truth, guess, sd
        Shape (x, y, z), g/cm³.
    envelope
        Shape (x, y, z), 0 to 1.
    sds
        How many deviations.

    Examples
    --------
    >>> one = np.ones((1, 1, 1))
    >>> [density_within(one, 2.5 * one, one, one, sds) for sds in (1, 2)]
    [0.0, 1.0]
    """
    error, spread, share = _inside(truth, guess, sd, envelope)
    return float(share[np.abs(error) <= sds * spread].sum() / share.sum())


def score_sd(
    truth_g_cm3: Grid, guess_g_cm3: Grid, sd_g_cm3: Grid, envelope: Grid
) -> dict[str, float]:
    """Every metric of one object that needs the standard deviation of its density.

    Parameters
    ----------
    truth_g_cm3, guess_g_cm3, sd_g_cm3
        Shape (x, y, z), voxel means and their standard deviation.
    envelope
        Shape (x, y, z), 0 to 1.

    Examples
    --------
    >>> box = np.ones((2, 2, 2))
    >>> score_sd(box, 2.5 * box, box, box)["density_within_2sd"]
    1.0
    """
    grids = (truth_g_cm3, guess_g_cm3, sd_g_cm3, envelope)
    return {
        "density_crps_g_cm3": density_crps_g_cm3(*grids),
        "density_within_1sd": density_within(*grids, 1),
        "density_within_2sd": density_within(*grids, 2),
    }


def _inside(
    truth: Grid, guess: Grid, sd: Grid, envelope: Grid
) -> tuple[Float64[np.ndarray, "n"], Float64[np.ndarray, "n"], Float64[np.ndarray, "n"]]:
    """Error, deviation and share of the voxels inside: few of them, so all else is quick."""
    places = np.flatnonzero(envelope > 0)
    true, guessed, spread, share = (
        grid.ravel()[places].astype(np.float64) for grid in (truth, guess, sd, envelope)
    )
    return guessed - true, spread, share
