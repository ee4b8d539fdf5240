"""The fenced blocks of the manual: which there are, and what is to be done with each.

A block of Python or of commands is run, unless its title says that it is an illustration, or slow.
A block of data is parsed. Nothing else may be in a manual.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import yaml

ROOT = Path(__file__).parents[2]
GENERATED = ("xden1k/sample",)
"""Documents that the builder writes and other tests hold."""
Kind = Literal["run", "slow", "illustration", "data"]

RUN = ("python", "pycon", "sh", "console")
DATA = {"json": json.loads, "toml": tomllib.loads, "yaml": yaml.safe_load, "csv": str, "text": str}
FENCE = re.compile(r"^(?P<indent> *)```(?P<info>[^`\n]*)$")
INFO = re.compile(r'(?P<language>\w+)(?: title="(?P<title>[^"]+)")?')


@dataclass(frozen=True)
class Block:
    """One fenced block.

    Parameters
    ----------
    page
        Relative to the repository.
    line
        Of the opening fence, from 1.
    language, title
        As the opening fence says.
    code
        What is between the fences.
    """

    page: str
    line: int
    language: str
    title: str
    code: str

    @property
    def kind(self) -> Kind:
        """What is to be done with it."""
        if self.language not in RUN:
            return "data"
        said = self.title.partition(":")[0]
        if said in ("", "Illustration", "Slow"):
            kinds: dict[str, Kind] = {"": "run", "Illustration": "illustration", "Slow": "slow"}
            return kinds[said]
        raise ValueError(
            f"{self.where}: title {self.title!r}, expected 'Illustration: why' or 'Slow: ...'"
        )

    @property
    def where(self) -> str:
        """Page and line."""
        return f"{self.page}:{self.line}"


def pages() -> list[Path]:
    """Every Markdown file of the manual, and every README."""
    found = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    for area in ("xden1k", "builder", "benchmarks", "baselines"):
        found += (ROOT / area).rglob("*.md")
    return sorted(
        path for path in found if not path.relative_to(ROOT).as_posix().startswith(GENERATED)
    )


def blocks(path: Path) -> Iterator[Block]:
    """Yield the blocks of a page.

    Raises
    ------
    ValueError
        If a fence says no language, or one that no manual has.
    """
    page = path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else path.name
    opened, indent, info, code = 0, "", "", list[str]()
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        fence = FENCE.match(line)
        if not opened and fence:
            opened, indent, info, code = number, fence["indent"], fence["info"].strip(), []
        elif opened and fence and not fence["info"].strip():
            said = INFO.fullmatch(info)
            if not said or said["language"] not in (*RUN, *DATA):
                raise ValueError(f"{page}:{opened}: a block of {info!r}")
            text = "\n".join(code) + "\n"
            yield Block(page, opened, said["language"], said["title"] or "", text)
            opened = 0
        elif opened:
            code.append(line.removeprefix(indent))


def parse(block: Block) -> object:
    """Parse a block of data."""
    return DATA[block.language](block.code)
