"""The manuals say what the code does."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from xden1k.modality import INPUTS, TRACKS
from xden1k.predictions import CODES, SubmissionMeta, open_predictions
from xden_bench.cli import cli
from xden_bench.metrics import METRICS
from xden_bench.protocol import load_protocol

ROOT = Path(__file__).parents[2]
MANUAL = (ROOT / "benchmarks" / "README.md").read_text()


def test_every_code_is_in_the_manual() -> None:
    assert dict(re.findall(r"^\| ([EW]\d{3}) \| (.*) \|$", MANUAL, re.MULTILINE)) == CODES


def test_the_manuals_python_writes_a_submission(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", MANUAL, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    exec(code, {"ids": ["mug"], "predict": lambda _: np.zeros((64, 64, 64))})  # noqa: S102
    with open_predictions(tmp_path / "preds.npz") as predictions:
        assert predictions.ids == ("mug",)


@pytest.mark.parametrize(
    "names",
    [
        tuple(METRICS),
        tuple(field.name for field in dataclasses.fields(SubmissionMeta)),
        tuple(load_protocol().unranked),
        TRACKS,
        INPUTS,
    ],
)
def test_every_name_is_in_the_manual(names: tuple[str, ...]) -> None:
    assert [name for name in names if f"`{name}`" not in MANUAL] == []


def test_every_command_is_in_the_manual() -> None:
    assert [name for name in cli.commands if f"xden-bench {name}" not in MANUAL] == []


def test_every_baseline_is_in_its_manual() -> None:
    text = (ROOT / "baselines" / "README.md").read_text()
    listed = re.findall(r"^\| `([a-z-]+)` \|", text, re.MULTILINE)
    assert listed == list(load_protocol().unranked)


def test_links_of_the_manuals_lead_somewhere() -> None:
    for folder in ("benchmarks", "baselines"):
        text = (ROOT / folder / "README.md").read_text()
        for link in re.findall(r"\]\(([^)]+)\)", text):
            assert (ROOT / folder / link).exists(), link
