"""Attenuation of an object, voxel by voxel, against a computed tomogram of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float

from xden1k.rays import CubeGrid, part_fractions
from xden1k.values.arrays import Vec3
from xden_builder.capture import CTReference

__all__ = ["CTAudit", "audit_ct"]


@dataclass(frozen=True, slots=True)
class CTAudit:
    """Attenuation of an object against a CT of it.

    The model of a voxel is the attenuation of each part times the share of the voxel it fills.
    The first four figures are over the labelled voxels of the CT, or over all where none are.

    Parameters
    ----------
    voxel_mae_per_cm
        Mean absolute difference of model and CT.
    voxel_mae_rel
        The same by the mean of the CT.
    mass_ratio
        Sum of the model by the sum of the CT.
    com_l1_cm
        Sum of the three absolute differences of the attenuation-weighted centre.
    mass_ratio_whole_grid
        Sum of the model by the sum of the CT over every voxel.
    """

    voxel_mae_per_cm: float
    voxel_mae_rel: float
    mass_ratio: float
    com_l1_cm: float
    mass_ratio_whole_grid: float


def audit_ct(
    meshes: Sequence[trimesh.Trimesh], lac_per_cm: Sequence[float], ct: CTReference
) -> CTAudit:
    """Compare parts that do not overlap with a CT.

    Parameters
    ----------
    meshes
        In the frame of the CT.
    lac_per_cm
        One for each mesh.
    ct
        The reference; its voxels need not be cubes.
    """
    model = _on_ct_grid(meshes, lac_per_cm, ct)
    inside = np.ones(model.shape, dtype=bool) if ct.labels is None else ct.labels > 0
    reference = np.where(inside, ct.mu_per_cm, 0).astype(np.float64)
    mae = float(np.abs(model - ct.mu_per_cm)[inside].mean())
    apart = _centre(np.where(inside, model, 0), ct) - _centre(reference, ct)
    return CTAudit(
        voxel_mae_per_cm=mae,
        voxel_mae_rel=mae / float(ct.mu_per_cm[inside].mean()),
        mass_ratio=float(model[inside].sum() / reference.sum()),
        com_l1_cm=float(np.abs(apart).sum()),
        mass_ratio_whole_grid=float(model.sum() / ct.mu_per_cm.sum(dtype=np.float64)),
    )


def _on_ct_grid(
    meshes: Sequence[trimesh.Trimesh], lac_per_cm: Sequence[float], ct: CTReference
) -> Float[np.ndarray, "x y z"]:
    """Voxel means of the parts' attenuation, in the CT's voxels stretched to cubes."""
    in_voxels = [
        trimesh.Trimesh((mesh.vertices - ct.origin_cm) / ct.spacing_cm, mesh.faces, process=False)
        for mesh in meshes
    ]
    cube = CubeGrid(np.zeros(3), 1.0, max(ct.mu_per_cm.shape))
    model = np.zeros(ct.mu_per_cm.shape)
    fills = part_fractions(in_voxels, range(len(meshes)), cube)
    for fill, lac in zip(fills, lac_per_cm, strict=True):
        part = model[fill.where]  # cut where the part reaches beyond a CT that is no cube
        x, y, z = part.shape
        part += lac * fill.share[:x, :y, :z]
    return model


def _centre(weight: Float[np.ndarray, "x y z"], ct: CTReference) -> Vec3:
    means = [
        np.arange(weight.shape[axis]) @ weight.sum(axis=tuple({0, 1, 2} - {axis}))
        for axis in range(3)
    ]
    return np.asarray(ct.origin_cm + ct.spacing_cm * np.array(means) / weight.sum())
