"""What work costs: processor time of threads and children, memory of one process alone."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from xden1k.values import cost
from xden1k.values.cost import processor_s


def spin(seconds: float) -> None:
    """Keep a processor busy for so much of its own time."""
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


def test_threads_and_children_that_ended_count() -> None:
    start = processor_s()
    threads = [threading.Thread(target=spin, args=(0.05,)) for _ in range(2)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    of_threads = processor_s() - start
    assert of_threads >= 0.1
    busy = "import time\nwhile time.process_time() < 0.1: pass"
    subprocess.run([sys.executable, "-c", busy], check=True)  # noqa: S603
    assert processor_s() - start >= of_threads + 0.09  # ticks of a hundredth


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the system tells it or does not")
def test_memory_is_that_of_the_process_and_not_of_who_started_it() -> None:
    held = bytearray(200_000_000)
    words = (
        f"import runpy; peak = runpy.run_path({str(Path(cost.__file__))!r})['peak_memory_gb']; "
        "first = peak(); more = bytearray(60_000_000); print(first, peak())"
    )
    told = subprocess.run([sys.executable, "-c", words], check=True, capture_output=True, text=True)  # noqa: S603
    first, then = map(float, told.stdout.split())
    assert 0 < first < 0.1 < 1e-9 * len(held)
    assert 0.055 < then - first < 0.08
