"""What radiographs are worth to a trained X-Field, on simulated objects."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from xden1k.folder import open_folder
from xden_bench.cli import cli as bench
from xden_bench.scoring.protocol import load_segment_protocol
from xden_bench.scoring.regions import SegmentReference
from xden_bench.scoring.segments import score_segment_file
from xden_builder.cli import cli as build

OBJECTS, SEED, SIZE_PX = 300, 31, 96
EPOCHS = 25


def call(cli: object, *words: str | Path) -> str:
    result = CliRunner().invoke(cli, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return result.stdout


def iou_a(segments: Path, root: Path) -> np.ndarray:
    """IoU in protocol A of each object of two regions or more, in the order of their ids."""
    reference = SegmentReference(open_folder(root), "test", load_segment_protocol())
    scores = score_segment_file(segments, reference).objects
    found = np.array([one.metrics["iou_a"] for one in scores])
    return found[~np.isnan(found)]


def least_gain(better: np.ndarray, worse: np.ndarray) -> float:
    """Lower end of the 95 % interval of a mean paired difference."""
    gain = better - worse
    return float(gain.mean() - 1.96 * gain.std(ddof=1) / np.sqrt(len(gain)))


@pytest.mark.slow
def test_radiographs_help_and_those_of_another_object_hurt(tmp_path: Path) -> None:
    root, swapped = tmp_path / "data", tmp_path / "swapped"
    counts = ("--count", OBJECTS, "--seed", SEED, "--size", SIZE_PX)
    call(build, "phantoms", root, "--as-dataset", *counts)
    call(bench, "disturb", root, "--out", swapped, "--split", "test", "--swap")

    def segments(method: str, of: Path, *more: str | Path) -> np.ndarray:
        out = tmp_path / f"{method}-{of.name}.npz"
        words = ("--task", "segments", "--root", of, "--out", out)
        call(bench, "baseline", method, *words, *more)
        return iou_a(out, of)

    taught = ("--budget", f"{EPOCHS}epochs", "--seed", "0", "--save")
    blind = segments("x-field-geometry-contrastive", root, *taught, tmp_path / "blind")
    seeing = segments("x-field", root, *taught, tmp_path / "seeing")
    misled = segments("x-field", swapped, "--model", tmp_path / "seeing")
    assert least_gain(seeing, blind) > 0
    assert least_gain(seeing, misled) > 0
    assert blind.mean() > misled.mean(), "believed, another object's are worse than none"
