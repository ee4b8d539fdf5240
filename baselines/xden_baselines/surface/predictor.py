"""The method ``surface-net``: what pictures give without weights from elsewhere."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from xden1k.predictor import Budget, Example, Examples, Prediction, SampleView
from xden1k.values.arrays import Grid
from xden1k.values.modality import Modality
from xden_baselines.gaussian_property.library import closed_list
from xden_baselines.materials import check_target
from xden_baselines.surface.matter import Matter, Seen, counted
from xden_baselines.surface.settings import Settings
from xden_baselines.views.lifting import votes_at_surface, whole_votes
from xden_baselines.views.pictures import Pictures

if TYPE_CHECKING:
    from xden_baselines.surface.network import PixelNetwork
    from xden_baselines.surface.training import FitReport

__all__ = ["SurfaceNet"]

REPORT_FILE = "training.json"
COUNTED_OBJECTS = 400
"""Training objects on which is counted what lies behind which surface, drawn by the seed."""


class SurfaceNet:
    """Names the material of every pixel, and fills the object with what lies behind it as a rule.

    A 2D U-Net learns materials on the training split's pictures, in the place of CLIP and of vision
    models; views vote on the voxels at the surface; what lies at which depth behind which
    material was counted on the training split.

    Parameters
    ----------
    settings
        Fields of :class:`Settings`.

    Raises
    ------
    DataError
        If a setting is out of its range.
    """

    name = "surface-net"
    version = "1"
    reads = Modality.GEOMETRY | Modality.RGB
    trainable = True
    external_data = False

    _network: PixelNetwork
    _matter: Matter
    _report: FitReport

    def __init__(self, **settings: Any) -> None:
        self.settings = Settings(**settings)

    @property
    def notes(self) -> str:
        """How the training went."""
        if not hasattr(self, "_report"):
            return ""
        millions = sum(one.numel() for one in self._network.parameters()) / 1e6
        return (
            f"{self._report.summary}; U-Net of {millions:.2g} million weights on pictures, "
            f"{len(self._network.materials)} materials, trained on the training split"
        )

    @property
    def network(self) -> PixelNetwork:
        """What was trained, in evaluation mode."""
        return self._network

    @property
    def fingerprint(self) -> str:
        """Checksum of the settings."""
        text = json.dumps(asdict(self.settings), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def fit(self, train: Examples, *, seed: int, budget: Budget | None = None) -> None:
        """Count what lies behind surfaces, then train the network.

        Raises
        ------
        DataError
            If targets are no true densities, or no picture shows a part of known material.
        """
        from xden_baselines.surface.lessons import lessons
        from xden_baselines.surface.training import train as train_network

        materials = closed_list(train).names
        rng = np.random.default_rng(seed)
        chosen = rng.permutation(len(train))[:COUNTED_OBJECTS].tolist()
        self._matter = counted(_surfaces(train, chosen, materials), len(materials))
        objects = [tuple(lessons(one, materials, self.settings.views, rng)) for one in train]
        self._network, self._report = train_network(
            [one for one in objects if one], materials, self.settings, seed=seed, budget=budget
        )

    def predict(self, sample: SampleView) -> Prediction:
        """Let the views vote on the surface, and fill the object from there.

        Raises
        ------
        DataError
            If no view shows any of the object, or targets are no true densities.
        """
        from xden_baselines.surface.inference import named

        check_target(sample)
        pictures: Pictures = sample.pictures
        said = named(self._network, pictures, self.settings.threads, self.settings.device)
        surface, votes = votes_at_surface(sample, pictures, said, len(self._network.materials))
        seen = Seen(surface, votes / votes.sum(axis=1, keepdims=True))
        return Prediction(self._matter.median_g_cm3(sample, seen), device=self.settings.device)

    def save(self, folder: Path) -> None:
        """Write the checkpoint, what lies behind surfaces, and the report."""
        self._network.save_pretrained(folder)
        self._matter.save(folder)
        (folder / REPORT_FILE).write_text(json.dumps(asdict(self._report), indent=2) + "\n")

    def load(self, folder: Path) -> None:
        """Take up what :meth:`save` wrote; only the settings ``threads`` and ``device`` count.

        Raises
        ------
        DataError
            If the folder does not hold it.
        """
        from xden_baselines.features.devices import check_device
        from xden_baselines.learning.checkpoint import load_pretrained, load_report
        from xden_baselines.surface.network import PixelNetwork
        from xden_baselines.surface.training import FitReport

        check_device(self.settings.device)
        self._network = load_pretrained(folder, PixelNetwork).eval().to(self.settings.device)
        self._matter = Matter.load(folder)
        self._report = load_report(folder / REPORT_FILE, FitReport)


def _surfaces(
    train: Examples, chosen: list[int], materials: tuple[str, ...]
) -> Iterator[tuple[SampleView, Seen, Grid]]:
    """Training objects with the true materials of their surfaces, if any is known."""
    for example in train.only(chosen):
        if (seen := _true_surface(example, materials)) is not None:
            yield example.sample, seen, example.density_g_cm3


def _true_surface(example: Example, materials: tuple[str, ...]) -> Seen | None:
    """Surface voxels of an object with the material that most views show there."""
    from xden_baselines.surface.lessons import UNKNOWN, of_parts, shown_materials

    pictures: Pictures = example.sample.pictures
    parts = example.truth.parts
    known = of_parts(parts, materials)
    if (known == UNKNOWN).all():
        return None
    shown = shown_materials([part.mesh for part in parts], known, pictures)
    said = (whole_votes(one, len(materials)) for one in shown)
    surface, votes = votes_at_surface(example.sample, pictures, said, len(materials))
    return Seen(surface, np.eye(len(materials))[votes.argmax(axis=1)])
