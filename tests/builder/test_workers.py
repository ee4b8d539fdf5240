import os
import signal
from pathlib import Path

from xden_builder.workers import WorkerDiedError, run_each


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


def test_an_object_that_kills_its_process_is_reported_and_accuses_nobody_else():
    keys = ["a", "b", "poison", *"cdefgh"]
    answers = list(run_each(poison, keys, workers=2))
    assert sorted(key for key, _ in answers) == sorted(keys)  # each once
    died = [key for key, answer in answers if isinstance(answer, WorkerDiedError)]
    assert died == ["poison"]


def test_an_object_whose_process_was_killed_from_outside_is_made_again(tmp_path):
    keys = [str(tmp_path / name) for name in ("a", "victim", "b")]
    answers = dict(run_each(killed_once, keys, workers=2))
    assert sorted(answers.values()) == ["a", "b", "victim"]
