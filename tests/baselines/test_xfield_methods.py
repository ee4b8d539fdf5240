"""X-Field's methods: what is learned, kept, taken up, and answered."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.torch import load_file, save_file

from tests.baselines.pixie_scenes import dataset
from xden1k.access.samples import Examples, SampleView
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.predictor import Predictor, Segmenter, Storable, takes_budget
from xden1k.segmentation import SegmentPoints
from xden1k.segmentation.points import draw_points, segment_grid
from xden1k.values.modality import Modality
from xden_baselines import xfield
from xden_baselines.clustering import segmentation_by_features
from xden_baselines.xfield import (
    Settings,
    XFieldGeometryContrastive,
    XFieldPaper,
    XFieldPixel,
    inference,
    methods,
)
from xden_baselines.xfield.clusters import free_clusters, segmentation
from xden_baselines.xfield.lessons import lesson
from xden_baselines.xfield.network import XField
from xden_baselines.xray import mean_lac_per_cm

METHODS = [getattr(methods, name) for name in methods.__all__]
SHORT: dict[str, Any] = {"epochs": 1, "batch": 4, "queries": 16}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    return dataset(tmp_path_factory.mktemp("xfield") / "dataset")


@pytest.fixture(scope="module")
def fitted(folder: DatasetFolder) -> XFieldPixel:
    """The pixel-aligned variant after an epoch."""
    method = XFieldPixel(**SHORT)
    method.fit(Examples(folder, "train", method.reads), seed=0)
    return method


@pytest.fixture(scope="module")
def saved(fitted: XFieldPixel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What it has learned."""
    path = tmp_path_factory.mktemp("saved")
    fitted.save(path)
    return path


def loaded(path: Path) -> XFieldPixel:
    method = XFieldPixel(**SHORT)
    method.load(path)
    return method


def asked(folder: DatasetFolder, reads: Modality) -> tuple[SampleView, SegmentPoints]:
    sample = SampleView(folder, "bar-0003", reads)
    grid = segment_grid(sample.origin_cm, sample.voxel_size_cm)
    return sample, draw_points(sample.outer_mesh, grid, sample.object_id, 1)


@pytest.mark.parametrize("kind", METHODS)
def test_methods_give_what_their_variant_can(kind: type[Any]) -> None:
    method = kind()
    assert isinstance(method, Segmenter)
    assert isinstance(method, Storable)
    assert takes_budget(method)
    assert isinstance(method, Predictor) == (kind is not XFieldGeometryContrastive)
    assert (Modality.XRAY in method.reads) == ("geometry" not in method.name)
    assert method.notes == ""


def test_a_fit_that_was_saved_and_loaded_answers_exactly_as_it_did_in_memory(
    folder: DatasetFolder, fitted: XFieldPixel, saved: Path
) -> None:
    again = loaded(saved)
    sample, points = asked(folder, fitted.reads)
    kept, told = (
        inference.answers(one._model, sample, points.points_cm, one.settings)
        for one in (fitted, again)
    )
    for one, other in zip(kept, told, strict=True):
        assert one.std() > 0
        assert np.array_equal(one, other)
    first, second = (method.segment(sample, points) for method in (fitted, again))
    assert np.array_equal(first.labels, second.labels)
    assert np.array_equal(first.free, second.free)
    assert first.points == len(points)
    assert again.notes == fitted.notes
    assert "tiny pixel, 3 objects, epoch 1 of 1" in again.notes
    assert "0.139 million weights" in again.notes


@pytest.mark.slow
def test_a_density_is_that_of_the_envelope(folder: DatasetFolder, saved: Path) -> None:
    sample, _ = asked(folder, XFieldPixel.reads)
    grid = loaded(saved).predict(sample).density_g_cm3
    assert grid.shape == (64, 64, 64)
    assert grid[sample.envelope > 0].any()
    assert not grid[sample.envelope == 0].any()
    assert grid.min() >= 0


def test_voxels_hold_the_mean_over_themselves(
    folder: DatasetFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    def squares(_: object, __: object, points_cm: np.ndarray, ___: object) -> tuple:
        return points_cm[:, :1] ** 2, points_cm[:, :0]

    monkeypatch.setattr(inference, "answers", squares)
    sample, _ = asked(folder, Modality.GEOMETRY)
    model = XField(variant="pixel", size="tiny")
    grid = inference.predicted_g_cm3(model, sample, Settings())
    centre = sample.origin_cm[0] + 40 * sample.voxel_size_cm
    mean = centre**2 + (sample.voxel_size_cm / 4) ** 2  # of two points at a quarter either side
    assert np.allclose(grid[40][sample.envelope[40] == 1], mean)
    assert np.allclose(grid[40][sample.envelope[40] == 0], 0)


def test_an_object_without_points_has_no_labels(folder: DatasetFolder, saved: Path) -> None:
    sample, _ = asked(folder, XFieldPixel.reads)
    none = SegmentPoints(np.zeros((0, 3), np.uint8), np.zeros((0, 3)))
    assert loaded(saved).segment(sample, none).labels.shape == (18, 0)


def test_what_learned_another_target_predicts_no_other(folder: DatasetFolder, saved: Path) -> None:
    sample = SampleView(folder, "bar-0003", XFieldPixel.reads, target="apparent_density")
    with pytest.raises(DataError, match="x-field learned density, not apparent_density"):
        loaded(saved).predict(sample)


def changed(key: str, value: Any) -> Callable[[dict], dict]:
    return lambda config: config | {key: value}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda config: {**config, "depth": 3}, r"wrong are \['depth'\]"),
        (lambda config: {"size": config["size"]}, r"wrong are \['format', .*'views'\]"),
        (changed("variant", "cross"), "expected the variant 'pixel', got 'cross'"),
        (changed("format", "xfield/0"), "format must be one of .*, got 'xfield/0'"),
        (changed("unit_g_cm3", 1.0), "unit_g_cm3 must be one of .*, got 1.0"),
        (changed("size", "small"), "cannot be read: .*size mismatch.* .and [0-9]+ more"),
        (changed("views", ["lat", "pa"]), "views must be one of"),
        (changed("views", None), r"views must be one of .*, got \[\]"),
        (changed("target", "mass"), "target must be one of .*'density'.*, got 'mass'"),
        (lambda _: None, "expected the keys .*'views'.*, got None"),
        (lambda config: [config], "expected the keys .*'views'.*, got "),
    ],
)
def test_a_checkpoint_of_another_make_is_refused(
    saved: Path, tmp_path: Path, change: Callable[[dict], dict], message: str
) -> None:
    for file in saved.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    config = tmp_path / "config.json"
    config.write_text(json.dumps(change(json.loads(config.read_text()))))
    with pytest.raises(DataError, match=message) as error:
        loaded(tmp_path)
    assert str(tmp_path) in str(error.value)
    assert "\n" not in str(error.value)


def spoilt(saved: Path, folder: Path) -> Path:
    """Write a copy whose weights hold what is no number."""
    for file in saved.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    weights = load_file(folder / "model.safetensors")
    weights["backbone.norm.bias"][3] = float("nan")
    save_file(weights, folder / "model.safetensors")
    return folder


def test_weights_that_are_no_numbers_are_refused(saved: Path, tmp_path: Path) -> None:
    with pytest.raises(
        DataError, match=r"model.safetensors: expected finite numbers, backbone\.norm"
    ):
        loaded(spoilt(saved, tmp_path))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"settings": {}}, "settings must have a size"),
        ({"held_out_loss": []}, "best_epoch must be from 1 to 0, got 1"),
        ({"best_epoch": 9}, "best_epoch must be from 1 to 1, got 9"),
        ({"best_epoch": "1"}, "no training report"),
        ({"processor_s": None}, "no training report"),
        ({"variant": "cross"}, "expected the variant 'pixel', got 'cross'"),
    ],
)
def test_a_report_that_no_training_has_written_is_refused(
    saved: Path, tmp_path: Path, wrong: dict[str, Any], message: str
) -> None:
    for file in saved.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    report = tmp_path / "training.json"
    report.write_text(json.dumps(json.loads(report.read_text()) | wrong))
    with pytest.raises(DataError, match=message) as error:
        loaded(tmp_path)
    assert str(error.value).startswith(f"{report}: ")


def test_another_variant_does_not_take_it_up(saved: Path) -> None:
    with pytest.raises(DataError, match="expected the variant 'cross', got 'pixel'"):
        XFieldPaper().load(saved)


def test_the_paper_without_one_part_is_another_fit() -> None:
    names = {XFieldPaper(without=one).variant for one in ("", "scale", "attention", "third")}
    assert names == {"cross", "cross-no-scale", "cross-no-attention", "cross-no-third"}
    assert XFieldPaper().fingerprint != XFieldPaper(without="third").fingerprint
    with pytest.raises(DataError, match=r"without must be one of \['scale', .*, got 'film'"):
        XFieldPaper(without="film")


def test_settings_tell_fits_apart() -> None:
    assert XFieldPixel().fingerprint == XFieldPixel().fingerprint
    assert XFieldPixel().fingerprint != XFieldPixel(queries=99).fingerprint


def test_clusters_by_features_find_groups_and_how_many_there_are() -> None:
    rng = np.random.default_rng(0)
    truth = np.repeat([0, 1, 2], [1000, 600, 400])
    features = np.eye(3)[truth] + 0.05 * rng.standard_normal((2000, 3))
    found = segmentation_by_features(features)
    pairs = set(zip(truth.tolist(), found.of(3).tolist(), strict=True))
    assert len(pairs) == 3
    assert len(np.unique(found.free)) == 3


@pytest.mark.parametrize(("few", "clusters"), [(110, 1), (120, 2)])
def test_a_group_apart_counts_where_it_lowers_the_mean_squared_distance_enough(
    few: int, clusters: int
) -> None:
    """By 2 p (1 - p) at a right angle: 0.196 and 0.211."""
    found = segmentation_by_features(np.eye(2)[np.repeat([0, 1], [1000 - few, few])])
    assert len(np.unique(found.free)) == clusters


@pytest.mark.parametrize("points", [1, 2, 30])
def test_few_or_equal_points_are_clustered_too(points: int) -> None:
    assert segmentation_by_features(np.zeros((points, 4))).points == points
    assert segmentation_by_features(np.eye(points)).points == points


def test_rays_divide_points_that_a_network_takes_for_alike_and_nothing_else_does() -> None:
    rng = np.random.default_rng(0)
    density, embedding = np.ones((400, 1), np.float32), np.eye(16, dtype=np.float32)[[0] * 400]
    lac = np.repeat([0.2, 3.0], 200) + 0.01 * rng.standard_normal(400)
    told = segmentation(density, embedding, lac)
    for divided in (told.of(2), told.free, free_clusters(density, embedding, lac)):
        assert len({*divided[:200]}) == len({*divided[200:]}) == 1
        assert divided[0] != divided[-1]
    scaled = segmentation(density, embedding, 5 * lac)  # no calibration: a factor changes nothing
    assert (scaled.of(2) == told.of(2)).all()
    assert len(np.unique(segmentation(density, embedding).free)) == 1


def test_noise_of_rays_is_not_taken_for_parts() -> None:
    density, embedding = np.ones((400, 1), np.float32), np.eye(16, dtype=np.float32)[[0] * 400]
    noise = np.random.default_rng(0).standard_normal(400)
    for lac in (0.2 * (1 + 0.1 * noise), np.zeros(400)):
        assert len(np.unique(segmentation(density, embedding, lac).free)) == 1


def test_rays_count_for_a_variant_that_sees_them_and_has_parts(
    folder: DatasetFolder, saved: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    method = loaded(saved)
    sample, points = asked(folder, method.reads)
    along = mean_lac_per_cm(sample, points.points_cm)
    said = inference.answers(method._model, sample, points.points_cm, method.settings)
    assert (method.segment(sample, points).labels == segmentation(*said, along).labels).all()
    blind = XFieldGeometryContrastive(**SHORT)
    blind.fit(Examples(folder, "train", blind.reads), seed=0)
    monkeypatch.setattr("xden_baselines.xray.mean_lac_per_cm", None)
    assert blind.segment(*asked(folder, blind.reads)).points == len(points)


def test_public_names_can_be_imported_without_torch_code() -> None:
    assert sorted(xfield.__all__) == sorted([*methods.__all__, "Settings"])
    assert lesson.__module__ == "xden_baselines.xfield.lessons"
