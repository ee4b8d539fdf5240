"""A small dataset, and submissions for it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.apart import run_here
from tests.bench.sealing import Sealed, sealed_dataset, write_dataset
from tests.phantoms import BAR, CUBE, FILLED, HOLLOW, box_object
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden1k.predictions import SubmissionMeta, write_predictions
from xden_bench.methods import apart, baseline
from xden_bench.scoring.reference import Reference

GOLDEN = Path(__file__).parents[1] / "golden"


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Callable[[str, Mapping[str, Any]], None]:
    """Compare numbers with those of tests/golden; --update-golden rewrites them."""

    def compare(name: str, values: Mapping[str, Any]) -> None:
        path = GOLDEN / f"{name}.json"
        if request.config.getoption("--update-golden"):
            path.parent.mkdir(exist_ok=True)
            path.write_text(json.dumps(values, indent=2) + "\n")
        expected = json.loads(path.read_text())
        assert values.keys() == expected.keys()
        for key, value in expected.items():
            np.testing.assert_allclose(values[key], value, rtol=1e-6, atol=1e-9, err_msg=key)

    return compare


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four objects to score, three to learn from, one in val."""
    root = tmp_path_factory.mktemp("bench") / "dataset"
    objects = [
        box_object("bar-0001", BAR, split="train", category="bar"),
        box_object("bar-0002", BAR, split="test", category="bar"),
        box_object("cube-0001", CUBE, split="train", category="cube"),
        box_object("cube-0002", CUBE, split="val", category="cube"),
        box_object("cube-0003", CUBE, split="test", category="cube"),
        box_object("filled-0001", FILLED, split="test", category="filled"),
        box_object("hollow-0001", HOLLOW, split="train", category="hollow"),
        box_object("hollow-0002", HOLLOW, split="test", category="hollow"),
    ]
    write_folder(objects, root, version="0.1.0", builder="tests")
    return root


@pytest.fixture(scope="session")
def folder(dataset: Path) -> DatasetFolder:
    return open_folder(dataset)


@pytest.fixture(scope="session")
def reference(folder: DatasetFolder) -> Reference:
    return Reference(folder, "test")


@pytest.fixture(scope="session")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> Sealed:
    """A dataset with answers to hide, and its sealed form."""
    root = tmp_path_factory.mktemp("sealed")
    return sealed_dataset(write_dataset(root / "whole"), root / "out")


@pytest.fixture(scope="session", autouse=True)
def methods_looked_for_once() -> Iterator[None]:
    """Search what is installed for methods once: each command would, and nothing changes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(baseline, "entry_points", cache(baseline.entry_points))
        yield


@pytest.fixture(scope="session", autouse=True)
def methods_run_here() -> Iterator[None]:
    """Run methods in this process: each of their own takes two seconds (see test_apart.py)."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(apart, "run_apart", run_here)
        yield


Submit = Callable[..., Path]


@pytest.fixture
def submission(tmp_path: Path, reference: Reference) -> Submit:
    """Write a submission: the truth, changed by ``change(object_id, grid)``."""

    return submissions(tmp_path, reference)


def submissions(folder: Path, reference: Reference) -> Submit:
    """A function that writes submissions to a folder."""

    def write(
        change: Callable[[str, np.ndarray], np.ndarray | None] = lambda _, grid: grid,
        name: str = "preds.npz",
        dtype: str = "float32",
        **meta: Any,
    ) -> Path:
        values = {
            "method": "test",
            "dataset_revision": "0.1.0",
            "config": "default",
            "split": "test",
            "inputs": ("mesh",),
            "training_data": (),
            "external_data": False,
        }
        pairs = (
            (one, change(one, reference.truth(one).density_g_cm3.copy())) for one in reference.ids
        )
        kept = ((one, grid) for one, grid in pairs if grid is not None)
        write_predictions(folder / name, SubmissionMeta(**{**values, **meta}), kept, dtype)
        return folder / name

    return write
