"""What commands share: an interrupt while modules are loaded."""

import signal
import subprocess
import sys

import pytest

from xden_builder.commands.shared import loading


@pytest.fixture(autouse=True)
def _as_it_was():
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(
    ("asked", "meanwhile"),
    [(signal.default_int_handler, signal.SIG_DFL), (signal.SIG_IGN, signal.SIG_IGN)],
)
def test_what_an_interrupt_does_is_as_before_once_modules_are_loaded(asked, meanwhile):
    signal.signal(signal.SIGINT, asked)
    with loading():
        assert signal.getsignal(signal.SIGINT) is meanwhile
    assert signal.getsignal(signal.SIGINT) is asked


def test_an_interrupt_that_an_import_would_swallow_ends_the_program():
    swallowing = """
import os, signal
from xden_builder.commands.shared import loading
signal.signal(signal.SIGINT, signal.default_int_handler)
with loading():
    try:
        os.kill(os.getpid(), signal.SIGINT)
    except BaseException:
        pass
print("went on")
"""
    command = [sys.executable, "-c", swallowing]
    ended = subprocess.run(command, capture_output=True, check=False)  # noqa: S603
    assert ended.returncode == -signal.SIGINT
    assert ended.stdout == b""
