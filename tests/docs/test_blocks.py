"""Every block of the manual and of the READMEs is run, parsed, or said to be an illustration."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.apart import run_here
from tests.docs.blocks import ROOT, Block, blocks, pages, parse
from tests.docs.playing import Player, clean_environment, steps
from xden_bench.methods import apart

PAGES = {path.relative_to(ROOT).as_posix(): path for path in pages()}
SLOW_PAGES = (
    "baselines/README.md",
    "benchmarks/README.md",
    "docs/manual/baselines.md",
    "docs/manual/calibrate.md",
    "docs/tutorial.md",
)
"""What these show, other pages and tests show too."""


def of_kind(page: str, *kinds: str) -> list[Block]:
    return [block for block in blocks(PAGES[page]) if block.kind in kinds]


def shown() -> list[object]:
    """Pages with a block to run; some are slow tests."""
    return [
        pytest.param(page, marks=[pytest.mark.slow] * (page in SLOW_PAGES))
        for page in PAGES
        if of_kind(page, "run")
    ]


@pytest.fixture
def player(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Player:
    base = tmp_path_factory.getbasetemp()
    kept = (base.parent if "popen-gw" in base.name else base) / "kept"  # one for all of xdist
    kept.mkdir(exist_ok=True)
    clean_environment(monkeypatch, tmp_path)
    monkeypatch.setattr(apart, "run_apart", run_here)
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return Player(folder, kept)


@pytest.mark.parametrize("page", shown())
def test_what_a_page_shows_is_so(page: str, player: Player) -> None:
    for block in of_kind(page, "run"):
        player.play(block)


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if of_kind(page, "slow")])
def test_what_a_page_shows_is_so_and_takes_long(page: str, player: Player) -> None:
    for block in of_kind(page, "run", "slow"):
        player.play(block)


@pytest.mark.parametrize("page", PAGES)
def test_every_block_is_known_and_data_can_be_parsed(page: str) -> None:
    for block in blocks(PAGES[page]):
        if block.kind == "data":
            parse(block)
        elif block.language in ("sh", "console"):
            assert list(steps(block)), f"{block.where}: no command; lines begin with '$ '"
