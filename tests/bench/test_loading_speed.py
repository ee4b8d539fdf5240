"""What loading is compared with holds the same samples; memory that grows is seen to grow."""

from __future__ import annotations

import json
import pickle
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import torch
from click.testing import CliRunner

from xden1k.access.dataset import FIELDS, Sample, XDen1K
from xden1k.errors import DataError
from xden1k.folder import open_folder
from xden_bench.cli import cli
from xden_bench.speed import loading, report
from xden_bench.speed.loading import FIELD_GROUPS
from xden_bench.speed.memory import anonymous_mb, epochs_mb
from xden_bench.speed.raw import RawCopy
from xden_bench.speed.rounds import Comparison
from xden_bench.speed.starting import opening, write_many

KEPT: list[torch.Tensor] = []


def keep(sample: Sample) -> Sample:
    """A transform with a leak of 2 MB a sample."""
    KEPT.append(sample["labels"].clone())
    return sample


def assert_same(one: Sample, other: Sample) -> None:
    assert one.keys() == other.keys()
    for name, value in one.items():
        if isinstance(value, torch.Tensor):
            assert (value.dtype, value.shape) == (other[name].dtype, other[name].shape)
            assert value.numpy().tobytes() == other[name].numpy().tobytes(), name
        else:
            assert value == other[name]


def test_the_copy_in_one_file_gives_the_samples_of_the_folder_after_pickling_too(
    dataset: Path, tmp_path: Path
) -> None:
    ours = XDen1K(dataset, "test")
    raw = RawCopy(ours, tmp_path / "raw")
    raw[0]
    again = pickle.loads(pickle.dumps(raw))  # noqa: S301
    assert len(pickle.dumps(raw)) < 0.1 * raw.sample_bytes(FIELDS)
    assert len(raw) == len(ours)
    for index, sample in enumerate(ours):
        assert_same(sample, raw[index])
        assert_same(sample, again[index])
    raw[0]["labels"][:] = 77  # the reader's own
    assert raw[0]["labels"].max() < 77
    assert raw.sample_bytes(["labels"]) == 128**3


def test_every_field_is_in_one_group_and_all_of_them() -> None:
    together = ("all", "object_id alone")
    apart = [names for group, names in FIELD_GROUPS.items() if group not in together]
    assert Counter(name for names in apart for name in names) == Counter(FIELDS)
    assert FIELD_GROUPS["all"] == FIELDS


def test_the_ratio_is_the_median_of_the_rounds_ratios() -> None:
    shown = Comparison((1.0, 2.0, 4.0), (2.0, 1.0, 4.0)).to_dict(tasks=2)
    assert shown == {"ours_ms": 1000, "other_ms": 1000, "ratio": 1, "lowest": 0.5, "highest": 2}


def test_a_large_folder_has_the_directory_of_its_objects_in_four_shards_a_split(
    dataset: Path, tmp_path: Path
) -> None:
    write_many(dataset, tmp_path / "many", 40)
    folder = open_folder(tmp_path / "many")
    assert folder.manifest.splits == {"train": 28, "val": 4, "test": 8}
    measured = opening(tmp_path / "many", rounds=1)
    assert (measured["objects"], measured["shards"]) == (40, 12)


def test_memory_of_a_process_that_is_not_there_is_one_line() -> None:
    with pytest.raises(DataError, match=r"/proc/none/status is not there: .* on Linux only"):
        anonymous_mb("none")


def test_loading_takes_no_submission(tmp_path: Path) -> None:
    result = CliRunner().invoke(cli, ["speed", "preds.npz", "--loading"])
    assert result.exit_code == 2
    assert "--loading and --serving take no submission" in result.stderr


@pytest.mark.slow
@pytest.mark.parametrize("workers", [0, 2])
def test_memory_stays_flat_over_ten_epochs(dataset: Path, workers: int) -> None:
    after = epochs_mb(dataset, "test", epochs=10, workers=workers)
    assert len(after) == 10
    assert max(after[5:]) - max(after[:5]) < 20  # 1 MB for each of the 20 samples in between


@pytest.mark.slow
def test_memory_of_samples_that_are_kept_is_seen_to_grow(dataset: Path) -> None:
    after = epochs_mb(dataset, "test", epochs=6, transform=keep)
    assert after[-1] - after[0] > 0.9 * 5 * 4 * 128**3 / 1e6


@pytest.fixture
def measured(dataset: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What is measured of a few samples in one process, memory left out."""
    monkeypatch.setattr(loading, "SAMPLES", 4)
    monkeypatch.setattr(loading, "ACCESSES", 2)
    monkeypatch.setattr(report, "loaders", lambda pair, _, rounds: loading.loaders(pair, 0, rounds))
    monkeypatch.setattr(report, "epochs_mb", lambda *_, workers: [1.0 + workers, 1.5 + workers])
    return report.measure_loading(dataset, "test", rounds=1, objects=20)


def test_the_command_prints_what_was_measured(
    dataset: Path, measured: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert_printed(dataset, measured, monkeypatch)


@pytest.mark.slow
def test_the_command_prints_what_was_measured_of_processes_and_memory_too(
    dataset: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured = report.measure_loading(dataset, "test", rounds=1, objects=20)
    assert_printed(dataset, measured, monkeypatch)


def assert_printed(
    dataset: Path, measured: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(report, "measure_loading", lambda *given: asked.append(given) or measured)
    options = ["--root", str(dataset), "--repeats", "2"]
    text, values = (
        CliRunner().invoke(cli, ["speed", "--loading", *options, *more]).stdout
        for more in ((), ("--json",))
    )
    assert json.loads(values) == json.loads(json.dumps(measured))
    assert all(given == (dataset, "test", 2) for given in asked)
    for name in (*FIELD_GROUPS, "workers", "DensityObject", "opening 20 objects", "import xden1k"):
        assert name in text
    assert measured["fields"][0]["share"] == 1
    assert measured["data"]["sample_mb"] > 10 * measured["data"]["stored_mb"]
