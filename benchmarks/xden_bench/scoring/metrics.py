"""The metrics: pure functions of one object's truth and prediction.

All of them see the same domain, the voxels with envelope > 0. Matter predicted in the air around
an object counts nowhere, so that a lump there cannot repair a mass or a centre of mass while the
voxel error looks away (the warning W503 tells of it). Truth and prediction are integrated by the
same code on the same grid: the truth scores exactly zero.

A prediction of no mass has no centre of mass. It is given the envelope's centroid, which is where
matter spread evenly through the object ends up as its density goes to zero: any other choice could
be had, or escaped, by predicting 1e-6 everywhere.

:mod:`xden_bench.scoring.calibration` has the metrics that need a standard deviation, and
:mod:`xden_bench.scoring.overlap` those of segments.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import log
from typing import Final

import numpy as np
from jaxtyping import Float, Float64

from xden1k.values.arrays import Grid, Vec3
from xden1k.values.mass import MassProperties, mass_of_grid

__all__ = [
    "METRICS",
    "Metric",
    "com_l1_cm",
    "com_l1_share",
    "com_l2_cm",
    "density_mae_g_cm3",
    "inertia_error",
    "integrate",
    "mass_alde",
    "mass_mape",
    "mass_mnre",
    "nonuniformity",
    "nonuniformity_error",
    "relative_error",
    "score_object",
]


@dataclass(frozen=True, slots=True)
class Metric:
    """How a metric is printed and read.

    Parameters
    ----------
    title
        With its unit.
    higher_is_better
        False for errors; None where neither is better and ``nominal`` is right.
    nominal
        The value of a method that knows its own errors, where there is such a value.
    best
        The value of the truth.
    digits
        Decimals in tables.
    """

    title: str
    higher_is_better: bool | None = False
    nominal: float | None = None
    best: float = 0.0
    digits: int = 3

    @property
    def heading(self) -> str:
        """Title and the arrow that says which way is better, or what the value should be."""
        if self.nominal is not None:
            return f"{self.title} (→ {self.nominal:.3f})"
        return f"{self.title} {'↑' if self.higher_is_better else '↓'}"

    def loss(self, values: Float64[np.ndarray, "..."]) -> Float64[np.ndarray, "..."]:
        """Values so turned that lower is better, for comparing two methods.

        Examples
        --------
        >>> METRICS["mass_mnre"].loss(np.array([0.5])).tolist()
        [-0.5]
        """
        if self.nominal is not None:
            return np.abs(values - self.nominal)
        return -values if self.higher_is_better else values


def _iou(protocol: str) -> Metric:
    return Metric(f"IoU {protocol}, %", higher_is_better=True, best=100.0, digits=1)


METRICS: Final[Mapping[str, Metric]] = {
    "density_mae_g_cm3": Metric("density MAE, g/cm³"),
    "density_relative_error": Metric("relative density error"),
    "com_l1_cm": Metric("CoM L1, cm"),
    "com_l1_share": Metric("CoM L1 / longest edge"),
    "com_l2_cm": Metric("CoM L2, cm"),
    "mass_mape": Metric("mass MAPE"),
    "mass_alde": Metric("mass ALDE"),
    "mass_mnre": Metric("mass MnRE", higher_is_better=True, best=1.0),
    "inertia_error": Metric("inertia error"),
    "nonuniformity_error": Metric("non-uniformity error"),
    "density_crps_g_cm3": Metric("density CRPS, g/cm³"),
    "density_within_1sd": Metric("within 1 sd", None, nominal=0.683),
    "density_within_2sd": Metric("within 2 sd", None, nominal=0.954),
    "iou_a": _iou("A"),
    "iou_b_material": _iou("B, materials"),
    "iou_b_part": _iou("B, parts"),
    "iou_c": _iou("C"),
}
"""Every metric by name."""


def density_mae_g_cm3(truth: Grid, guess: Grid, envelope: Grid) -> float:
    """Mean absolute density error inside the outer surface.

    ``sum(w |guess - truth|) / sum(w)`` with ``w`` the share of the voxel inside the envelope.
    Enclosed cavities belong to the envelope: filling one with material is an error.

    Parameters
    ----------
    truth, guess
        Shape (x, y, z), g/cm³, voxel means.
    envelope
        Shape (x, y, z), 0 to 1.

    Examples
    --------
    >>> shell = np.array([[[1.0, 0.0, 1.0]]])
    >>> density_mae_g_cm3(shell, np.ones((1, 1, 3)), np.ones((1, 1, 3)))
    0.3333333333333333
    """
    error = np.abs(guess - truth)
    total = np.sum(envelope, dtype=np.float64)
    return float(np.sum(error * envelope, dtype=np.float64) / total)


def relative_error(truth: Grid, guess: Grid, envelope: Grid) -> float:
    """Density MAE as a share of the mean true density: ``sum(w |guess - truth|) / sum(w truth)``.

    Unlike a mean of relative errors it has a value where the truth is air (Kolassa & Schütz, 2007,
    Foresight 6, 40-43). Nothing scores 1.

    Parameters
    ----------
    truth, guess
        Shape (x, y, z), g/cm³, voxel means; the truth has mass.
    envelope
        Shape (x, y, z), 0 to 1: the ``w``.

    Examples
    --------
    >>> shell = np.array([[[2.0, 0.0, 2.0]]])
    >>> relative_error(shell, 1.5 * shell, np.ones((1, 1, 3)))
    0.5
    """
    error, mass = (
        np.sum(one * envelope, dtype=np.float64) for one in (np.abs(guess - truth), truth)
    )
    return float(error / mass)


def com_l1_cm(truth_cm: Vec3, guess_cm: Vec3) -> float:
    """Distance of the centres of mass along the axes: ``|dx| + |dy| + |dz|``.

    Examples
    --------
    >>> com_l1_cm(np.zeros(3), np.array([3.0, 0.0, -4.0]))
    7.0
    """
    return float(np.abs(guess_cm - truth_cm).sum())


def com_l1_share(truth_cm: Vec3, guess_cm: Vec3, extent_cm: float) -> float:
    """:func:`com_l1_cm` as a share of the object's size, the longest edge of its bounding box.

    A centimetre is much for a pair of scissors and little for a chair.

    Examples
    --------
    >>> com_l1_share(np.zeros(3), np.array([3.0, 0.0, -4.0]), 28.0)
    0.25
    """
    return com_l1_cm(truth_cm, guess_cm) / extent_cm


def com_l2_cm(truth_cm: Vec3, guess_cm: Vec3) -> float:
    """Distance of the centres of mass: ``sqrt(dx² + dy² + dz²)``.

    Examples
    --------
    >>> com_l2_cm(np.zeros(3), np.array([3.0, 0.0, -4.0]))
    5.0
    """
    return float(np.linalg.norm(guess_cm - truth_cm))


def mass_mape(truth_g: float, guess_g: float) -> float:
    """Mass error as a share of the true mass: ``|guess - truth| / truth``. A ratio, not percent.

    No bound above, but at most 1 below: it rewards predicting too little, and predicting nothing
    scores 1.

    Examples
    --------
    >>> mass_mape(100.0, 0.0), mass_mape(100.0, 250.0)
    (1.0, 1.5)
    """
    return abs(guess_g - truth_g) / truth_g


def mass_alde(truth_g: float, guess_g: float, limit: float = 1000.0) -> float:
    """Absolute error of the logarithm of the mass: ``|ln(guess / truth)|``.

    The same for twice and for half the mass. It ends at ``ln(limit)``, 6.908 for 1000, which a
    mass of zero also gets: one such object would otherwise make every mean infinite.

    Examples
    --------
    >>> round(mass_alde(100.0, 50.0), 3), round(mass_alde(100.0, 0.0), 3)
    (0.693, 6.908)
    """
    return abs(log(min(max(guess_g / truth_g, 1 / limit), limit)))


def mass_mnre(truth_g: float, guess_g: float) -> float:
    """Smaller of the two masses over the larger: ``min(guess / truth, truth / guess)``.

    The "min ratio error" of image2mass (Standley et al., CoRL 2017): 1 is exact, higher is
    better, and nothing scores 0.

    Examples
    --------
    >>> mass_mnre(100.0, 50.0), mass_mnre(50.0, 100.0), mass_mnre(100.0, 0.0)
    (0.5, 0.5, 0.0)
    """
    return min(truth_g, guess_g) / max(truth_g, guess_g)


def inertia_error(truth: Float[np.ndarray, "3 3"], guess: Float[np.ndarray, "3 3"]) -> float:
    """Error of the inertia tensor as a share of it: ``||guess - truth|| / ||truth||``, Frobenius.

    Each tensor is about its own centre of mass. The norm does not depend on the axes.

    Examples
    --------
    >>> inertia_error(np.eye(3), np.zeros((3, 3)))
    1.0
    """
    return float(np.linalg.norm(guess - truth) / np.linalg.norm(truth))


def nonuniformity(density_g_cm3: Grid, envelope: Grid) -> float:
    """How far an object is from homogeneous: the share of its mass that lies where it should not.

    ``sum |d / sum(d) - w / sum(w)| / 2`` over the voxels with ``w > 0``, ``w`` the share of the
    voxel inside the envelope: the total variation distance between the mass and an even filling
    of the outer surface. That share of the mass would have to move to make it even. 0 for an even
    filling, whatever its density, towards 1 for a heavy grain in an empty shell. Nothing scores 0,
    as an ever thinner even filling does.

    A coefficient of variation would divide voxels at the surface by their small shares, and be
    ruled by them; a distance of histograms would repeat the error of the mass.

    Parameters
    ----------
    density_g_cm3
        Shape (x, y, z), g/cm³, voxel means.
    envelope
        Shape (x, y, z), 0 to 1.

    Examples
    --------
    >>> nonuniformity(np.array([[[3.0, 1.0]]]), np.ones((1, 1, 2)))
    0.25
    """
    inside = envelope > 0
    density, share = (grid[inside].astype(np.float64) for grid in (density_g_cm3, envelope))
    if not (mass := density.sum()):
        return 0.0
    return float(np.abs(density / mass - share / share.sum()).sum() / 2)


def nonuniformity_error(truth: Grid, guess: Grid, envelope: Grid) -> float:
    """Error of :func:`nonuniformity`: ``|guess's - truth's|``.

    It asks how uneven a prediction is, not where: the right unevenness in the wrong place scores
    0, and density MAE and the centre of mass tell of that. All homogeneous predictions score the
    same, the non-uniformity of the truth.

    Parameters
    ----------
    truth, guess
        Shape (x, y, z), g/cm³, voxel means.
    envelope
        Shape (x, y, z), 0 to 1.

    Examples
    --------
    >>> box = np.ones((1, 1, 2))
    >>> nonuniformity_error(np.array([[[3.0, 1.0]]]), 7 * box, box)
    0.25
    """
    return abs(nonuniformity(guess, envelope) - nonuniformity(truth, envelope))


def integrate(
    density_g_cm3: Grid, envelope: Grid, origin_cm: Vec3, voxel_size_cm: float
) -> MassProperties:
    """Mass properties over the voxels with envelope > 0.

    Without mass, the centre of mass is the envelope's centroid.

    Parameters
    ----------
    density_g_cm3, envelope
        Shape (x, y, z).
    origin_cm
        Shape (3,): centre of voxel (0, 0, 0).
    voxel_size_cm
        Edge of a voxel.

    Examples
    --------
    >>> box = np.array([[[1.0, 1.0, 0.0]]])
    >>> nothing = integrate(0 * box, box, np.zeros(3), 2.0)
    >>> nothing.mass_g, nothing.com_cm.tolist()
    (0.0, [0.0, 0.0, 1.0])
    """
    inside = np.where(envelope > 0, density_g_cm3, 0)
    properties = mass_of_grid(inside, origin_cm, voxel_size_cm)
    if properties.mass_g == 0.0:
        centroid = mass_of_grid(envelope, origin_cm, voxel_size_cm).com_cm
        return replace(properties, com_cm=centroid)
    return properties


def score_object(
    truth_g_cm3: Grid,
    guess_g_cm3: Grid,
    envelope: Grid,
    origin_cm: Vec3,
    voxel_size_cm: float,
    extent_cm: float,
    mass_ratio_limit: float = 1000.0,
) -> dict[str, float]:
    """Every metric of one object that needs its density alone.

    Parameters
    ----------
    truth_g_cm3, guess_g_cm3
        Shape (x, y, z), voxel means; the truth has mass.
    envelope
        Shape (x, y, z), 0 to 1.
    origin_cm
        Shape (3,): centre of voxel (0, 0, 0).
    voxel_size_cm
        Edge of a voxel.
    extent_cm
        Longest edge of the object's bounding box.
    mass_ratio_limit
        See :func:`mass_alde`.

    Examples
    --------
    >>> box = np.ones((2, 2, 2))
    >>> scores = score_object(box, 2 * box, box, np.zeros(3), 1.0, 2.0)
    >>> scores["mass_mape"], scores["com_l1_cm"], scores["inertia_error"]
    (1.0, 0.0, 1.0)
    """
    truth, guess = (
        integrate(density, envelope, origin_cm, voxel_size_cm)
        for density in (truth_g_cm3, guess_g_cm3)
    )
    return {
        "density_mae_g_cm3": density_mae_g_cm3(truth_g_cm3, guess_g_cm3, envelope),
        "density_relative_error": relative_error(truth_g_cm3, guess_g_cm3, envelope),
        "com_l1_cm": com_l1_cm(truth.com_cm, guess.com_cm),
        "com_l1_share": com_l1_share(truth.com_cm, guess.com_cm, extent_cm),
        "com_l2_cm": com_l2_cm(truth.com_cm, guess.com_cm),
        "mass_mape": mass_mape(truth.mass_g, guess.mass_g),
        "mass_alde": mass_alde(truth.mass_g, guess.mass_g, mass_ratio_limit),
        "mass_mnre": mass_mnre(truth.mass_g, guess.mass_g),
        "inertia_error": inertia_error(truth.inertia_g_cm2, guess.inertia_g_cm2),
        "nonuniformity_error": nonuniformity_error(truth_g_cm3, guess_g_cm3, envelope),
    }
