"""Submissions that are sound as files but not what is being scored."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.phantoms import CUBE, box_object
from xden1k.errors import DataError
from xden1k.folder import open_folder, write_folder
from xden_bench.methods.baseline import find_predictor, run_predictor
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import score
from xden_bench.scoring.submission import validate

RULES = load_protocol()
COPIED = f"W504: the values of the reference, within {RULES.copied_within:.1%}"
Submit = Callable[..., Path]


def scaled(_: str, grid: np.ndarray) -> np.ndarray:
    """Wrong, but not suspicious."""
    return np.float32(1.1) * grid


def found(path: Path, reference: Reference, **more: object) -> list[str]:
    return [str(problem) for problem in validate(path, reference, RULES, **more)]


def test_a_sound_submission_has_no_problem(submission: Submit, reference: Reference) -> None:
    assert found(submission(scaled), reference) == []


@pytest.mark.parametrize(
    ("meta", "line"),
    [
        (
            {"dataset_revision": "0.2.0"},
            "E205: dataset_revision must be '0.1.0' here, got '0.2.0'",
        ),
        ({"config": "metadata"}, "E205: config must be 'default' here, got 'metadata'"),
        ({"split": "val"}, "E205: split must be 'test' here, got 'val'"),
    ],
)
def test_e205_what_was_predicted(
    submission: Submit, reference: Reference, meta: dict[str, str], line: str
) -> None:
    assert found(submission(scaled, **meta), reference) == [line]


def test_e205_another_dataset_of_the_same_revision(
    submission: Submit, reference: Reference, tmp_path: Path
) -> None:
    path = tmp_path / "water.npz"
    run_predictor(find_predictor("water"), reference.folder, "test", path)
    assert not [line for line in found(path, reference) if line.startswith("E")]
    here, other = reference.manifest_sha256, "0" * 64
    assert found(submission(scaled, manifest_sha256=here), reference) == []
    assert found(submission(scaled, manifest_sha256=other), reference) == [
        f"E205: manifest_sha256 must be {here!r} here, got {other!r}"
    ]
    objects = [reference.folder.object(one) for one in sorted(reference.folder.ids())]
    write_folder(objects, tmp_path / "other", version="0.1.0", builder="another")
    (line,) = (
        line
        for line in found(path, Reference(open_folder(tmp_path / "other"), "test"))
        if line.startswith("E")
    )
    assert line.startswith("E205: manifest_sha256 must be ")


def test_e205_another_track(submission: Submit, reference: Reference) -> None:
    path = submission(scaled, inputs=("mesh", "parts"))
    assert found(path, reference, track="rgb") == [
        "E205: track must be 'rgb' here, got 'rgb_parts', from the inputs ['mesh', 'parts']"
    ]
    assert found(path, reference, track="rgb_parts") == []


def test_e301_and_e302_are_told_together(submission: Submit, reference: Reference) -> None:
    from xden1k.predictions import PredictionsWriter, open_predictions

    path = submission(scaled)
    with open_predictions(path) as old, PredictionsWriter(path.with_name("p.npz")) as new:
        for object_id in old.ids:
            new.add(object_id.replace("bar", "baz"), old.read(object_id))
        assert old.meta is not None
        new.finish(old.meta)
    assert found(path.with_name("p.npz"), reference) == [
        "E301: objects missing of the 4 in the split test: 1: 'bar-0002'",
        "E302: objects that are none of the 4 in the split test: 1: 'baz-0002'",
    ]


def test_a_file_that_is_no_archive_has_one_problem(tmp_path: Path, reference: Reference) -> None:
    (tmp_path / "p.npz").write_bytes(b"hello")
    (line,) = found(tmp_path / "p.npz", reference)
    assert line.startswith("E101")


def test_an_object_with_a_flaw_is_not_called_missing(
    submission: Submit, reference: Reference
) -> None:
    path = submission(lambda _, grid: grid[:1].ravel()[:3] * 0 if _ == "bar-0002" else grid * 1.1)
    lines = found(path, reference)
    assert lines == [
        "E402 bar-0002: part_density is for methods whose inputs include 'parts'; "
        "send a density grid"
    ]


def test_e402_the_wrong_number_of_parts(submission: Submit, reference: Reference) -> None:
    path = submission(lambda *_: np.array([0, 1, 2], np.float32), inputs=("parts",))
    assert found(path, reference) == [
        "E402 cube-0003: shape must be (2,), air and 1 parts, got (3,)",
        "E402 hollow-0002: shape must be (2,), air and 1 parts, got (3,)",
    ]


def test_e405_the_wrong_place(submission: Submit, reference: Reference) -> None:
    def corner(_: str, grid: np.ndarray) -> np.ndarray:
        grid[:] = 0
        grid[0, 0, 0] = 1
        return grid

    lines = found(submission(corner), reference)
    assert len(lines) == 4
    assert lines[0] == (
        "E405 bar-0002: it has mass, but none where the object is: check axes and origin"
    )


def test_w501_kilograms_sent_as_grams(submission: Submit, reference: Reference) -> None:
    path = submission(lambda _, grid: 1100 * grid)
    (problem,) = validate(path, reference, load_protocol("v1"))
    assert str(problem) == "W501: highest value 8800 g/cm³, above 25: units?"


def test_e407_what_no_matter_has_is_refused_where_the_protocol_says_so(
    submission: Submit, reference: Reference
) -> None:
    path = submission(lambda _, grid: np.float32(1100) * grid)
    (problem,) = validate(path, reference, load_protocol("v2"))
    assert str(problem) == "E407: highest value 8800 g/cm³, above 25: units?"
    assert problem.is_error


def test_e207_a_template_without_a_name(submission: Submit, reference: Reference) -> None:
    lines = found(submission(method="my method"), reference)
    assert lines[0].startswith("E207: method is still 'my method', as in the template")


def test_w501_grams_sent_as_kilograms(submission: Submit, reference: Reference) -> None:
    lines = found(submission(scaled, units="kg/m3"), reference)
    assert lines == ["W501: kg/m3 declared, but the highest value is 8.8"]


@pytest.mark.parametrize("constant", [0.0, 2.5])
def test_w502_one_constant(submission: Submit, reference: Reference, constant: float) -> None:
    path = submission(
        lambda one, _: np.float32(constant) * reference.truth(one).envelope, dtype="float16"
    )
    assert found(path, reference) == [f"W502: {constant:g} g/cm³ inside every object"]


def test_w503_mass_outside(submission: Submit, reference: Reference) -> None:
    def leak(_: str, grid: np.ndarray) -> np.ndarray:
        grid *= np.float32(1.1)
        grid[:, :, 0] += np.float32(0.02 * grid.sum() / grid[:, :, 0].size)
        return grid

    (line,) = found(submission(leak), reference)
    assert line.startswith(
        "W503: over 1% of the mass lies outside the object, not scored: 4: 'bar-0002'"
    )


def with_air(_: str, grid: np.ndarray) -> np.ndarray:
    grid[0, 0, 0] += np.float32(0.01)
    return grid


def with_noise(_: str, grid: np.ndarray) -> np.ndarray:
    noise = np.random.default_rng(0).normal(0, 0.001, grid.shape)
    return np.maximum(grid * (1 + noise), 0).astype(np.float32)


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda _, grid: grid, id="the truth itself"),
        pytest.param(with_air, id="one voxel of air"),
        pytest.param(lambda _, grid: np.float32(1.0015) * grid, id="scaled"),
        pytest.param(lambda _, grid: grid.astype(np.float16).astype(np.float32), id="rounded"),
        pytest.param(with_noise, id="noise"),
    ],
)
def test_w504_a_copy_of_the_truth_is_told_whatever_is_done_to_it(
    submission: Submit, reference: Reference, change: Callable[[str, np.ndarray], np.ndarray]
) -> None:
    path = submission(change)
    assert found(path, reference) == [
        f"{COPIED}: 4: 'bar-0002', 'cube-0003', 'filled-0001', 'hollow-0002'"
    ]


def hit(*names: str) -> Callable[[str, np.ndarray], np.ndarray]:
    """The truth of these objects, and what is a tenth off of others."""
    return lambda one, grid: grid if one in names else 1.1 * grid


def test_w504_is_not_for_homogeneous_objects_that_a_good_method_hits(
    submission: Submit, reference: Reference
) -> None:
    assert found(submission(hit("cube-0003")), reference) == []


def test_w504_is_not_for_a_few_objects_that_a_good_method_hits(
    submission: Submit, reference: Reference
) -> None:
    path = submission(hit("bar-0002"))
    assert found(path, reference) == [f"{COPIED}: 1: 'bar-0002'"]
    lenient = replace(RULES, max_identical_share=0.5)
    assert validate(path, reference, lenient) == ()


def test_the_checksum_of_the_arrays_sees_what_is_scored_alone(
    submission: Submit, reference: Reference
) -> None:
    def checksum(*change: Any, **options: Any) -> str:
        return score(submission(*change, **options), reference, RULES).arrays_sha256

    plain = checksum()
    assert plain == checksum(with_air) == checksum(method="another")
    assert plain != checksum(hit("bar-0002"))


def test_an_object_without_density_is_scored_on_attenuation_alone(
    submission: Submit, tmp_path: Path
) -> None:
    unknown = box_object("cube-0009", CUBE, split="val", density_known=False)
    write_folder([unknown], tmp_path / "dataset", version="0.1.0", builder="tests")
    reference = Reference(open_folder(tmp_path / "dataset"), "val")
    with pytest.raises(DataError, match="cube-0009 has no density, only attenuation"):
        reference.truth("cube-0009")
    assert reference.truth("cube-0009", "apparent_density").density_g_cm3.max() == 2.5


def test_the_protocol_is_the_file_that_design_names() -> None:
    link = Path(__file__).parents[2] / "benchmarks" / "protocol-v1.toml"
    assert link.resolve() == link.parent / "xden_bench" / "scoring" / "protocol-v1.toml"
    assert load_protocol("v1").name == "v1"
    with pytest.raises(DataError, match="no protocol 'v9'"):
        load_protocol("v9")
