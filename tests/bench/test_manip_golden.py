"""The quick tier on the packaged sample, from the dataset to the table, as it came out before."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import xden1k
from xden_bench.cli import cli

SAMPLE = Path(xden1k.__file__).parent / "sample"
CONTROLS = ("top", "random", "uniform", "true")
GOLDEN = {
    "off": {"top": 0.5, "random": 0.4375, "uniform": 0.75, "true": 0.6875},
    "balanced": {"top": 1.0, "random": 0.875, "uniform": 1.0, "true": 1.0},
}
"""Share of held trials by stratum and row, with MuJoCo 4.0.0: another version may give others."""


def told(*arguments: str) -> dict:
    done = CliRunner().invoke(cli, ["manip", *arguments, "--json"])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


@pytest.mark.slow
def test_the_quick_tier_on_the_sample_gives_the_table_that_it_gave(tmp_path: Path) -> None:
    scenes, rows = str(tmp_path / "scenes"), str(tmp_path / "rows")
    told("prepare", str(SAMPLE), "--out", scenes, "--split", "train")
    asked = [word for name in CONTROLS for word in ("--control", name)]
    found = told("table", *told("run", scenes, *asked, "--out", rows)["rows"])
    assert found["warnings"] == 0
    table: dict[str, dict[str, float]] = {}
    for line in found["lines"]:
        table.setdefault(line["stratum"], {})[line["name"]] = round(line["success"], 4)
    assert table == GOLDEN
