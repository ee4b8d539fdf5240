"""A server in every mood, asked about 400 objects, eight at a time: what counts, and what is kept.

Slow, wordy, refusing, malformed, busy, cut off in the middle, hopeless; and a process that is
killed while it asks.
"""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from tests.baselines.chat_stub import Reply, stub_endpoint
from tests.baselines.recording import IN_FLIGHT, OBJECTS, question, record_all
from tests.waiting import until
from xden_baselines.chat.cassette import Replayer, read_answers
from xden_bench.cli import cli

ROOT = Path(__file__).parents[2]
GOOD = "(Steel: 7,750-8,050 kg/m^3);(oak wood: 600-900 kg/m^3)"
READ = {"steel": (7.75, 8.05), "oak wood": (0.6, 0.9)}
SLOW_S = 0.04
"""40 s at a thousandth of the time: the patience is 300 s."""
WORDY = f"""<think>Ceramic: (porcelain: 2400 kg/m^3)? No.</think>
Here is the list:
```text
**{GOOD}**
```"""

MOODS: dict[str, tuple[Reply, ...]] = {
    "plain": (Reply(GOOD),),
    "slow": (Reply(GOOD, after_s=SLOW_S),),
    "wordy": (Reply(WORDY),),
    "silent": (Reply(None), Reply(GOOD)),
    "refusing": (Reply("I'm sorry, but I can't help with that."), Reply(GOOD)),
    "malformed": (Reply(body=b"<html>gateway</html>"), Reply(GOOD)),
    "busy": (Reply(status=429), Reply(GOOD)),
    "cut off": (Reply(GOOD[:40], finish="length"), Reply(GOOD)),
    "hopeless": (Reply("no idea"),) * 4,
}
"""What an object's questions get, one by one; the right answer last, if there is one."""
IN_ORDER = tuple(MOODS)
NOT_RECORDED = ("malformed", "busy")
"""Whose first reply is no answer: the same question is asked again."""


def mood_of(number: int) -> str:
    return IN_ORDER[number % len(IN_ORDER)]


class Moody:
    """Replies by object; knows how often each was asked about and how many were at a time."""

    def __init__(self, retry_after: str) -> None:
        self.busy = {"Retry-After": retry_after}
        self.asked: Counter[int] = Counter()
        self.most_at_once = self._now = 0
        self._lock = threading.Lock()

    def __call__(self, request: dict[str, Any]) -> Reply:
        text = request["messages"][-1]["content"][0]["text"]
        number = int(re.findall(r"mug-(\d+)", text)[0])
        with self._lock:
            self._now += 1
            self.most_at_once = max(self.most_at_once, self._now)
            nth = self.asked[number]
            self.asked[number] += 1
        threading.Event().wait(0.002)
        with self._lock:
            self._now -= 1
        replies = MOODS[mood_of(number)]
        reply = replies[min(nth, len(replies) - 1)]
        return replace(reply, headers=self.busy) if reply.status == 429 else reply


@pytest.mark.slow
def test_four_hundred_objects_eight_at_a_time_lose_and_double_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paused: list[float] = []
    monkeypatch.setattr("xden_baselines.chat.endpoint.time.sleep", paused.append)
    cassette, server = tmp_path / "answers.jsonl", Moody("17")
    with stub_endpoint(server) as stub:
        found = record_all(stub.base_url, str(cassette))
    moods = [mood_of(number) for number in range(OBJECTS)]
    assert found == [None if mood == "hopeless" else READ for mood in moods]
    assert [server.asked[number] for number in range(OBJECTS)] == [len(MOODS[m]) for m in moods]
    assert server.most_at_once <= IN_FLIGHT
    assert Counter(paused) == {17.0: moods.count("busy"), 0.0: moods.count("malformed")}
    lines = [json.loads(line) for line in cassette.read_text().splitlines()]
    assert len({line["key"] for line in lines}) == len(lines)
    kept = Counter(line["about"] for line in lines)
    expected = {
        question(number).about: len(MOODS[mood]) - (mood in NOT_RECORDED)
        for number, mood in enumerate(moods)
    }
    assert kept == expected


@pytest.mark.slow
def test_a_recorder_that_is_killed_goes_on_where_it_stopped(tmp_path: Path) -> None:
    cassette, server = tmp_path / "answers.jsonl", Moody("0")
    with stub_endpoint(server) as stub:
        call = (
            f"from tests.baselines.recording import *; record_all({stub.base_url!r}, '{cassette}')"
        )
        words = [sys.executable, "-c", call]
        process = subprocess.Popen(words, cwd=ROOT)  # noqa: S603
        until(lambda: cassette.exists() and cassette.read_text().count("\n") > 60)
        process.kill()
        assert process.wait() == -signal.SIGKILL
        kept = read_answers(cassette)
        subprocess.run(words, cwd=ROOT, check=True)  # noqa: S603
    answers = read_answers(cassette)
    assert kept.items() <= answers.items()
    moods = [mood_of(number) for number in range(OBJECTS)]
    # asked again is only what was in flight, or still without an answer
    once = sum(len(MOODS[mood]) for mood in moods)
    assert once <= sum(server.asked.values()) <= once + IN_FLIGHT
    replayer = Replayer("qwen", cassette)
    for number in range(OBJECTS):
        replayer.complete(question(number))  # or it raises


def region_answers(refused_from: int) -> tuple[list[str], Any]:
    """Reply to questions about parts until there were so many, then refuse to serve."""
    keys: list[str] = []

    def answer(request: dict[str, Any]) -> Reply:
        if len(keys) >= refused_from:
            return Reply(status=401)
        keys.append(json.dumps(request, sort_keys=True))
        return Reply("a part, steel, 0.9")

    return keys, answer


def zero_shot(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, base_url: str) -> Result:
    monkeypatch.chdir(tmp_path)
    values = {"MODE": "record", "CASSETTE": "answers.jsonl", "BASE_URL": base_url, "MODEL": "qwen"}
    for name, value in values.items():
        monkeypatch.setenv(f"XDEN_VLM_{name}", value)
    words: Sequence[str] = ["gaussian-property-style", "--set", "zero_shot=true", "--json"]
    return CliRunner().invoke(cli, ["baseline", *words])


@pytest.mark.slow
def test_a_run_that_lost_its_server_tells_so_in_one_line_and_asks_nothing_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, answer = region_answers(refused_from=100)
    with stub_endpoint(answer) as stub:
        broken = zero_shot(monkeypatch, tmp_path, stub.base_url)
    assert broken.exit_code == 1
    assert re.search(r"part-material/2: qwen at .*: refused with HTTP status 401\n$", broken.stderr)
    assert "Traceback" not in broken.stderr
    assert not list(tmp_path.glob("*.npz"))
    second, answer = region_answers(refused_from=10**6)
    with stub_endpoint(answer) as stub:
        whole = zero_shot(monkeypatch, tmp_path, stub.base_url)
    assert whole.exit_code == 0, whole.stderr
    assert not set(first) & set(second)
    meta = json.loads(whole.stdout)["meta"]
    assert meta["method"] == "gaussian-property-zero-shot"
    assert meta["inputs"] == ["mesh", "rgb"]
    assert len(read_answers(tmp_path / "answers.jsonl")) == len(set(first)) + len(set(second))
