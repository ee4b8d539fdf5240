"""Recorded answers: seeds do not make hosted models repeat themselves, a record does.

A cassette is a JSONL file, a line for each answer: ``key``, ``text``, and for the reader
``model``, ``prompt``, ``about``, ``seed``, ``host`` and ``time``. Secrets are in none.
"""

from __future__ import annotations

import hashlib
import json
import os
import threading
from collections.abc import Mapping
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path

from xden1k.errors import DataError
from xden1k.folder.place import exclusive
from xden_baselines.chat.endpoint import MAX_TOKENS, ChatError, Endpoint
from xden_baselines.chat.request import ChatRequest

__all__ = ["Recorder", "Replayer", "read_answers"]


class Replayer:
    """Gives recorded answers and nothing else.

    Parameters
    ----------
    model
        Whose answers.
    path
        The cassette.
    max_tokens
        They were limited to.

    Raises
    ------
    DataError
        If the cassette cannot be read.
    """

    def __init__(self, model: str, path: Path, max_tokens: int = MAX_TOKENS) -> None:
        self.model, self.path, self.max_tokens = model, path, max_tokens
        self._answers = read_answers(path)
        self._digest = _digest(self._answers)

    @property
    def source(self) -> str:
        """The model, and the hash of all recorded answers, whatever their order."""
        return f"{self.model}, replay:{self._digest[:12]}"

    def complete(self, request: ChatRequest) -> str:
        """Return the recorded answer.

        Raises
        ------
        ChatError
            If there is none.
        """
        key = request.key(self.model, self.max_tokens)
        if key not in self._answers:
            raise ChatError(
                f"{request.about}: {self.path} has no answer of {self.model} to the prompt "
                f"{request.prompt}, seed {request.seed} (key {key[:12]})"
            )
        return self._answers[key]


class Recorder(Replayer):
    """Gives recorded answers; asks for those that are not there yet, and records them.

    One recorder at a time: it holds the cassette's lock until it is closed or its process ends. Its
    threads may ask at the same time.

    Parameters
    ----------
    endpoint
        Who is asked.
    path
        The cassette; begun if it is not there.

    Raises
    ------
    DataError
        If the cassette cannot be read, or another recorder has it.
    """

    def __init__(self, endpoint: Endpoint, path: Path) -> None:
        self._endpoint, self._lock, self._writing = endpoint, ExitStack(), threading.Lock()
        try:
            self._lock.enter_context(exclusive(path))
        except BlockingIOError as err:
            raise DataError(f"{path}: another process records into this cassette") from err
        except OSError as err:
            raise DataError(f"{path}: the cassette cannot be begun: {err.strerror}") from err
        super().__init__(endpoint.model, path, endpoint.max_tokens)

    @property
    def source(self) -> str:
        """The model and the host: what is being recorded has no hash yet."""
        return self._endpoint.source

    def complete(self, request: ChatRequest) -> str:
        """Return the answer, on disk before it is used."""
        key = request.key(self.model, self.max_tokens)
        if key not in self._answers:
            text = self._endpoint.complete(request)
            with self._writing:
                if key not in self._answers:  # another thread may have asked the same
                    _append(self.path, _line(key, text, request, self._endpoint))
                    self._answers[key] = text
        return self._answers[key]

    def close(self) -> None:
        """Let others record."""
        self._lock.close()


def read_answers(path: Path) -> dict[str, str]:
    """Read a cassette: answers by key, the first of two for one key.

    An unfinished last line, which a killed recorder leaves, is not an answer.

    Raises
    ------
    DataError
        If the file is not there, or another line is not a recorded answer.
    """
    try:
        lines = path.read_bytes().split(b"\n")[:-1]
    except OSError as err:
        raise DataError(f"{path}: the cassette cannot be read: {err.strerror}") from err
    answers: dict[str, str] = {}
    for number, line in enumerate(lines, 1):
        key, text = _parsed(line, f"{path}, line {number}")
        answers.setdefault(key, text)
    return answers


def _append(path: Path, line: Mapping[str, object]) -> None:
    """Add a line, whole and on disk when this returns."""
    with path.open("r+b") as file:
        # Who holds the lock is the only writer: a line without an end is a dead one's.
        file.seek(file.truncate(path.read_bytes().rfind(b"\n") + 1))
        file.write(json.dumps(line, sort_keys=True).encode() + b"\n")
        file.flush()
        os.fsync(file.fileno())


def _line(key: str, text: str, request: ChatRequest, endpoint: Endpoint) -> dict[str, object]:
    return {
        "key": key,
        "text": text,
        "model": endpoint.model,
        "prompt": request.prompt,
        "about": request.about,
        "seed": request.seed,
        "host": endpoint.host,
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _parsed(line: bytes, where: str) -> tuple[str, str]:
    try:
        values = json.loads(line)
        key, text = values["key"], values["text"]
    except (ValueError, TypeError, KeyError) as err:
        raise DataError(f"{where}: expected JSON with a key and a text, got {line[:40]!r}") from err
    if not (isinstance(key, str) and isinstance(text, str)):
        raise DataError(f"{where}: key and text must be texts, got {line[:40]!r}")
    return key, text


def _digest(answers: Mapping[str, str]) -> str:
    canonical = json.dumps(answers, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode()).hexdigest()
