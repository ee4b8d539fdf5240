"""A small encoder that learns on the training split what materials look like.

Ridge regression from random Fourier features of a patch's statistics to the vector of its
material's name. It stands in for CLIP where no weights are at hand, and every row says so: it has
seen this dataset's colours, so nothing it does is zero-shot.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float32, Int64, UInt8

from xden1k.errors import DataError
from xden1k.predictor import Example, Examples
from xden1k.values.types import Part
from xden_baselines.features.encoder import half_px
from xden_baselines.features.names import NAME_FEATURES, embed_names
from xden_baselines.features.statistics import STATISTICS, patch_statistics
from xden_baselines.views.pictures import Pictures
from xden_baselines.views.rendering import Surface

__all__ = ["FittedEncoder", "fit_encoder"]

TRAINING_OBJECTS, PATCHES_PER_OBJECT = 500, 480
WAVES = 256
"""Random Fourier features."""
LENGTH = 3.0
"""Of the kernel they stand for, in standard deviations of the statistics."""
RIDGE = 1e-4
"""Penalty on the weights, for each training patch."""
BLOCK = 16384
FILE = "encoder.npz"


@dataclass(frozen=True, slots=True, eq=False)
class FittedEncoder:
    """What :func:`fit_encoder` learned.

    Parameters
    ----------
    mean, deviation
        Of each statistic over the training patches.
    frequencies, phases
        Of the random Fourier features.
    weights
        From these features, and a constant, to the vectors of names.
    """

    mean: Float32[np.ndarray, "statistics"]
    deviation: Float32[np.ndarray, "statistics"]
    frequencies: Float32[np.ndarray, "statistics waves"]
    phases: Float32[np.ndarray, "waves"]
    weights: Float32[np.ndarray, "terms features"]

    source = "fitted encoder"
    stride_px = 2
    width = NAME_FEATURES

    def patches(
        self,
        picture: UInt8[np.ndarray, "rows columns 3"],
        mask: Bool[np.ndarray, "rows columns"],
        pixels: Int64[np.ndarray, "patches 2"],
    ) -> Float32[np.ndarray, "patches features"]:
        """Predict the vector of the name of what each patch shows."""
        waves = self._waves(patch_statistics(picture, mask, pixels))
        return np.asarray(waves @ self.weights)

    def texts(self, names: Sequence[str]) -> Float32[np.ndarray, "texts features"]:
        """Return the vectors of names."""
        return embed_names(names)

    def save(self, folder: Path) -> None:
        """Write what was learned into a folder."""
        np.savez(folder / FILE, **{one.name: getattr(self, one.name) for one in fields(self)})

    @classmethod
    def load(cls, folder: Path) -> FittedEncoder:
        """Read what :meth:`save` wrote.

        Raises
        ------
        DataError
            If the file is missing or another encoder's.
        """
        shapes = {
            "mean": (STATISTICS,),
            "deviation": (STATISTICS,),
            "frequencies": (STATISTICS, WAVES),
            "phases": (WAVES,),
            "weights": (WAVES + 1, NAME_FEATURES),
        }
        try:
            with np.load(folder / FILE, allow_pickle=False) as found:
                arrays = {name: found[name] for name in shapes}
        except (OSError, KeyError, ValueError) as err:
            raise DataError(f"{folder / FILE}: not a fitted encoder: {err}") from err
        if wrong := {n: a.shape for n, a in arrays.items() if a.shape != shapes[n]}:
            raise DataError(f"{folder / FILE}: expected shapes {shapes}, got {wrong}")
        return cls(**arrays)

    def _waves(
        self, statistics: Float32[np.ndarray, "patches statistics"]
    ) -> Float32[np.ndarray, "patches terms"]:
        standard = (statistics - self.mean) / self.deviation
        return _waves(standard, self.frequencies, self.phases)


def fit_encoder(train: Examples, *, seed: int) -> FittedEncoder:
    """Learn from the pictures of the training split and the materials of the parts they show.

    Parameters
    ----------
    train
        Examples whose samples have pictures.
    seed
        Which objects and patches are drawn, and which Fourier features.

    Raises
    ------
    DataError
        If no picture shows a part of known material.
    """
    rng = np.random.default_rng(seed)
    chosen = rng.permutation(len(train))[:TRAINING_OBJECTS].tolist()
    drawn = [found for example in train.only(chosen) for found in _training_patches(example, rng)]
    if not drawn:
        raise DataError(f"split {train.split}: no picture shows a part of known material")
    statistics = np.concatenate([found for found, _ in drawn])
    names = [name for _, labels in drawn for name in labels]
    mean, deviation = statistics.mean(axis=0), statistics.std(axis=0)
    deviation = np.where(deviation > 1e-6, deviation, 1).astype(np.float32)
    frequencies = (rng.standard_normal((STATISTICS, WAVES)) / LENGTH).astype(np.float32)
    phases = rng.uniform(0, 2 * np.pi, WAVES).astype(np.float32)
    standard = (statistics - mean) / deviation
    weights = _ridge(standard, frequencies, phases, embed_names(names))
    return FittedEncoder(mean, deviation, frequencies, phases, weights)


def _training_patches(
    example: Example, rng: np.random.Generator
) -> Iterator[tuple[Float32[np.ndarray, "patches 23"], list[str]]]:
    """Draw patches from each view of an object, and name what they show."""
    pictures: Pictures = example.sample.pictures
    parts = example.truth.parts
    surface = Surface(np.concatenate([np.asarray(part.mesh.triangles) for part in parts]))
    part_of_face = np.repeat(np.arange(len(parts)), [len(part.mesh.faces) for part in parts])
    margin, wanted = half_px(pictures.masks.shape[1:]), -(-PATCHES_PER_OBJECT // len(pictures))
    for view, camera in enumerate(pictures.cameras):
        mask = pictures.masks[view]
        pixels = np.argwhere(mask[margin:-margin, margin:-margin]) + margin
        if not len(pixels):
            continue
        pixels = pixels[rng.choice(len(pixels), size=min(wanted, len(pixels)), replace=False)]
        rays = camera.rays_through(pixels[:, 0], pixels[:, 1])
        faces, _ = surface.first_hits(camera.position_cm, rays)
        known, names = _named(parts, part_of_face, faces)
        if names:
            yield patch_statistics(pictures.colors[view], mask, pixels[known]), names


def _named(
    parts: Sequence[Part], part_of_face: np.ndarray, faces: np.ndarray
) -> tuple[Bool[np.ndarray, "patches"], list[str]]:
    """Which patches show a part of known material, and its name."""
    materials = ["" if face < 0 else parts[part_of_face[face]].material for face in faces]
    return np.array([bool(name) for name in materials]), [name for name in materials if name]


def _waves(
    standard: Float32[np.ndarray, "patches statistics"],
    frequencies: Float32[np.ndarray, "statistics waves"],
    phases: Float32[np.ndarray, "waves"],
) -> Float32[np.ndarray, "patches terms"]:
    """Random Fourier features (Rahimi and Recht, NIPS 2007), and a constant."""
    waves = np.cos(standard @ frequencies + phases) * np.float32(np.sqrt(2 / len(phases)))
    return np.concatenate([waves, np.ones((len(waves), 1), dtype=np.float32)], axis=1)


def _ridge(
    standard: Float32[np.ndarray, "patches statistics"],
    frequencies: Float32[np.ndarray, "statistics waves"],
    phases: Float32[np.ndarray, "waves"],
    targets: Float32[np.ndarray, "patches features"],
) -> Float32[np.ndarray, "terms features"]:
    """Solve the normal equations, added up in blocks to keep memory small."""
    size = len(phases) + 1
    gram, right = np.zeros((size, size)), np.zeros((size, targets.shape[1]))
    for start in range(0, len(standard), BLOCK):
        block = slice(start, start + BLOCK)
        waves = _waves(standard[block], frequencies, phases).astype(np.float64)
        gram += waves.T @ waves
        right += waves.T @ targets[block]
    gram += RIDGE * len(standard) * np.eye(size)
    return np.asarray(np.linalg.solve(gram, right), dtype=np.float32)
