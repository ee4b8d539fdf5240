import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.waiting import until
from xden_builder.workers import WorkerDiedError, gather, run_each


def double(key: str) -> str:
    if key == "bad":
        raise ValueError("no")
    return key * 2


def poison(key: str) -> str:
    if key == "poison":
        os.kill(os.getpid(), signal.SIGKILL)
    return key


def killed_once(key: str) -> str:
    mark = Path(key)
    if mark.name == "victim" and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return mark.name


def test_one_exception_is_an_answer_and_the_rest_goes_on():
    answers = dict(run_each(double, ["a", "bad", "c"], workers=2))
    assert (answers["a"], answers["c"]) == ("aa", "cc")
    assert isinstance(answers["bad"], ValueError)


def test_what_is_gathered_is_sorted_and_a_failure_loses_nothing_else():
    done: list[str] = []
    results, failures = gather(double, ["c", "bad", "a"], 2, done.append)
    assert list(results.items()) == [("a", "aa"), ("c", "cc")]
    assert failures == [("bad", "internal error: ValueError: no")]
    assert sorted(done) == ["a", "bad", "c"]


def test_an_object_that_kills_its_process_is_reported_and_accuses_nobody_else():
    keys = ["a", "b", "poison", *"cdefgh"]
    answers = list(run_each(poison, keys, workers=2))
    assert sorted(key for key, _ in answers) == sorted(keys)  # each once
    died = [key for key, answer in answers if isinstance(answer, WorkerDiedError)]
    assert died == ["poison"]


@pytest.mark.slow
def test_an_object_whose_process_was_killed_from_outside_is_made_again(tmp_path):
    keys = [str(tmp_path / name) for name in ("a", "victim", "b")]
    answers = dict(run_each(killed_once, keys, workers=2))
    assert sorted(answers.values()) == ["a", "b", "victim"]


PARENT = """
import signal, sys, time
from pathlib import Path
from xden_builder.workers import run_each
from test_workers_tasks import linger
if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # shells ignore it in the background
    list(run_each(linger, [sys.argv[1] + "/a", sys.argv[1] + "/b"], workers=2))
"""
TASKS = """
import os, time
from pathlib import Path
def linger(key):
    Path(key).write_text(str(os.getpid()))
    time.sleep(100_000)
"""


def lingering(tmp_path):
    """A parent and its two workers, at work for ever; in a process group of their own."""
    (tmp_path / "parent.py").write_text(PARENT)
    (tmp_path / "test_workers_tasks.py").write_text(TASKS)
    path = os.pathsep.join([str(tmp_path), *sys.path])
    parent = subprocess.Popen(  # noqa: S603
        [sys.executable, str(tmp_path / "parent.py"), str(tmp_path)],
        env={**os.environ, "PYTHONPATH": path},
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    marks = [tmp_path / "a", tmp_path / "b"]
    until(lambda: all(mark.exists() and mark.read_text() for mark in marks))
    return parent, [int(mark.read_text()) for mark in marks]


def test_workers_end_when_their_parent_is_killed(tmp_path):
    parent, workers = lingering(tmp_path)
    parent.kill()
    parent.communicate()
    until(lambda: not any(map(_alive, workers)))


def test_ctrl_c_waits_for_no_task_and_workers_do_not_speak_of_it(tmp_path):
    parent, workers = lingering(tmp_path)
    os.killpg(parent.pid, signal.SIGINT)
    _, said = parent.communicate()
    assert parent.returncode == -signal.SIGINT
    assert said.count(b"KeyboardInterrupt") == said.count(b"Traceback") == 1  # the parent's
    until(lambda: not any(map(_alive, workers)))


def _alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"
