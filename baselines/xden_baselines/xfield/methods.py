"""The methods: one for each variant. torch is imported by what needs it, not here."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from jaxtyping import Float32, Float64, UInt8

from xden1k.access.samples import Examples, SampleView
from xden1k.errors import DataError, about
from xden1k.predictor import Budget, Prediction
from xden1k.segmentation import CLUSTER_COUNTS, Segmentation, SegmentPoints
from xden1k.values.arrays import Points
from xden1k.values.modality import Modality
from xden_baselines.xfield.clusters import free_clusters, segmentation
from xden_baselines.xfield.settings import Settings

if TYPE_CHECKING:
    from xden_baselines.xfield.crew import Crew
    from xden_baselines.xfield.network import XField
    from xden_baselines.xfield.training import FitReport

__all__ = [
    "XFieldBoth",
    "XFieldGeometryContrastive",
    "XFieldGeometryDensity",
    "XFieldPaper",
    "XFieldPixel",
    "XFieldRays",
    "XFieldVoxel",
]

REPORT_FILE = "training.json"
PAPER_PARTS = ("scale", "attention", "third")
"""What can be left out of the paper's network."""


class Segmenting:
    """A network on points: what all variants have in common.

    Parameters
    ----------
    settings
        Fields of :class:`Settings`.

    Raises
    ------
    DataError
        If a setting is out of its range.
    """

    version = "1"
    trainable = True
    external_data = False
    reads = Modality.GEOMETRY | Modality.XRAY
    name: ClassVar[str]
    variant: str

    _model: XField
    _report: FitReport

    def __init__(self, **settings: Any) -> None:
        self.settings = Settings(**settings)

    @property
    def notes(self) -> str:
        """How the training went and what was trained."""
        if not hasattr(self, "_report"):
            return ""
        return f"{self._report.summary}; {self._model.summary}, trained on the training split"

    @property
    def fingerprint(self) -> str:
        """Checksum of the settings and the variant."""
        text = json.dumps(asdict(self.settings) | {"variant": self.variant}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def fit(self, train: Examples, *, seed: int, budget: Budget | None = None) -> None:
        """Prepare what is seen and known of every object, then train; both can be interrupted.

        An object so thin that none of the points lies inside teaches nothing and is left out.

        Raises
        ------
        DataError
            If a part has no known density or attenuation, a radiograph does not show its object, or
            there are fewer than two objects.
        """
        from xden_baselines.xfield.crew import ALONE

        self._model, self._report = self._trained(train, seed, budget, ALONE, keep=False)

    def train_ahead(
        self, train: Examples, *, seed: int, budget: Budget | None, crew: Crew
    ) -> FitReport:
        """Train in one of several processes, and leave the training in the user's cache.

        The next :meth:`fit` with the same settings, objects, seed and budget takes it up from its
        end.

        Raises
        ------
        DataError
            As :meth:`fit`, or if there are several processes and the budget is in seconds.
        """
        return self._trained(train, seed, budget, crew, keep=True)[1]

    def _trained(
        self, train: Examples, seed: int, budget: Budget | None, crew: Crew, *, keep: bool
    ) -> tuple[XField, FitReport]:
        from xden_baselines.xfield.lessons import cache, kept_lesson
        from xden_baselines.xfield.sizes import SIZES
        from xden_baselines.xfield.training import train as train_network

        kept = cache()
        lessons = []
        with crew.first_one_first():
            for example in train:
                with about(example.sample.object_id):
                    lessons.append(kept_lesson(example, SIZES[self.settings.size], kept))
        return train_network(
            [lesson for lesson in lessons if len(lesson.voxels)],
            self.variant,
            train.target,
            self.settings,
            seed=seed,
            budget=budget,
            kept=kept,
            crew=crew,
            keep=keep,
        )

    def segment(self, sample: SampleView, points: SegmentPoints) -> Segmentation:
        """Divide points by embedding, density and rays, or by whichever of them the variant has."""
        from xden_baselines.xfield.inference import answers

        if not len(points):
            return Segmentation(np.zeros((len(CLUSTER_COUNTS), 0), np.uint8), np.zeros(0, np.uint8))
        said = answers(self._model, sample, points.points_cm, self.settings)
        return segmentation(*said, self._along_rays(sample, points.points_cm))

    def _along_rays(
        self, sample: SampleView, points_cm: Points
    ) -> Float64[np.ndarray, "points"] | None:
        """Mean attenuation along the rays of points, for a variant that sees them and has parts."""
        from xden_baselines.xray import mean_lac_per_cm

        variant = self._model.variant
        return mean_lac_per_cm(sample, points_cm) if variant.xray and variant.parts else None

    def save(self, folder: Path) -> None:
        """Write the checkpoint (``model.safetensors``, ``config.json``) and the report."""
        self._model.save_pretrained(folder)
        (folder / REPORT_FILE).write_text(json.dumps(asdict(self._report), indent=2) + "\n")

    def load(self, folder: Path) -> None:
        """Take up a checkpoint; only the settings ``threads`` and ``device`` still count.

        Raises
        ------
        DataError
            If the folder does not hold one of this variant.
        """
        from xden_baselines.features.devices import check_device
        from xden_baselines.learning.checkpoint import load_report
        from xden_baselines.xfield.checkpoint import load_model
        from xden_baselines.xfield.training import FitReport

        check_device(self.settings.device)
        self._model = load_model(folder, self.variant).to(self.settings.device)
        self._report = load_report(folder / REPORT_FILE, FitReport)
        if (found := self._report.variant) != self.variant:
            path = folder / REPORT_FILE
            raise DataError(f"{path}: expected the variant {self.variant!r}, got {found!r}")


class Predicting(Segmenting):
    """A variant that gives densities too."""

    def clusters(
        self, sample: SampleView, points_cm: Points
    ) -> tuple[UInt8[np.ndarray, "points"], Float32[np.ndarray, "points"]]:
        """Divide points into as many clusters as tell enough, and give the density of each point.

        Parameters
        ----------
        sample
            The object.
        points_cm
            Shape (points, 3), at least one: inside its outer surface.

        Raises
        ------
        DataError
            If a radiograph does not show the object.
        """
        from xden_baselines.xfield.inference import answers

        density, embedding = answers(self._model, sample, points_cm, self.settings)
        along = self._along_rays(sample, points_cm)
        return free_clusters(density, embedding, along), density[:, 0]

    def predict(self, sample: SampleView) -> Prediction:
        """Integrate the density over eight points of each voxel.

        Raises
        ------
        DataError
            If the network was trained on another target.
        """
        from xden_baselines.xfield.inference import predicted_g_cm3

        if sample.target != self._model.target:
            raise DataError(f"{self.name} learned {self._model.target}, not {sample.target}")
        grid = predicted_g_cm3(self._model, sample, self.settings)
        return Prediction(grid, device=self.settings.device)


class XFieldGeometryDensity(Predicting):
    """X-Field without X-rays: density from the outer surface alone."""

    name = "x-field-geometry-density"
    variant = "geometry-density"
    reads = Modality.GEOMETRY


class XFieldGeometryContrastive(Segmenting):
    """X-Field without X-rays: parts from the outer surface alone, as PartField learns them."""

    name = "x-field-geometry-contrastive"
    variant = "geometry-contrastive"
    reads = Modality.GEOMETRY


class XFieldPaper(Predicting):
    """X-Field as the paper has it: cross-attention to radiographs, scale, third view.

    Parameters
    ----------
    without
        ``scale``, ``attention`` or ``third``: it lacks this, to see what it is worth.
    settings
        Fields of :class:`Settings`.

    Raises
    ------
    DataError
        If it is none of these, or a setting is out of its range.
    """

    name = "x-field-paper"
    variant = "cross"

    def __init__(self, *, without: str = "", **settings: Any) -> None:
        super().__init__(**settings)
        if without:
            if without not in PAPER_PARTS:
                raise DataError(f"without must be one of {list(PAPER_PARTS)}, got {without!r}")
            self.variant = f"{self.variant}-no-{without}"


class XFieldPixel(Predicting):
    """X-Field, pixel-aligned: each point is told what the radiographs show where it projects to."""

    name = "x-field"
    variant = "pixel"
    version = "2"


class XFieldBoth(Predicting):
    """X-Field, pixel-aligned and with cross-attention."""

    name = "x-field-both"
    variant = "both"
    version = "2"


class XFieldRays(Predicting):
    """X-Field without an encoder of radiographs: points are told their own two rays alone."""

    name = "x-field-rays"
    variant = "rays"
    version = "2"


class XFieldVoxel(Predicting):
    """X-Field with a 3D U-Net on back-projected radiographs in place of the triplane."""

    name = "x-field-voxel"
    variant = "voxel"
    version = "2"
