"""The trivial baselines: what they predict, and what they may look at."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.phantoms import BAR, CUBE, HOLLOW, box_object
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden1k.predictor import Examples, Prediction, Predictor, SampleView
from xden1k.values.modality import Modality, ModalityError
from xden_baselines.constant import CategoryMedian, TrainMedian, Water, Zero, mean_density_g_cm3

ALL = [Zero, Water, TrainMedian, CategoryMedian]


class Album:
    description = "from an album"

    def __call__(self, folder: DatasetFolder, object_id: str) -> str:
        return f"pictures of {object_id}"


pictures_of = Album()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    root = tmp_path_factory.mktemp("baselines") / "dataset"
    objects = [
        box_object("bar-0001", BAR, split="train", category="bar"),
        box_object("bar-0002", BAR, split="test", category="bar"),
        box_object("cube-0001", CUBE, split="train", category="cube"),
        box_object("hollow-0001", HOLLOW, split="train", category="hollow"),
        box_object("hollow-0002", HOLLOW, split="test", category="mug"),
    ]
    write_folder(objects, root, version="0.1.0", builder="tests")
    return open_folder(root)


def fitted(kind: type, folder: DatasetFolder) -> Predictor:
    predictor: Predictor = kind()
    predictor.fit(Examples(folder, "train", predictor.reads), seed=0)
    return predictor


@pytest.mark.parametrize("kind", ALL)
def test_each_is_a_predictor_that_sees_only_what_it_declares(
    folder: DatasetFolder, kind: type
) -> None:
    predictor = fitted(kind, folder)
    assert isinstance(predictor, Predictor)
    sample = SampleView(folder, "hollow-0002", predictor.reads)
    found = predictor.predict(sample)
    grid = found.density_g_cm3 if isinstance(found, Prediction) else found
    assert grid.shape == (64, 64, 64)
    assert grid.dtype == np.float32
    assert (grid >= 0).all()
    envelope = SampleView(folder, "hollow-0002", Modality.GEOMETRY).envelope
    assert not grid[envelope == 0].any()


def test_zero_is_nothing(folder: DatasetFolder) -> None:
    assert not Zero().predict(SampleView(folder, "bar-0002", Modality.NONE)).any()


def test_water_fills_cavities_it_cannot_know_of(folder: DatasetFolder) -> None:
    sample = SampleView(folder, "hollow-0002", Modality.GEOMETRY)
    grid = Water().predict(sample)
    assert grid[32, 32, 32] == 1.0
    assert grid.sum() * sample.voxel_size_cm**3 == pytest.approx(64, rel=1e-3)


def test_train_median_is_the_middle_of_the_training_means(folder: DatasetFolder) -> None:
    examples = Examples(folder, "train", Modality.GEOMETRY)
    # bar: 72 g in 16 cm³, cube: 2 g/cm³, hollow: 84 g in 64 cm³
    means = [mean_density_g_cm3(example) for example in examples]
    assert means == pytest.approx([4.5, 2.0, 84 / 64], rel=1e-2)
    grid = fitted(TrainMedian, folder).predict(SampleView(folder, "bar-0002", Modality.GEOMETRY))
    assert grid.max() == pytest.approx(2.0, rel=1e-2)


def test_category_median_takes_the_category_and_says_where_it_could_not(
    folder: DatasetFolder,
) -> None:
    predictor = fitted(CategoryMedian, folder)
    reads = Modality.GEOMETRY | Modality.CATEGORY
    known = predictor.predict(SampleView(folder, "bar-0002", reads))
    unseen = predictor.predict(SampleView(folder, "hollow-0002", reads))
    assert known.density_g_cm3.max() == pytest.approx(4.5, rel=1e-2)
    assert unseen.density_g_cm3.max() == pytest.approx(2.0, rel=1e-2)
    assert known.remark == ""
    assert unseen.remark.startswith("a category unseen in training")


def test_pictures_come_from_the_source_that_is_given(folder: DatasetFolder) -> None:
    sample = SampleView(folder, "bar-0002", Modality.RGB, pictures_of)
    assert sample.pictures == "pictures of bar-0002"
    with pytest.raises(DataError, match="bar-0002: the dataset has no colour pictures"):
        SampleView(folder, "bar-0002", Modality.RGB).pictures  # noqa: B018
    train = list(Examples(folder, "train", Modality.RGB, pictures_of=pictures_of))
    assert train[0].sample.pictures == "pictures of bar-0001"


def test_training_objects_come_with_their_answers(folder: DatasetFolder) -> None:
    first = next(iter(Examples(folder, "train", Modality.NONE)))
    assert [part.material for part in first.truth.parts] == ["polypropylene", "steel"]


@pytest.mark.parametrize(
    ("what", "needed"),
    [
        ("envelope", "GEOMETRY"),
        ("outer_mesh", "GEOMETRY"),
        ("category", "CATEGORY"),
        ("labels", "PARTS"),
        ("occupancy", "PARTS"),
        ("part_meshes", "PARTS"),
        ("part_materials", "MATERIALS"),
        ("views", "XRAY"),
        ("pictures", "RGB"),
        ("truth", "TRUTH"),
    ],
)
def test_what_is_not_declared_is_not_shown(folder: DatasetFolder, what: str, needed: str) -> None:
    every = ~Modality.NONE
    assert getattr(SampleView(folder, "bar-0002", every, pictures_of), what) is not None
    others = every & ~Modality[needed]
    with pytest.raises(ModalityError, match=f"bar-0002: {what} needs the modality {needed}"):
        getattr(SampleView(folder, "bar-0002", others, pictures_of), what)


def test_the_outer_surface_hides_a_cavity(folder: DatasetFolder) -> None:
    sample = SampleView(folder, "hollow-0002", Modality.GEOMETRY)
    assert sample.outer_mesh.volume == pytest.approx(64.0)
    assert sample.envelope[32, 32, 32] == 1.0


def test_nothing_else_is_within_reach_of_a_sample() -> None:
    public = {name for name in vars(SampleView) if not name.startswith("_")}
    assert public == {
        "category",
        "envelope",
        "labels",
        "occupancy",
        "origin_cm",
        "outer_mesh",
        "part_materials",
        "part_meshes",
        "part_names",
        "pictures",
        "pictures_of",
        "target",
        "truth",
        "views",
        "voxel_size_cm",
    }


def test_only_outer_geometry_is_declared_by_the_trivial_ones() -> None:
    for kind in ALL:
        assert not (Modality.PARTS | Modality.XRAY | Modality.RGB) & kind.reads


def test_examples_can_be_gone_through_again(folder: DatasetFolder) -> None:
    examples = Examples(folder, "train", Modality.GEOMETRY)
    assert len(examples) == 3
    assert len(list(examples)) == len(list(examples)) == 3


def test_a_dataset_without_training_objects_is_refused(tmp_path: Path) -> None:
    root = tmp_path / "dataset"
    write_folder([box_object("cube-0001", CUBE)], root, version="0.1.0", builder="tests")
    with pytest.raises(ValueError, match="no split 'train'"):
        fitted(TrainMedian, open_folder(root))
