"""The trained methods as the benchmark runs them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.baselines.pixie_scenes import (
    TINY,
    altered,
    backwards,
    dataset,
    examples,
    same_in_black,
    sample,
)
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.predictor import Budget, Fingerprinted, Predictor, Storable, takes_budget
from xden1k.values.modality import Modality, ModalityError
from xden_baselines.pixie import (
    ColourUNet,
    ColourUNetFull,
    GeometryUNet,
    PixieStyleFull,
    XRayUNet,
)

EVERY = [GeometryUNet, ColourUNet, XRayUNet]
SLOW = pytest.mark.slow
MOSTLY_COLOUR = [
    ColourUNet,
    pytest.param(GeometryUNet, marks=SLOW),
    pytest.param(XRayUNet, marks=SLOW),
]


@pytest.fixture(scope="module", autouse=True)
def no_clip() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("XDEN_CLIP", raising=False)
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    return dataset(tmp_path_factory.mktemp("predictor") / "dataset")


@pytest.fixture(scope="module")
def fitted(folder: DatasetFolder) -> dict[type, Predictor]:
    methods = {kind: kind(**TINY, patience=99) for kind in EVERY}
    for method in methods.values():
        # this seed holds out a bar, whose halves are told by colours and radiographs alone
        epochs = 2 if method.reads == Modality.GEOMETRY else 8
        method.fit(examples(folder, method.reads), seed=1, budget=Budget(epochs=epochs))
    return methods


@pytest.mark.parametrize("kind", EVERY)
def test_each_fills_the_envelope_alone_with_densities(
    folder: DatasetFolder, fitted: dict[type, Predictor], kind: type
) -> None:
    method = fitted[kind]
    assert isinstance(method, (Predictor, Storable, Fingerprinted))
    assert takes_budget(method)
    one = sample(folder, "bar-0003", method.reads)
    grid = method.predict(one).density_g_cm3
    assert grid.shape == (64, 64, 64)
    assert grid.dtype == np.float32
    assert np.isfinite(grid).all()
    assert not grid[one.envelope == 0].any()
    assert (grid[one.envelope > 0] > 0).all()


@pytest.mark.slow
@pytest.mark.parametrize("kind", MOSTLY_COLOUR)
def test_a_prediction_is_the_same_to_the_bit_each_time(
    folder: DatasetFolder, fitted: dict[type, Predictor], kind: type
) -> None:
    method = fitted[kind]
    one, two = (
        method.predict(sample(folder, "bar-0003", method.reads)).density_g_cm3 for _ in range(2)
    )
    assert np.array_equal(one, two)


@pytest.mark.parametrize("kind", MOSTLY_COLOUR)
def test_what_was_saved_predicts_the_same_to_the_bit(
    folder: DatasetFolder, fitted: dict[type, Predictor], kind: type, tmp_path: Path
) -> None:
    method, fresh = fitted[kind], kind()
    method.save(tmp_path)
    fresh.load(tmp_path)
    one, two = (
        each.predict(sample(folder, "hollow-0002", kind.reads)).density_g_cm3
        for each in (method, fresh)
    )
    assert np.array_equal(one, two)
    assert fresh.notes == method.notes
    assert (tmp_path / "model.safetensors").is_file()


def test_pixie_looks_at_the_colours(folder: DatasetFolder, fitted: dict[type, Predictor]) -> None:
    method = fitted[ColourUNet]
    seen = method.predict(sample(folder, "bar-0003", method.reads)).density_g_cm3
    black = altered(folder, "bar-0003", method.reads, same_in_black)
    assert np.abs(seen - method.predict(black).density_g_cm3).max() > 0.1
    turned = altered(folder, "bar-0003", method.reads, backwards)
    assert np.array_equal(seen, method.predict(turned).density_g_cm3)


@pytest.mark.parametrize("view", [pytest.param(0, marks=SLOW), 1])
def test_the_xray_network_looks_at_either_radiograph(
    folder: DatasetFolder, fitted: dict[type, Predictor], view: int
) -> None:
    method = fitted[XRayUNet]
    one, faint = (sample(folder, "bar-0003", method.reads) for _ in range(2))
    views = list(one.views)
    views[view] = replace(views[view], transmission=np.ones_like(views[view].transmission))
    faint.__dict__["views"] = tuple(views)  # where a cached property keeps its value
    found, other = (method.predict(each).density_g_cm3 for each in (one, faint))
    assert np.abs(found - other).max() > 0.01


@pytest.mark.parametrize("kind", [ColourUNet, XRayUNet])
def test_without_a_declared_modality_there_is_no_prediction(
    folder: DatasetFolder, fitted: dict[type, Predictor], kind: type
) -> None:
    with pytest.raises((ModalityError, DataError, RuntimeError)):
        fitted[kind].predict(sample(folder, "bar-0003", Modality.GEOMETRY))


@pytest.mark.parametrize("kind", MOSTLY_COLOUR)
def test_another_category_gives_another_prediction(
    folder: DatasetFolder, fitted: dict[type, Predictor], kind: type
) -> None:
    method = fitted[kind]
    one, other, unheard = (sample(folder, "bar-0003", method.reads) for _ in range(3))
    other.__dict__["category"], unheard.__dict__["category"] = "mug", "zeppelin"
    bar, mug, new = (method.predict(each).density_g_cm3 for each in (one, other, unheard))
    assert np.abs(bar - mug).max() > 0.1
    assert np.abs(bar - new).max() > 0.01
    assert np.isfinite(new).all()


def test_none_touches_what_it_does_not_declare(
    folder: DatasetFolder, fitted: dict[type, Predictor]
) -> None:
    for method in fitted.values():
        one = sample(folder, "bar-0003", method.reads)
        for hidden in ("part_meshes", "labels", "occupancy"):
            with pytest.raises(ModalityError):
                getattr(one, hidden)
        method.predict(one)


def test_the_row_tells_how_the_training_went(fitted: dict[type, Predictor]) -> None:
    assert GeometryUNet().notes == ""
    notes = fitted[GeometryUNet].notes
    assert "held-out training objects" in notes
    assert "U-Net of 0.397 million weights at 16³" in notes
    assert len(notes) < 500
    assert "\n" not in notes


def test_other_settings_have_another_fingerprint() -> None:
    assert ColourUNet().fingerprint == ColourUNet(resolution=32).fingerprint
    assert ColourUNet().fingerprint != ColourUNet(resolution=64).fingerprint
    with pytest.raises(TypeError, match="nonsense"):
        ColourUNet(nonsense=1)


def test_the_published_size_asks_for_a_gpu_and_can_be_told_otherwise() -> None:
    for kind in (ColourUNetFull, PixieStyleFull):
        assert kind().settings.device == "cuda"
        assert kind(device="cpu").settings.size == "full"


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda folder: (folder / "model.safetensors").unlink(), "model.safetensors missing"),
        (lambda folder: (folder / "model.safetensors").write_bytes(b"no"), "cannot be read"),
        (lambda folder: (folder / "config.json").write_text("{"), "cannot be read"),
        (lambda folder: (folder / "training.json").write_text("[]"), "no training report"),
        (lambda folder: (folder / "training.json").unlink(), "no training report"),
    ],
)
def test_a_damaged_checkpoint_is_a_plain_error(
    fitted: dict[type, Predictor], tmp_path: Path, damage, message: str
) -> None:
    fitted[GeometryUNet].save(tmp_path)
    damage(tmp_path)
    with pytest.raises(DataError, match=message):
        GeometryUNet().load(tmp_path)


def test_a_folder_that_is_not_there_is_not_looked_for_on_the_hub(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no checkpoint there"):
        GeometryUNet().load(tmp_path / "nobody" / "nothing")


def test_the_checkpoint_of_another_method_is_refused(
    fitted: dict[type, Predictor], tmp_path: Path
) -> None:
    fitted[GeometryUNet].save(tmp_path)
    with pytest.raises(DataError, match=r"expected .*log10_lac_pa"):
        XRayUNet().load(tmp_path)
    assert json.loads((tmp_path / "config.json").read_text())["resolution"] == 16
