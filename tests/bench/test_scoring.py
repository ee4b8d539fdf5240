"""Scores of whole submissions."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from xden1k.errors import DataError, SubmissionError
from xden1k.folder import DatasetFolder
from xden_bench.methods.baseline import find_predictor, run_predictor
from xden_bench.scoring.expand import PartShares, part_shares
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import Score, score

RULES = load_protocol()
Submit = Callable[..., Path]


def means(scored: Score) -> dict[str, float]:
    return {name: one.mean for name, one in scored.metrics.items()}


@pytest.mark.parametrize("dtype", ["float16", "float32"])
def test_the_truth_scores_exactly_zero(
    submission: Submit, reference: Reference, dtype: str
) -> None:
    found = means(score(submission(dtype=dtype), reference, RULES))
    assert found.pop("mass_mnre") == 1.0
    assert set(found.values()) == {0.0}


def test_zero_has_a_mape_of_one(submission: Submit, reference: Reference) -> None:
    found = means(score(submission(lambda _, grid: 0 * grid), reference, RULES))
    assert found["mass_mape"] == 1.0
    assert found["inertia_error"] == 1.0
    assert found["mass_mnre"] == 0.0


@pytest.mark.parametrize(
    "scale", [0.5, *(pytest.param(one, marks=pytest.mark.slow) for one in (1.25, 2.0))]
)
def test_k_times_the_truth_is_wrong_by_k_minus_1(
    submission: Submit, reference: Reference, scale: float
) -> None:
    found = means(score(submission(lambda _, grid: scale * grid), reference, RULES))
    assert found["mass_mape"] == pytest.approx(abs(scale - 1), rel=1e-6)
    assert found["com_l1_cm"] == pytest.approx(0, abs=1e-9)


def test_units_do_not_matter(submission: Submit, reference: Reference) -> None:
    grams = score(submission(lambda _, grid: 1.1 * grid), reference, RULES)
    kilos = score(
        submission(lambda _, grid: 1100 * grid, name="kilos.npz", units="kg/m3"), reference, RULES
    )
    for name, value in means(grams).items():
        assert means(kilos)[name] == pytest.approx(value, rel=1e-5, abs=1e-6)


def test_the_order_of_the_objects_does_not_matter(
    submission: Submit, reference: Reference, tmp_path: Path
) -> None:
    rng = np.random.default_rng(0)
    path = submission(lambda _, grid: grid * rng.random(grid.shape, np.float32))
    turned = tmp_path / "turned.npz"
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(turned, "w") as new:
        for name in reversed(old.namelist()):
            new.writestr(name, old.read(name))
    assert score(path, reference, RULES).metrics == score(turned, reference, RULES).metrics


def test_each_object_counts_once_whatever_its_size(
    submission: Submit, reference: Reference
) -> None:
    def change(object_id: str, grid: np.ndarray) -> np.ndarray:
        return grid * (3.0 if object_id == "cube-0003" else 1.0)

    scored = score(submission(change), reference, RULES)
    assert scored.metrics["mass_mape"].mean == pytest.approx(2 / 4, rel=1e-6)
    assert {one.object_id: one.metrics["mass_mape"] for one in scored.objects} == pytest.approx(
        {"bar-0002": 0, "cube-0003": 2, "filled-0001": 0, "hollow-0002": 0}
    )


def test_tables_by_category_and_by_size(submission: Submit, reference: Reference) -> None:
    scored = score(submission(lambda _, grid: 2 * grid), reference, RULES)
    assert {name: count for name, (count, _) in scored.by_category().items()} == {
        "bar": 1,
        "cube": 1,
        "filled": 1,
        "hollow": 1,
    }
    ((name, (count, metrics)),) = scored.by_size().items()
    assert (name, count) == ("under 8 cm", 4)
    assert metrics == scored.metrics


def test_the_extent_is_the_longest_edge(reference: Reference) -> None:
    truth = reference.truth("bar-0002")
    assert truth.extent_cm == pytest.approx(4.0, abs=2 * truth.voxel_size_cm)


def test_a_bad_submission_has_no_score(submission: Submit, reference: Reference) -> None:
    path = submission(lambda one, grid: None if one == "bar-0002" else grid)
    with pytest.raises(SubmissionError, match=r"E301: objects missing of the 4.*'bar-0002'"):
        score(path, reference, RULES)


def test_part_densities_score_like_their_grid(submission: Submit, reference: Reference) -> None:
    values = {
        "bar-0002": [0, 1, 8],
        "cube-0003": [0, 2],
        "filled-0001": [0, 1, 4],
        "hollow-0002": [0, 1.5],
    }
    path = submission(
        lambda one, _: np.array(values[one], np.float32), inputs=("mesh", "parts", "xray")
    )
    found = means(score(path, reference, RULES))
    assert found["mass_mape"] < 0.005
    assert found["com_l1_cm"] < 0.01
    assert found["density_mae_g_cm3"] < 0.05


def test_apparent_density_is_scored_against_itself(
    submission: Submit, reference: Reference
) -> None:
    def apparent(object_id: str, _: np.ndarray) -> np.ndarray:
        return reference.truth(object_id, "apparent_density").density_g_cm3

    right = submission(apparent, name="right.npz", target="apparent_density")
    assert means(score(right, reference, RULES))["density_mae_g_cm3"] == 0.0
    for wrong in (submission(target="apparent_density"), submission(apparent, name="other.npz")):
        assert means(score(wrong, reference, RULES))["density_mae_g_cm3"] > 0.3


def with_sd(path: Path, reference: Reference, sd: float, kind: str = "density") -> Path:
    """Give every object of a submission the same standard deviation."""
    with np.load(path) as sound:
        arrays = dict(sound)
    for one in reference.ids:
        values = np.full_like(arrays[f"{kind}/{one}"], sd)
        if kind == "part_density":
            values[0] = 0
        arrays[f"{kind}_sd/{one}"] = values
    np.savez_compressed(path, **arrays)
    return path


def test_calibration_is_scored_where_there_is_a_deviation(
    submission: Submit, reference: Reference
) -> None:
    without = score(submission(lambda _, grid: 1.1 * grid), reference, RULES)
    assert not set(RULES.sd_metrics) & without.metrics.keys()
    path = submission(lambda _, grid: grid, name="sure.npz")
    found = means(score(with_sd(path, reference, 0.5), reference, RULES))
    assert tuple(found) == RULES.metrics_of(has_sd=True)
    assert found["density_crps_g_cm3"] == pytest.approx(0.5 * 0.2336949, rel=1e-4)
    assert found["density_within_1sd"] == found["density_within_2sd"] == 1.0


def test_deviations_in_kilograms_are_converted(submission: Submit, reference: Reference) -> None:
    path = submission(lambda _, grid: 1000 * grid, units="kg/m3")
    found = means(score(with_sd(path, reference, 500.0), reference, RULES))
    assert found["density_crps_g_cm3"] == pytest.approx(0.5 * 0.2336949, rel=1e-4)


def test_deviations_of_parts_are_spread_over_their_voxels(
    submission: Submit, reference: Reference
) -> None:
    values = {"bar-0002": [0, 1, 8], "cube-0003": [0, 2], "filled-0001": [0, 1, 4]}
    values["hollow-0002"] = [0, 1.5]
    path = submission(
        lambda one, _: np.array(values[one], np.float32), inputs=("mesh", "parts", "xray")
    )
    found = means(score(with_sd(path, reference, 0.5, "part_density"), reference, RULES))
    inside = 0.5 * 0.2336949
    assert 0.6 * inside < found["density_crps_g_cm3"] <= inside * 1.01
    assert found["density_within_2sd"] > 0.95


def test_parts_are_cut_once_for_density_and_deviation(
    submission: Submit, reference: Reference, monkeypatch: pytest.MonkeyPatch
) -> None:
    cuts = []

    def counted(*place: Any) -> PartShares:
        cuts.append(place)
        return part_shares(*place)

    monkeypatch.setattr("xden_bench.scoring.submission.part_shares", counted)
    ones = {one: [0.0] + [1.0] * reference.truth(one).parts for one in reference.ids}
    path = submission(lambda one, _: np.array(ones[one]), inputs=("mesh", "parts"))
    score(with_sd(path, reference, 0.5, "part_density"), reference, RULES)
    assert len(cuts) == len(reference.ids)


def test_the_papers_protocol_scores_its_three_metrics_of_apparent_density(
    submission: Submit, reference: Reference
) -> None:
    paper = load_protocol("paper")
    with pytest.raises(SubmissionError, match="E205: target must be one of"):
        score(submission(), reference, paper)
    path = submission(target="apparent_density")
    found = means(score(with_sd(path, reference, 0.5), reference, paper))
    assert tuple(found) == ("density_mae_g_cm3", "com_l1_cm", "mass_mape")
    assert {"density_unit", "domain", "mass_rule", "split"} <= paper.open_choices.keys()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"sd_metrics": ("sharpness",)}, r"unknown metrics \['sharpness'\]; known: "),
        ({"max_density_g_cm3": {"density": 25.0}}, "max_density_g_cm3 must name the targets"),
        ({"rank_by": "mass_error"}, "rank_by 'mass_error' is not in metrics"),
        ({"size_edges_cm": (20.0, 8.0)}, "size_edges_cm must ascend"),
        ({"size_edges_cm": (8.0, 8.0)}, "size_edges_cm must ascend"),
    ],
)
def test_rules_that_contradict_themselves_are_refused(
    changed: dict[str, Any], message: str
) -> None:
    with pytest.raises(DataError, match=f"protocol {RULES.name}: {message}"):
        replace(RULES, **changed)


def test_a_split_that_is_not_there(folder: DatasetFolder) -> None:
    with pytest.raises(DataError, match="no split 'nope'"):
        Reference(folder, "nope")


def test_the_numbers_of_the_whole_way(
    folder: DatasetFolder,
    reference: Reference,
    tmp_path: Path,
    golden: Callable[..., None],
) -> None:
    """When one of these moves, the CHANGELOG says why."""
    found, rules = {}, load_protocol("v1")
    for name in ("zero", "water", "train-median", "category-median"):
        path = tmp_path / f"{name}.npz"
        run_predictor(find_predictor(name), folder, "test", path)
        for metric, one in score(path, reference, rules).metrics.items():
            found[f"{name} {metric}"] = [one.mean, *(one.interval or ())]
    sure = score(with_sd(tmp_path / "water.npz", reference, 0.5), reference, rules).metrics
    for metric in RULES.sd_metrics:
        found[f"water with sd {metric}"] = [
            sure[metric].mean,
            *(sure[metric].interval or ()),
        ]
    golden("bench", found)
