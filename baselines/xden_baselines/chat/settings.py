"""Which chat model a method asks: environment variables, and nothing else, say it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal, get_args

from xden1k.errors import DataError
from xden_baselines.chat.cassette import Recorder, Replayer
from xden_baselines.chat.endpoint import MAX_TOKENS, TIMEOUT_S, ChatModel, Endpoint, check_url

__all__ = ["ChatSettings", "Mode", "chat_settings", "open_chat"]

Mode = Literal["off", "live", "record", "replay"]
Fallback = Literal["train", "none"]
_NEEDED: dict[str, tuple[str, ...]] = {
    "off": (),
    "live": ("base_url", "model"),
    "record": ("base_url", "model", "cassette"),
    "replay": ("model", "cassette"),
}
_TEXTS: Final = ("mode", "base_url", "model", "api_key", "cassette", "fallback")
_NUMBERS: Final[Mapping[str, type[int | float]]] = {
    "timeout_s": float,
    "max_tokens": int,
    "in_flight": int,
}
_MOST: Final = {"timeout_s": 86_400.0, "max_tokens": 10**7, "in_flight": 1000}


@dataclass(frozen=True, slots=True)
class ChatSettings:
    """Which chat model is asked, and what is kept of its answers.

    Parameters
    ----------
    mode
        ``off``: none is asked; ``live``: nothing is kept; ``record``: what is not in the cassette
        is asked and kept; ``replay``: only the cassette answers.
    base_url, model, api_key
        See :class:`~xden_baselines.chat.endpoint.Endpoint`.
    cassette
        Path of the recorded answers.
    fallback
        Who answers where no answer makes sense: ``train``: what was learned from the training
        split, counted; ``none``: nobody, and the run ends there.
    timeout_s, max_tokens
        See :class:`~xden_baselines.chat.endpoint.Endpoint`.
    in_flight
        Questions asked at the same time.

    Raises
    ------
    DataError
        If a value is unknown or out of range, the mode lacks what it needs, or is off with an
        endpoint or a cassette set.
    """

    mode: str = "off"
    base_url: str = ""
    model: str = ""
    api_key: str = field(default="", repr=False)
    cassette: str = ""
    fallback: str = "train"
    timeout_s: float = TIMEOUT_S
    max_tokens: int = MAX_TOKENS
    in_flight: int = 1

    def __post_init__(self) -> None:
        if self.mode not in get_args(Mode):
            raise DataError(f"XDEN_VLM_MODE must be one of {get_args(Mode)}, got {self.mode!r}")
        if self.fallback not in get_args(Fallback):
            expected = get_args(Fallback)
            raise DataError(f"XDEN_VLM_FALLBACK must be one of {expected}, got {self.fallback!r}")
        for name, most in _MOST.items():
            if not 0 < (got := getattr(self, name)) <= most:
                must = f"must be positive and at most {most:g}"
                raise DataError(f"{_variable(name)} {must}, got {got:g}")
        if missing := [name for name in _NEEDED[self.mode] if not getattr(self, name)]:
            names = ", ".join(_variable(name) for name in missing)
            raise DataError(f"XDEN_VLM_MODE={self.mode} also needs {names}")
        if self.mode == "off" and (self.base_url or self.cassette):
            raise DataError(
                "an endpoint or a cassette is set, but XDEN_VLM_MODE does not say what for: "
                "live, record or replay"
            )
        self._check_texts()

    def _check_texts(self) -> None:
        """Refuse an address or a key that cannot be sent; the message shows neither's secret."""
        if not (self.api_key.isascii() and (self.api_key + "a").isprintable()):
            raise DataError("XDEN_VLM_API_KEY must be ASCII without line ends")
        if self.base_url:
            try:
                check_url(self.base_url)
            except ValueError:
                raise DataError(
                    "XDEN_VLM_BASE_URL must be an address such as http://127.0.0.1:8000/v1"
                ) from None

    @property
    def source(self) -> str:
        """Which model answers and how, as a row says it; nobody is asked, nothing locked.

        Raises
        ------
        DataError
            If recorded answers cannot be read.
        """
        if self.mode == "replay":
            return Replayer(self.model, Path(self.cassette), self.max_tokens).source
        return Endpoint(self.base_url, self.model).source

    @property
    def fingerprint(self) -> str:
        """What answers depend on: mode, model, and host or recorded answers; no secrets.

        Raises
        ------
        DataError
            If recorded answers cannot be read.
        """
        host = Endpoint(self.base_url, self.model).host if self.base_url else ""
        said = [self.mode, self.source if self.mode == "replay" else self.model, host]
        if self.fallback != "train":
            said.append(f"fallback {self.fallback}")
        if self.mode != "off" and self.max_tokens != MAX_TOKENS:
            said.append(f"{self.max_tokens} tokens")
        return " ".join(filter(None, said))


def chat_settings(environment: Mapping[str, str] = os.environ) -> ChatSettings:
    """Read ``XDEN_VLM_MODE`` and the others, one for each field of :class:`ChatSettings`.

    Raises
    ------
    DataError
        If one is not of its kind, or they do not go together.

    Examples
    --------
    >>> chat_settings({"XDEN_VLM_MAX_TOKENS": "4000"}).max_tokens
    4000
    """
    found: dict[str, Any] = {
        name: environment[_variable(name)]
        for name in (*_TEXTS, *_NUMBERS)
        if environment.get(_variable(name))
    }
    for name in found.keys() & _NUMBERS:
        try:
            found[name] = _NUMBERS[name](found[name])
        except ValueError as err:
            raise DataError(f"{_variable(name)} must be a number, got {found[name]!r}") from err
    return ChatSettings(**found)


def open_chat(settings: ChatSettings) -> ChatModel | None:
    """Return the model to ask; None if there is none.

    Raises
    ------
    DataError
        If the cassette cannot be read.
    """
    if settings.mode == "off":
        return None
    if settings.mode == "replay":
        return Replayer(settings.model, Path(settings.cassette), settings.max_tokens)
    endpoint = Endpoint(
        settings.base_url,
        settings.model,
        settings.api_key,
        timeout_s=settings.timeout_s,
        max_tokens=settings.max_tokens,
    )
    return endpoint if settings.mode == "live" else Recorder(endpoint, Path(settings.cassette))


def _variable(name: str) -> str:
    return f"XDEN_VLM_{name.upper()}"
