"""The perfect eye: oracles of the material of all that a picture shows, and of nothing else.

What a method that works from appearance makes wrong beyond ``seen-materials`` is recognition; what
``seen-materials`` makes wrong is hidden in the object, or the spread of a material's density.
"""

from __future__ import annotations

import numpy as np

from xden1k.errors import DataError
from xden1k.predictor import Examples, Prediction, SampleView
from xden1k.values.arrays import Grid
from xden1k.values.modality import Modality
from xden_baselines.gaussian_property.regions import part_numbers
from xden_baselines.geometry import nearest_filled
from xden_baselines.materials import nominal_densities_g_cm3
from xden_baselines.views.lifting import votes_at_surface, whole_votes
from xden_baselines.views.pictures import Pictures

__all__ = ["SeenMaterials", "SeenMaterialsHollow"]


class SeenMaterials:
    """Oracle of what is seen: its true material at the density of the table, filled solid.

    Each voxel at the surface takes the part that most views show there, every other voxel the
    nearest of these; nothing is known of cavities.
    """

    name = "seen-materials"
    version = "1"
    reads = Modality.GEOMETRY | Modality.RGB | Modality.PARTS | Modality.MATERIALS
    trainable = False
    external_data = False
    notes = "true material of the visible surface, solid"

    def fit(self, train: Examples, *, seed: int) -> None:
        """Learn nothing."""

    def predict(self, sample: SampleView) -> Prediction:
        """Predict the nominal density of what is seen, and of what lies behind.

        Raises
        ------
        DataError
            If a part has no material of the library, no view shows any of the object, or the
            target is not the density.
        """
        if sample.target != "density":
            raise DataError(f"{self.name} knows true densities, not apparent ones")
        surface, part = _seen_parts(sample)
        known = np.zeros((1, *surface.shape), dtype=np.float32)
        known[0, surface] = np.array(nominal_densities_g_cm3(sample))[part]
        return Prediction(nearest_filled(known, surface)[0] * self._share(sample))

    def _share(self, sample: SampleView) -> Grid:
        """Share of each voxel that is taken for filled."""
        return sample.envelope


class SeenMaterialsHollow(SeenMaterials):
    """Oracle of what is seen, with the true cavities: what is left is hidden material."""

    name = "seen-materials-hollow"
    notes = "true material of the visible surface, true cavities"

    def _share(self, sample: SampleView) -> Grid:
        return sample.occupancy


def _seen_parts(sample: SampleView) -> tuple[np.ndarray, np.ndarray]:
    """Voxels at the surface that a view shows, as a mask, and the part of each in C order."""
    pictures: Pictures = sample.pictures
    meshes = sample.part_meshes
    shown = part_numbers(meshes, pictures.cameras)
    said = (whole_votes(one.astype(np.int64) - 1, len(meshes)) for one in shown)
    surface, votes = votes_at_surface(sample, pictures, said, len(meshes))
    return surface, votes.argmax(axis=1)
