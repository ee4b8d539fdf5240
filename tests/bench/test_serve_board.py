"""The tables of the web app's leaderboard."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Any

import pytest

from xden_bench.entries.result import entry_of, read_entries, write_entry
from xden_bench.methods.baseline import find_predictor, run_predictor
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import score
from xden_bench.serve import board
from xden_bench.serve.explorer import best_and_worst

Entry = dict[str, Any]


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
        )
    return place / "results"


@pytest.fixture(scope="module")
def rows(results: Path) -> list[Entry]:
    ((_, tracks),) = board.boards(read_entries(results)).items()
    ((_, found),) = tracks.items()
    return list(found)


def renamed(row: Entry, name: str, **rest: Any) -> Entry:
    method = {**row["method"], "name": name}
    return {**row, "method": method, "submission_sha256": name.ljust(64, "0"), **rest}


def column(table: tuple[list[str], list[list[Any]]], heading: str) -> list[Any]:
    place = table[0].index(heading)
    return [row[place] for row in table[1]]


def test_the_title_of_a_table_names_source_split_target_dataset_and_protocol(
    results: Path, reference: Reference
) -> None:
    (title,) = board.boards(read_entries(results))
    manifest = reference.manifest_sha256[:8]
    assert title == f"phantom · test · density · dataset 0.1.0 ({manifest}) · protocol v1"


def test_entries_of_another_source_split_or_metric_version_are_another_table(
    rows: list[Entry],
) -> None:
    first = rows[0]
    others = [
        {**first, "dataset": {**first["dataset"], "source": "scan"}},
        {**first, "dataset": {**first["dataset"], "split": "val"}},
        {**first, "metric_version": first["metric_version"] + 7},
    ]
    assert len(board.boards([first, *others])) == 4
    assert any("old metric version" in title for title in board.boards(others))


def test_every_row_shows_its_source_and_marks_trivial_methods(rows: list[Entry]) -> None:
    table = board.board_table(rows, "density_mae_g_cm3")
    assert column(table, "source") == ["phantom", "phantom"]
    assert all(name.endswith(" (trivial)") for name in column(table, "method"))
    assert column(table, "rank") == [None, None]


def test_rows_that_cannot_be_told_apart_share_a_rank_and_are_marked(rows: list[Entry]) -> None:
    twins = [renamed(rows[0], "one"), renamed(rows[0], "two")]
    table = board.board_table(twins, "density_mae_g_cm3")
    assert column(table, "rank") == [1, 1]
    assert column(table, "tie") == ["=", "="]


def test_a_higher_is_better_metric_puts_the_highest_first(rows: list[Entry]) -> None:
    table = board.board_table(rows, "mass_mnre")
    values = column(table, "mass MnRE ↑")
    assert values == sorted(values, reverse=True)
    assert values[0] > values[1]


def test_a_metric_that_should_have_a_value_puts_the_nearest_first(rows: list[Entry]) -> None:
    known = [
        renamed(rows[0], name, metrics={"density_within_1sd": {"mean": mean, "ci95": [0.0, 1.0]}})
        for name, mean in (("too wide", 0.99), ("right", 0.7), ("too narrow", 0.1))
    ]
    ordered = board.best_first([*known, rows[1]], "density_within_1sd")
    assert [row["method"]["name"] for row in ordered] == ["right", "too wide", "too narrow"]


def test_means_are_numbers_and_the_chosen_metric_has_its_interval(rows: list[Entry]) -> None:
    table = board.board_table(rows, "com_l1_cm")
    assert all(type(value) is float for value in column(table, "CoM L1, cm ↓"))
    first = board.best_first(rows, "com_l1_cm")[0]
    low, high = first["metrics"]["com_l1_cm"]["ci95"]
    assert column(table, "95 % interval of CoM L1, cm")[0] == f"{low:.3f} to {high:.3f}"


def test_a_row_is_found_again_however_the_page_sorted_it(rows: list[Entry]) -> None:
    _, table = board.board_table(rows, "density_mae_g_cm3")
    for cells in reversed(table):
        found = board.entry_at(rows, cells)
        assert found is not None
        assert cells[2].startswith(found["method"]["name"])
    assert board.entry_at(rows, []) is None


def test_the_groups_of_a_table_count_their_objects(rows: list[Entry]) -> None:
    headings, table = board.group_table(rows, "density_mae_g_cm3", "category")
    assert headings[:2] == ["category", "objects"]
    assert [line[0] for line in table] == ["bar", "cube", "filled", "hollow"]
    assert sum(line[1] for line in table) == 4
    assert all("[" in cell for line in table for cell in line[2:])


def test_groups_of_the_private_split_are_not_shown(rows: list[Entry]) -> None:
    private = [{**row, "dataset": {**row["dataset"], "split": "private"}} for row in rows]
    assert board.group_table(private, "density_mae_g_cm3", "category")[1] == []


def test_how_a_row_is_remade_names_its_commands_and_its_entry(
    rows: list[Entry], results: Path
) -> None:
    text = board.how_made(rows[0], results)
    name = rows[0]["method"]["name"]
    assert f"xden-bench submit {name}.npz" in text.splitlines()
    place = text.splitlines()[-1].removeprefix("xden-bench verify ")
    assert Path(place).is_file()


def test_a_strangers_command_cannot_add_a_line(rows: list[Entry], results: Path) -> None:
    sly = renamed(rows[0], "sly", command="xden-bench submit a.npz\nrm -rf /")
    assert "xden-bench submit a.npz rm -rf /" in board.how_made(sly, results).splitlines()


def test_footnotes_and_a_missing_rank_are_among_the_facts(rows: list[Entry]) -> None:
    facts = dict(map(tuple, board.facts(renamed(rows[0], "x", warnings=["W504: the same"]))))
    assert facts["footnote 1"] == "W504: the same"
    assert facts["not ranked"] == "its values are those of the reference"
    assert "paper" not in facts


def test_best_and_worst_objects_are_disjoint_and_sorted(rows: list[Entry], results: Path) -> None:
    best, worst = best_and_worst(rows[0], "density_mae_g_cm3", results)
    assert not {line[0] for line in best} & {line[0] for line in worst}
    assert len(best) + len(worst) == 4
    values = [line[-1] for line in [*best, *reversed(worst)]]
    assert values == sorted(values)
    only, none = best_and_worst(rows[0], "density_mae_g_cm3", results, most=1)
    assert (len(only), len(none)) == (1, 1)
