"""Runs submissions in a process of its own, and tells of each what it cost and what it touched.

Run as a script with the dataset's folder and one to work in; paths come in by lines, one line of
JSON goes out for each.
"""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

__all__ = ["judge_apart", "judged", "peak_mib", "touched", "watch"]

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
    elif event in _CHANGES:
        touched.append(f"{event} {values[0]!s}")


def peak_mib() -> float:
    """The most memory this process has held."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def judged(path: Path, root: Path, results: Path) -> dict[str, Any]:
    """Validate a file as ``xden-bench validate`` does, then try to submit it."""
    from click.testing import CliRunner

    from xden_bench.cli import cli

    touched.clear()
    start = time.perf_counter()
    where = ["--root", str(root)]
    told = CliRunner().invoke(cli, ["validate", str(path), *where, "--json"])
    seconds = time.perf_counter() - start
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


def judge_apart(paths: Iterable[Path], root: Path, folder: Path) -> Iterator[dict[str, Any]]:
    """Judge files in another process, which runs in ``folder`` and enters in its ``results``."""
    scratch = folder / "scratch"
    scratch.mkdir()
    run = subprocess.run(  # noqa: S603
        [sys.executable, "-B", __file__, str(root), str(folder)],
        input="".join(f"{path}\n" for path in paths),
        cwd=folder,
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
            "TMPDIR": str(scratch),
        },
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert run.returncode == 0, run.stderr[-2000:]
    return map(json.loads, run.stdout.splitlines())


if __name__ == "__main__":
    watch()
    root, folder = map(Path, sys.argv[1:])
    for line in sys.stdin:
        verdict = judged(Path(line.rstrip("\n")), root, folder / "results")
        sys.stdout.write(json.dumps(verdict) + "\n")
