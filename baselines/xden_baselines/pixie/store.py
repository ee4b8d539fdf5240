"""Training objects as a network sees them, in memory: voxels inside the envelope only, float16.

Each voxel of the envelope takes 2 bytes a channel and 13 for its place and its targets, so 57 with
22 channels and 121 with 32 features of CLIP: a full cube of 64³ takes 15 MB (32), one of 32³ 1.9
(4). Phantoms fill 7 % of theirs on average: 0.13 MB each at 32³ and about 1 MB at 64³.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float16, Float32, Int32, UInt8

from xden1k.access.samples import Example
from xden1k.values.arrays import Labels
from xden1k.values.materials import check_label, families, load_materials
from xden_baselines.pixie.channels import ENVELOPE, Channels

__all__ = ["UNKNOWN_FAMILY", "Stored", "at_resolution", "pooled", "stored"]

UNKNOWN_FAMILY = 255
"""Of voxels whose material is not known, or that are empty."""
FULL = 1e-3
"""Shares of a voxel below this are rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Stored:
    """One training object.

    Parameters
    ----------
    object_id, category
        Its name and its class.
    voxels
        Shape (n,): flat indices of the voxels with a share in the envelope, C order.
    channels
        Shape (channels, n).
    envelope
        Shape (n,): share of the voxel inside the outer surface.
    mean_g_cm3
        Shape (n,): target, mean over that share, cavities included.
    solid
        Shape (n,): part of that share which is filled with material.
    family
        Shape (n,): index of the material's family; 255 = none known.
    """

    object_id: str
    category: str
    voxels: Int32[np.ndarray, "n"]
    channels: Float16[np.ndarray, "channels n"]
    envelope: Float32[np.ndarray, "n"]
    mean_g_cm3: Float16[np.ndarray, "n"]
    solid: Float16[np.ndarray, "n"]
    family: UInt8[np.ndarray, "n"]

    @property
    def stuff_g_cm3(self) -> Float32[np.ndarray, "n"]:
        """Density of the material alone; 0 where there is none."""
        solid = self.solid.astype(np.float32)
        stuff = np.zeros_like(solid)
        np.divide(self.mean_g_cm3, solid, out=stuff, where=solid > FULL)
        return stuff

    @property
    def overall_g_cm3(self) -> float:
        """Mass over the volume inside the outer surface."""
        return float(np.average(self.mean_g_cm3.astype(np.float64), weights=self.envelope))

    @property
    def nbytes(self) -> int:
        """Memory it takes."""
        arrays = (self.channels, self.envelope, self.mean_g_cm3, self.solid, self.family)
        return int(self.voxels.nbytes + sum(array.nbytes for array in arrays))


def stored(example: Example, seen: Channels, resolution: int) -> Stored:
    """Prepare a training object, with what is seen of it, at a resolution that divides 64.

    Raises
    ------
    ModalityError
        If the category is not declared.
    """
    sample, truth = example.sample, example.truth
    envelope = pooled(sample.envelope, resolution)
    chosen = envelope > 0
    share = np.where(chosen, envelope, 1)
    return Stored(
        object_id=sample.object_id,
        category=sample.category,
        voxels=np.flatnonzero(chosen).astype(np.int32),
        channels=at_resolution(seen, resolution)[:, chosen].astype(np.float16),
        envelope=envelope[chosen].astype(np.float32),
        mean_g_cm3=(pooled(example.density_g_cm3, resolution) / share)[chosen].astype(np.float16),
        solid=(pooled(truth.occupancy, resolution) / share)[chosen].clip(0, 1).astype(np.float16),
        family=_families(truth.labels, [part.material for part in truth.parts], resolution)[chosen],
    )


def at_resolution(values: Channels, resolution: int) -> Float32[np.ndarray, "channels u v w"]:
    """Average channels over what each coarser voxel holds of the envelope; 0 in the air."""
    envelope = values[ENVELOPE]
    weight = pooled(envelope, resolution)
    means = pooled(values * envelope, resolution) / np.where(weight > 0, weight, 1)
    means[ENVELOPE] = weight
    return means


def pooled(
    values: Float[np.ndarray, "*channels x y z"], resolution: int
) -> Float32[np.ndarray, "*channels u v w"]:
    """Mean over blocks of voxels.

    Examples
    --------
    >>> pooled(np.eye(64, dtype=np.float32)[None].repeat(64, 0), 32)[5, 5, 4:8].tolist()
    [0.0, 0.5, 0.0, 0.0]
    """
    block = values.shape[-1] // resolution
    lead, size, edge = values.shape[:-3], values.shape[-1], (resolution,) * 3
    # an axis at a time: numpy takes several times as long for short axes amid others
    means = values.reshape(*lead, resolution, block, size, size).mean(-3, dtype=np.float32)
    means = means.reshape(*lead, resolution, resolution, block, size).mean(-2)
    return np.asarray(means.reshape(*lead, *edge, block) @ np.full(block, 1 / block, np.float32))


def _families(labels: Labels, materials: list[str], resolution: int) -> UInt8[np.ndarray, "x y z"]:
    """Return the family that fills most of each voxel."""
    of_part = [_family(check_label(material)) for material in materials]
    most = np.zeros((resolution,) * 3, dtype=np.float32)
    found = np.full(most.shape, UNKNOWN_FAMILY, dtype=np.uint8)
    for family in sorted(set(of_part) - {UNKNOWN_FAMILY}):
        table = np.array([False, *(one == family for one in of_part)])
        share = pooled(table[labels].astype(np.float32), resolution)
        found[share > most] = family
        most = np.maximum(most, share)
    return found


def _family(label: str) -> int:
    """Index of the family of a material, of a family, or of nothing."""
    library = load_materials()
    name = library[label].family if label in library else label
    return families().index(name) if name else UNKNOWN_FAMILY
