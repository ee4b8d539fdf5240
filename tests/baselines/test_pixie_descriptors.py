"""Features of an encoder for each voxel: which ones, their components, and CLIP from end to end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from tests.baselines.pixie_scenes import Altered, backwards, dataset, same_in_black
from tests.baselines.tiny_clip import FEATURES, tiny_clip
from xden1k.access.samples import Examples, SampleView
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.predictor import Budget
from xden_baselines.learning.checkpoint import FILES as CHECKPOINT
from xden_baselines.pixie import ColourUNet, PixieStyle
from xden_baselines.pixie.descriptors import FILE, Descriptors
from xden_baselines.views.cameras import Rig
from xden_baselines.views.pictures import Pictures
from xden_baselines.views.source import RenderedPhantoms

LARGE = RenderedPhantoms(Rig(elevations_deg=(-40.0, 35.0), per_ring=3, size_px=160))
"""Six pictures in which whole patches of the object lie."""
TINY = {"resolution": 16, "epochs": 2, "batch": 2}
READS = PixieStyle.reads


@dataclass(frozen=True)
class MeanColor:
    """Features of a patch: three mixtures of its middle pixel's colour, the first the strongest."""

    source: str = "mean colour"
    width: int = 3
    stride_px: int = 1

    def patches(self, picture: np.ndarray, mask: np.ndarray, pixels: np.ndarray) -> np.ndarray:
        rgb = picture[pixels[:, 0], pixels[:, 1]].astype(np.float32) / 255
        return rgb * np.float32([100, 1, 0.01])

    def texts(self, names: Sequence[str]) -> np.ndarray:
        raise AssertionError("voxels ask for no names")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    return dataset(tmp_path_factory.mktemp("descriptors") / "dataset")


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(tiny_clip(tmp_path_factory.mktemp("clip") / "tiny"))


def train(folder: DatasetFolder) -> Examples:
    return Examples(folder, "train", READS, "density", LARGE)


def view(folder: DatasetFolder, change=lambda pictures: pictures) -> SampleView:
    return SampleView(folder, "bar-0003", READS, Altered(change, source=LARGE))


def test_components_are_uncorrelated_and_the_strongest_comes_first(folder: DatasetFolder) -> None:
    found = Descriptors.fit(train(folder), MeanColor(), seed=0)
    assert found.names == ("feature_1", "feature_2", "feature_3")
    assert found.components @ found.components.T == pytest.approx(np.eye(3), abs=1e-5)
    assert np.abs(found.components[0]) == pytest.approx([1, 0, 0], abs=0.05)


def test_each_voxel_has_the_features_of_the_surface_nearest_to_it(folder: DatasetFolder) -> None:
    found = Descriptors.fit(train(folder), MeanColor(), seed=0)
    sample = view(folder)
    grids = found.channels(sample)
    red = np.tensordot(found.components, grids, axes=(0, 0))[0] + found.mean[0]
    size, corner = sample.voxel_size_cm, sample.origin_cm
    halves = [
        red[*np.rint((np.array(point) - corner) / size).astype(int)]
        for point in ((0.25, 1.0, 2.0), (1.75, 1.0, 2.0))
    ]
    # plastic is redder than steel, 0.9 against 0.5, under the same light
    assert halves[0] > 1.4 * halves[1]
    assert not grids[:, sample.envelope == 0].any()


def test_the_order_of_the_pictures_does_not_change_them(folder: DatasetFolder) -> None:
    found = Descriptors.fit(train(folder), MeanColor(), seed=0)
    one, two = (found.channels(view(folder, change)) for change in (lambda same: same, backwards))
    assert np.allclose(one, two, atol=1e-4)


def test_pictures_without_a_whole_patch_are_a_plain_error(folder: DatasetFolder) -> None:
    found = Descriptors.fit(train(folder), MeanColor(), seed=0)
    empty = view(folder, lambda pictures: replace(pictures, masks=np.zeros_like(pictures.masks)))
    with pytest.raises(DataError, match="bar-0003: no view shows a voxel with its whole patch"):
        found.channels(empty)


def test_what_was_saved_is_the_same_and_belongs_to_its_encoder(
    folder: DatasetFolder, tmp_path: Path
) -> None:
    found = Descriptors.fit(train(folder), MeanColor(), seed=0)
    found.save(tmp_path)
    again = Descriptors.load(tmp_path, MeanColor())
    assert np.array_equal(found.channels(view(folder)), again.channels(view(folder)))
    with pytest.raises(DataError, match="made with mean colour, not with other"):
        Descriptors.load(tmp_path, MeanColor(source="other"))
    with pytest.raises(DataError, match="expected 4 features"):
        Descriptors.load(tmp_path, MeanColor(width=4))


@pytest.mark.parametrize("damage", [pytest.param(b"", marks=pytest.mark.slow), b"no", None])
def test_damaged_descriptors_are_a_plain_error(
    folder: DatasetFolder, tmp_path: Path, damage: bytes | None
) -> None:
    Descriptors.fit(train(folder), MeanColor(), seed=0).save(tmp_path)
    whole = (tmp_path / FILE).read_bytes()
    (tmp_path / FILE).write_bytes(whole[:-4] if damage is None else damage)
    with pytest.raises(DataError, match="no descriptors"):
        Descriptors.load(tmp_path, MeanColor())


def test_held_out_objects_have_no_part_in_the_components(folder: DatasetFolder) -> None:
    @dataclass(frozen=True)
    class Seen(RenderedPhantoms):
        def __call__(self, folder: DatasetFolder, object_id: str) -> Pictures:
            seen.append(object_id)
            return super().__call__(folder, object_id)

    seen: list[str] = []
    source = Seen(LARGE.rig)
    examples = Examples(folder, "train", READS, "density", source)
    Descriptors.fit(examples, MeanColor(), seed=0, held_out={1, 2})
    assert seen == ["bar-0001", "hollow-0001"]


@pytest.mark.slow
def test_pixie_with_clip_looks_through_it_and_says_so(
    folder: DatasetFolder, weights: str, tmp_path: Path
) -> None:
    method = PixieStyle(clip=weights, **TINY)
    assert method.external_data
    assert method.fingerprint != ColourUNet(**TINY).fingerprint
    method.fit(train(folder), seed=1, budget=Budget(epochs=4))
    assert "CLIP tiny" in method.notes
    assert "Pixie without its field of CLIP's features" in method.notes
    assert method.notes.endswith(", its size")
    seen, black = (
        method.predict(view(folder, change)).density_g_cm3
        for change in (lambda same: same, same_in_black)
    )
    assert not np.array_equal(seen, black)
    method.save(tmp_path)
    fresh = PixieStyle(clip=weights)
    fresh.load(tmp_path)
    assert np.array_equal(fresh.predict(view(folder)).density_g_cm3, seen)
    assert len(fresh._names) == len(ColourUNet()._names) + FEATURES
    with pytest.raises(DataError, match="its network sees"):
        ColourUNet().load(tmp_path)
    with pytest.raises(DataError, match="no checkpoint there"):
        PixieStyle(clip=weights).load(tmp_path / "nobody")


def test_the_environment_names_the_weights(weights: str, monkeypatch: pytest.MonkeyPatch) -> None:
    without = PixieStyle(clip="").fingerprint
    monkeypatch.setenv("XDEN_CLIP", weights)
    assert PixieStyle().fingerprint == PixieStyle(clip=weights).fingerprint != without
    monkeypatch.delenv("XDEN_CLIP")
    assert PixieStyle().fingerprint == without


def test_pixie_style_without_weights_names_the_network_that_needs_none(
    folder: DatasetFolder, tmp_path: Path
) -> None:
    for begin in (lambda method: method.fit(train(folder), seed=0), lambda one: one.load(tmp_path)):
        with pytest.raises(DataError, match=r"name the folder .* XDEN_CLIP .* is colour-unet"):
            begin(PixieStyle(clip=""))


@pytest.mark.slow
def test_other_weights_than_it_learned_with_are_refused(
    folder: DatasetFolder, weights: str, tmp_path: Path
) -> None:
    method = PixieStyle(clip=weights, **TINY)
    method.fit(train(folder), seed=1, budget=Budget(epochs=1))
    (tmp_path / "fit").mkdir()
    method.save(tmp_path / "fit")
    other = str(tiny_clip(tmp_path / "tiny", seed=1))
    with pytest.raises(DataError, match=r"made with CLIP tiny .*, not with CLIP tiny"):
        PixieStyle(clip=other).load(tmp_path / "fit")


def test_what_was_learned_without_clip_is_refused_with_it(weights: str, tmp_path: Path) -> None:
    for name in CHECKPOINT:
        (tmp_path / name).touch()
    with pytest.raises(DataError, match="learned without features of CLIP: by colour-unet"):
        PixieStyle(clip=weights).load(tmp_path)
