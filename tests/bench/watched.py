"""Runs submissions in a process of its own, and tells of each what it cost and what it touched.

Seconds are of processor time, for a busy machine must not fail a test.

Run as a script with the dataset's folder and one to work in. Without more, paths come in by lines;
with a folder of sound files and seeds, these are damaged. One line of JSON goes out for
each.
"""

from __future__ import annotations

import datetime
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from xden_bench.scoring.reference import Reference

__all__ = ["fuzz_apart", "judge_apart"]

_CHANGES = {
    "os.chmod", "os.chown", "os.link", "os.mkdir", "os.remove", "os.rename", "os.rmdir",
    "os.symlink", "os.truncate", "os.utime", "pickle.find_class", "os.system", "socket.connect",
}  # fmt: skip
touched: list[str] = []
"""What this process changed in the file system, unpickled or ran, since this was cleared."""


def watch() -> None:
    """Note from now on every change."""
    sys.addaudithook(_note)


def _note(event: str, values: tuple[Any, ...]) -> None:
    if event == "open":
        path, mode, flags = values
        if isinstance(path, str | bytes | os.PathLike) and (
            (mode and set(mode) & set("wax+")) or flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        ):
            touched.append(f"{event} {os.fspath(path)!s}")
    elif event in ("os.remove", "os.rmdir") and values[1] not in (-1, None):
        folder = os.readlink(f"/proc/self/fd/{values[1]}")  # the path is relative to it
        touched.append(f"{event} {folder}/{values[0]!s}")
    elif event in _CHANGES:
        touched.append(f"{event} {values[0]!s}")


def peak_mib() -> float:
    """The most memory this process has held; getrusage would count that of its parent too."""
    status = Path("/proc/self/status").read_text()
    return int(re.findall(r"^VmHWM:\s+(\d+) kB$", status, re.MULTILINE)[0]) / 1024


def judged(path: Path, root: Path, results: Path) -> dict[str, Any]:
    """Validate a file as ``xden-bench validate`` does, then try to submit it among no others."""
    from click.testing import CliRunner

    from xden_bench.cli import cli

    touched.clear()
    start = time.process_time()
    where = ["--root", str(root), "--accept-warnings"]
    told = CliRunner().invoke(cli, ["validate", str(path), *where, "--json"])
    seconds = time.process_time() - start
    problems = json.loads(told.stdout)["problems"] if told.exit_code in (0, 1) else []
    entered = CliRunner().invoke(cli, ["submit", str(path), *where, "--out", str(results)])
    errors = [one.exception for one in (told, entered)]
    return {
        "codes": sorted({one["code"] for one in problems}),
        "messages": [one["message"] for one in problems],
        "crashes": [repr(one) for one in errors if not isinstance(one, SystemExit | None)],
        "exits": [told.exit_code, entered.exit_code],
        "submit": sorted(set(re.findall(r"^(?:Error: )?([EW]\d{3})\b", entered.output, re.M))),
        "seconds": seconds,
        "peak_mib": peak_mib(),
        "touched": list(touched),
    }


def scored_or_told(path: Path, reference: Reference) -> dict[str, Any]:
    """Score a file: the problems if it has errors, else its numbers, which must be numbers."""
    from xden1k.errors import SubmissionError
    from xden_bench.entries.result import entry_of
    from xden_bench.scoring.protocol import load_protocol
    from xden_bench.scoring.score import score

    touched.clear()
    start = time.process_time()
    told: list[str] = []
    try:
        scored = score(path, reference, load_protocol())
    except SubmissionError as err:
        told = list(err.problems)
    seconds = time.process_time() - start
    if not told:
        entry = entry_of(scored, reference, command="none", date=datetime.date(2025, 1, 1))
        json.dumps(entry, allow_nan=False)
    return {"told": told, "seconds": seconds, "peak_mib": peak_mib(), "touched": list(touched)}


def judge_apart(paths: Iterable[Path], root: Path, folder: Path) -> Iterator[dict[str, Any]]:
    """Judge files in another process, which runs in ``folder`` and enters in its ``results``."""
    return _lines_apart([str(root), str(folder)], "".join(f"{path}\n" for path in paths), folder)


def fuzz_apart(seeds: range, root: Path, folder: Path) -> Iterator[dict[str, Any]]:
    """Score mutations of ``sound-0.npz`` and ``sound-1.npz`` in another process."""
    return _lines_apart([str(root), str(folder), str(seeds.start), str(seeds.stop)], "", folder)


def _lines_apart(words: list[str], lines: str, folder: Path) -> Iterator[dict[str, Any]]:
    scratch = folder / "scratch"
    scratch.mkdir()
    run = subprocess.run(  # noqa: S603
        [sys.executable, "-B", __file__, *words],
        input=lines,
        cwd=folder,
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
            "TMPDIR": str(scratch),
        },
        capture_output=True,
        text=True,
        timeout=1800,
        check=False,
    )
    assert run.returncode == 0, run.stderr[-2000:]
    return map(json.loads, run.stdout.splitlines())


def _verdicts(root: Path, folder: Path, *seeds: str) -> Iterator[dict[str, Any]]:
    from tests.bench.mutations import mutated
    from xden1k.folder import open_folder
    from xden_bench.scoring.reference import Reference

    if not seeds:
        for line in sys.stdin:
            path = Path(line.rstrip("\n"))
            yield judged(path, root, folder / "results" / path.stem)
        return
    reference = Reference(open_folder(root), "test")
    sounds = [(folder / f"sound-{index}.npz").read_bytes() for index in range(2)]
    path = folder / "scratch" / "mutated.npz"
    for index in range(2):  # what is compiled or imported once is not what is measured
        scored_or_told(folder / f"sound-{index}.npz", reference)
    for seed in range(*map(int, seeds)):
        # part densities take ten times as long to spread over the grid
        path.write_bytes(mutated(sounds[seed % 16 == 15], seed))
        try:
            yield {"seed": seed, "crash": "", **scored_or_told(path, reference)}
        except Exception as err:
            yield {"seed": seed, "crash": repr(err)}


if __name__ == "__main__":
    watch()
    for verdict in _verdicts(Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:]):
        sys.stdout.write(json.dumps(verdict) + "\n")
