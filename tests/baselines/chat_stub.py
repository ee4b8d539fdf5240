"""A chat endpoint on the loopback address that does what a script says, and a model without one."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from xden_baselines.chat.request import ChatRequest

NEVER_S = 1000.0


@dataclass(frozen=True)
class Reply:
    """One answer of the endpoint: a text, or a body as it is; None as text is a refusal."""

    text: str | None = ""
    status: int = 200
    body: bytes | None = None
    after_s: float = 0.0
    finish: str = "stop"
    headers: Mapping[str, str] = field(default_factory=dict)

    @property
    def bytes(self) -> bytes:
        if self.body is not None:
            return self.body
        message = {"role": "assistant", "content": self.text}
        choice = {"index": 0, "finish_reason": self.finish, "message": message}
        return json.dumps({"choices": [choice], "model": "stub", "created": 1, "id": "1"}).encode()


@dataclass
class Stub:
    """Where the endpoint is, and what it was asked."""

    base_url: str
    requests: list[dict[str, Any]] = field(default_factory=list)
    authorization: list[str | None] = field(default_factory=list)

    @property
    def seeds(self) -> list[int]:
        return [request["seed"] for request in self.requests]


@contextmanager
def stub_endpoint(script: Sequence[Reply] | Callable[[dict[str, Any]], Reply]) -> Iterator[Stub]:
    """Serve the replies one by one, the last again and again, or what each request calls for."""
    stub, enough = Stub(""), threading.Event()
    answer = script if callable(script) else _one_by_one(script)

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            size = int(self.headers["Content-Length"])
            request = json.loads(self.rfile.read(size))
            stub.requests.append(request)
            stub.authorization.append(self.headers.get("Authorization"))
            reply = answer(request)
            enough.wait(reply.after_s)
            try:
                self.send_response(reply.status)
                self.send_header("Content-Type", "application/json")
                for name, value in reply.headers.items():
                    self.send_header(name, value)
                self.send_header("Content-Length", str(len(reply.bytes)))
                self.end_headers()
                self.wfile.write(reply.bytes)
            except (BrokenPipeError, ConnectionResetError):
                pass  # the client had no patience

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    stub.base_url = f"http://127.0.0.1:{server.server_port}/v1"
    try:
        yield stub
    finally:
        enough.set()
        server.shutdown()
        thread.join()
        server.server_close()


def _one_by_one(script: Sequence[Reply]) -> Callable[[dict[str, Any]], Reply]:
    replies = iter(script)
    return lambda request: next(replies, script[-1])


@dataclass
class Parrot:
    """A model in memory: gives what a function says, and keeps the questions."""

    answer: Callable[[ChatRequest], str]
    asked: list[ChatRequest] = field(default_factory=list)
    source: str = "parrot"

    def complete(self, request: ChatRequest) -> str:
        self.asked.append(request)
        return self.answer(request)
