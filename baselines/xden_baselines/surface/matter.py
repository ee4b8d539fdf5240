"""What lies at which depth behind a material that is seen: densities of training objects.

A steel surface may be that of a solid bar or of a sheet with air behind it. How often it is which,
at which depth, is counted on the training split; the median of what was found there is the answer
of least expected error.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64
from scipy import ndimage

from xden1k.errors import DataError
from xden1k.predictor import SampleView
from xden1k.values.arrays import Grid

__all__ = ["DEPTHS_CM", "Matter", "Seen", "counted"]

DEPTHS_CM = (0.1, 0.2, 0.4, 0.8, 1.6, 3.2)
"""Where one class of depths ends and the next begins."""
EDGES_G_CM3 = np.concatenate([[0.0], np.geomspace(0.01, 25.0, 64)])
"""Of the classes of density; the first holds empty voxels."""
CLASSES = len(EDGES_G_CM3) - 1
PRIOR_OBJECTS = 1.0
"""What lies at a depth behind any material counts as much as so many objects of each."""
FILE = "matter.npz"

Surface = Bool[np.ndarray, "64 64 64"]
Shares = Float64[np.ndarray, "voxels materials"]


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """An object's surface, and what it is taken to be made of.

    Parameters
    ----------
    surface
        Voxels of known material.
    shares
        Of each of these in C order, how probable each material is; adds up to 1.
    """

    surface: Surface
    shares: Shares


@dataclass(frozen=True, slots=True, eq=False)
class Matter:
    """How often which density lies at which depth behind which material.

    Parameters
    ----------
    counts
        Shape (materials, depths, classes): share of the voxels there, adds up to 1 over classes.
    middles_g_cm3
        Shape (classes,): mean density of the training voxels of each class.

    Raises
    ------
    DataError
        If shapes do not fit, or shares do not add up.
    """

    counts: Float64[np.ndarray, "materials depths classes"]
    middles_g_cm3: Float64[np.ndarray, "classes"]

    def __post_init__(self) -> None:
        expected = (len(self.counts), len(DEPTHS_CM) + 1, CLASSES)
        if self.counts.shape != expected or self.middles_g_cm3.shape != (CLASSES,):
            raise DataError(f"expected counts of {expected}, got {self.counts.shape}")
        if not np.allclose(self.counts.sum(axis=-1), 1):
            raise DataError("shares of densities must add up to 1")

    def median_g_cm3(self, sample: SampleView, seen: Seen) -> Grid:
        """Fill an object: at each voxel the median of what lies so deep behind what is seen.

        Parameters
        ----------
        sample
            Its envelope.
        seen
            Its surface.

        Returns
        -------
        density_g_cm3
            Shape (64, 64, 64), times the envelope.
        """
        depth, behind = _placed(sample, seen.surface)
        by_depth = np.stack(
            [self._medians(seen.shares, which) for which in range(len(DEPTHS_CM) + 1)]
        )
        return np.asarray(by_depth[depth, behind] * sample.envelope, dtype=np.float32)

    def save(self, folder: Path) -> None:
        """Write it into a folder."""
        np.savez(folder / FILE, counts=self.counts, middles_g_cm3=self.middles_g_cm3)

    @classmethod
    def load(cls, folder: Path) -> Matter:
        """Read what :meth:`save` wrote.

        Raises
        ------
        DataError
            If the file is missing or damaged.
        """
        try:
            with np.load(folder / FILE, allow_pickle=False) as found:
                return cls(found["counts"], found["middles_g_cm3"])
        except (OSError, KeyError, ValueError) as err:
            raise DataError(f"{folder / FILE}: not what lies behind surfaces: {err}") from err

    def _medians(self, shares: Shares, depth: int) -> Float64[np.ndarray, "voxels"]:
        """Median density at a depth behind each voxel of the surface."""
        below = (shares @ self.counts[:, depth]).cumsum(axis=1)
        return np.asarray(self.middles_g_cm3[(below < 0.5 * below[:, -1:]).sum(axis=1)])


def counted(objects: Iterable[tuple[SampleView, Seen, Grid]], materials: int) -> Matter:
    """Count what lies behind the surfaces of training objects. Each object counts as much.

    Parameters
    ----------
    objects
        Sample, surface with its true materials, and density in g/cm³, shape (64, 64, 64).
    materials
        How many there are.

    Raises
    ------
    DataError
        If there is no object.
    """
    shape = (materials, len(DEPTHS_CM) + 1, CLASSES)
    counts, weights, sums = np.zeros(shape), np.zeros(CLASSES), np.zeros(CLASSES)
    for sample, seen, density_g_cm3 in objects:
        depth, behind = _placed(sample, seen.surface)
        inside = sample.envelope > 0
        share = sample.envelope[inside].astype(np.float64)
        found_g_cm3 = density_g_cm3[inside] / share
        which = _class_of(found_g_cm3)
        share /= share.sum()
        material = seen.shares.argmax(axis=1)[behind[inside]]
        np.add.at(counts, (material, depth[inside], which), share)
        weights += np.bincount(which, share, CLASSES)
        sums += np.bincount(which, share * found_g_cm3, CLASSES)
    if not weights.any():
        raise DataError("no training object shows a part of known material")
    return Matter(_smoothed(counts), _middles(weights, sums))


def _class_of(density_g_cm3: Float[np.ndarray, "n"]) -> Int64[np.ndarray, "n"]:
    place = np.searchsorted(EDGES_G_CM3, density_g_cm3, side="right") - 1
    return np.asarray(place.clip(0, CLASSES - 1))


def _smoothed(
    counts: Float64[np.ndarray, "materials depths classes"],
) -> Float64[np.ndarray, "materials depths classes"]:
    """Shares of the classes: what is found behind all materials counts as one object of each."""
    every = counts.sum(axis=0) + 1e-9
    prior = every / every.sum(axis=1, keepdims=True)
    blended = counts + PRIOR_OBJECTS * prior / len(DEPTHS_CM)
    return np.asarray(blended / blended.sum(axis=-1, keepdims=True))


def _middles(
    weights: Float64[np.ndarray, "classes"], sums: Float64[np.ndarray, "classes"]
) -> Float64[np.ndarray, "classes"]:
    """Mean of each class; of one that was never met, the middle between its edges."""
    between = (EDGES_G_CM3[:-1] + EDGES_G_CM3[1:]) / 2
    return np.where(weights > 0, sums / np.where(weights > 0, weights, 1), between)


def _placed(
    sample: SampleView, surface: Surface
) -> tuple[Int64[np.ndarray, "64 64 64"], Int64[np.ndarray, "64 64 64"]]:
    """Class of depth of each voxel below the air, and the number of the surface voxel nearest."""
    depth_cm = ndimage.distance_transform_edt(sample.envelope > 0) * sample.voxel_size_cm
    _, nearest = ndimage.distance_transform_edt(~surface, return_indices=True)
    number = surface.reshape(-1).cumsum().reshape(surface.shape) - 1
    return np.digitize(depth_cm, DEPTHS_CM), number[tuple(nearest)]
