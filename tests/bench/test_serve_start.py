"""How the web app starts: what it refuses at once, and where it keeps things."""

from __future__ import annotations

import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from tests.phantoms import BAR, box_object
from xden1k.access import hub
from xden1k.folder import write_folder
from xden_bench.cli import cli
from xden_bench.serve import site

Serve = Callable[..., Result]


@pytest.fixture
def serve(dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Serve:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("XDEN1K_ROOT", str(dataset))
    monkeypatch.setattr(hub, "cache_folder", lambda: tmp_path / "cache")
    return lambda *words: CliRunner().invoke(cli, ["serve", *map(str, words)])


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Every site that would have been served."""
    sites: list[Any] = []
    monkeypatch.setattr(site, "run", lambda one, *_: sites.append(one))
    return sites


def test_a_port_that_is_taken_is_one_line_and_makes_nothing(
    serve: Serve, started: list[Any], tmp_path: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = serve("--port", port)
    assert done.exit_code == 1
    assert done.stderr == (
        f"Error: cannot listen at 127.0.0.1, port {port}: Address already in use: "
        "choose another --host or --port\n"
    )
    assert not started
    assert [one.name for one in tmp_path.iterdir()] == ["here"]


def test_a_dataset_without_a_test_split_is_one_line_before_an_address_is_told(
    serve: Serve, started: list[Any], tmp_path: Path
) -> None:
    root = tmp_path / "train"
    write_folder([box_object("bar", BAR, split="train")], root, version="0.1.0", builder="tests")
    done = serve("--root", root)
    assert done.exit_code == 1
    assert done.output == f"Error: {root}: no split 'test'; there are ['train']\n"
    assert not started


def test_nothing_is_kept_in_the_working_folder_unasked(
    serve: Serve, started: list[Any], tmp_path: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    assert serve("--port", port).exit_code == 0
    (one,) = started
    assert (one.state, one.results) == (tmp_path / "cache/desk", tmp_path / "cache/desk/results")
    assert list((tmp_path / "here").iterdir()) == []


def test_in_a_checkout_the_entries_are_those_of_the_checkout(
    serve: Serve, started: list[Any]
) -> None:
    results = Path("benchmarks/results")
    results.mkdir(parents=True)
    (results / "README.md").touch()
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    assert serve("--port", port, "--state", "asked").exit_code == 0
    assert (started[0].results, started[0].state) == (results, Path("asked"))
