"""Patch statistics, names, the fitted encoder, and fusion over the views that see a point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.baselines.painted import BROWN, GREY, RED, camera_at, painted
from tests.phantoms import Box
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden1k.predictor import Examples
from xden1k.values.materials import load_materials
from xden1k.values.modality import Modality
from xden_baselines.features.encoder import PatchEncoder, cosines, half_px
from xden_baselines.features.fitted import FittedEncoder, fit_encoder
from xden_baselines.features.fusion import fused_features
from xden_baselines.features.names import embed_names
from xden_baselines.features.statistics import WINDOW_SHARES, patch_statistics
from xden_baselines.views.cameras import Rig
from xden_baselines.views.rendering import render
from xden_baselines.views.source import RenderedPhantoms

READS = Modality.GEOMETRY | Modality.RGB
VIEWS = RenderedPhantoms(Rig(elevations_deg=(10.0,), per_ring=4, size_px=160))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    root = tmp_path_factory.mktemp("features") / "dataset"
    low, middle, high = (0, 0, 0), (1, 2, 4), (2, 2, 4)
    objects = [
        painted(
            f"bar-000{number}",
            (
                Box("handle", low, middle, 0.7, material="wood_oak"),
                Box("head", (1, 0, 0), high, 7.8, material="steel"),
            ),
            {"handle": tuple(shade * np.array(BROWN)), "head": tuple(shade * np.array(GREY))},
            split="train",
        )
        for number, shade in enumerate((0.9, 1.0, 1.1))
    ]
    unknown = painted("cube-0001", [Box("cube", low, (1, 1, 1))], {"cube": RED}, split="val")
    write_folder([*objects, unknown], root, version="0.1.0", builder="tests")
    return open_folder(root)


def examples(folder: DatasetFolder, split: str = "train") -> Examples:
    return Examples(folder, split, READS, pictures_of=VIEWS)


@pytest.fixture(scope="module")
def encoder(folder: DatasetFolder) -> FittedEncoder:
    return fit_encoder(examples(folder), seed=3)


@given(edge=st.integers(32, 4096), longer=st.integers(0, 4096))
def test_a_patch_covers_the_same_share_of_every_picture(edge: int, longer: int) -> None:
    """56 pixels of 512, to the nearest even number of pixels."""
    half = half_px((edge + longer, edge))
    assert half == half_px((edge, edge + longer))
    assert abs(2 * half - 56 / 512 * edge) <= 1


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 10**6), filled=st.floats(0, 1))
def test_statistics_are_those_of_the_objects_pixels(seed: int, filled: float) -> None:
    """Against a loop over the pixels of each window."""
    rng = np.random.default_rng(seed)
    picture = rng.integers(0, 256, (120, 140, 3), dtype=np.uint8)
    mask = rng.random((120, 140)) < filled
    pixels = np.array([[7, 7], [113, 133], [35, 40]])
    found = patch_statistics(picture, mask, pixels)
    for (row, column), values in zip(pixels, found, strict=True):
        for which, share in enumerate(WINDOW_SHARES):
            half = half_px(mask.shape, share)
            at = np.s_[row - half : row + half, column - half : column + half]
            colors = picture[at][mask[at]] / 255
            filled, mean, deviation = np.split(values[7 * which : 7 * which + 7], [1, 4])
            assert filled == pytest.approx(len(colors) / (2 * half) ** 2, abs=1e-6)
            if len(colors):
                np.testing.assert_allclose(mean, colors.mean(axis=0), atol=1e-5)
                np.testing.assert_allclose(deviation, colors.std(axis=0), atol=1e-4)


def test_a_window_without_object_takes_the_wider_ones_values() -> None:
    picture = np.full((512, 512, 3), 255, dtype=np.uint8)
    mask = np.zeros((512, 512), dtype=bool)
    mask[:4], picture[:4] = True, [51, 102, 0]
    (values,) = patch_statistics(picture, mask, np.array([[28, 28]]))
    assert values[14] == 0  # share of the smallest window
    np.testing.assert_allclose(values[15:18], [0.2, 0.4, 0], atol=1e-6)
    np.testing.assert_allclose(values[-2:], [1 / 3, 2 / 3], atol=1e-6)


def test_light_does_not_change_the_last_two_statistics() -> None:
    mask = np.ones((56, 56), dtype=bool)
    dark = np.full((56, 56, 3), [40, 80, 20], dtype=np.uint8)
    at = np.array([[28, 28]])
    np.testing.assert_allclose(
        patch_statistics(dark, mask, at)[0, -2:], patch_statistics(3 * dark, mask, at)[0, -2:]
    )


def test_names_are_unit_vectors_and_the_same_for_every_spelling() -> None:
    vectors = embed_names(["PP", "polypropylene", "oak wood", "Oak-Wood", "unheard of"])
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, rtol=1e-6)
    np.testing.assert_array_equal(vectors[0], vectors[1])
    np.testing.assert_array_equal(vectors[2], vectors[3])


def test_names_of_a_family_are_nearer_than_strangers() -> None:
    names = list(load_materials())
    family = np.array([load_materials()[name].family for name in names])
    near = cosines(embed_names(names), embed_names(names))
    kin = family[:, None] == family
    assert near[kin & ~np.eye(len(names), dtype=bool)].mean() > 0.3
    assert np.abs(near[~kin]).mean() < 0.1
    assert cosines(embed_names(["metal"]), embed_names(["brass", "pp"]))[0] @ [1, -1] > 0.1


def test_the_fitted_encoder_tells_materials_it_was_shown(
    folder: DatasetFolder, encoder: FittedEncoder
) -> None:
    assert isinstance(encoder, PatchEncoder)
    assert encoder.source == "fitted encoder"
    (example, *_) = examples(folder)
    pictures = example.sample.pictures
    texts = encoder.texts(["steel", "wood oak", "glass soda lime"])
    margin = half_px(pictures.masks.shape[1:])
    right = total = 0
    for colors, mask in zip(pictures.colors, pictures.masks, strict=True):
        pixels = np.argwhere(mask[margin:-margin, margin:-margin])[::7] + margin
        guess = cosines(encoder.patches(colors, mask, pixels), texts).argmax(axis=1)
        red, blue = colors[pixels[:, 0], pixels[:, 1]][:, [0, 2]].astype(int).T
        right += (guess == np.where(red > 1.5 * blue, 1, 0)).sum()
        total += len(pixels)
    assert total > 500
    assert right / total > 0.97


def test_the_fitted_encoder_is_the_same_for_the_same_seed(
    folder: DatasetFolder, encoder: FittedEncoder, tmp_path: Path
) -> None:
    again, other = fit_encoder(examples(folder), seed=3), fit_encoder(examples(folder), seed=4)
    np.testing.assert_array_equal(again.weights, encoder.weights)
    assert not np.array_equal(other.weights, encoder.weights)
    encoder.save(tmp_path)
    loaded = FittedEncoder.load(tmp_path)
    for name in ("mean", "deviation", "frequencies", "phases", "weights"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(encoder, name))


def test_another_file_is_no_fitted_encoder(encoder: FittedEncoder, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"encoder\.npz: not a fitted encoder"):
        FittedEncoder.load(tmp_path)
    replace(encoder, weights=encoder.weights[:9]).save(tmp_path)
    with pytest.raises(DataError, match=r"got \{'weights': \(9, 128\)\}"):
        FittedEncoder.load(tmp_path)
    (tmp_path / "encoder.npz").write_bytes(b"PK nothing")
    with pytest.raises(DataError, match="not a fitted encoder"):
        FittedEncoder.load(tmp_path)


def test_without_a_known_material_nothing_can_be_learned(folder: DatasetFolder) -> None:
    with pytest.raises(DataError, match="split val: no picture shows a part of known material"):
        fit_encoder(examples(folder, "val"), seed=0)


class Colors:
    """Encodes a patch as the colour of its centre."""

    source = "test"
    stride_px = 1
    width = 3

    def patches(self, picture: np.ndarray, mask: np.ndarray, pixels: np.ndarray) -> np.ndarray:
        return picture[pixels[:, 0], pixels[:, 1]].astype(np.float32)

    def texts(self, names: Sequence[str]) -> np.ndarray:
        return np.zeros((len(names), 3), dtype=np.float32)


PLATE = trimesh.creation.box(bounds=[[-1, -0.1, -1], [1, 0.1, 1]])
SCREEN = trimesh.creation.box(bounds=[[-1, -2, -1], [1, -1.9, 1]])
FRONT = np.array([[0.0, -0.1, 0.0], [0.2, -0.1, 0.1]])


def test_an_occluded_camera_contributes_nothing() -> None:
    """The second camera sees a screen before the plate, and the third its back."""
    free, hidden, behind = (camera_at(at) for at in ((0.5, -1.5, 0), (0, -9, 0), (0, 9, 0)))
    pictures = render([PLATE, SCREEN], [RED, BROWN], [free, hidden, behind]).pictures
    features, views = fused_features(FRONT, pictures, Colors(), tolerance_cm=0.05)
    alone, _ = fused_features(FRONT, pictures.take([0]), Colors(), tolerance_cm=0.05)
    assert views.tolist() == [1, 1]
    np.testing.assert_array_equal(features, alone)
    assert (features[:, 0] > 4 * features[:, 1]).all()  # red, not brown
    none, views = fused_features(FRONT, pictures.take([1, 2]), Colors(), tolerance_cm=0.05)
    assert not none.any()
    assert not views.any()


def test_features_are_the_mean_over_views_in_any_order() -> None:
    cameras = [camera_at((x, -3, z)) for x, z in ((0, 0), (0.6, 0.2), (-0.4, -0.5))]
    pictures = render([PLATE], [RED], cameras).pictures
    features, views = fused_features(FRONT, pictures, Colors(), tolerance_cm=0.05)
    assert views.tolist() == [3, 3]
    each = [
        fused_features(FRONT, pictures.take([v]), Colors(), tolerance_cm=0.05)[0] for v in range(3)
    ]
    np.testing.assert_allclose(features, np.mean(each, axis=0), rtol=1e-6)
    turned, _ = fused_features(FRONT, pictures.take([2, 0, 1]), Colors(), tolerance_cm=0.05)
    np.testing.assert_allclose(turned, features, rtol=1e-6)


def test_patches_of_one_stride_are_encoded_once() -> None:
    class Counting(Colors):
        stride_px = 8
        asked = 0

        def patches(self, picture: np.ndarray, mask: np.ndarray, pixels: np.ndarray) -> np.ndarray:
            half = half_px(mask.shape)
            assert (pixels >= half).all()
            assert (pixels <= np.array(mask.shape) - half).all()
            self.asked += len(pixels)
            return super().patches(picture, mask, pixels)

    points = np.stack([np.linspace(-0.9, 0.9, 500), np.full(500, -0.1), np.zeros(500)], axis=1)
    pictures = render([PLATE], [RED], [camera_at((0, -4, 0))]).pictures
    encoder = Counting()
    _, views = fused_features(points, pictures, encoder, tolerance_cm=0.05)
    assert views.all()
    # 46 pixels of one row
    assert 5 <= encoder.asked <= 8
