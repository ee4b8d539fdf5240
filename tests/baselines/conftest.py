"""Tests draw pictures anew, and keep features apart from the user's."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from xden1k.format.cache import LIMIT_VARIABLE


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(LIMIT_VARIABLE, "0")
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield
