"""An error splits into what is misjudged on view and what no picture shows."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from tests.bench.conftest import Submit
from xden1k.errors import DataError, SubmissionError
from xden_bench.cli import cli
from xden_bench.scoring.hidden import HIDDEN_ABOVE, SplitError, split_errors
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference

RULES = load_protocol()
SOLID = {"bar-0002": None, "cube-0003": None, "filled-0001": 1.0, "hollow-0002": 1.5}
"""What a perfect eye takes an object for, g/cm³; None where that is the truth."""


@pytest.fixture
def eye(submission: Submit, reference: Reference) -> Path:
    """The surface's density through and through."""

    def solid(object_id: str, grid: np.ndarray) -> np.ndarray:
        density = SOLID[object_id]
        return grid if density is None else density * reference.truth(object_id).envelope

    return submission(solid, "eye.npz", inputs=("mesh", "rgb", "parts", "materials"))


def split(submission: Path, eye: Path, reference: Reference) -> SplitError:
    return split_errors(submission, eye, reference, RULES)


def test_shares_add_up_to_the_error_that_is_ranked(
    submission: Submit, eye: Path, reference: Reference
):
    rng = np.random.default_rng(0)
    noisy = submission(lambda _, grid: rng.uniform(0, 8, grid.shape).astype(np.float32))
    found = split(noisy, eye, reference)
    assert found.recognition_g_cm3 + found.hidden_g_cm3 == pytest.approx(found.density_mae_g_cm3)
    scored = CliRunner().invoke(
        cli, ["score", str(noisy), "--root", str(reference.folder.root), "--json"]
    )
    ranked = json.loads(scored.output)["metrics"]["density_mae_g_cm3"]["mean"]
    assert found.density_mae_g_cm3 == pytest.approx(ranked)
    assert found.objects == len(reference.ids)


def test_a_perfect_eye_errs_in_what_is_hidden_alone(eye: Path, reference: Reference):
    found = split(eye, eye, reference)
    assert found.from_eye_g_cm3 == 0
    assert found.hidden_g_cm3 > 0.1
    assert found.recognition_g_cm3 < 0.05 * found.hidden_g_cm3  # voxels cut by a cavity's wall


def test_the_truth_has_no_error_of_either_kind(submission: Submit, eye: Path, reference: Reference):
    found = split(submission(), eye, reference)
    assert found.density_mae_g_cm3 == found.recognition_g_cm3 == found.hidden_g_cm3 == 0
    assert found.from_eye_g_cm3 == pytest.approx(split(eye, eye, reference).hidden_g_cm3, rel=0.05)


def test_a_wrong_surface_is_recognition_and_a_missed_cavity_is_hidden(
    submission: Submit, eye: Path, reference: Reference
):
    only = "hollow-0002"  # 56 cm³ of 1.5 g/cm³ around 8 cm³ of nothing
    outside = 2 * 1.5 * reference.truth(only).envelope
    doubled = submission(lambda one, grid: outside if one == only else grid)
    found, count = split(doubled, eye, reference), len(reference.ids)
    assert count * found.recognition_g_cm3 == pytest.approx(56 * 1.5 / 64, rel=0.1)
    assert count * found.hidden_g_cm3 == pytest.approx(8 * 3.0 / 64, rel=0.3)
    # to the voxel, by hand
    truth = reference.truth(only)
    solid = 1.5 * truth.envelope
    apart = np.abs(truth.density_g_cm3 - solid) > HIDDEN_ABOVE * np.maximum(
        truth.density_g_cm3, solid
    )
    weighed = np.abs(outside - truth.density_g_cm3) * truth.envelope / truth.envelope.sum()
    assert count * found.hidden_g_cm3 == pytest.approx(weighed[apart].sum(), rel=1e-3)


def test_a_method_that_was_told_nothing_is_no_eye(
    submission: Submit, eye: Path, reference: Reference
):
    with pytest.raises(DataError, match=r"preds.npz: expected a perfect eye.*test looks at mesh$"):
        split(eye, submission(), reference)
    apparent = submission(target="apparent_density")
    with pytest.raises(DataError, match=r"its target is density, that of test apparent_density"):
        split(apparent, eye, reference)


def test_problems_of_either_file_are_told(submission: Submit, eye: Path, reference: Reference):
    lacking = submission(lambda one, grid: None if one == "bar-0002" else grid)
    with pytest.raises(SubmissionError, match=r"E301.*bar-0002"):
        split(lacking, eye, reference)


def test_the_command_prints_a_row_for_each(submission: Submit, eye: Path, reference: Reference):
    mine = submission()
    command = ["appearance", str(mine), str(eye), "--eye", str(eye)]
    done = CliRunner().invoke(cli, [*command, "--root", str(reference.folder.root)])
    assert done.exit_code == 0, done.output
    assert done.output.splitlines()[0].split() == [
        *("method", "density", "MAE,", "g/cm³", "recognition", "hidden", "from", "the", "eye")
    ]
    assert done.output.splitlines()[-1].startswith("means over 4 objects")
    done = CliRunner().invoke(cli, [*command, "--root", str(reference.folder.root), "--json"])
    assert [one["objects"] for one in json.loads(done.output)] == [4, 4]
