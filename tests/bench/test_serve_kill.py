"""Twenty uploads at once and a server that is killed: nothing lost, doubled or corrupt."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.waiting import until
from xden_bench.entries.archive import ARCHIVE
from xden_bench.entries.reading import read_entries
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.serve import store
from xden_bench.serve.desk import Desk
from xden_bench.serve.tickets import TurnedAwayError

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")

Submit = Callable[..., Path]
RULES = load_protocol()
UPLOADS = 20
SERVER = """
import json, sys, threading
from pathlib import Path
from xden1k.folder import open_folder
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.serve import store
from xden_bench.serve.desk import Desk
from xden_bench.serve.tickets import TurnedAwayError

store.MOST_STARTS = int(sys.argv.pop(1))
root, results, state, *files = map(Path, sys.argv[1:])
desk = Desk(Reference(open_folder(root), "test"), load_protocol(), results=results, state=state)
start, speak = threading.Barrier(len(files)), threading.Lock()

def send(path):
    start.wait()
    try:
        answer = desk.submit(path, user=path.stem, filename=path.name).ticket_id
    except TurnedAwayError as away:
        answer = away.reason
    with speak:
        print(json.dumps([path.name, answer]), flush=True)

for path in files:
    threading.Thread(target=send, args=[path]).start()
threading.Event().wait()
"""
STARTS = 100
"""More than there are kills: on a slow machine one file may be at work at several of them."""


def children(pid: int) -> list[int]:
    return [int(one) for one in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def serve_and_kill(
    command: list[object], results: Path, *, answers: int, scored: int, then_s: float = 0.0
) -> list[tuple[str, str]]:
    """Run a server until so many uploads are answered and entries are there, then kill it.

    Return what it had answered.
    """
    said: list[tuple[str, str]] = []
    with subprocess.Popen(  # noqa: S603
        [sys.executable, "-c", SERVER, str(STARTS), *map(str, command)],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    ) as server:
        assert server.stdout is not None
        lines = iter(server.stdout.readline, "")
        reader = threading.Thread(target=lambda: said.extend(json.loads(one) for one in lines))
        reader.start()
        try:
            until(lambda: len(said) >= answers)
            until(lambda: len(list(results.rglob("*.json"))) >= scored)
            time.sleep(then_s)
            workers = children(server.pid)
        finally:
            server.kill()
            reader.join()
    until(lambda: not any(map(is_running, workers)))
    return said


class Uploads:
    """Files, good and bad, that their users send until they have an answer."""

    def __init__(self, folder: Path, files: dict[str, bool], root: Path) -> None:
        self.folder, self.files, self.root = folder, files, root
        self.results, self.state = folder / "results", folder / "state"
        self.tickets: dict[str, str] = {}

    def note(self, name: str, answer: str) -> None:
        """Keep a ticket; a file that is there although nobody was told of it needs none."""
        if answer not in ("entered", "one_at_a_time"):
            assert self.tickets.setdefault(name, answer) == answer

    def serve_and_kill(self, *, answers: int, scored: int, then_s: float = 0.0) -> None:
        paths = [self.folder / name for name in self.files if name not in self.tickets]
        command = [self.root, self.results, self.state, *paths]
        moment = {"answers": min(answers, len(paths)), "scored": scored, "then_s": then_s}
        for name, answer in serve_and_kill(command, self.results, **moment):
            self.note(name, answer)

    def finish(self, reference: Reference) -> None:
        """Send what has no answer yet, and wait for the end of everything."""
        with Desk(reference, RULES, results=self.results, state=self.state) as desk:
            for name in self.files.keys() - self.tickets.keys():
                path = self.folder / name
                try:
                    self.note(name, desk.submit(path, user=path.stem, filename=name).ticket_id)
                except TurnedAwayError as away:
                    self.note(name, away.reason)
            waiting = "SELECT count(*) FROM jobs WHERE state IN ('queued', 'checking')"
            until(lambda: desk._store._db.execute(waiting).fetchone()[0] == 0)
            for name, ticket_id in self.tickets.items():
                expected = "scored" if self.files[name] else "refused"
                assert desk.status(ticket_id).state == expected

    def check(self) -> None:
        """Every good file is entered once, nothing else is, and every job has one end."""
        sums = {name: sha256(self.folder / name) for name in self.files}
        good = sorted(sums[name] for name, is_good in self.files.items() if is_good)
        assert sorted(entry["submission_sha256"] for entry in read_entries(self.results)) == good
        suffixes = Counter(path.suffix for path in self.results.rglob("*") if path.is_file())
        each = dict.fromkeys((".json", ".parquet", ".npz"), len(good))
        assert suffixes == {"": 1, **each}  # "" is .lock
        for kept in (self.state / "uploads", self.results / ARCHIVE):
            assert sorted(map(sha256, kept.iterdir())) == good

        lines = (self.state / "audit.jsonl").read_text().splitlines()
        events = [json.loads(line) for line in lines]
        assert [event["number"] for event in events] == list(range(1, len(events) + 1))
        queued = [event for event in events if event["event"] == "queued"]
        ends = [event for event in events if event["event"] in ("scored", "refused", "failed")]
        assert sorted(e["job"] for e in ends) == sorted(e["job"] for e in queued)
        assert sum(event["event"] == "scored" for event in ends) == len(good)
        sent = Counter(event["sha256"] for event in queued)
        assert sent.keys() == set(sums.values())
        assert all(sent[one] == 1 for one in good)


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture
def uploads(
    tmp_path: Path, submission: Submit, dataset: Path, monkeypatch: pytest.MonkeyPatch
) -> Uploads:
    """Twenty files: fifteen good ones, four that lack an object, one cut short."""
    monkeypatch.setattr(store, "MOST_STARTS", STARTS)
    files = {f"{number:02}.npz": number % 4 != 3 for number in range(UPLOADS)}
    for number, (name, is_good) in enumerate(files.items()):
        change = scaled(1 + (number + 1) / 100) if is_good else without_an_object
        submission(change, name, method=f"method {number}", notes=name)
    last = tmp_path / "19.npz"
    last.write_bytes(last.read_bytes()[:2000])
    return Uploads(tmp_path, files, dataset)


def scaled(factor: float) -> Callable[[str, np.ndarray], np.ndarray]:
    return lambda _, grid: factor * grid


def without_an_object(object_id: str, grid: np.ndarray) -> np.ndarray | None:
    return None if object_id == "bar-0002" else grid


@pytest.mark.slow
def test_two_kills_among_twenty_uploads_lose_double_and_spoil_nothing(
    uploads: Uploads, reference: Reference
) -> None:
    uploads.serve_and_kill(answers=7, scored=0)
    assert 7 <= len(uploads.tickets) <= UPLOADS
    uploads.serve_and_kill(answers=UPLOADS, scored=4)
    uploads.finish(reference)
    uploads.check()


@pytest.mark.slow
def test_a_kill_at_any_moment_of_the_scoring_loses_doubles_and_spoils_nothing(
    uploads: Uploads, reference: Reference
) -> None:
    chance = np.random.default_rng(20)
    for scored in range(14):
        uploads.serve_and_kill(answers=1, scored=scored, then_s=chance.random() / 3)
    uploads.finish(reference)
    uploads.check()
