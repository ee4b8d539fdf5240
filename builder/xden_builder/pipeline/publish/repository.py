"""One dataset repository of the Hub: what is there, and what the Hub says, in one line."""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final, TypeVar

import huggingface_hub
from huggingface_hub import HfApi, HfFileSystem
from huggingface_hub.errors import HfHubHTTPError, HFValidationError, RepositoryNotFoundError

from xden1k.errors import DataError

__all__ = ["AGAIN", "BRANCH", "HubError", "Repository", "one_line", "patiently"]

Answer = TypeVar("Answer")

BRANCH: Final = "main"
TRIES: Final = 5
LONGEST_WAIT_S: Final = 300
WAIT_S: Final = 10
"""Between two tries, where the Hub does not say."""
AGAIN = "run again: what was uploaded is kept"

logger = logging.getLogger(__name__)
wait: Callable[[float], object] = time.sleep


class HubError(DataError):
    """The Hub refuses, or cannot be reached."""


def patiently(call: Callable[[], Answer]) -> Answer:
    """Call, and wait and call again while the Hub limits the rate of requests."""
    for _ in range(TRIES - 1):
        try:
            return call()
        except HfHubHTTPError as err:
            if err.response.status_code != 429:
                raise
            seconds = min(_wanted_wait_s(err.response.headers), LONGEST_WAIT_S)
            logger.warning("the Hub limits the rate of requests: waiting %d s", seconds)
            wait(seconds)
    return call()


def _wanted_wait_s(headers: Any) -> int:
    told = re.search(r"\bt=(\d+)", headers.get("ratelimit", ""))
    plain = re.fullmatch(r"\d+", headers.get("retry-after", ""))
    return int(told[1]) if told else int(plain[0]) if plain else WAIT_S


@contextmanager
def one_line(repo_id: str) -> Iterator[None]:
    """Turn what the client of the Hub raises into one line.

    Raises
    ------
    HubError
        With what was wanted and what to do.
    """
    # The bases are OSError and the error of whichever HTTP client it has.
    known: tuple[type[BaseException], ...] = (*HfHubHTTPError.__bases__, HFValidationError)
    wrapped: tuple[type[BaseException], ...] = (RuntimeError, ValueError, *known)
    try:
        yield
    except DataError:
        raise
    except wrapped as err:
        cause: BaseException | None = err
        while isinstance(cause, RuntimeError) and not isinstance(cause, known):
            cause = cause.__cause__  # the client says which file, and keeps the reason behind it
        raise HubError(f"cannot push to {repo_id}: {_reason(cause or err)}") from err


def _reason(err: BaseException) -> str:
    if not isinstance(err, HfHubHTTPError):
        lines = [line for line in str(err).splitlines() if line.strip()] or [type(err).__name__]
        broken = not isinstance(err, HFValidationError | ValueError)
        # Of a list of refused files, the first one after the heading.
        return f"{lines[-1] if 'LFS' in lines[0] else lines[0]}" + (f"; {AGAIN}" if broken else "")
    said = (getattr(err, "server_message", None) or "").splitlines()
    heard = f" ({said[0]})" if said else ""
    match err.response.status_code:
        case 401:
            return "the Hub does not take this token: log in by `hf auth login`, or set HF_TOKEN"
        case 403:
            return f"this token may not write there{heard}"
        case 404:
            return f"there is no such repository or namespace{heard}"
        case 412:
            return f"{BRANCH} has changed meanwhile; {AGAIN}"
        case 402 | 413 | 507:
            return f"the Hub has no room for it, or takes no file so large{heard}"
        case 429:
            return f"the Hub limits the rate of requests, also after {TRIES} tries; {AGAIN}"
        case status:
            return f"the Hub answered {status}{heard}; {AGAIN}"


class Repository:
    """A dataset repository.

    Parameters
    ----------
    repo_id
        ``owner/name``.

    Raises
    ------
    DataError
        If that is not its form.
    """

    def __init__(self, repo_id: str) -> None:
        if not re.fullmatch(r"[\w.-]+/[\w.-]+", repo_id, re.ASCII):
            raise DataError(f"--repo-id must be OWNER/NAME, got {repo_id!r}")
        self.repo_id = repo_id
        self.api = HfApi()

    def address(self, revision: str) -> str:
        """Where the files of a revision are, ending in a slash."""
        return f"{self.api.endpoint}/datasets/{self.repo_id}/resolve/{revision}/"

    def refuse_readers(self) -> None:
        """Refuse a token that is not there, or may only read."""
        if not huggingface_hub.get_token():
            raise DataError("no token of the Hub: log in by `hf auth login`, or set HF_TOKEN")
        token = patiently(self.api.whoami).get("auth", {}).get("accessToken", {})
        if token.get("role") == "read":
            raise DataError("the token of the Hub may only read: make one that may write")

    def head(self) -> str | None:
        """Commit at the end of ``main``; None if there is no such repository to be seen."""
        try:
            info = patiently(lambda: self.api.dataset_info(self.repo_id, revision=BRANCH))
        except RepositoryNotFoundError:
            return None
        return str(info.sha)

    def refs(self) -> tuple[dict[str, str], list[str]]:
        """Commit of each tag, and names of the pull requests, the newest first."""
        refs = patiently(
            lambda: self.api.list_repo_refs(
                self.repo_id, repo_type="dataset", include_pull_requests=True
            )
        )
        pulls = [each.ref for each in refs.pull_requests or ()]
        return {tag.name: tag.target_commit for tag in refs.tags}, pulls[::-1]

    def files(self, revision: str) -> dict[str, tuple[str, bool]]:
        """Digest of each file: its checksum where it is stored apart (True), else git's name."""
        entries = patiently(
            lambda: list(
                self.api.list_repo_tree(
                    self.repo_id, recursive=True, revision=revision, repo_type="dataset"
                )
            )
        )
        return {
            entry.path: (entry.lfs.sha256, True) if entry.lfs else (entry.blob_id, False)
            for entry in entries
            if isinstance(entry, huggingface_hub.hf_api.RepoFile)
        }

    def document(self, revision: str, name: str) -> bytes:
        """Content of a small file; empty if there is none."""
        try:
            fs = HfFileSystem(skip_instance_cache=True)
            return bytes(fs.cat_file(f"datasets/{self.repo_id}@{revision}/{name}"))
        except FileNotFoundError:
            return b""
