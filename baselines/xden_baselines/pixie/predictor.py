"""The methods that train a 3D network: Pixie style on pictures, and relatives on other inputs."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from xden1k.access.samples import Examples, SampleView
from xden1k.errors import DataError
from xden1k.predictor import Budget, Prediction
from xden1k.values.arrays import Grid
from xden1k.values.modality import Modality
from xden_baselines.chat.zero_shot import lacking
from xden_baselines.features.settings import clip_folder, clip_sha256, open_clip
from xden_baselines.pixie.settings import Settings

if TYPE_CHECKING:
    from xden_baselines.features.encoder import PatchEncoder
    from xden_baselines.pixie.channels import Channels
    from xden_baselines.pixie.descriptors import Descriptors
    from xden_baselines.pixie.model import VoxelModel
    from xden_baselines.pixie.training import FitReport

__all__ = [
    "ColourUNet",
    "ColourUNetFull",
    "GeometryUNet",
    "PixieStyle",
    "PixieStyleFull",
    "XRayUNet",
]

REPORT_FILE = "training.json"
FULL = Settings(size="full", resolution=64, epochs=100, learning_rate=1e-4, device="cuda")


class _Trained:
    """A network on voxels: what the methods have in common.

    Parameters
    ----------
    settings
        Fields of :class:`Settings`.

    Raises
    ------
    DataError
        If a setting is out of its range.
    """

    version = "3"
    trainable = True
    external_data = False
    reads = Modality.GEOMETRY | Modality.CATEGORY
    default = Settings()

    _model: VoxelModel
    _report: FitReport

    def __init__(self, **settings: Any) -> None:
        self.settings = replace(self.default, **settings)

    @property
    def notes(self) -> str:
        """How the training went and what was trained."""
        if not hasattr(self, "_report"):
            return ""
        return f"{self._report.summary}; {self._model.summary}, trained on the training split"

    @property
    def fingerprint(self) -> str:
        """Checksum of the settings."""
        text = json.dumps(asdict(self.settings), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def fit(self, train: Examples, *, seed: int, budget: Budget | None = None) -> None:
        """Prepare the channels of every object, then train."""
        from xden_baselines.pixie.store import stored
        from xden_baselines.pixie.training import train as train_network

        resolution = self.settings.resolution
        objects = [stored(example, self._seen(example.sample), resolution) for example in train]
        self._model, self._report = train_network(
            objects, self._names, self.settings, seed=seed, budget=budget
        )

    def predict(self, sample: SampleView) -> Prediction:
        """Predict at the network's resolution, then between its voxels, inside the envelope."""
        from xden_baselines.pixie.inference import predicted_g_cm3

        density = predicted_g_cm3(
            self._model,
            self._seen(sample),
            sample.category,
            self.settings.threads,
            self.settings.device,
        )
        filled: Grid = density * sample.envelope.astype(np.float32)
        return Prediction(filled, device=self.settings.device)

    def save(self, folder: Path) -> None:
        """Write the checkpoint (``model.safetensors``, ``config.json``) and the report."""
        self._model.save_pretrained(folder)
        (folder / REPORT_FILE).write_text(json.dumps(asdict(self._report), indent=2) + "\n")

    def load(self, folder: Path) -> None:
        """Take up a checkpoint; only the settings ``threads`` and ``device`` still count.

        Raises
        ------
        DataError
            If the folder does not hold one of this method.
        """
        from xden_baselines.features.devices import check_device
        from xden_baselines.learning.checkpoint import load_report
        from xden_baselines.pixie.checkpoint import load_model
        from xden_baselines.pixie.training import FitReport

        check_device(self.settings.device)
        self._model = load_model(folder, self._names).to(self.settings.device)
        self._report = load_report(folder / REPORT_FILE, FitReport)

    @property
    def _names(self) -> tuple[str, ...]:
        """Names of the channels that the network sees."""
        from xden_baselines.pixie.channels import channel_names

        return channel_names(self.reads)

    def _seen(self, sample: SampleView) -> Channels:
        """Make the channels of a sample."""
        from xden_baselines.pixie.channels import channels

        return channels(sample)


class GeometryUNet(_Trained):
    """3D U-Net on shape and category, trained on the training split."""

    name = "geometry-unet"


class ColourUNet(_Trained):
    """3D U-Net on shape, category and colours, trained on the training split."""

    name = "colour-unet"
    reads = _Trained.reads | Modality.RGB


class ColourUNetFull(ColourUNet):
    """colour-unet at the size of Pixie's, 53 million weights with a material head; for GPUs."""

    name = "colour-unet-full"
    default = FULL


class PixieStyle(ColourUNet):
    """Pixie style: as colour-unet, and CLIP's features of the pictures. Needs CLIP's weights.

    Parameters
    ----------
    clip
        Folder with the weights; by default that of ``XDEN_CLIP``.
    settings
        Fields of :class:`Settings`.
    """

    name = "pixie-style"
    external_data = True

    _descriptors: Descriptors | None = None

    def __init__(self, *, clip: str | None = None, **settings: Any) -> None:
        super().__init__(**settings)
        self._clip = clip_folder(clip)

    @property
    def notes(self) -> str:
        """How the training went, what was trained, whose features it saw, and what Pixie has."""
        if self._descriptors is None:
            return super().notes
        parts = {
            "its field of CLIP's features (those of patches are averaged)": True,
            "labels by vision-language models (the truth teaches)": True,
            "its size": self.settings.size != FULL.size,
        }
        return f"{super().notes}; {self._descriptors.encoder.source}; {lacking('Pixie', parts)}"

    @property
    def fingerprint(self) -> str:
        """Checksum of the settings, and of CLIP's weights."""
        return f"{super().fingerprint} {clip_sha256(self._clip)}".strip()

    def fit(self, train: Examples, *, seed: int, budget: Budget | None = None) -> None:
        """Learn how CLIP's features are reduced; then as the others.

        Raises
        ------
        DataError
            If there are no weights.
        """
        from xden_baselines.features.devices import check_device
        from xden_baselines.learning.clock import torch_threads
        from xden_baselines.learning.held_out import held_out_numbers
        from xden_baselines.pixie.descriptors import Descriptors

        self._check_weights()
        check_device(self.settings.device)
        rng = np.random.default_rng(seed)
        held_out = held_out_numbers(len(train), self.settings.held_out, rng)
        with torch_threads(self.settings.threads):
            self._descriptors = Descriptors.fit(
                train, self._encoder(), seed=seed, held_out=held_out
            )
        super().fit(train, seed=seed, budget=budget)

    def save(self, folder: Path) -> None:
        """Write the checkpoint and the report, and how features are reduced."""
        super().save(folder)
        if self._descriptors:
            self._descriptors.save(folder)

    def load(self, folder: Path) -> None:
        """Take up a checkpoint; only the settings ``threads`` and ``device`` still count.

        Raises
        ------
        DataError
            If the folder does not hold one of this method, learned with the same CLIP, or there
            are no weights.
        """
        from xden_baselines.features.devices import check_device
        from xden_baselines.learning.checkpoint import check_files
        from xden_baselines.pixie.descriptors import FILE, Descriptors

        self._check_weights()
        check_device(self.settings.device)
        check_files(folder)
        if not (folder / FILE).is_file():
            raise DataError(f"{folder}: learned without features of CLIP: by {ColourUNet.name}")
        self._descriptors = Descriptors.load(folder, self._encoder())
        super().load(folder)

    @property
    def _names(self) -> tuple[str, ...]:
        return super()._names + (self._descriptors.names if self._descriptors else ())

    def _seen(self, sample: SampleView) -> Channels:
        seen = super()._seen(sample)
        if self._descriptors is None:
            return seen
        from xden_baselines.learning.clock import torch_threads

        with torch_threads(self.settings.threads):
            return np.concatenate([seen, self._descriptors.channels(sample)])

    def _encoder(self) -> PatchEncoder:
        return open_clip(self._clip, self.settings.device)

    def _check_weights(self) -> None:
        if not self._clip:
            raise DataError(
                f"{self.name} sees features of CLIP: name the folder with its weights in XDEN_CLIP "
                f"or by --set clip=FOLDER; without weights the same network is {ColourUNet.name}"
            )


class PixieStyleFull(PixieStyle):
    """pixie-style at the published size, 53 million weights with a material head; for GPUs."""

    name = "pixie-style-full"
    default = FULL


class XRayUNet(_Trained):
    """3D U-Net on shape, category and back-projected radiographs, trained on the training split."""

    name = "xray-unet"
    reads = _Trained.reads | Modality.XRAY
    # the rays come along two directions, which must stay those of the radiographs
    default = Settings(turned="mirrored")
