"""CLIP through ``transformers``, from weights in a folder that the user names.

NeRF2Physics takes OpenCLIP ViT-B-16, ``datacomp_xl_s13b_b90k``; any CLIP in the format of
``transformers`` will do here. Nothing is downloaded.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int64, UInt8

from xden1k.errors import DataError, require
from xden_baselines.features.devices import check_device
from xden_baselines.features.encoder import half_px
from xden_baselines.features.settings import clip_source

__all__ = ["ClipEncoder", "weights_sha256"]

CLIP_MEAN = (0.48145466, 0.4578275, 0.40821073)
CLIP_DEVIATION = (0.26862954, 0.26130258, 0.27577711)
"""Of the colours CLIP was trained on, red, green, blue (Radford et al. 2021, released code)."""


class ClipEncoder:
    """CLIP's picture and text towers.

    Parameters
    ----------
    folder
        Holds ``config.json``, the weights and the tokenizer, as ``save_pretrained`` writes them.
    device
        Where it runs, as torch names it.
    stride_px
        Patches are centred on every so many pixels: a view of 320 pixels shows thousands of
        points, and ViT-B-16 takes 17.6 billion multiplications a patch.
    batch
        Patches at a time.

    Raises
    ------
    DataError
        If the folder holds no CLIP, or torch has no such device.
    MissingExtraError
        If ``transformers`` is not installed.
    """

    def __init__(
        self, folder: Path, *, device: str = "cpu", stride_px: int = 16, batch: int = 64
    ) -> None:
        transformers = require("transformers", "clip")
        _check(folder)
        check_device(device)
        try:
            model = transformers.CLIPModel.from_pretrained(folder, local_files_only=True)
            self._tokenizer = transformers.CLIPTokenizer.from_pretrained(
                folder, local_files_only=True
            )
        except (OSError, ValueError) as err:
            raise DataError(f"{folder}: no CLIP of transformers: {err}") from err
        self._model = model.eval().to(device)
        self.width: int = model.config.projection_dim
        self._device, self._batch, self.stride_px = device, batch, stride_px
        self.source = clip_source(str(folder))
        made = f"torch {torch.__version__}, transformers {transformers.__version__}"
        self.identity = f"{self.source}, batch {batch}, {device}, {made}"
        self._norm = torch.tensor([CLIP_MEAN, CLIP_DEVIATION], device=device)[..., None, None]

    def patches(
        self,
        picture: UInt8[np.ndarray, "rows columns 3"],
        mask: Bool[np.ndarray, "rows columns"],
        pixels: Int64[np.ndarray, "patches 2"],
    ) -> Float32[np.ndarray, "patches features"]:
        """Encode patches, enlarged to the size that the model takes."""
        half = half_px(mask.shape)
        channels = torch.from_numpy(np.ascontiguousarray(picture.transpose(2, 0, 1)))
        crops = [
            channels[:, row - half : row + half, column - half : column + half]
            for row, column in pixels.tolist()
        ]
        batches = [
            self._encode(torch.stack(crops[start : start + self._batch]))
            for start in range(0, len(crops), self._batch)
        ]
        return np.concatenate(batches)

    def texts(self, names: Sequence[str]) -> Float32[np.ndarray, "texts features"]:
        """Encode bare names."""
        tokens = self._tokenizer(list(names), padding=True, return_tensors="pt").to(self._device)
        with torch.inference_mode():
            return _array(self._model.get_text_features(**tokens))

    def _encode(self, crops: torch.Tensor) -> Float32[np.ndarray, "patches features"]:
        size = self._model.config.vision_config.image_size
        with torch.inference_mode():
            scaled = torch.nn.functional.interpolate(
                crops.to(self._device, torch.float32) / 255,
                size=(size, size),
                mode="bicubic",
                align_corners=False,
                antialias=True,
            ).clamp(0, 1)
            standard = (scaled - self._norm[0]) / self._norm[1]
            return _array(self._model.get_image_features(pixel_values=standard))


def _array(found: Any) -> Float32[np.ndarray, "rows features"]:
    # older versions give the tensor itself
    features = found if isinstance(found, torch.Tensor) else found.pooler_output
    return np.asarray(features.float().cpu().numpy())


def weights_sha256(folder: Path) -> str:
    """SHA-256 of the configuration and the weights.

    Raises
    ------
    DataError
        If the folder holds no CLIP.
    """
    _check(folder)
    digest = hashlib.sha256()
    for path in sorted(
        [folder / "config.json", *folder.glob("*.safetensors"), *folder.glob("*.bin")]
    ):
        with path.open("rb") as file:
            digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()


def _check(folder: Path) -> None:
    try:
        kind = json.loads((folder / "config.json").read_text(encoding="utf-8"))["model_type"]
    except (OSError, ValueError, KeyError, TypeError) as err:
        raise DataError(f"{folder}: config.json of a CLIP is expected: {err}") from err
    if kind != "clip":
        raise DataError(f"{folder}: model_type 'clip' is expected, got {kind!r}")
