"""Rebuilt folders against the truth beside their captures."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from xden1k.folder import open_folder
from xden_builder.cli import cli
from xden_builder.evaluate.rebuilt import RebuiltObject, RebuiltPart, RebuiltSet
from xden_builder.evaluate.rebuilt_table import rebuilt_markdown, rebuilt_row, where_rows
from xden_builder.evaluate.run import PartCheck
from xden_builder.evaluate.truth import Errors
from xden_builder.phantoms import Scanner, write_captures

pytestmark = pytest.mark.usefixtures("in_this_process")


def part(density, truth, *, sd=0.1, source="xray", flags=(), material="brass", share=0.5):
    check = PartCheck(density, sd, truth, source, tuple(flags))
    return RebuiltPart("part", material, "brass", share, check)


def thing(*parts):
    return RebuiltObject("thing-0000", Errors(0.1, 0.02, 0.03), parts)


def test_flags_and_deviations_are_counted_over_the_parts_they_concern():
    parts = (
        part(1.3, 1.0, flags=["uncertain"]),  # far off, told
        part(0.7, 1.0, source="prior"),  # far off, not told
        part(1.15, 1.0),  # off by more than a tenth, within 2 sd
        part(1.05, 1.0, source="weighed"),  # within 1 sd
    )
    row = rebuilt_row("set", [thing(*parts)])
    assert row[5:] == ["2", "50.0 %", "2 of 3", "3", "33.3 %", "66.7 %"]


def test_the_error_sits_where_most_of_the_density_error_comes_from():
    parts = (part(1.1, 1.0, material="oak", share=0.9), part(9.0, 8.0, share=0.03))
    rows = where_rows([thing(*parts)])
    assert [row[0] for row in rows] == ["oak", "brass"]
    assert rows[0][2:4] == ["75.0 %", "+10.0 %"]


def test_several_sets_have_a_row_of_all_and_missing_objects_no_row():
    one = RebuiltSet((thing(part(1.0, 1.0)),), ())
    tables = rebuilt_markdown({"a": one, "b": one, "c": RebuiltSet((), ("mug-0000",))})
    assert "| all" in tables
    assert "| c" not in tables
    assert rebuilt_markdown({"c": RebuiltSet((), ("mug-0000",))}) == "0 rebuilt objects.\n"


def test_folders_that_do_not_pair_up_are_refused(tmp_path):
    answer = CliRunner().invoke(cli, ["evaluate", str(tmp_path), str(tmp_path)])
    assert answer.exit_code == 2
    assert "expected one folder CAPTURES, or as many as --rebuilt" in answer.output


@pytest.mark.slow
def test_a_rebuilt_folder_is_scored_without_another_fit(tmp_path):
    captures, built = tmp_path / "captures", tmp_path / "built"
    write_captures(captures, 1, 5, scanner=Scanner.realistic(96), categories=["pencil"])
    run = CliRunner().invoke(cli, ["run", str(captures), "--out", str(built), "--workers", "1"])
    assert run.exit_code == 0, run.output
    scored = CliRunner().invoke(cli, ["evaluate", str(captures), "--rebuilt", str(built), "--json"])
    assert scored.exit_code == 0, scored.output
    (found,) = json.loads(scored.stdout)[str(captures)]["objects"]
    assert found["object_id"] == "pencil-0000"
    (rebuilt,) = open_folder(built).objects()
    truth = json.loads((captures / "pencil-0000" / "truth.json").read_text())
    assert found["errors"]["mass_ape"] == pytest.approx(abs(rebuilt.mass_g / truth["mass_g"] - 1))
    assert [part["material"] for part in found["parts"]] == [
        part["material"] for part in truth["parts"]
    ]
    assert np.isclose(sum(each["volume_share"] for each in found["parts"]), 1.0)
