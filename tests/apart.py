"""Methods in the process of the tests: one of their own takes two seconds to start."""

from __future__ import annotations

from typing import Any

from xden_bench.methods.apart import Method
from xden_bench.methods.running import Report, run_predictor

__all__ = ["run_here"]


def run_here(_: Method, *run: Any) -> Report:
    """Stand for :func:`xden_bench.methods.apart.run_apart`, which test_apart.py tests."""
    return run_predictor(*run)
