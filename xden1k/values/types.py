"""The values the dataset is made of: parts, density fields and objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
import trimesh
from jaxtyping import Float, Integer

from xden1k.errors import DataError, require
from xden1k.values.arrays import Grid, Labels, Vec3
from xden1k.values.labels import count_label_voxels
from xden1k.values.mass import MassProperties, mass_of_grid, mass_of_meshes
from xden1k.values.views import XRayView

if TYPE_CHECKING:
    import torch

__all__ = [
    "ALL_SPLITS",
    "AXES",
    "CAPTURED",
    "FIELD_SIZE",
    "LABEL_SIZE",
    "MAX_PARTS",
    "PRIVATE",
    "SOURCES",
    "SPLITS",
    "UNSEEN",
    "Axis",
    "DensityField",
    "DensityObject",
    "DensitySource",
    "Part",
    "Source",
    "Split",
]

FIELD_SIZE = 64
"""Voxels along each edge of the density, occupancy and envelope grids."""
LABEL_SIZE = 128
"""Voxels along each edge of the label grid, which fills the same cube."""
MAX_PARTS = 255
"""Labels are one byte, and 0 is air."""

MAX_RESAMPLED = 1024
"""Voxels along an axis beyond which a resampled field is a slip of the unit."""
Axis = Literal["x", "y", "z"]
AXES: tuple[Axis, ...] = get_args(Axis)

Split = Literal["train", "val", "test", "unseen", "private"]
ALL_SPLITS: tuple[Split, ...] = get_args(Split)
PRIVATE: Split = "private"
"""The split of a published folder whose objects come without answers."""
UNSEEN: Split = "unseen"
"""The split of whole categories that are in no other: whether a method knows kinds or matter."""
SPLITS = tuple(split for split in ALL_SPLITS if split != PRIVATE)
"""What a capture or a simulator may name."""
Source = Literal["scan", "phantom", "ct", "published"]
SOURCES: tuple[Source, ...] = get_args(Source)
CAPTURED = tuple(source for source in SOURCES if source != "published")
"""Sources of objects that have a capture: nobody but an importer writes the other one."""
DensitySource = Literal["xray", "prior", "weighed", "truth", "none", "withheld"]


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One homogeneous region of an object.

    Parameters
    ----------
    name
        Unique in its object.
    mesh
        Closed, outward-wound, in cm, in the object frame. Parts of one object do not overlap.
    material
        A name or a family of the material library; empty = unknown.
    lac_per_cm
        Linear attenuation coefficient as the X-rays give it; nan where none was measured.
    apparent_density_g_cm3
        LAC / 0.17, the paper's rule; nan where no LAC was measured.
    density_g_cm3
        Best estimate; nan where only attenuation is known.
    density_sd_g_cm3
        Its standard deviation; nan where no density is known.
    density_source
        ``xray`` (measured), ``prior`` (from the material alone), ``weighed`` (a scale had the
        last word), ``truth`` (a simulator's), ``none`` (no density), ``withheld`` (not published).
    flags
        What a user should know before trusting the figures.
    color_rgb
        Base colour, three values from 0 to 1.

    Raises
    ------
    DataError
        If a density is negative or infinite, or the source is not a known one.
    """

    name: str
    mesh: trimesh.Trimesh
    material: str
    lac_per_cm: float
    apparent_density_g_cm3: float
    density_g_cm3: float
    density_sd_g_cm3: float
    density_source: DensitySource
    flags: tuple[str, ...] = ()
    color_rgb: tuple[float, float, float] = (0.7, 0.7, 0.7)

    def __post_init__(self) -> None:
        for name in ("lac_per_cm", "apparent_density_g_cm3", "density_g_cm3", "density_sd_g_cm3"):
            value = getattr(self, name)
            if value < 0 or np.isinf(value):
                raise DataError(f"part {self.name}: {name} must be finite and >= 0, got {value}")
        if self.density_source not in get_args(DensitySource):
            raise DataError(
                f"part {self.name}: density_source must be one of {get_args(DensitySource)}, "
                f"got {self.density_source!r}"
            )
        if np.isnan(self.density_g_cm3) != (self.density_source in ("none", "withheld")):
            raise DataError(
                f"part {self.name}: density {self.density_g_cm3} does not go with "
                f"density_source {self.density_source!r}"
            )


@dataclass(frozen=True, eq=False)
class DensityField:
    """Voxel means of a density on a cubic grid, in the object frame.

    Parameters
    ----------
    density_g_cm3
        Shape (x, y, z), finite, never negative; zero outside the object.
    origin_cm
        Shape (3,): centre of voxel (0, 0, 0).
    voxel_size_cm
        Edge of one cubic voxel.

    Raises
    ------
    DataError
        If a density is negative or not finite, or the voxel size is not positive.

    Examples
    --------
    >>> water = DensityField(np.ones((2, 2, 2)), np.zeros(3), voxel_size_cm=0.5)
    >>> water.mass_g
    1.0
    """

    density_g_cm3: Grid
    origin_cm: Vec3
    voxel_size_cm: float

    def __post_init__(self) -> None:
        if not self.voxel_size_cm > 0:
            raise DataError(f"voxel_size_cm must be positive, got {self.voxel_size_cm}")
        bad = ~np.isfinite(self.density_g_cm3) | (self.density_g_cm3 < 0)
        if bad.any():
            first = tuple(int(i) for i in np.argwhere(bad)[0])
            raise DataError(
                f"density_g_cm3 has {bad.sum()} negative or non-finite voxels, first at {first}"
            )

    @cached_property
    def mass_properties(self) -> MassProperties:
        """Mass, centre of mass and inertia, integrated on the grid."""
        return mass_of_grid(self.density_g_cm3, self.origin_cm, self.voxel_size_cm)

    @property
    def mass_g(self) -> float:
        """Total mass."""
        return self.mass_properties.mass_g

    @property
    def com_cm(self) -> Vec3:
        """Centre of mass, shape (3,)."""
        return self.mass_properties.com_cm

    def __repr__(self) -> str:
        size = " x ".join(map(str, self.density_g_cm3.shape))
        return f"DensityField({size} voxels of {self.voxel_size_cm:.4g} cm, {self.mass_g:.4g} g)"

    def resampled(self, voxel_size_cm: float) -> DensityField:
        """Field of the same matter in voxels of another size, which start at the same corner.

        Each new voxel is the mean over its space, air where it reaches beyond the old grid: the
        mass is kept to rounding, the centre of mass to a fraction of a voxel.

        Parameters
        ----------
        voxel_size_cm
            Edge of the new voxels, coarser or finer.

        Raises
        ------
        DataError
            If the size is not positive, or makes more than 1024 voxels along an axis.

        Examples
        --------
        >>> field = DensityField(np.ones((4, 4, 4)), np.zeros(3), voxel_size_cm=1.0)
        >>> coarse = field.resampled(2.0)
        >>> coarse.density_g_cm3.shape, coarse.origin_cm.tolist(), coarse.mass_g
        ((2, 2, 2), [0.5, 0.5, 0.5], 64.0)
        """
        if not 0 < voxel_size_cm < np.inf:
            raise DataError(f"voxel_size_cm must be positive, got {voxel_size_cm}")
        ratio = voxel_size_cm / self.voxel_size_cm
        if max(self.density_g_cm3.shape) / ratio > MAX_RESAMPLED:
            raise DataError(
                f"voxels of {voxel_size_cm} cm make more than {MAX_RESAMPLED} along an axis of "
                f"{max(self.density_g_cm3.shape)} voxels of {self.voxel_size_cm} cm"
            )
        values = self.density_g_cm3.astype(np.float64)
        for axis, size in enumerate(values.shape):
            values = np.moveaxis(np.tensordot(_shares(size, ratio), values, (1, axis)), 0, axis)
        low = self.origin_cm - self.voxel_size_cm / 2
        density = values.astype(np.promote_types(self.density_g_cm3.dtype, np.float32))
        return DensityField(density, low + voxel_size_cm / 2, voxel_size_cm)

    def sliced(self, axis: Axis, at_cm: float | None = None) -> Float[np.ndarray, "across up"]:
        """Plane of voxels perpendicular to an axis; the other two axes stay in their order.

        Parameters
        ----------
        axis
            ``x``, ``y`` or ``z``.
        at_cm
            Where, object frame; None = through the centre of mass.

        Raises
        ------
        DataError
            If there is no such axis, the place is outside the grid, or it is not given and
            nothing has mass.

        Examples
        --------
        >>> field = DensityField(np.arange(8.0).reshape(2, 2, 2), np.zeros(3), voxel_size_cm=1.0)
        >>> field.sliced("z", 1.2).tolist()
        [[1.0, 3.0], [5.0, 7.0]]
        """
        if axis not in AXES:
            raise DataError(f"axis must be one of {list(AXES)}, got {axis!r}")
        number = AXES.index(axis)
        if at_cm is None:
            if self.mass_g == 0:
                raise DataError("nothing has mass, and so no centre of mass to cut: give at_cm")
            at_cm = float(self.com_cm[number])
        size = self.density_g_cm3.shape[number]
        place = (at_cm - self.origin_cm[number]) / self.voxel_size_cm
        if not -0.5 <= place <= size - 0.5:
            low, high = self.origin_cm[number] + np.array([-0.5, size - 0.5]) * self.voxel_size_cm
            raise DataError(f"{axis} = {at_cm:g} cm is outside the grid, {low:g} to {high:g} cm")
        plane: Float[np.ndarray, "across up"] = np.take(
            self.density_g_cm3, min(max(round(place), 0), size - 1), axis=number
        )
        return plane

    def to_torch(self) -> torch.Tensor:
        """Densities as a float32 tensor of shape (x, y, z), a copy, g/cm³."""
        import torch

        return torch.tensor(self.density_g_cm3, dtype=torch.float32)

    def to_nibabel(self) -> Any:
        """Densities as a ``nibabel.Nifti1Image``, float32, g/cm³.

        NIfTI is in millimetres: the affine takes voxel numbers to the object frame times 10. The
        frame is the object's, not a patient's.

        Raises
        ------
        MissingExtraError
            If nibabel (extra ``volumes``) is not installed.
        """
        nibabel = require("nibabel", "volumes")
        affine = np.diag([*[10 * self.voxel_size_cm] * 3, 1.0])
        affine[:3, 3] = 10 * self.origin_cm
        image = nibabel.Nifti1Image(self.density_g_cm3.astype(np.float32), affine)
        image.header.set_xyzt_units("mm")
        return image


def _shares(size: int, ratio: float) -> Float[np.ndarray, "new old"]:
    """Share of each new voxel, ``ratio`` times as wide, that each old one fills."""
    count = max(1, int(np.ceil(size / ratio - 1e-9)))
    low, old = ratio * np.arange(count)[:, None], np.arange(size)
    shared: Float[np.ndarray, "new old"] = np.minimum(low + ratio, old + 1) - np.maximum(low, old)
    return shared.clip(0) / ratio


@dataclass(frozen=True, eq=False)
class DensityObject:
    """One object of the dataset: radiographs, parts and what is inside.

    Parameters
    ----------
    object_id, category
        Its name and its class.
    split
        ``train``, ``val``, ``test``, ``unseen`` or ``private``.
    source
        ``scan``, ``phantom`` (simulated with known truth), ``ct`` (views computed from a CT) or
        ``published`` (attenuation of the authors' release, densities of ours).
    views
        The radiographs ``pa`` and ``lat``, in this order; empty where there are none.
    parts
        1 to 255 parts that do not overlap; part k of the labels is ``parts[k - 1]``.
    labels
        Shape (128, 128, 128) uint8: the part at each voxel's centre, 0 = air.
    occupancy
        Shape (64, 64, 64), 0 to 1: share of the voxel filled with material.
    envelope
        Shape (64, 64, 64), 0 to 1: share inside the outer surface, enclosed cavities included.
    density, apparent_density
        Voxel means on the field grid; ``density`` is None where only attenuation is known, both
        are where the answers are withheld.
    origin_cm
        Shape (3,): centre of field voxel (0, 0, 0).
    voxel_size_cm
        Edge of a field voxel. Label voxels have half of it and start a quarter lower.
    weighed_mass_g
        From a scale; None if it never was on one.
    flags
        Remarks on the object as a whole.
    meta
        Fit report and provenance, of JSON's types.

    Raises
    ------
    DataError
        If there are views that are not ``pa`` and ``lat``, the split is unknown, or there are no
        parts or more than 255, or two of one name.
    """

    object_id: str
    category: str
    split: Split
    source: Source
    views: tuple[XRayView, XRayView] | tuple[()]
    parts: tuple[Part, ...]
    labels: Labels
    occupancy: Grid
    envelope: Grid
    density: DensityField | None
    apparent_density: DensityField | None
    origin_cm: Vec3
    voxel_size_cm: float
    weighed_mass_g: float | None = None
    flags: tuple[str, ...] = ()
    meta: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        names = [view.name for view in self.views]
        if names not in ([], ["pa", "lat"]):
            raise DataError(f"{self.object_id}: views must be pa and lat, or none, got {names}")
        if self.split not in ALL_SPLITS:
            raise DataError(
                f"{self.object_id}: split must be one of {ALL_SPLITS}, got {self.split!r}"
            )
        if not 1 <= len(self.parts) <= MAX_PARTS:
            raise DataError(f"{self.object_id}: 1 to {MAX_PARTS} parts, got {len(self.parts)}")
        if len({part.name for part in self.parts}) < len(self.parts):
            raise DataError(f"{self.object_id}: part names must be unique")

    def __repr__(self) -> str:
        mass = f"{self.mass_g:.4g} g" if np.isfinite(self.mass_g) else "mass unknown"
        return (
            f"DensityObject({self.object_id!r}, {self.category!r}, {mass}, "
            f"{len(self.parts)} parts, {self.source}, {self.split} split)"
        )

    def _repr_html_(self) -> str:
        """Show radiographs, slices and parts in a notebook; no external resources."""
        from xden1k.values.notebook import object_html

        return object_html(self)

    @property
    def best_field(self) -> DensityField:
        """The density, or the apparent density where that is all there is.

        Raises
        ------
        DataError
            If the answers are withheld.
        """
        field = self.density or self.apparent_density
        if field is None:
            raise DataError(f"{self.object_id}: its density is withheld: there is no field")
        return field

    @cached_property
    def label_voxels(self) -> Integer[np.ndarray, "parts"]:
        """How many voxels of the labels each part has, in the order of the parts.

        0 where a part is thinner than they are: its mesh and the shares of the field grid have
        it all the same.
        """
        return count_label_voxels(self.labels, len(self.parts))

    @cached_property
    def mass_properties(self) -> MassProperties:
        """Exact mass, centre of mass and inertia, from meshes and densities, not from voxels.

        Not a number where a part has no density.
        """
        return mass_of_meshes(
            [part.mesh for part in self.parts], [part.density_g_cm3 for part in self.parts]
        )

    @property
    def mass_g(self) -> float:
        """Exact mass."""
        return self.mass_properties.mass_g

    @property
    def com_cm(self) -> Vec3:
        """Exact centre of mass, shape (3,), object frame."""
        return self.mass_properties.com_cm
