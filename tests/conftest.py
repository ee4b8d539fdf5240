"""Fixtures every area uses, and how many examples Hypothesis draws.

The profile ``fast`` is the one of ``make test``: few examples, the same each time. Those of
``make test-all``, with ``--hypothesis-profile all``, are new and more. None has a deadline. There
the annotations of every function are checked as it runs, too (jaxtyping, beartype).
"""

import ctypes
import gc
import os
from collections.abc import Generator, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import settings

from tests.hub_server import HubServer, running_hub

settings.register_profile("fast", max_examples=20, deadline=None, derandomize=True)
settings.register_profile("all", max_examples=100, deadline=None)
settings.load_profile("fast")

SHARED_DATA = Path(
    os.environ.get("XDEN1K_TEST_DATA", Path(__file__).parents[2] / "shared" / "data")
)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update-golden", action="store_true", help="Rewrite tests/golden.")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None]:
    """Look for garbage neither while all is imported, which takes half as long again, nor in it."""
    gc.disable()
    result = yield
    gc.enable()
    gc.freeze()
    return result


@pytest.hookimpl(wrapper=True, trylast=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> Generator[None]:
    """Give back what a module held before the next one takes its own.

    What is left then was imported or is kept for the session: no garbage is looked for in it again.
    """
    result = yield
    if nextitem is None or nextitem.path != item.path:
        gc.collect()
        gc.freeze()
        if malloc_trim := getattr(ctypes.CDLL(None), "malloc_trim", None):  # the GNU C library's
            malloc_trim(0)
    return result


@pytest.fixture
def shared_data() -> Path:
    """The folder of real and independent test data, which is not in the repository."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"real test data not found at {SHARED_DATA}; set XDEN1K_TEST_DATA")
    return SHARED_DATA


@pytest.fixture(scope="session")
def one_hub() -> Iterator[HubServer]:
    """One server for all tests: the client keeps its connections, which are dear to make."""
    from huggingface_hub.utils import _http

    with running_hub() as server:
        yield server
        _http.close_session()


@pytest.fixture
def hub(one_hub: HubServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[HubServer]:
    """A stand-in for the Hub, empty, which the client of this process takes for the real one."""
    from huggingface_hub import HfFileSystem, constants
    from huggingface_hub.utils import _http

    one_hub.reset()
    HfFileSystem.clear_instance_cache()
    monkeypatch.setattr(constants, "ENDPOINT", one_hub.url)
    template = f"{one_hub.url}/{{repo_id}}/resolve/{{revision}}/{{filename}}"
    monkeypatch.setattr(constants, "HUGGINGFACE_CO_URL_TEMPLATE", template)
    monkeypatch.setattr(constants, "HF_HUB_DISABLE_XET", True)
    monkeypatch.setattr(constants, "HF_TOKEN_PATH", str(tmp_path / "no-token"))
    monkeypatch.setattr(_http, "time", SimpleNamespace(sleep=lambda _: None))
    monkeypatch.setenv("HF_TOKEN", "hf_write")
    yield one_hub
    HfFileSystem.clear_instance_cache()
