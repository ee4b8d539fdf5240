"""A maintainer's answers on the command line: from the template into what is pushed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from tests.builder.folders import contents
from tests.phantoms import objects
from xden1k.documents.statements import materials_text
from xden1k.errors import DataError
from xden1k.folder import verify, write_folder
from xden1k.format.manifest import Manifest
from xden_builder.cli import cli
from xden_builder.phantoms.realism import LIFELIKE
from xden_builder.pipeline.publish.parcel import read_folder


@pytest.fixture
def root(tmp_path: Path) -> Path:
    write_folder(objects()[:2], tmp_path / "root", version="1.2.0", builder="test")
    return tmp_path / "root"


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli, list(map(str, arguments)), catch_exceptions=False)


def test_a_filled_template_becomes_the_datasheet(root: Path, tmp_path: Path) -> None:
    template = tmp_path / "mine.toml"
    assert run("datasheet", "--template", template).stdout == f"{template}\n"
    written = template.read_text(encoding="utf-8")
    template.write_text(written.replace('# funding = ""', 'funding = "A lottery."'))
    before = json.loads(run("datasheet", root, "--json").stdout)
    after = run("datasheet", root, "--answers", template)
    left = [key for key in before["unanswered"] if key != "motivation.funding"]
    told = f"{root}/DATASHEET.md: {57 - len(left)} of 57 questions answered"
    assert after.stdout.splitlines() == [told, *(f"unanswered: {key}" for key in left)]
    assert "A lottery." in (root / "DATASHEET.md").read_text(encoding="utf-8")
    assert verify.verify_folder(root) == []


def test_a_template_says_what_the_data_answer_and_replaces_nothing(
    root: Path, tmp_path: Path
) -> None:
    template = tmp_path / "mine.toml"
    told = json.loads(run("datasheet", root, "--template", template, "--json").stdout)
    assert "composition.count" in told["answered_by_data"]
    assert "motivation.funding" not in told["answered_by_data"]
    again = run("datasheet", "--template", template)
    assert again.exit_code == 1
    assert again.stderr == f"Error: {template} exists: remove it yourself, or choose another\n"


@pytest.mark.parametrize("arguments", [(), ("--template", "a", "--answers", "b")])
def test_neither_a_folder_nor_a_template_is_a_misuse(arguments: tuple[str, ...]) -> None:
    assert run("datasheet", *arguments).exit_code == 2


def test_answers_that_are_not_in_the_datasheet_are_not_pushed(root: Path) -> None:
    (root / "datasheet.toml").write_text('[motivation]\nfunding = "A lottery."\n')
    with pytest.raises(
        DataError, match=f"is not in the datasheet yet: `xden-build datasheet {root}`"
    ):
        read_folder(root)
    run("datasheet", root)
    assert read_folder(root) == Manifest.read(root)


def test_the_share_of_labels_that_err_is_the_simulators() -> None:
    rebuilt = Manifest("1.0.0", "test", "", {"test": 1}, {"phantom": 1}, {"xray": 3}, ())
    wrong, missing = 100 * LIFELIKE.wrong_label_share, 100 * LIFELIKE.missing_label_share
    said = (
        f"about {wrong:.0f} are labelled as another material of the same family, and {missing:.0f}"
    )
    assert said in materials_text(rebuilt)


@pytest.mark.slow
def test_phantoms_made_again_keep_the_answers_and_are_the_same_bytes(tmp_path: Path) -> None:
    truth = tmp_path / "truth"
    command = ("phantoms", truth, "--as-dataset", "--count", "1", "--seed", "1", "--size", "64")
    assert run(*command).exit_code == 0
    (truth / "datasheet.toml").write_text('[motivation]\nfunding = "A lottery."\n')
    run("datasheet", truth)
    before = contents(truth)
    assert run(*command).exit_code == 0
    assert contents(truth) == before
