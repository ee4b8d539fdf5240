"""What an encoder makes of the pictures, for each voxel, in a few numbers.

Pixie gives its networks 768 features of CLIP; here they are averaged over the views that see a
voxel, and reduced to their principal components on the training split.
"""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float32
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from xden1k.access.samples import Examples, SampleView
from xden1k.errors import DataError
from xden_baselines.features.encoder import PatchEncoder
from xden_baselines.features.fusion import fused_features
from xden_baselines.geometry import SKIN, near_surface, nearest_filled, voxel_centres_cm
from xden_baselines.pixie.channels import Channels

__all__ = ["FILE", "Descriptors"]

FILE = "descriptors.safetensors"
WIDTH = 32
"""Principal components at most."""
TRAINING_OBJECTS = 50
"""The components are those of so many training objects, drawn by the seed; held-out ones apart."""


@dataclass(frozen=True, slots=True, eq=False)
class Descriptors:
    """Features of an encoder along their principal components.

    Parameters
    ----------
    encoder
        Makes features of patches.
    mean
        Shape (features,): of the voxels they were learned from.
    components
        Shape (components, features), of length 1, the strongest first.
    """

    encoder: PatchEncoder
    mean: Float32[np.ndarray, "features"]
    components: Float32[np.ndarray, "components features"]

    @classmethod
    def fit(
        cls, train: Examples, encoder: PatchEncoder, *, seed: int, held_out: Set[int] = frozenset()
    ) -> Descriptors:
        """Learn the components.

        Parameters
        ----------
        train, encoder
            Pictures, and what makes features of them.
        seed
            Which objects are looked at.
        held_out
            Numbers of the objects that are not.

        Raises
        ------
        DataError
            If the pictures of an object show no voxel with its whole patch.
        """
        order = np.random.default_rng(seed).permutation(len(train)).tolist()
        chosen = [number for number in order if number not in held_out][:TRAINING_OBJECTS]
        count, total = 0, np.zeros(encoder.width)
        products = np.zeros((encoder.width, encoder.width))
        for example in train.only(chosen):
            _, found, seen = _seen(example.sample, encoder)
            features = found[seen].astype(np.float64)
            count += len(features)
            total += features.sum(axis=0)
            products += features.T @ features
        mean = total / count
        _, axes = np.linalg.eigh(products / count - np.outer(mean, mean))
        strongest = axes.T[::-1][:WIDTH]
        return cls(encoder, mean.astype(np.float32), strongest.astype(np.float32))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels."""
        return tuple(f"feature_{number + 1}" for number in range(len(self.components)))

    def channels(self, sample: SampleView) -> Channels:
        """Give each voxel the components of what is seen of it, or of its nearest seen voxel.

        Raises
        ------
        DataError
            If the pictures show no voxel with its whole patch.
        """
        near, features, seen = _seen(sample, self.encoder)
        grids = np.zeros((len(self.components), *near.shape), dtype=np.float32)
        grids[:, near] = self.components @ (features - self.mean).T
        known = np.zeros(near.shape, dtype=bool)
        known[near] = seen
        return np.asarray(nearest_filled(grids, known) * (sample.envelope > 0))

    def save(self, folder: Path) -> None:
        """Write what was learned, and from which encoder."""
        values = {"mean": self.mean, "components": np.ascontiguousarray(self.components)}
        save_file(values, folder / FILE, metadata={"source": self.encoder.source})

    @classmethod
    def load(cls, folder: Path, encoder: PatchEncoder) -> Descriptors:
        """Read what :meth:`save` wrote.

        Raises
        ------
        DataError
            If the file is missing or damaged, or tells of another encoder.
        """
        path = folder / FILE
        try:
            with safe_open(path, framework="numpy") as found:
                source = (found.metadata() or {}).get("source")
                mean, components = found.get_tensor("mean"), found.get_tensor("components")
        except (SafetensorError, OSError) as err:
            raise DataError(f"{path}: no descriptors: {err}") from err
        if source != encoder.source:
            raise DataError(f"{path}: made with {source}, not with {encoder.source}")
        if mean.shape != (encoder.width,) or components.shape[1:] != mean.shape:
            raise DataError(
                f"{path}: expected {encoder.width} features, got {mean.shape}, {components.shape}"
            )
        return cls(encoder, mean, components)


def _seen(
    sample: SampleView, encoder: PatchEncoder
) -> tuple[
    Bool[np.ndarray, "x y z"], Float32[np.ndarray, "near features"], Bool[np.ndarray, "near"]
]:
    """Voxels near the surface, the features of each, and which of them some view shows."""
    near = near_surface(sample)
    features, views = fused_features(
        voxel_centres_cm(sample, near),
        sample.pictures,
        encoder,
        tolerance_cm=SKIN * sample.voxel_size_cm,
    )
    if not views.any():
        raise DataError(f"{sample.object_id}: no view shows a voxel with its whole patch")
    return near, features, views > 0
