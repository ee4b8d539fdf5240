"""Entries as the Hub reads them."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from huggingface_hub import parse_eval_result_entries

from xden1k.errors import DataError
from xden_bench.entries.eval_results import TASKS, left_out_because, write_eval_results
from xden_bench.entries.result import entry_of
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import score

ROOT = Path(__file__).parents[2]


@pytest.fixture
def entry(submission: Callable[..., Path], reference: Reference) -> dict[str, Any]:
    path = submission(lambda _, grid: 1.25 * grid, method="My net")
    scored = score(path, reference, load_protocol())
    return entry_of(scored, reference, command="", date=datetime.date(2025, 12, 10))


def test_the_tasks_are_those_of_the_dataset() -> None:
    tasks = yaml.safe_load((ROOT / "xden1k" / "sample" / "eval.yaml").read_text())["tasks"]
    assert {one["id"]: (one["config"], one["split"]) for one in tasks} == dict.fromkeys(
        TASKS, ("default", "test")
    )


def test_the_hubs_own_reader_reads_the_values_back(entry: dict[str, Any], tmp_path: Path) -> None:
    (path,) = write_eval_results([entry], tmp_path / ".eval_results", "me/my-data")
    assert path.name == f"my-net-{entry['submission_sha256'][:8]}.yaml"
    found = parse_eval_result_entries(yaml.safe_load(path.read_text()))
    assert {one.task_id: one.value for one in found} == {
        task: entry["metrics"][metric]["mean"] for task, metric in TASKS.items()
    }
    for one in found:
        assert (one.dataset_id, one.date) == ("me/my-data", "2025-12-10")
        assert one.notes is not None
        assert "4 objects, simulated phantoms; track geometry, protocol v2" in one.notes
        assert one.notes.endswith("self-reported")


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"target": "apparent_density"}, "target must be 'density', got 'apparent_density'"),
        ({"protocol": "paper"}, "protocol must be 'v2', got 'paper'"),
        ({"metric_version": 0}, "metric version must be 1, got 0"),
        ({"warnings": ["W504: x"]}, "not ranked: its values are those of the reference"),
    ],
)
def test_what_the_hubs_tasks_do_not_hold_is_left_out_with_a_reason(
    entry: dict[str, Any], tmp_path: Path, changes: dict[str, Any], reason: str
) -> None:
    assert left_out_because(entry) is None
    assert left_out_because(entry | changes) == reason
    with pytest.raises(DataError, match=f"is none of the Hub's tasks: {reason}"):
        write_eval_results([entry | changes], tmp_path, "me/my-data")
    assert list(tmp_path.glob("*.yaml")) == []
