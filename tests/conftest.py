"""Fixtures every area uses."""

import os
from pathlib import Path

import pytest

SHARED_DATA = Path(
    os.environ.get("XDEN1K_TEST_DATA", Path(__file__).parents[2] / "shared" / "data")
)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update-golden", action="store_true", help="Rewrite tests/golden.")


@pytest.fixture
def shared_data() -> Path:
    """The folder of real and independent test data, which is not in the repository."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"real test data not found at {SHARED_DATA}; set XDEN1K_TEST_DATA")
    return SHARED_DATA
