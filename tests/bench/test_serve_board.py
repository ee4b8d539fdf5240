"""The web app's leaderboard, as its template and programs get it."""

from __future__ import annotations

import csv
import datetime
import io
import subprocess
from pathlib import Path
from typing import Any

import pytest

from xden1k.errors import MissingObjectError
from xden_bench.entries.leaderboard import tables
from xden_bench.entries.ranking import ranks
from xden_bench.entries.reading import read_entries
from xden_bench.entries.result import entry_of, write_entry
from xden_bench.methods.baseline import find_predictor, run_predictor
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import score
from xden_bench.serve import api, board, page_board
from xden_bench.serve.board import Asked
from xden_bench.serve.explorer import best_and_worst
from xden_bench.serve.render import render
from xden_bench.serve.standings import Snapshot, Table, place_of

Entry = dict[str, Any]
METRIC = load_protocol().rank_by


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory, reference: Reference) -> Path:
    """Entries of two trivial methods."""
    place = tmp_path_factory.mktemp("board")
    for name in ("water", "category-median"):
        out = place / f"{name}.npz"
        run_predictor(find_predictor(name), reference.folder, "test", out)
        found = score(out, reference, load_protocol())
        day = datetime.date(2026, 1, 2)
        write_entry(
            entry_of(found, reference, command=f"xden-bench submit {name}.npz", date=day),
            found,
            place / "results",
            submission=out,
        )
    return place / "results"


@pytest.fixture(scope="module")
def rows(results: Path) -> list[Entry]:
    return list(read_entries(results))


def renamed(row: Entry, name: str, by: float = 1.0, **rest: Any) -> Entry:
    """An entry of another method, whose density errors are so many times as large."""
    scores = row["object_scores"]
    changed = {
        "method": {**row["method"], "name": name},
        "submission_sha256": name.ljust(64, "0"),
        "arrays_sha256": name.ljust(64, "0"),
        "object_scores": {**scores, METRIC: [by * one for one in scores[METRIC]]},
        "metrics": {**row["metrics"], METRIC: {**row["metrics"][METRIC]}},
    }
    changed["metrics"][METRIC]["mean"] *= by
    return {**row, **changed, **rest}


def snapshot(*rows: Entry) -> Snapshot:
    return Snapshot(rows, tuple(Table(tuple(one), tuple(ranks(one))) for one in tables(rows)))


def shown(*rows: Entry, **asked: str) -> dict[str, Any]:
    return board.board_values(snapshot(*rows), Asked(**asked))


def page_of(*rows: Entry, **asked: str) -> str:
    return render("board", page="/board", chart="", **shown(*rows, **asked))


def test_the_title_of_a_table_names_source_split_target_dataset_and_protocol(
    rows: list[Entry], reference: Reference
) -> None:
    ((title,), (track,)) = (shown(*rows)[key] for key in ("titles", "tracks"))
    manifest = reference.manifest_sha256[:8]
    assert title["title"] == f"phantom · test · density · dataset 0.1.0 ({manifest}) · protocol v2"
    assert track["name"] == "geometry"


def test_entries_of_another_source_split_or_metric_version_are_another_table(
    rows: list[Entry],
) -> None:
    first = rows[0]
    others = [
        {**first, "dataset": {**first["dataset"], "source": "scan"}},
        {**first, "dataset": {**first["dataset"], "split": "val"}},
        {**first, "metric_version": first["metric_version"] + 7},
    ]
    titles = shown(first, *others)["titles"]
    assert len(titles) == len({one["value"] for one in titles}) == 4
    assert sum("old metric version" in one["title"] for one in titles) == 1


def test_trivial_rows_and_oracles_stand_apart_without_a_rank_and_say_why(
    rows: list[Entry],
) -> None:
    sees_truth = {**rows[0]["method"], "name": "seer", "inputs": ["truth"]}
    oracle = {**rows[0], "method": sees_truth, "submission_sha256": "f" * 64}
    found = shown(renamed(rows[0], "own", by=1.5), rows[1], oracle)
    assert [(one["rank"], one["kind"]) for one in found["rows"]] == [("1", "")]
    reasons = {one["name"]: one["kind"] for one in found["unranked"]}
    assert reasons.pop(rows[1]["method"]["name"]) == "trivial"
    assert reasons.pop("seer").startswith(board.ORACLE)
    assert not reasons


def test_rows_that_cannot_be_told_apart_share_a_rank_and_are_marked(rows: list[Entry]) -> None:
    found = shown(renamed(rows[0], "one"), renamed(rows[0], "two", by=1.2))
    assert [one["rank"] for one in found["rows"]] == ["1=", "1="]


def test_a_higher_is_better_metric_puts_the_highest_first(rows: list[Entry]) -> None:
    ordered = board.best_first(rows, "mass_mnre")
    values = [row["metrics"]["mass_mnre"]["mean"] for row in ordered]
    assert values[0] > values[1]
    found = shown(*rows, metric="mass_mnre")["unranked"]
    assert [one["name"] for one in found] == [row["method"]["name"] for row in ordered]


def test_a_metric_that_should_have_a_value_puts_the_nearest_first(rows: list[Entry]) -> None:
    known = [
        renamed(rows[0], name, metrics={"density_within_1sd": {"mean": mean, "ci95": [0.0, 1.0]}})
        for name, mean in (("too wide", 0.99), ("right", 0.7), ("too narrow", 0.1))
    ]
    ordered = board.best_first([*known, rows[1]], "density_within_1sd")
    names = [row["method"]["name"] for row in ordered]
    assert names == ["right", "too wide", "too narrow", rows[1]["method"]["name"]]


def test_every_figure_has_three_decimals_and_the_chosen_metric_comes_first(
    rows: list[Entry],
) -> None:
    found = shown(*rows, metric="com_l1_cm")
    assert found["headings"][0]["heading"] == "CoM L1, cm ↓"
    first = board.best_first(rows, "com_l1_cm")[0]["metrics"]["com_l1_cm"]
    value = found["unranked"][0]["figures"][0]
    assert value["mean"] == f"{first['mean']:.3f}"
    assert found["headings"][1]["heading"] == "by category"
    assert found["unranked"][0]["figures"][1]["mean"] == f"{first['macro_mean']:.3f}"
    printed = [one["mean"] for row in found["unranked"] for one in row["figures"]]
    assert {len(text.partition(".")[2]) for text in printed} == {3}


def test_a_figure_without_an_interval_is_shown_without_one(rows: list[Entry]) -> None:
    bare = renamed(rows[0], "bare", metrics={METRIC: {"mean": 0.5, "ci95": None}})
    found = shown(bare)
    assert found["rows"][0]["figures"][0] == {"mean": "0.500", "spread": "", "interval": ""}
    assert not found["has_intervals"]
    assert ",0.5,," in api.board_csv(snapshot(bare))


def test_an_interval_has_three_decimals_too(rows: list[Entry]) -> None:
    known = renamed(rows[0], "known", metrics={METRIC: {"mean": 0.5, "ci95": [0.4, 0.61]}})
    found = shown(known)
    assert found["rows"][0]["figures"][0]["interval"] == "[0.400, 0.610]"
    assert found["has_intervals"]


def test_rows_of_an_older_protocol_are_shown_without_ranks_and_categories(
    rows: list[Entry],
) -> None:
    found = shown(*(row | {"protocol": "v1"} for row in rows))
    assert not found["is_ranked"]
    assert found["rows"] == []
    assert len(found["unranked"]) == 2
    assert "by category" not in [one["heading"] for one in found["headings"]]


@pytest.mark.parametrize(
    ("protocol", "said", "missing"),
    [("v2", "takes 300 objects of 100 categories", "older one"), ("v1", "older one", "takes 300")],
)
def test_a_page_says_why_there_is_no_interval_and_has_empty_cells_for_missing_metrics(
    rows: list[Entry], protocol: str, said: str, missing: str
) -> None:
    bare = renamed(rows[0], "bare", metrics={METRIC: rows[0]["metrics"][METRIC]})
    page = page_of(*(row | {"protocol": protocol} for row in (bare, *rows)))
    assert said in page
    assert missing not in page
    assert page.count('data-label="mass MAPE ↓"></td>') == 1


def test_seeds_are_one_row_with_their_spread_that_every_seeds_link_opens(
    rows: list[Entry],
) -> None:
    seeds = [renamed(rows[0], f"{seed}", by=1 + 0.2 * seed) for seed in range(2)]
    for seed, one in enumerate(seeds):
        one["method"] |= {"name": "net", "seed": seed}
    mean = seeds[0]["metrics"][METRIC]["mean"]
    for one in seeds:
        (line,) = shown(*seeds, row=place_of(one))["rows"]
        value = line["figures"][0]
        assert value["mean"] == f"{1.1 * mean:.3f}"
        assert value["spread"] == f"± {0.2 * mean / 2**0.5:.3f}"
        found = {name: text for name, text, _ in line["facts"]}
        assert found["seed 0"] == f"density MAE, g/cm³ ↓ {mean:.3f}, submission sha256 {'0' * 64}"
        assert found["seeds"].startswith("trained, with fewer than 3 seeds")
        assert line["how"].count("xden-bench verify") == 2


def test_a_table_of_unseen_categories_is_beside_that_of_seen_ones(rows: list[Entry]) -> None:
    seen = renamed(rows[0], "own")
    unseen = renamed(rows[0], "own", by=2) | {"dataset": {**seen["dataset"], "split": "unseen"}}
    group, *_ = shown(seen, unseen)["groups"]
    assert group["title"].startswith("From seen to unseen categories")
    ((name, *_, ratio),) = group["rows"]
    assert (name, ratio) == ("own", "2.00")


def test_a_link_to_a_row_opens_its_table_and_nothing_else_does(rows: list[Entry]) -> None:
    scan = {**rows[0], "dataset": {**rows[0]["dataset"], "source": "scan"}}
    found = shown(*rows, scan, row=place_of(scan))
    assert found["title"].startswith("scan")
    (line,) = found["unranked"]
    assert line["facts"]
    assert line["href"] == f"/board?row={place_of(scan)}#{line['anchor']}"
    for asked in ({"row": "x"}, {"table": "x"}, {"track": "x"}, {"metric": "x"}):
        with pytest.raises(MissingObjectError):
            shown(*rows, **asked)


def test_the_groups_of_a_table_count_their_objects(rows: list[Entry]) -> None:
    headings, table = board.group_table(rows, "density_mae_g_cm3", "category")
    assert headings[:2] == ["category", "objects"]
    assert [line[0] for line in table] == ["bar", "cube", "filled", "hollow"]
    assert sum(int(line[1]) for line in table) == 4


def test_groups_of_the_private_split_are_not_shown(rows: list[Entry]) -> None:
    private = [{**row, "dataset": {**row["dataset"], "split": "private"}} for row in rows]
    assert board.group_table(private, "density_mae_g_cm3", "category")[1] == []
    assert shown(*private)["groups"] == []


def test_how_a_row_is_remade_names_its_commands_and_its_entry_but_no_folder_of_the_server(
    rows: list[Entry], results: Path
) -> None:
    text = board.how_made(rows[0])
    name = rows[0]["method"]["name"]
    assert f"xden-bench submit {name}.npz" in text.splitlines()
    place = text.splitlines()[-1].removeprefix("xden-bench verify benchmarks/results/")
    assert (results / place).is_file()


def test_a_strangers_command_cannot_add_a_line(rows: list[Entry]) -> None:
    sly = renamed(rows[0], "sly", command="xden-bench submit a.npz\nrm -rf /")
    assert "xden-bench submit a.npz rm -rf /" in board.how_made(sly).splitlines()


def test_footnotes_a_missing_rank_and_look_alike_links_are_among_the_facts(
    rows: list[Entry],
) -> None:
    row = renamed(rows[0], "x", warnings=["W504: the same"])
    row["method"] |= {"code": "https://ex\u0430mple.org", "paper": "https://example.org/a"}
    found = {name: (text, is_link) for name, text, is_link in board.facts(row)}
    assert found["footnote 1"] == ("W504: the same", False)
    assert found["not ranked"] == ("its values are those of the reference", False)
    assert found["paper"] == ("https://example.org/a", True)
    assert found["code"] == ("https://ex\u0430mple.org", False)
    assert found["letters in code"] == ("Cyrillic and Latin", False)


def test_programs_get_every_row_with_its_rank_and_no_object(rows: list[Entry]) -> None:
    now = snapshot(renamed(rows[0], "own", by=1.5), *rows)
    (table,) = api.board_json(now)["tables"]
    lines = list(csv.DictReader(io.StringIO(api.board_csv(now))))
    assert [line["method"] for line in lines] == [one["method"]["name"] for one in table]
    assert [one["rank"] for one in table if one["method"]["name"] == "own"] == [1]
    assert "object_scores" not in str(table)
    assert "hollow-0002" not in str(table)


def test_a_spreadsheet_takes_no_name_for_a_formula(rows: list[Entry]) -> None:
    text = api.board_csv(snapshot(renamed(rows[0], "=1+1")))
    assert ",'=1+1," in text


def test_history_is_that_of_the_repository_and_empty_without_one(tmp_path: Path) -> None:
    results = tmp_path / "repository" / "results"
    results.mkdir(parents=True)

    def git(*words: str) -> None:
        who = ("-c", "user.name=t", "-c", "user.email=t@example.org")
        command = ["git", *who, *words]
        subprocess.run(command, cwd=results, check=True, capture_output=True)  # noqa: S603

    git("init", "-q", "..")
    for name in ("a", "b"):
        (results / f"{name}.json").write_text("{}")
        git("add", ".")
        git("commit", "-q", "-m", f"Enter {name}")
    found = api.history(results)
    assert [(one["subject"], one["added"]) for one in found] == [
        ("Enter b", ["b"]),
        ("Enter a", ["a"]),
    ]
    assert api.history(tmp_path / "elsewhere") == []


def test_best_and_worst_objects_are_disjoint_and_sorted(rows: list[Entry], results: Path) -> None:
    best, worst = best_and_worst(rows[0], "density_mae_g_cm3", results)
    assert not {line[0] for line in best} & {line[0] for line in worst}
    assert len(best) + len(worst) == 4
    values = [line[-1] for line in [*best, *reversed(worst)]]
    assert values == sorted(values)
    only, none = best_and_worst(rows[0], "density_mae_g_cm3", results, most=1)
    assert (len(only), len(none)) == (1, 1)


def test_the_chart_of_many_methods_has_the_best_and_every_oracle(rows: list[Entry]) -> None:
    method = next(row for row in rows if row["method"]["name"] == "water")
    methods = [renamed(method, f"method-{number}") for number in range(60)]
    oracle = renamed(method, "part-oracle")
    oracle["method"]["inputs"] = ["mesh", "parts", "truth"]
    drawn = page_board._charted([*methods, oracle])
    assert drawn == [*methods[: page_board.CHARTED], oracle]
    assert page_board._charted([oracle, *methods[:3]]) == [oracle, *methods[:3]]
