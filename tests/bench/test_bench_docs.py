"""The manuals say what the code does."""

from __future__ import annotations

import dataclasses
import hashlib
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from xden1k.predictions import CODES, SubmissionMeta
from xden1k.segmentation import SEGMENT_CODES
from xden1k.values.modality import INPUTS, TRACKS
from xden_bench.cli import cli
from xden_bench.methods.baseline import run_predictor
from xden_bench.scoring.metrics import METRICS
from xden_bench.scoring.protocol import load_protocol, load_segment_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.submission import validate

ROOT = Path(__file__).parents[2]
PREDICTIONS = (ROOT / "docs" / "formats" / "predictions.md").read_text()
SCORING = (ROOT / "docs" / "method" / "scoring.md").read_text()
SEGMENTS = (ROOT / "docs" / "formats" / "segments.md").read_text()
SEGMENTATION = (ROOT / "docs" / "method" / "segmentation.md").read_text()
SUBMIT = (ROOT / "docs" / "manual" / "submit.md").read_text()
HIDDEN = (ROOT / "docs" / "manual" / "hidden-truth.md").read_text()


def test_every_code_is_in_the_manual() -> None:
    assert dict(re.findall(r"^\| ([EW]\d{3}) \| (.*) \|$", PREDICTIONS, re.MULTILINE)) == CODES


def python_of(manual: str, which: int = 0, of: int = 1) -> dict[str, Any]:
    """Run one piece of a manual's Python with nothing but itself."""
    codes = re.findall(r"```python\n(.*?)```", manual, re.DOTALL)
    assert len(codes) == of
    names: dict[str, Any] = {}
    exec(codes[which], names)  # noqa: S102
    return names


def errors_of(path: Path, reference: Reference) -> list[str]:
    return [str(one) for one in validate(path, reference, load_protocol()) if one.is_error]


def test_the_manuals_python_writes_a_submission_that_is_valid(
    tmp_path: Path, reference: Reference, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDEN1K_ROOT", str(reference.folder.root))
    python_of(PREDICTIONS)
    assert errors_of(tmp_path / "preds.npz", reference) == []


def test_the_baselines_manuals_method_runs(tmp_path: Path, reference: Reference) -> None:
    made = python_of((ROOT / "docs" / "manual" / "predictor.md").read_text(), of=2)["MyMethod"]()
    run_predictor(made, reference.folder, "test", tmp_path / "preds.npz")
    assert errors_of(tmp_path / "preds.npz", reference) == []
    assert 1 < made.density_g_cm3 < 4.5


@pytest.mark.parametrize(
    ("names", "page"),
    [
        (tuple(METRICS), SCORING),
        (tuple(field.name for field in dataclasses.fields(SubmissionMeta)), PREDICTIONS),
        (tuple(load_protocol().unranked), SCORING),
        (TRACKS, SCORING),
        (INPUTS, SCORING),
        (INPUTS, PREDICTIONS),
    ],
)
def test_every_name_is_in_the_manual(names: tuple[str, ...], page: str) -> None:
    assert [name for name in names if f"`{name}`" not in page] == []


def test_every_command_is_in_the_manual() -> None:
    missing = [name for name in cli.commands if f"xden-bench {name} " not in SUBMIT]
    assert [name for name in missing if f"xden-bench {name} " not in HIDDEN] == []


def test_every_baseline_is_in_its_manual() -> None:
    pages = [ROOT / "docs" / "method" / name for name in ("baselines.md", "x-field.md")]
    text = "\n".join(page.read_text() for page in pages)
    listed = set(re.findall(r"^\| `([a-z0-9-]+)` \|", text, re.MULTILINE))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    installed = set(project["entry-points"]["xden1k.predictors"])
    assert set(load_protocol().unranked) <= installed
    assert installed - listed == set()


def test_the_changelog_knows_the_golden_numbers() -> None:
    """When a golden number moves, CHANGELOG.md says why and quotes the checksum of the new file."""
    golden = (ROOT / "tests" / "golden" / "bench.json").read_bytes()
    digest = hashlib.sha256(golden).hexdigest()[:12]
    assert digest in (ROOT / "CHANGELOG.md").read_text(), f"quote {digest} and say what moved"


def test_every_code_of_segments_is_in_the_manual() -> None:
    found = dict(re.findall(r"^\| (E\d{3}) \| (.*) \|$", SEGMENTS, re.MULTILINE))
    assert found == SEGMENT_CODES
    assert [name for name in ("points_seed", "points_sha256") if f"`{name}`" not in SEGMENTS] == []


def test_every_row_and_metric_of_segments_is_in_the_manual() -> None:
    rules = load_segment_protocol()
    names = [*rules.metrics, *rules.unranked]
    assert [name for name in names if f"`{name}`" not in SEGMENTATION] == []


def test_the_protocol_of_segments_never_changes() -> None:
    text = (ROOT / "benchmarks" / "segment-v1.toml").read_text()
    frozen = re.sub(r"^metric_version = .*$", "", text, flags=re.MULTILINE)
    assert hashlib.sha256(frozen.encode()).hexdigest()[:12] == "e9f3d63fe439"
