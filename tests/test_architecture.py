"""ARCHITECTURE.md names files and rooms that are there, all of them."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
AREAS = {
    "xden1k": ROOT / "xden1k",
    "xden_bench": ROOT / "benchmarks" / "xden_bench",
    "xden_baselines": ROOT / "baselines" / "xden_baselines",
    "xden_builder": ROOT / "builder" / "xden_builder",
}


def floors(area: str) -> list[list[str]]:
    """Rooms of an area by floor, the top one first, as the linter holds them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts: list[dict[str, Any]] = project["tool"]["importlinter"]["contracts"]
    (layers,) = (each["layers"] for each in contracts if each.get("containers") == [area])
    return [sorted(layer.split(" | ")) for layer in layers]


def paths(text: str) -> list[str]:
    """Whatever looks like a path of this repository."""
    return [each for each in re.findall(r"`([\w./-]+)`", text) if "/" in each or "." in each]


def test_every_file_that_the_page_names_is_there() -> None:
    tops = {path.name for path in ROOT.iterdir()}
    named = [each for each in paths(PAGE) if each.split("/")[0] in tops]
    assert len(named) > 30
    assert [each for each in named if not (ROOT / each).exists()] == []


def test_every_link_of_the_page_leads_somewhere() -> None:
    links = re.findall(r"\]\(([^)]+)\)", PAGE)
    assert links
    assert [each for each in links if not (ROOT / each).exists()] == []


@pytest.mark.parametrize("area", AREAS)
def test_the_page_shows_the_floors_that_the_linter_holds(area: str) -> None:
    (line,) = re.findall(rf"^- \*\*`{area}`\*\* (.*)$", PAGE, re.MULTILINE)
    shown = [sorted(re.findall(r"`(\w+)`", floor)) for floor in line.split(" · ")]
    assert shown == floors(area)


@pytest.mark.parametrize("area", AREAS)
def test_the_top_of_an_area_holds_about_a_dozen_rooms(area: str) -> None:
    rooms = {
        path.stem
        for path in AREAS[area].iterdir()
        if (path.suffix == ".py" and path.stem != "__init__") or (path / "__init__.py").is_file()
    }
    assert rooms == {room for floor in floors(area) for room in floor}
    assert len(rooms) <= 17  # the builder has two ways in: a lab's captures and a published release
