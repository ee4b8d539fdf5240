"""Plays a page: its commands and its Python in order, in one folder, in this process."""

from __future__ import annotations

import contextlib
import doctest
import hashlib
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from filelock import FileLock

from tests.docs.blocks import Block
from xden1k.cli import cli as xden
from xden_baselines.views.__main__ import cli as views
from xden_bench.cli import cli as xden_bench
from xden_builder import workers
from xden_builder.cli import cli as xden_build

PROGRAMS = {
    "xden": xden,
    "xden-build": xden_build,
    "xden-bench": xden_bench,
    "python -m xden_baselines.views": views,
}
SMALL_TOOLS = ("cat", "cp", "ls", "mkdir", "rm")
MAKERS = ("xden-build phantoms", "xden-build run", "xden-build audit", "xden show")
"""Commands whose results pages share, where they and all that stood before them are the same."""
FIRST = "xden-build phantoms"
"""What stood before this one does not matter."""
EXACT = ["xden-bench", "dataset"]
"""Its workers are started with libraries told how to round, so it needs processes of its own."""
EXITS = re.compile(r"# exits with (\d)$")
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


@dataclass
class Player:
    """Plays the blocks of one page.

    Parameters
    ----------
    folder
        Where the page's commands run.
    kept
        Where results of makers are kept for other pages.
    """

    folder: Path
    kept: Path
    names: dict[str, Any] = field(default_factory=lambda: {"__name__": "page"})
    history: list[str] = field(default_factory=list)

    def play(self, block: Block) -> None:
        """Run one block; fail where the manual is wrong."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if block.language == "python":
                self.history.append(block.code)
                self._python(block)
            elif block.language == "pycon":
                self._session(block)
            else:
                self._commands(block)

    def _python(self, block: Block) -> None:
        padding = "\n" * block.line  # tracebacks show the line of the page
        with contextlib.redirect_stdout(io.StringIO()):
            exec(compile(padding + block.code, block.page, "exec"), self.names)  # noqa: S102

    def _session(self, block: Block) -> None:
        test = doctest.DocTestParser().get_doctest(
            block.code, {}, block.page, block.page, block.line
        )
        test.globs = self.names
        told = io.StringIO()
        runner = doctest.DocTestRunner(optionflags=FLAGS)
        runner.run(test, out=told.write, clear_globs=False)
        if runner.summarize(verbose=False).failed:
            pytest.fail(told.getvalue(), pytrace=False)

    def _commands(self, block: Block) -> None:
        for line, expected in steps(block):
            told = EXITS.search(line)
            code, out = self._command(line)
            at = f"{block.where}: {line}"
            if code != int(told[1] if told else 0):
                pytest.fail(f"{at}\nexits with {code}:\n{out}", pytrace=False)
            if expected is not None and not doctest.OutputChecker().check_output(
                expected, out, FLAGS
            ):
                pytest.fail(f"{at}\nprints\n{out}\nand not\n{expected}", pytrace=False)

    def _command(self, line: str) -> tuple[int, str]:
        words = shlex.split(line, comments=True)
        if words[:2] == ["python", "-m"]:
            words = [" ".join(words[:3]), *words[3:]]
        if words[0] in SMALL_TOOLS:
            if words[0] not in ("cat", "ls"):
                self.history.append(line)
            return _run(words)
        if words[:2] == EXACT:
            return _run([str(Path(sys.executable).with_name(words[0])), *words[1:]])
        if words[0] not in PROGRAMS:
            raise ValueError(f"a manual's commands are {', '.join(PROGRAMS)}; got {line!r}")
        if not line.startswith(MAKERS):
            return _invoke(words)
        self.history.append(" ".join(words))
        return self._make(words, self.history[-1:] if line.startswith(FIRST) else self.history)

    def _make(self, words: list[str], history: list[str]) -> tuple[int, str]:
        """Run a command, or take over what it has made for another page."""
        digest = hashlib.sha256("\n".join(history).encode()).hexdigest()
        place = self.kept / digest[:16]
        with FileLock(f"{place}.lock"):
            if not place.exists():
                before = self._snapshot()
                code, out = _invoke(words)
                made = [
                    name for name, state in self._snapshot().items() if state != before.get(name)
                ]
                partial = place.with_suffix(".partial")
                partial.mkdir(parents=True)
                for name in made:
                    _copy(self.folder / name, partial / "made" / name)
                (partial / "told").write_text(f"{code}\n{out}")
                partial.rename(place)
                return code, out
        for path in sorted((place / "made").glob("*")):
            _copy(path, self.folder / path.name)
        code_text, _, out = (place / "told").read_text().partition("\n")
        return int(code_text), out

    def _snapshot(self) -> dict[str, tuple[tuple[str, int], ...]]:
        """What is in the folder: for each name all files and when they were written."""
        return {
            path.name: tuple(
                (one.as_posix(), one.stat().st_mtime_ns)
                for one in sorted([path, *path.rglob("*")])
                if one.is_file()
            )
            for path in self.folder.iterdir()
        }


def steps(block: Block) -> Iterator[tuple[str, str | None]]:
    """Yield the commands of a block, each with the output that the manual shows, if it does."""
    text = block.code.replace("\\\n", " ")
    if block.language == "sh":
        for line in text.splitlines():
            if line.strip() and not line.startswith("#"):
                yield line, None
        return
    for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
        line, _, expected = part.partition("\n")
        yield line, expected


def _run(words: list[str]) -> tuple[int, str]:
    ran = subprocess.run(words, capture_output=True, text=True, check=False)  # noqa: S603
    return ran.returncode, ran.stdout + ran.stderr


def _invoke(words: Iterable[str]) -> tuple[int, str]:
    program, *arguments = words
    result = CliRunner().invoke(PROGRAMS[program], arguments)
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout if result.exit_code == 0 else result.output


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.is_dir():
        shutil.rmtree(target, ignore_errors=True)
        shutil.copytree(source, target)
    else:
        shutil.copy2(source, target)


class InThisProcess(ProcessPoolExecutor):
    """In place of a pool of processes, each of which would import everything again."""

    def __init__(self, *_: object, **__: object) -> None: ...

    def __enter__(self) -> InThisProcess:
        return self

    def __exit__(self, *_: object) -> None: ...

    def submit(self, task: Callable[[Any], Any], key: Any) -> Future[Any]:
        """Do it now."""
        future: Future[Any] = Future()
        try:
            future.set_result(task(key))
        except Exception as err:
            future.set_exception(err)
        return future


def clean_environment(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Let nothing of the machine be seen: no data, no cache, no network."""
    monkeypatch.setattr(workers, "ProcessPoolExecutor", InThisProcess)
    for name in list(os.environ):
        if name.startswith("XDEN"):
            monkeypatch.delenv(name)
    monkeypatch.setenv("HF_HOME", str(folder / "hf"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    monkeypatch.setenv("TMPDIR", str(folder))
