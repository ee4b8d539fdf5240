"""Objects of the authors' release: no X-ray track without radiographs, and a row of their own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.bench.conftest import submissions
from tests.phantoms import BAR, CUBE, box_object, published_object
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden1k.predictor import Examples, SampleView
from xden1k.values.arrays import Grid
from xden1k.values.modality import Modality
from xden_bench.entries.eval_results import SOURCES
from xden_bench.methods.running import run_predictor
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import score
from xden_bench.scoring.submission import validate
from xden_bench.serve import words
from xden_bench.serve.explorer import Explorer


class Xray:
    """A method that reads radiographs, or would."""

    name, version, notes = "x", "1", ""
    reads = Modality.GEOMETRY | Modality.XRAY
    external_data = False

    def __init__(self, *, trainable: bool = False) -> None:
        self.trainable = trainable

    def fit(self, train: Examples, *, seed: int) -> None:
        """Nothing."""

    def predict(self, sample: SampleView) -> Grid:
        return sample.envelope + 0 * len(sample.views)


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    """Three objects, two of them without radiographs; one in val that has them."""
    root = tmp_path_factory.mktemp("published") / "dataset"
    objects = [
        published_object("bar-0001", BAR, split="test"),
        box_object("bar-0002", BAR, split="test", source="published"),
        box_object("cube-0001", CUBE, split="val", source="published"),
        published_object("cube-0002", CUBE, split="train"),
    ]
    write_folder(objects, root, version="0.1.0", builder="tests")
    return open_folder(root)


@pytest.mark.parametrize(
    ("split", "trainable", "message"),
    [
        ("test", False, "'xray' needs radiographs, 1 of 2 objects of the split 'test' have none"),
        ("val", True, "'xray' needs radiographs, 1 of 1 objects of the split 'train' have none"),
    ],
)
def test_a_method_of_the_xray_track_does_not_run_without_radiographs(
    published: DatasetFolder, tmp_path: Path, split: str, trainable: bool, message: str
) -> None:
    with pytest.raises(DataError, match=message):
        run_predictor(Xray(trainable=trainable), published, split, tmp_path / "out.npz")
    assert list(tmp_path.iterdir()) == []


def test_a_method_of_the_xray_track_runs_where_all_have_theirs(
    published: DatasetFolder, tmp_path: Path
) -> None:
    run_predictor(Xray(), published, "val", tmp_path / "out.npz")


def test_a_sample_says_that_it_has_no_radiographs(published: DatasetFolder) -> None:
    with pytest.raises(DataError, match="bar-0001 has no radiographs"):
        _ = SampleView(published, "bar-0001", Modality.XRAY).views


def test_a_submission_in_the_xray_track_is_refused_with_the_count(
    published: DatasetFolder, tmp_path: Path
) -> None:
    reference = Reference(published, "test")
    path = submissions(tmp_path, reference)(inputs=("mesh", "xray"))
    problems = validate(path, reference, load_protocol())
    assert [one.code for one in problems if one.is_error] == ["E205"]
    assert "1 of 2 objects of the split 'test' have none" in problems[0].message


def test_scores_on_the_release_are_of_its_source(published: DatasetFolder, tmp_path: Path) -> None:
    reference = Reference(published, "test")
    path = submissions(tmp_path, reference)(lambda _, grid: 1.2 * grid)
    assert score(path, reference, load_protocol()).sources == ("published",)


@pytest.mark.parametrize("table", [SOURCES, words.SOURCES])
def test_every_source_is_told_in_words(table: dict[str, Any]) -> None:
    assert table.keys() == {"scan", "phantom", "ct", "published"}


def test_the_explorer_draws_no_radiographs_where_there_are_none(
    published: DatasetFolder, tmp_path: Path
) -> None:
    explorer = Explorer(published, lambda _: None, tmp_path)
    assert explorer.radiographs("bar-0001") == ()
    assert "published: the authors' release" in words.object_line(explorer.object("bar-0001"))
