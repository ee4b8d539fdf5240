"""What pyproject.toml tells of the package is so."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest
import yaml

ROOT: Final = Path(__file__).parents[1]
PACKAGES: Final = ("xden1k", "benchmarks", "baselines", "builder")


@pytest.fixture(scope="module")
def project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


@pytest.fixture(scope="module")
def citation() -> dict[str, Any]:
    return yaml.safe_load((ROOT / "CITATION.cff").read_text())


def extras_asked_for() -> Iterator[str]:
    """Every extra that a missing module is told to come with."""
    for package in PACKAGES:
        for file in (ROOT / package).rglob("*.py"):
            text = file.read_text()
            yield from re.findall(r"""require\(\s*"[\w.]+",\s*"(\w+)"\s*\)""", text)


def test_every_extra_is_used_and_every_extra_asked_for_is_there(project: dict[str, Any]) -> None:
    for_nothing_imported = {"dev", "docs", "peers"}
    assert set(extras_asked_for()) == set(project["optional-dependencies"]) - for_nothing_imported


def test_version_and_authors_are_those_to_cite(
    project: dict[str, Any], citation: dict[str, Any]
) -> None:
    assert project["version"] == citation["version"]
    assert project["authors"] == citation["authors"]


def test_links_are_known_to_the_repository(
    project: dict[str, Any], citation: dict[str, Any]
) -> None:
    assert project["urls"].pop("Paper") == citation["preferred-citation"]["url"]
    manual = (ROOT / "README.md").read_text()
    assert [url for url in project["urls"].values() if url not in manual] == []


def test_the_oldest_python_that_is_named_is_the_one_required(project: dict[str, Any]) -> None:
    named = re.findall(r"Python :: 3\.(\d+)$", "\n".join(project["classifiers"]), re.MULTILINE)
    assert project["requires-python"] == f">=3.{min(map(int, named))}"
    assert named == [str(minor) for minor in range(int(named[0]), int(named[-1]) + 1)]


def test_every_folder_of_tests_is_run_by_make_test() -> None:
    makefile = (ROOT / "Makefile").read_text()
    named = re.search(r"^TESTS := (.*)$", makefile, re.MULTILINE)
    assert named is not None
    lines = [f"^{name} := (.*)$" for name in named[1].split()]
    paths = {path for line in lines for path in re.search(line, makefile, re.M)[1].split()}
    tests = {file.parent.relative_to(ROOT).as_posix() for file in ROOT.glob("tests/*/test_*.py")}
    assert tests | set(PACKAGES) <= paths
    assert "$(wildcard" in paths  # of those that lie above the folders
