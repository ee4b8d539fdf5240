"""The truth on a grid: density and owner of each voxel, in one file beside ``truth.json``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from xden1k.rays import column_samples, density_grid, object_cube, part_fractions, voxel_labels
from xden1k.values.arrays import Labels
from xden1k.values.types import DensityField
from xden_builder.capture.damage import decoding
from xden_builder.phantoms.phantom import Phantom

__all__ = ["TruthGrid", "truth_grid"]


@dataclass(frozen=True, eq=False)
class TruthGrid:
    """What a phantom is made of, voxel by voxel, in the frame of the true meshes.

    Parameters
    ----------
    density
        Shape (64, 64, 64): voxel means.
    labels
        Shape (128, 128, 128): owner of each voxel's centre, 0 = air, k = part k of ``part_names``.
        Their cube is the density's; a label voxel has half the edge.
    part_names
        Sorted.
    """

    density: DensityField
    labels: Labels
    part_names: tuple[str, ...]

    def save(self, path: Path) -> None:
        """Write ``truth.npz``: ``density_g_cm3`` (float32), ``labels``, ``part_names``, and where.

        The same grid gives the same bytes.
        """
        np.savez_compressed(
            path,
            density_g_cm3=self.density.density_g_cm3.astype(np.float32),
            labels=self.labels,
            part_names=np.array(self.part_names),
            origin_cm=self.density.origin_cm,
            voxel_size_cm=np.array(self.density.voxel_size_cm),
        )

    @classmethod
    def load(cls, path: Path) -> TruthGrid:
        """Read a ``truth.npz``.

        Raises
        ------
        DataError
            If it is missing or is not one.
        """
        with decoding(path, "a truth grid"), np.load(path) as kept:
            field = DensityField(
                kept["density_g_cm3"], kept["origin_cm"], float(kept["voxel_size_cm"])
            )
            return cls(field, kept["labels"], tuple(kept["part_names"].tolist()))


def truth_grid(phantom: Phantom) -> TruthGrid:
    """Put a phantom on its grids, as the dataset does (:func:`xden1k.rays.object_grids`)."""
    meshes = [part.mesh for part in phantom.parts]
    field, label = object_cube(meshes)
    fills = part_fractions(meshes, range(len(meshes)), field, column_samples(meshes, field))
    density = density_grid(fills, [part.density_g_cm3 for part in phantom.parts], field)
    return TruthGrid(
        DensityField(density, field.origin_cm, field.voxel_size_cm),
        voxel_labels(meshes, range(len(meshes)), label),
        tuple(part.name for part in phantom.parts),
    )
