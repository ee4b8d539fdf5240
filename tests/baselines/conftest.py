"""Tests of pictures draw them anew: none is taken from the user's cache, none is left there."""

from collections.abc import Iterator

import pytest

from xden1k.format.cache import LIMIT_VARIABLE


@pytest.fixture(scope="session", autouse=True)
def no_cache() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(LIMIT_VARIABLE, "0")
        yield
