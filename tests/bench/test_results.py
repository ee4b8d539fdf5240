"""Entries and the leaderboard made of them."""

from __future__ import annotations

import copy
import datetime
import hashlib
import json
import re
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from tests.bench.conftest import submissions
from xden1k.errors import DataError
from xden_bench.entries.durable import results_lock
from xden_bench.entries.entry_form import check_form
from xden_bench.entries.leaderboard import (
    BEGIN,
    END,
    check_leaderboard,
    group_tables,
    render,
    write_leaderboard,
)
from xden_bench.entries.merging import merged_rows
from xden_bench.entries.provenance import code_commit
from xden_bench.entries.ranking import MERGED, rank_labels, ranks
from xden_bench.entries.reading import read_entries
from xden_bench.entries.recomputed import write_recomputed
from xden_bench.entries.result import entry_of, entry_path, object_columns, write_entry
from xden_bench.entries.signing import MAINTAINERS, SigningKey
from xden_bench.entries.verification import Verification
from xden_bench.manip.section import picks_sections
from xden_bench.scoring.metrics import METRICS
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import Score, score

RULES = load_protocol()
DATE = datetime.date(2025, 12, 10)
MAINTAINER, STRANGER = (SigningKey(one, Ed25519PrivateKey.generate()) for one in ("m", "s"))
FOUND = Verification(1, 1e-9, (), same_file=False, compared=("metrics",), not_verifiable=("date",))
Submit = Callable[..., Path]


@pytest.fixture(scope="module")
def scored(tmp_path_factory: pytest.TempPathFactory, reference: Reference) -> Score:
    write = submissions(tmp_path_factory.mktemp("results"), reference)
    path = write(lambda _, grid: 1.1 * grid, method="My | *net*", seed=7, notes="a note")
    return score(path, reference, RULES)


@pytest.fixture(scope="module")
def made(scored: Score, reference: Reference) -> dict[str, Any]:
    return entry_of(scored, reference, command="xden-bench submit preds.npz", date=DATE)


@pytest.fixture
def entry(made: dict[str, Any], scored: Score) -> dict[str, Any]:
    """An entry that a test may change."""
    return copy.deepcopy(made) | {"object_scores": object_columns(scored)}


def test_an_entry_says_how_to_remake_it(
    entry: dict[str, Any], scored: Score, reference: Reference
) -> None:
    manifest = (reference.folder.root / "manifest.json").read_bytes()
    assert entry["schema"] == "xden-result/2"
    assert entry["dataset"] == {
        "revision": "0.1.0",
        "config": "default",
        "split": "test",
        "source": "phantom",
        "manifest_sha256": hashlib.sha256(manifest).hexdigest(),
    }
    assert entry["method"]["seed"] == 7
    assert entry["command"] == "xden-bench submit preds.npz"
    assert entry["date"] == "2025-12-10"
    assert entry["submission_sha256"] == scored.submission_sha256
    assert entry["xden_version"]
    assert entry["commit"] is None or len(entry["commit"].removesuffix("-dirty")) == 40
    assert entry["bootstrap"] == {"seed": 20251210, "resamples": 10000}
    assert entry["metrics"]["mass_mape"]["mean"] == pytest.approx(0.1, rel=1e-5)
    assert entry["metrics"]["mass_mape"]["macro_mean"] == pytest.approx(0.1, rel=1e-5)
    assert entry["metrics"]["mass_mape"]["ci95"] is None
    assert entry["by_category"]["bar"]["n_objects"] == 1
    assert entry["higher_is_better"]["mass_mnre"] is True


def test_code_outside_a_checkout_has_no_commit(tmp_path: Path) -> None:
    assert code_commit(tmp_path) is None


def stored(entry: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in entry.items() if key != "object_scores"}


def test_an_entry_comes_back_with_its_objects(
    entry: dict[str, Any], scored: Score, tmp_path: Path
) -> None:
    path = write_entry(stored(entry), scored, tmp_path / "results")
    (read,) = read_entries(tmp_path / "results")
    objects = path.parent / read.pop("objects")["file"]
    assert read.pop("disqualified") == "its predictions are archived nowhere"
    assert read == json.loads(json.dumps(entry))
    assert read["metric_version"] == RULES.metric_version
    table = pq.read_table(objects).to_pydict()
    assert table["object_id"] == [one.object_id for one in scored.objects]
    assert table["mass_mape"] == [one.metrics["mass_mape"] for one in scored.objects]


def test_an_entry_is_never_changed(entry: dict[str, Any], scored: Score, tmp_path: Path) -> None:
    path = write_entry(stored(entry), scored, tmp_path)
    before = path.read_bytes()
    with pytest.raises(DataError, match=r"entered already: .*; entries are never changed"):
        write_entry({**stored(entry), "date": "2026-01-01"}, scored, tmp_path)
    assert path.read_bytes() == before
    assert sorted(one.suffix for one in path.parent.iterdir()) == [".json", ".parquet"]


def test_an_entry_that_is_no_json_leaves_nothing(
    entry: dict[str, Any], scored: Score, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_entry({**stored(entry), "n_objects": float("nan")}, scored, tmp_path / "results")
    assert not (tmp_path / "results").exists()


def test_an_entry_waits_for_another_writer(
    entry: dict[str, Any], scored: Score, tmp_path: Path
) -> None:
    writer = threading.Thread(target=write_entry, args=(stored(entry), scored, tmp_path))
    with results_lock(tmp_path):
        writer.start()
        writer.join(0.3)
        assert writer.is_alive()
        assert read_entries(tmp_path) == ()
    writer.join()
    assert len(read_entries(tmp_path)) == 1


def test_an_entry_lies_where_its_content_says(
    entry: dict[str, Any], scored: Score, tmp_path: Path
) -> None:
    path = write_entry(stored(entry), scored, tmp_path)
    path.rename(path.with_stem("better"))
    with pytest.raises(DataError, match=r"better.json: its content belongs to v2/0.1.0-"):
        read_entries(tmp_path)


def edited(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    entry = json.loads(path.read_text())
    change(entry)
    path.write_text(json.dumps(entry))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda one: one["metrics"]["mass_mape"].update(mean=0.01), "metrics is not what the"),
        (lambda one: one["metrics"]["com_l1_cm"].update(ci95=[0, 1]), "metrics is not what the"),
        (lambda one: one["metrics"].pop("density_mae_g_cm3"), "metrics is not what the objects"),
        (lambda one: one.pop("metrics"), "metrics is not what the objects"),
        (lambda one: one["by_category"]["bar"].update(n_objects=9), "by_category is not what"),
        (lambda one: one.update(n_objects=400), "n_objects is not what the objects"),
        (lambda one: one["bootstrap"].update(resamples=1), "bootstrap is not what the objects"),
        (lambda one: one.update(protocol="v9"), "its content belongs to v9/"),
        (lambda one: one.pop("warnings"), "warnings is missing from entry"),
        (lambda one: one["method"].pop("inputs"), "inputs is missing from method"),
        (lambda one: one["method"].update(inputs="mesh"), "inputs is of the wrong type, str"),
        (lambda one: one["dataset"].update(split=3), "split is of the wrong type, int"),
        (lambda one: one.update(objects=None), "objects is of the wrong type, NoneType"),
        (lambda one: one["objects"].update(sha256="0" * 64), "sha256 is "),
        (lambda one: one["method"].update(inputs=["xray"]), "the inputs lead to 'xray'"),
        (lambda one: one["method"].update(inputs=["lidar"]), "inputs must be a list of any of"),
        (lambda one: one["method"].update(name="w\u0430ter"), "E203: method must be one"),
        (lambda one: one.update(status="recomputed"), "status must be 'self-reported'"),
        (lambda one: one.update(status="by the organiser"), "status must be 'self-reported'"),
    ],
)
def test_an_edited_entry_is_refused_by_name(
    entry: dict[str, Any],
    scored: Score,
    tmp_path: Path,
    change: Callable[[dict[str, Any]], object],
    message: str,
) -> None:
    path = write_entry(stored(entry), scored, tmp_path)
    edited(path, change)
    with pytest.raises(DataError, match=re.escape(message)) as caught:
        read_entries(tmp_path)
    assert path.stem in str(caught.value)


def test_simulated_objects_are_not_passed_off_as_scans(
    entry: dict[str, Any], scored: Score, tmp_path: Path
) -> None:
    path = write_entry(stored(entry), scored, tmp_path)
    edited(path, lambda one: one["dataset"].update(source="scan"))
    scans = tmp_path / entry_path(json.loads(path.read_text())).parent
    scans.parent.mkdir()
    path.parent.rename(scans)
    with pytest.raises(DataError, match="source is not that of the objects, phantom"):
        read_entries(tmp_path)


def test_an_entry_without_its_objects_or_with_others_is_refused(
    entry: dict[str, Any], scored: Score, tmp_path: Path
) -> None:
    path = write_entry(stored(entry), scored, tmp_path)
    objects = path.with_suffix(".parquet")
    better = pq.read_table(objects)
    zero = pa.array([0.0] * len(better))
    better = better.set_column(better.column_names.index("mass_mape"), "mass_mape", zero)
    pq.write_table(better, objects)
    with pytest.raises(DataError, match=r"\.parquet: sha256 is [0-9a-f]{64}, .* says"):
        read_entries(tmp_path)
    digest = hashlib.sha256(objects.read_bytes()).hexdigest()
    edited(path, lambda one: one["objects"].update(sha256=digest))
    with pytest.raises(DataError, match="metrics is not what the objects in"):
        read_entries(tmp_path)
    pq.write_table(better.drop(["category"]), objects)
    digest = hashlib.sha256(objects.read_bytes()).hexdigest()
    edited(path, lambda one: one["objects"].update(sha256=digest))
    with pytest.raises(DataError, match=r"its objects cannot be summed up: KeyError\('category'\)"):
        read_entries(tmp_path)
    objects.unlink()
    with pytest.raises(DataError, match="its objects must lie beside it"):
        read_entries(tmp_path)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"schema": "xden-result/9"}'])
def test_a_file_that_is_no_entry(tmp_path: Path, text: str) -> None:
    (tmp_path / "x.json").write_text(text)
    with pytest.raises(DataError, match=r"x\.json: not (JSON|a result of schema xden-result/2)"):
        read_entries(tmp_path)


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="there is no folder of results at"):
        read_entries(tmp_path / "nope")


@pytest.mark.parametrize("name", ["../../etc", "/abs", "..", "a/b", "net\u202e", "   x"])
def test_no_method_name_leaves_the_results(entry: dict[str, Any], name: str) -> None:
    entry["method"]["name"] = name
    parts = entry_path(entry).parts
    assert len(parts) == 4
    assert not {"..", "/"} & set(parts)


SPREAD = (-1.0, 0.0, 0.0, 1.0)
"""How hard the four objects are, for every method."""


def row(
    entry: dict[str, Any],
    name: str,
    mean: float,
    half: float,
    noise: tuple[float, ...] = SPREAD,
    **changes: Any,
) -> Any:
    made = copy.deepcopy(entry)
    made["method"]["name"] = name
    made["arrays_sha256"] = hashlib.sha256(f"{name} {mean}".encode()).hexdigest()
    interval = [mean - half, mean + half]
    made["metrics"]["density_mae_g_cm3"] = {"mean": mean, "macro_mean": mean, "ci95": interval}
    made["object_scores"]["density_mae_g_cm3"] = [mean + half * one for one in noise]
    made["dataset"] |= changes.pop("dataset", {})
    return made | changes


def test_rows_that_differ_by_as_much_on_every_object_are_told_apart(
    entry: dict[str, Any],
) -> None:
    rows = [row(entry, "a", 1.0, 0.0), row(entry, "b", 1.1, 0.0), row(entry, "c", 2.0, 0.0)]
    assert ranks(rows) == [1, 2, 3]
    assert rank_labels(rows) == ["1", "2", "3"]


def test_rows_whose_difference_depends_on_the_object_are_a_tie(entry: dict[str, Any]) -> None:
    turned = SPREAD[::-1]
    rows = [row(entry, "a", 1.0, 0.5), row(entry, "b", 1.1, 0.5, turned)]
    assert ranks(rows) == [1, 1]
    assert rank_labels(rows) == ["1=", "1="]
    assert "| 1=" in render(rows)


def test_two_equal_rows_are_a_tie_however_they_are_rounded(entry: dict[str, Any]) -> None:
    noise = (0.1, 0.2, 0.3, 0.7)
    rows = [row(entry, name, 1.0, 1 / 3, noise) for name in "abcdefg"]
    assert ranks(rows) == [1] * 7


def test_rows_on_other_objects_are_not_compared(entry: dict[str, Any]) -> None:
    rows = [row(entry, "a", 1.0, 0.1), row(entry, "b", 1.0, 0.1)]
    rows[1]["object_scores"]["object_id"][0] = "mug-0001"
    with pytest.raises(DataError, match=r"were scored on different objects: \['a', 'b'\]"):
        ranks(rows)


def test_trivial_rows_have_no_rank_and_push_nobody_down(entry: dict[str, Any]) -> None:
    rows = [row(entry, "water", 0.1, 0.0), row(entry, "a", 1.0, 0.0), row(entry, "b", 3.0, 0.0)]
    assert ranks(rows) == [None, 1, 2]
    assert rank_labels(rows) == ["", "1", "2"]


def test_rows_of_an_older_metric_version_are_kept_apart(entry: dict[str, Any]) -> None:
    old = RULES.metric_version - 1
    rows = [row(entry, "new", 1.0, 0.1), row(entry, "old", 0.1, 0.0, metric_version=old)]
    current, older = render(rows).split("## Older metric versions")
    assert "| new " in current
    assert "| old " not in current
    assert "| 1      | old " in older
    assert f"protocol v2, metric version {old}." in older
    assert "## Older metric versions" not in render(rows[:1])


def test_rows_with_and_without_a_deviation_share_a_table(entry: dict[str, Any]) -> None:
    sure = row(entry, "sure", 1.0, 0.1)
    sure["metrics"]["density_crps_g_cm3"] = {"mean": 0.7, "ci95": [0.6, 0.8]}
    text = render([sure, row(entry, "plain", 2.0, 0.1)])
    assert METRICS["density_crps_g_cm3"].heading in text
    assert "0.700 [0.600, 0.800]" in text
    assert METRICS["density_crps_g_cm3"].heading not in render([row(entry, "plain", 2.0, 0.1)])


def test_what_a_row_cost_is_shown_where_any_row_tells_it(entry: dict[str, Any]) -> None:
    dear, old = row(entry, "dear", 1.0, 0.1), row(entry, "old", 2.0, 0.1)
    dear["method"] |= {"processor_seconds_per_object": 12.34, "peak_memory_gb": 2.6}
    text = render([dear, old])
    headings = r"\| s / object +\| processor s / object +\| GB +\| status"
    assert re.search(headings, text)
    assert re.search(r"\| dear .*\| +\| 12 +\| 2\.6 +\| self-reported", text)
    assert re.search(r"\| old .*\| +\| - +\| - +\| self-reported", text)
    assert "processor s" not in render([old])


def test_a_method_costs_the_mean_time_and_the_most_memory_of_its_seeds(
    entry: dict[str, Any],
) -> None:
    seeds = [row(entry, "net", 1.0 + i, 0.0, submission_sha256=f"{i:064x}") for i in range(3)]
    for seed, one in enumerate(seeds):
        cost = {"processor_seconds_per_object": 1.0 + seed, "peak_memory_gb": 3.0 - seed}
        one["method"] |= {"seed": seed, **cost}
    assert re.search(r"\| net .*\| 2 +\| 3 +\| self-reported", render(seeds))
    assert "of its 3 seeds" not in render(seeds)


def test_costs_are_of_the_seeds_that_tell_them_and_a_footnote_says_of_how_many(
    entry: dict[str, Any],
) -> None:
    seeds = [row(entry, "net", 1.0 + i, 0.0, submission_sha256=f"{i:064x}") for i in range(3)]
    for seed, one in enumerate(seeds):
        one["method"] |= {"seed": seed, "processor_seconds_per_object": None}
    assert "of its 3 seeds" not in render(seeds)
    seeds[1]["method"] |= {"processor_seconds_per_object": 4.0, "peak_memory_gb": 2.0}
    text = render(seeds)
    assert re.search(r"\| net .*\| 4 +\| 2 +\| self-reported", text)
    assert "processor time and memory of 1 of its 3 seeds" in text


def test_an_entry_tells_what_was_measured_and_nothing_else(
    entry: dict[str, Any], scored: Score, reference: Reference
) -> None:
    assert "peak_memory_gb" not in entry["method"]
    beside = {"objects": {"file": "x.parquet", "sha256": "0" * 64}}
    check_form(entry | beside, Path("old.json"))
    meta = replace(scored.meta, processor_seconds_per_object=1.5, peak_memory_gb=0.3)
    measured = beside | entry_of(replace(scored, meta=meta), reference, command="", date=DATE)
    told = measured["method"]
    assert (told["processor_seconds_per_object"], told["peak_memory_gb"]) == (1.5, 0.3)
    check_form(measured, Path("new.json"))
    for wrong in (None, "much", -1):
        told["peak_memory_gb"] = wrong
        with pytest.raises(DataError, match="peak_memory_gb"):
            check_form(measured, Path("new.json"))


def test_the_drop_from_seen_to_unseen_categories_is_printed(entry: dict[str, Any]) -> None:
    new = {"split": "unseen"}
    rows = [row(entry, "a", 1.0, 0.1), row(entry, "b", 2.0, 0.1)]
    rows += [row(entry, "a", 1.5, 0.1, dataset=new), row(entry, "c", 2.0, 0.1, dataset=new)]
    _, drop = render(rows).split("from seen to unseen categories")
    assert re.search(r"\| a +\| 1\.000 +\| 1\.500 +\| \+0\.500 +\| 1\.50 +\|", drop)
    assert not re.search(r"^\| [bc] ", drop, re.MULTILINE)
    assert "from seen to unseen" not in render(rows[:2])


def test_the_drop_of_a_method_that_is_another_s_copy_on_unseen_kinds_is_printed(
    entry: dict[str, Any],
) -> None:
    new = {"split": "unseen"}
    rows = [row(entry, "all", 2.0, 0.1), row(entry, "by-kind", 1.0, 0.1)]
    copies = [row(entry, name, 2.0, 0.1, dataset=new) for name in ("all", "by-kind")]
    assert any(MERGED in one for one in merged_rows(copies))
    _, drop = render([*rows, *copies]).split("from seen to unseen categories")
    assert re.search(r"\| by-kind +\| 1\.000 +\| 2\.000 ", drop)
    assert re.search(r"\| all +\| 2\.000 +\| 2\.000 ", drop)


def test_older_protocols_come_last_with_means_alone(entry: dict[str, Any]) -> None:
    rows = [row(entry, "old", 1.0, 0.1, protocol="v1"), row(entry, "new", 2.0, 0.1)]
    current, older = render(rows).split("## Older protocols")
    assert "2.000 [1.900, 2.100]" in current
    assert re.search(r"\|  +\| old +\| 1\.000 +\|", older)
    assert "1.100]" not in older


def test_a_trained_row_of_few_seeds_says_so(entry: dict[str, Any]) -> None:
    seeds = [row(entry, "net", 1.0 + i, 0.0, submission_sha256=f"{i:064x}") for i in range(3)]
    for seed, one in enumerate(seeds):
        one["method"] |= {"training_data": ["xden1k/train"], "seed": seed}
    assert "fewer than 3 seeds" in render(seeds[:2])
    text = render(seeds)
    assert "fewer than 3 seeds" not in text
    assert "| 2.000 ± 1.000" in text
    assert "seed 2: 3.000, submission `000000000000`" in text


def test_the_papers_table_names_what_the_paper_leaves_open(entry: dict[str, Any]) -> None:
    text = render([row(entry, "a", 1.0, 0.1, protocol="paper")])
    assert "Choices that the paper leaves open: density unit: not printed; g/cm³" in text


@pytest.mark.parametrize(("by", "group"), [("category", "bar"), ("size", "under 8 cm")])
def test_tables_by_group_have_a_line_for_each_group_and_a_column_for_each_row(
    entry: dict[str, Any], by: str, group: str
) -> None:
    mean = entry[f"by_{by}"][group]["metrics"]["mass_mape"]["mean"]
    text = group_tables([row(entry, "a", 1.0, 0.1), row(entry, "b", 1.0, 0.1)], by, "mass_mape")
    assert re.search(r"\| mass MAPE ↓ +\| objects +\| a +\| b +\|", text)
    assert text.count(f"{mean:.3f} ") >= 2
    assert f"| {group} " in text
    with pytest.raises(DataError, match=r"no density_crps_g_cm3 in the rows \['a'\]; there are"):
        group_tables([row(entry, "a", 1.0, 0.1)], by, "density_crps_g_cm3")


def test_a_maintainers_note_makes_a_row_recomputed_and_holds_for_that_entry_alone(
    entry: dict[str, Any], scored: Score, tmp_path: Path
) -> None:
    path = write_entry(stored(entry), scored, tmp_path)
    before = path.read_bytes()
    (tmp_path / MAINTAINERS).write_text(f'[keys]\nm = "{MAINTAINER.public_key}"\n')

    def noted(key: SigningKey | None) -> Path:
        said = "xden-bench verify x.json"
        return write_recomputed(path, "remade", FOUND, said, DATE, key, tmp_path)

    for key, reason in ((None, "it is not signed"), (STRANGER, "is not trusted here")):
        note = noted(key)
        (read,) = read_entries(tmp_path)
        assert (read["status"], "recomputed" in read) == ("self-reported", False)
        assert reason in render([read])
    note = noted(MAINTAINER)
    assert path.read_bytes() == before
    (read,) = read_entries(tmp_path)
    assert (read["status"], read["recomputed"]["how"]) == ("recomputed", "remade")
    assert "recomputed 2025-12-10" in render([read])
    with pytest.raises(DataError, match="is there already: it is never changed"):
        noted(STRANGER)
    edited(note, lambda one: one.update(how="rescored"))
    (read,) = read_entries(tmp_path)
    assert "its signature is not that of m" in render([read])
    edited(path, lambda one: one["method"].update(notes="better"))
    with pytest.raises(DataError, match=r"recomputed\.json: it is for an entry of sha256"):
        read_entries(tmp_path)
    edited(note, lambda one: one.update(how="believed"))
    with pytest.raises(DataError, match=r"recomputed\.json: (not a note|it is for an entry)"):
        read_entries(tmp_path)
    note.write_text("[" * 200_000)
    with pytest.raises(DataError, match=r"recomputed\.json: not JSON: maximum recursion"):
        read_entries(tmp_path)
    path.unlink()
    with pytest.raises(DataError, match=r"recomputed\.json: there is no entry beside it"):
        read_entries(tmp_path)


def test_a_row_that_is_the_reference_or_circular_has_no_rank_and_says_why(
    entry: dict[str, Any],
) -> None:
    copied = row(entry, "b", 0.0, 0.0, warnings=["W504: identical to the reference: 1: 'x'"])
    rows = [row(entry, "a", 1.0, 0.1), copied, row(entry, "builder", 0.1, 0.0)]
    assert ranks(rows) == [2, None, 1]
    scans = [row(entry, "a", 1.0, 0.1), row(entry, "builder", 0.1, 0.0)]
    for one in scans:
        one["dataset"]["source"] = "phantom+scan"
    assert ranks(scans) == [1, None]
    assert "not ranked: its values are those of the reference" in render(rows)
    assert "not ranked: circular: on scans the truth is the builder's own" in render(scans)
    assert "| *b*" not in render(rows)


def test_a_row_that_is_told_the_materials_has_no_rank_and_says_why(entry: dict[str, Any]) -> None:
    told = row(entry, "b", 0.1, 0.0)
    told["method"]["inputs"] = ["mesh", "parts", "xray", "materials"]
    rows = [row(entry, "a", 1.0, 0.1), told]
    assert ranks(rows) == [1, None]
    assert "not ranked: it is told the material of each part" in render(rows)


def test_a_row_that_measures_what_it_is_told_has_no_interval_and_says_why(
    entry: dict[str, Any],
) -> None:
    rows = [row(entry, "a", 1.0, 0.1), row(entry, "b", 0.5, 0.1)]
    rows[1]["method"]["inputs"] = ["parts", "materials"]
    assert "0.500 [0.400, 0.600]" in render(rows)
    rows[1]["method"]["inputs"] = ["parts", "xray", "materials"]
    text = render(rows)
    assert "1.000 [0.900, 1.100]" in text
    assert "0.500 [" not in text
    assert text.count("no intervals: its means are made by a few objects") == 1
    assert "no intervals" not in render([one | {"protocol": "v1"} for one in rows])


def test_what_differs_is_never_in_one_table(entry: dict[str, Any]) -> None:
    rows = [
        row(entry, "base", 1.0, 0.1),
        row(entry, "track", 1.0, 0.1, track="xray"),
        row(entry, "target", 1.0, 0.1, target="apparent_density"),
        row(entry, "source", 1.0, 0.1, dataset={"source": "scan"}),
        row(entry, "split", 1.0, 0.1, dataset={"split": "val"}),
        row(entry, "revision", 1.0, 0.1, dataset={"revision": "0.2.0"}),
        row(entry, "rebuilt", 1.0, 0.1, dataset={"manifest_sha256": "0" * 64}),
    ]
    text = render(rows)
    assert text.count("## Track") == len(rows)
    assert "Source of the objects: **scan**" in text
    assert "Source of the objects: **phantom**" in text


def test_the_order_of_the_entries_does_not_matter(entry: dict[str, Any]) -> None:
    rows = [
        row(entry, name, mean, 0.0) for name, mean in zip("abcde", (3, 1, 2, 2, 5), strict=True)
    ]
    text = render(rows)
    for turned in (rows[::-1], rows[2:] + rows[:2]):
        assert render(turned) == text
    names = [line.split("|")[2].strip() for line in text.splitlines() if line.startswith("| 1")]
    assert names == ["b"]


def test_the_papers_rows_are_apart_and_have_no_rank() -> None:
    text = render([])
    assert text.startswith("No entries yet.")
    assert "## Reported by the paper, protocol unknown" in text
    assert "| NeRF2Physics     | 1.157" in text
    assert "rank " not in text.split("## Reported")[1].split("|")[1]


def test_markdown_in_names_is_shown_not_run(entry: dict[str, Any]) -> None:
    entry["method"] |= {
        "paper": "javascript:alert(1)",
        "code": "https://example.org/a_b",
        "notes": "<img src=x>",
        "command": "run `x` | y",
    }
    text = render([entry])
    assert "My \\| \\*net\\*" in text
    assert "&lt;img src=x\\>" in text
    assert "<javascript" not in text
    assert "<https://example.org/a_b>" in text
    assert "`run 'x' \\| y`" in text


def test_a_strangers_marker_does_not_end_the_table(entry: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "LEADERBOARD.md"
    entry["method"] |= {"command": f"x {END}", "notes": END, "paper": BEGIN}
    write_leaderboard([entry], path)
    check_leaderboard([entry], path)
    write_leaderboard([entry], path)
    assert "<code>x &lt;!-- results: end --\\></code>" in path.read_text()
    assert path.read_text().count(END) == 1


def test_only_the_part_between_the_markers_is_written(
    entry: dict[str, Any], tmp_path: Path
) -> None:
    path = tmp_path / "LEADERBOARD.md"
    path.write_text(f"# Mine\n\nBefore.\n\n{BEGIN}\nold\n{END}\n\nAfter.\n")
    write_leaderboard([entry], path)
    text = path.read_text()
    assert text.startswith(f"# Mine\n\nBefore.\n\n{BEGIN}\n")
    assert text.endswith(f"{END}\n\nAfter.\n")
    assert "old" not in text
    check_leaderboard([entry], path)
    write_leaderboard([entry], path)
    assert path.read_text() == text


def test_the_check_notices_a_hand(entry: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "LEADERBOARD.md"
    with pytest.raises(DataError, match="is missing: run xden-bench leaderboard"):
        check_leaderboard([entry], path)
    write_leaderboard([entry], path)
    path.write_text(path.read_text().replace("0.100 ", "0.001 ", 1))
    with pytest.raises(DataError, match="does not match the results"):
        check_leaderboard([entry], path)


def test_a_file_without_markers_is_left_alone(entry: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "LEADERBOARD.md"
    path.write_text("no markers")
    with pytest.raises(DataError, match="must each be there once"):
        write_leaderboard([entry], path)
    assert path.read_text() == "no markers"


@pytest.mark.slow  # make lint looks too
def test_the_repositorys_leaderboard_matches_its_results() -> None:
    root = Path(__file__).parents[2]
    results = root / "benchmarks" / "results"
    check_leaderboard(read_entries(results), root / "LEADERBOARD.md", picks_sections(results))
