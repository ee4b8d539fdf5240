"""Commands that other packages add: listed without being imported, loaded when run."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from xden1k import commands
from xden1k.commands import OpenGroup

ADDED = """
import click
from xden1k.errors import DataError

@click.command(epilog="Example: xden greet me")
@click.argument("name")
def greet(name):
    "Say hello."
    if name == "nobody":
        raise DataError("expected a name, got nobody")
    click.echo(f"hello {name}")

nothing = 3
"""


@click.group(cls=OpenGroup)
def xden() -> None:
    """A stand-in for ``xden``."""


@xden.command()
def info() -> None:
    """Say something."""
    click.echo("own")


@pytest.fixture(autouse=True)
def added(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a_package.py").write_text(ADDED)
    (tmp_path / "a_broken_package.py").write_text("import a_library_that_is_not_there")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "a_package", raising=False)
    values = {
        "greet": "a_package:greet",
        "import": "a_broken_package:run",
        "info": "a_package:greet",
        "lost": "a_package:gone",
        "odd": "a_package:nothing",
    }
    found = [EntryPoint(name, value, commands.COMMANDS) for name, value in values.items()]
    monkeypatch.setattr(commands, "entry_points", lambda group: found)


def run(*words: str) -> Result:
    return CliRunner().invoke(xden, words)


def test_the_list_names_what_was_added_and_imports_nothing() -> None:
    listed = run("--help").stdout
    assert "greet   Of a_package: ask it for its --help." in listed
    assert "import  Of a_broken_package" in listed
    assert "a_package" not in sys.modules


def test_an_added_command_is_loaded_when_it_is_run_or_asked_for_help() -> None:
    assert run("greet", "you").stdout == "hello you\n"
    assert "Example: xden greet me" in run("greet", "--help").stdout
    assert run("greet").exit_code == 2


def test_an_error_of_an_added_command_is_one_line() -> None:
    result = run("greet", "nobody")
    assert (result.exit_code, result.stderr) == (1, "Error: expected a name, got nobody\n")


def test_a_command_of_its_own_is_not_replaced() -> None:
    assert run("info").stdout == "own\n"


def test_a_missing_library_is_told_with_the_extra_of_the_commands_name() -> None:
    result = run("import")
    assert result.exit_code == 1
    assert "No module named 'a_library_that_is_not_there'" in result.stderr
    assert "[import]'\n" in result.stderr


@pytest.mark.parametrize(
    ("name", "message"), [("lost", "does not load"), ("odd", "is no click command: a_package")]
)
def test_an_entry_that_is_no_command_is_told(name: str, message: str) -> None:
    result = run(name)
    assert (result.exit_code, result.stderr.count("\n")) == (1, 1)
    assert message in result.stderr


def test_an_unknown_command_is_a_usage_error() -> None:
    assert run("nothing").exit_code == 2
