"""A chat model behind any endpoint that speaks OpenAI's protocol."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable
from urllib.parse import urlsplit

from xden1k.errors import XDenError
from xden_baselines.chat.request import ChatRequest

__all__ = ["ChatError", "ChatModel", "Endpoint"]

NO_KEY = "none"
"""Sent where no key is set: without one the client would send the user's Hub token."""
WORTH_ANOTHER_TRY = (408, 409, 425, 429)
"""HTTP statuses below 500 that can pass by themselves."""

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
        For the connection, and between two pieces of an answer.
    tries
        Calls for one request, at least one.
    pause_s
        Before the second try; doubled with each one after it.
    """

    base_url: str
    model: str
    api_key: str = field(default="", repr=False)
    timeout_s: float = 20.0
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
            if attempt:
                time.sleep(self.pause_s * 2 ** (attempt - 1))
            answer = self._call(request, where)
            if isinstance(answer, str):
                return answer
            logger.warning("%s: %s (try %d of %d)", where, answer, attempt + 1, self.tries)
        raise ChatError(f"{where}: no answer in {self.tries} tries; the last: {answer}")

    def _call(self, request: ChatRequest, where: str) -> str | ChatError:
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
                max_tokens=request.max_tokens,
            )
            return output.choices[0].message.content or ""
        except InferenceTimeoutError:
            return ChatError(f"nothing came for {self.timeout_s:g} s")
        except HfHubHTTPError as err:
            status = err.response.status_code
            if status < 500 and status not in WORTH_ANOTHER_TRY:
                raise ChatError(f"{where}: refused with HTTP status {status}") from None
            return ChatError(f"HTTP status {status}")
        except broken as err:
            return ChatError(f"no connection ({type(err).__name__})")
        except (ValueError, TypeError, KeyError, IndexError, AttributeError):
            return ChatError("the body is no chat completion")
