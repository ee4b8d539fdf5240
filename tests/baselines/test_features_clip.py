"""CLIP from a folder: a tiny model with random weights, in the format of the real ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from tests.baselines.tiny_clip import FEATURES, tiny_clip
from xden1k.errors import DataError
from xden_baselines.features.clip import ClipEncoder
from xden_baselines.features.encoder import PatchEncoder, half_px


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_clip(tmp_path_factory.mktemp("clip") / "tiny")


@pytest.fixture(scope="module")
def encoder(weights: Path) -> ClipEncoder:
    return ClipEncoder(weights, batch=2)


def picture(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (120, 100, 3), dtype=np.uint8)


MASK = np.ones((120, 100), dtype=bool)
PIXELS = np.array([[28, 28], [60, 50], [92, 72], [60, 50], [40, 40]])


def test_patches_are_encoded_one_row_each(encoder: ClipEncoder) -> None:
    assert isinstance(encoder, PatchEncoder)
    found = encoder.patches(picture(), MASK, PIXELS)
    assert found.shape == (5, FEATURES) == (5, encoder.width)
    np.testing.assert_allclose(found[1], found[3], rtol=1e-5)
    assert np.abs(found[0] - found[2]).max() > 1e-4


def test_a_patch_is_its_pixels_and_nothing_else(encoder: ClipEncoder) -> None:
    at = np.array([[60, 50]])
    one, other = picture(0), picture(1)
    half = half_px(MASK.shape)
    inside = np.s_[60 - half : 60 + half, 50 - half : 50 + half]
    mixed = other.copy()
    mixed[inside] = one[inside]
    expected = encoder.patches(one, MASK, at)
    np.testing.assert_array_equal(encoder.patches(mixed, MASK, at), expected)
    mixed[60 - half, 50 - half] ^= 255
    assert not np.array_equal(encoder.patches(mixed, MASK, at), expected)


def test_patches_are_scaled_and_standardised_as_clip_was_trained(
    weights: Path, encoder: ClipEncoder
) -> None:
    """A patch of one colour stays one colour whatever the enlargement."""
    from transformers import CLIPModel

    color = np.array([200, 100, 50], dtype=np.uint8)
    plain = np.broadcast_to(color, (60, 60, 3)).copy()
    found = encoder.patches(plain, np.ones((60, 60), dtype=bool), np.array([[30, 30]]))
    mean = [0.48145466, 0.4578275, 0.40821073]
    deviation = [0.26862954, 0.26130258, 0.27577711]
    standard = torch.tensor((color / 255 - mean) / deviation, dtype=torch.float32)
    pixels = standard[None, :, None, None].expand(1, 3, 32, 32)
    model = CLIPModel.from_pretrained(weights).eval()
    with torch.inference_mode():
        expected = model.visual_projection(model.vision_model(pixel_values=pixels).pooler_output)
    np.testing.assert_allclose(found, expected.numpy(), rtol=1e-4, atol=1e-6)


def test_a_name_has_the_same_features_beside_longer_ones(encoder: ClipEncoder) -> None:
    both = encoder.texts(["steel", "stainlesssteelsheet"])
    assert both.shape == (2, FEATURES)
    np.testing.assert_allclose(encoder.texts(["steel"])[0], both[0], rtol=1e-4, atol=1e-6)
    assert np.abs(both[0] - both[1]).max() > 1e-4


def test_the_row_tells_the_weights_apart(weights: Path, encoder: ClipEncoder) -> None:
    assert encoder.source.startswith("CLIP tiny ")
    config = weights / "config.json"
    before = config.read_text()
    try:
        config.write_text(before + "\n")
        assert ClipEncoder(weights).source != encoder.source
    finally:
        config.write_text(before)


def test_a_folder_without_clip_is_named(weights: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"config\.json of a CLIP is expected"):
        ClipEncoder(tmp_path)
    (tmp_path / "config.json").write_text('{"model_type": "bert"}')
    with pytest.raises(DataError, match="model_type 'clip' is expected, got 'bert'"):
        ClipEncoder(tmp_path)
    (tmp_path / "config.json").write_text((weights / "config.json").read_text())
    with pytest.raises(DataError, match=r"no CLIP of transformers"):
        ClipEncoder(tmp_path)


def test_a_device_that_is_not_there_is_told(weights: Path) -> None:
    with pytest.raises(DataError, match="torch has no device 'abacus' here"):
        ClipEncoder(weights, device="abacus")


def test_its_identity_tells_weights_batch_and_device(weights: Path, tmp_path: Path) -> None:
    others = [ClipEncoder(weights, batch=3), ClipEncoder(tiny_clip(tmp_path / "tiny", seed=1))]
    assert len({one.identity for one in (ClipEncoder(weights), *others)}) == 3
    assert "cpu" in others[0].identity
