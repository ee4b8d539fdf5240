"""A chat model behind any endpoint that speaks OpenAI's protocol."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable
from urllib.parse import urlsplit

from xden1k.errors import XDenError
from xden_baselines.chat.request import CUT_OFF, ChatRequest

__all__ = ["MAX_TOKENS", "TIMEOUT_S", "ChatError", "ChatModel", "Endpoint", "check_url"]

NO_KEY = "none"
"""Sent where no key is set: without one the client would send the user's Hub token."""
WORTH_ANOTHER_TRY = (408, 409, 425, 429)
"""HTTP statuses below 500 that can pass by themselves."""
TIMEOUT_S = 120.0
MAX_TOKENS = 2000
LONGEST_PAUSE_S = 300.0

logger = logging.getLogger(__name__)


class ChatError(XDenError):
    """No answer came: the endpoint is wrong or out of order, or no answer was recorded."""


@runtime_checkable
class ChatModel(Protocol):
    """Answers questions."""

    @property
    def source(self) -> str:
        """Which model answers and how, as a row says it."""
        ...

    def complete(self, request: ChatRequest) -> str:
        """Return the raw text of the answer; empty if the model declines to write any.

        One that the limit of tokens has ended ends with :data:`.request.CUT_OFF`.

        Raises
        ------
        ChatError
            If there is none.
        """
        ...


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A server: llama.cpp, Ollama, vLLM, LiteLLM, TGI or a hosted one.

    A call that fails for reasons that can pass (no connection, too slow, HTTP 429 or 5xx, a body
    that is no completion) is made again with the same seed; what the model says is not judged.

    Parameters
    ----------
    base_url
        Up to and with ``/v1``.
    model
        Its name there.
    api_key
        Sent as a bearer token and shown nowhere; empty = none.
    timeout_s
        For the connection, and for as long as nothing comes of the answer: a model that thinks long
        needs more.
    max_tokens
        Of an answer, thoughts included.
    tries
        Calls for one request, at least one.
    pause_s
        Before the second try; doubled with each one after it. Where the server says when to come
        again (``Retry-After``), that counts, up to :data:`LONGEST_PAUSE_S`.
    """

    base_url: str
    model: str
    api_key: str = field(default="", repr=False)
    timeout_s: float = TIMEOUT_S
    max_tokens: int = MAX_TOKENS
    tries: int = 4
    pause_s: float = 3.0

    @property
    def host(self) -> str:
        """Its host and port, without user, password or path."""
        parts = urlsplit(self.base_url)
        return f"{parts.hostname}:{parts.port}" if parts.port else str(parts.hostname)

    @property
    def source(self) -> str:
        """The model and the host."""
        return f"{self.model} at {self.host}"

    def complete(self, request: ChatRequest) -> str:
        """Ask the server.

        Raises
        ------
        ChatError
            If the server refuses the request, or every try fails.
        """
        where = f"{request.about}: {request.prompt}: {self.source}"
        for attempt in range(self.tries):
            answer = self._call(request, where)
            if isinstance(answer, str):
                return answer
            logger.warning("%s: %s (try %d of %d)", where, answer, attempt + 1, self.tries)
            if attempt + 1 < self.tries:
                time.sleep(max(self.pause_s * 2**attempt, answer.wait_s))
        raise ChatError(f"{where}: no answer in {self.tries} tries; the last: {answer}")

    def _call(self, request: ChatRequest, where: str) -> str | _Passing:
        """Return the answer, or what went wrong if that can pass; messages carry no secrets."""
        from huggingface_hub import InferenceClient
        from huggingface_hub.errors import HfHubHTTPError, InferenceTimeoutError

        # the HTTP library's own base, whichever it is, and OSError
        broken: tuple[type[BaseException], ...] = HfHubHTTPError.__bases__
        client = InferenceClient(
            base_url=self.base_url, api_key=self.api_key or NO_KEY, timeout=self.timeout_s
        )
        try:
            output = client.chat_completion(
                request.messages(),
                model=self.model,
                seed=request.seed,
                temperature=request.temperature,
                max_tokens=self.max_tokens,
            )
            choice = output.choices[0]
            return (choice.message.content or "") + CUT_OFF * (choice.finish_reason == "length")
        except InferenceTimeoutError:
            return _Passing(f"nothing came for {self.timeout_s:g} s")
        except HfHubHTTPError as err:
            status = err.response.status_code
            if status < 500 and status not in WORTH_ANOTHER_TRY:
                raise ChatError(f"{where}: refused with HTTP status {status}") from None
            return _Passing(f"HTTP status {status}", _wait_s(err.response.headers))
        except broken as err:
            return _Passing(f"no connection, or it broke ({type(err).__name__})")
        except (ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError):
            return _Passing("the body is no chat completion")


def check_url(base_url: str) -> None:
    """Raise a ValueError unless this is where a server can be: ``http://HOST:PORT/v1``."""
    parts = urlsplit(base_url)
    if parts.scheme not in ("http", "https") or not parts.hostname or parts.port == 0:
        raise ValueError("no scheme http or https, or no host")


@dataclass(frozen=True, slots=True)
class _Passing:
    """What went wrong and may pass, and how long the server wants to be left alone."""

    what: str
    wait_s: float = 0.0

    def __str__(self) -> str:
        return self.what


def _wait_s(headers: Mapping[str, str]) -> float:
    """Seconds of a ``Retry-After``; 0 if there is none, or a date."""
    try:
        return min(max(float(headers.get("Retry-After", 0)), 0.0), LONGEST_PAUSE_S)
    except ValueError:
        return 0.0
