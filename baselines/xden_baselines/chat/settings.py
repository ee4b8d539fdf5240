"""Which chat model a method asks: environment variables, and nothing else, say it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

from xden1k.errors import DataError
from xden_baselines.chat.cassette import Recorder, Replayer
from xden_baselines.chat.endpoint import ChatModel, Endpoint

__all__ = ["ChatSettings", "Mode", "chat_settings", "open_chat"]

Mode = Literal["off", "live", "record", "replay"]
_NEEDED: dict[str, tuple[str, ...]] = {
    "off": (),
    "live": ("base_url", "model"),
    "record": ("base_url", "model", "cassette"),
    "replay": ("model", "cassette"),
}
_VARIABLES = {
    name: f"XDEN_VLM_{name.upper()}"
    for name in ("mode", "base_url", "model", "api_key", "cassette")
}


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

    Raises
    ------
    DataError
        If the mode is unknown, lacks what it needs, or is off with an endpoint or a cassette set.
    """

    mode: str = "off"
    base_url: str = ""
    model: str = ""
    api_key: str = field(default="", repr=False)
    cassette: str = ""

    def __post_init__(self) -> None:
        if self.mode not in get_args(Mode):
            raise DataError(f"XDEN_VLM_MODE must be one of {get_args(Mode)}, got {self.mode!r}")
        if missing := [name for name in _NEEDED[self.mode] if not getattr(self, name)]:
            names = ", ".join(_VARIABLES[name] for name in missing)
            raise DataError(f"XDEN_VLM_MODE={self.mode} also needs {names}")
        if self.mode == "off" and (self.base_url or self.cassette):
            raise DataError(
                "an endpoint or a cassette is set, but XDEN_VLM_MODE does not say what for: "
                "live, record or replay"
            )

    @property
    def fingerprint(self) -> str:
        """What answers depend on: mode, model, and host or recorded answers; no secrets.

        Raises
        ------
        DataError
            If recorded answers cannot be read.
        """
        model = open_chat(self) if self.mode == "replay" else None
        host = Endpoint(self.base_url, self.model).host if self.base_url else ""
        return f"{self.mode} {model.source if model else self.model} {host}".strip()


def chat_settings(environment: Mapping[str, str] = os.environ) -> ChatSettings:
    """Read ``XDEN_VLM_MODE``, ``_BASE_URL``, ``_MODEL``, ``_API_KEY`` and ``_CASSETTE``.

    Raises
    ------
    DataError
        If they do not go together.

    Examples
    --------
    >>> chat_settings({}).mode
    'off'
    """
    found = {name: environment.get(variable, "") for name, variable in _VARIABLES.items()}
    return ChatSettings(**{name: value for name, value in found.items() if value})


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
        return Replayer(settings.model, Path(settings.cassette))
    endpoint = Endpoint(settings.base_url, settings.model, settings.api_key)
    return endpoint if settings.mode == "live" else Recorder(endpoint, Path(settings.cassette))
