"""Asking an endpoint: what is sent, what can go wrong, and who is told."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest

from tests.baselines.chat_stub import NEVER_S, Parrot, Reply, stub_endpoint
from xden1k.errors import DataError
from xden_baselines.chat.asking import ask, at_once
from xden_baselines.chat.endpoint import ChatError, Endpoint
from xden_baselines.chat.request import ChatRequest, png

BEARER = "sk-very-secret"
REQUEST = ChatRequest("materials/1", "mug-0001", "What is it made of?")


def endpoint(base_url: str, **changes: object) -> Endpoint:
    return replace(Endpoint(base_url, "qwen", BEARER, timeout_s=300, pause_s=0.001), **changes)


def test_the_question_arrives_with_model_seed_and_picture() -> None:
    request = replace(REQUEST, images=(png(np.zeros((2, 2, 3), dtype=np.uint8)),), seed=7)
    with stub_endpoint([Reply("oak")]) as stub:
        assert endpoint(stub.base_url).complete(request) == "oak"
    (sent,) = stub.requests
    assert (sent["model"], sent["seed"], sent["max_tokens"]) == ("qwen", 7, 2000)
    assert "temperature" not in sent
    text, picture = sent["messages"][0]["content"]
    assert text["text"] == "What is it made of?"
    assert picture["image_url"]["url"].startswith("data:image/png;base64,iVBOR")
    assert stub.authorization == [f"Bearer {BEARER}"]


def test_the_token_of_the_hub_goes_to_no_other_server(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HF_TOKEN", "hf_private")
    with stub_endpoint([Reply("oak")]) as stub:
        endpoint(stub.base_url, api_key="").complete(REQUEST)
    assert stub.authorization == ["Bearer none"]


@pytest.mark.parametrize("status", [408, 429, 500, 503, 504])
def test_a_server_in_trouble_is_asked_again_with_the_same_seed(status: int) -> None:
    with stub_endpoint([Reply(status=status), Reply(status=status), Reply("oak")]) as stub:
        assert endpoint(stub.base_url).complete(REQUEST) == "oak"
    assert stub.seeds == [100, 100, 100]


@pytest.mark.parametrize("status", [400, 401, 403, 404, 422])
def test_a_request_that_is_refused_is_not_sent_again(status: int) -> None:
    with (
        stub_endpoint([Reply(status=status)]) as stub,
        pytest.raises(ChatError, match=rf"mug-0001: materials/1: qwen at .*status {status}"),
    ):
        endpoint(stub.base_url).complete(REQUEST)
    assert len(stub.requests) == 1


@pytest.mark.parametrize(
    "body",
    [b"", b"<html>gateway</html>", b"[]", b"{}", b'{"choices": []}', b'{"choices": [{}]}', b"7"],
)
def test_a_body_that_is_no_completion_counts_as_no_answer(body: bytes) -> None:
    with (
        stub_endpoint([Reply(body=body)]) as stub,
        pytest.raises(ChatError, match="no answer in 2 tries; the last: the body is no chat"),
    ):
        endpoint(stub.base_url, tries=2).complete(REQUEST)
    assert len(stub.requests) == 2


def test_an_answer_that_takes_too_long_is_asked_for_again() -> None:
    with stub_endpoint([Reply("late", after_s=NEVER_S), Reply("oak")]) as stub:
        asked = endpoint(stub.base_url, timeout_s=0.2, tries=1000)  # a busy machine is late, too
        assert asked.complete(REQUEST) == "oak"
    assert len(stub.requests) >= 2


def test_a_slow_answer_within_the_timeout_counts() -> None:
    with stub_endpoint([Reply("oak", after_s=0.3)]) as stub:
        assert endpoint(stub.base_url).complete(REQUEST) == "oak"
    assert len(stub.requests) == 1


def test_silence_becomes_an_error_that_says_how_long() -> None:
    with (
        stub_endpoint([Reply("late", after_s=NEVER_S)]) as stub,
        pytest.raises(ChatError, match=r"in 2 tries; the last: nothing came for 0\.1 s"),
    ):
        endpoint(stub.base_url, timeout_s=0.1, tries=2).complete(REQUEST)


def test_nobody_there_is_an_error_that_names_the_host() -> None:
    with stub_endpoint([Reply("oak")]) as stub:
        gone = endpoint(stub.base_url, tries=2)
    with pytest.raises(ChatError, match=rf"{gone.host}: no answer in 2 tries.*no connection"):
        gone.complete(REQUEST)


def test_a_server_that_says_when_to_come_again_is_left_alone_till_then(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    paused: list[float] = []
    monkeypatch.setattr("xden_baselines.chat.endpoint.time.sleep", paused.append)
    busy = Reply(status=429, headers={"Retry-After": "17"})
    rude = Reply(status=429, headers={"Retry-After": "Sun, 06 Nov 1994 08:49:37 GMT"})
    with stub_endpoint([busy, rude, Reply("oak")]) as stub:
        assert endpoint(stub.base_url, pause_s=3.0).complete(REQUEST) == "oak"
    assert paused == [17.0, 6.0]


def test_an_answer_that_ran_out_of_tokens_is_none_however_whole_it_reads() -> None:
    with stub_endpoint([Reply("8", finish="length"), Reply("9")]) as stub:
        assert ask(endpoint(stub.base_url), REQUEST, number, retries=1) == 9
    assert stub.seeds == [100, 101]


def test_questions_asked_at_once_are_answered_in_their_order() -> None:
    together = threading.Barrier(3)

    def work(one: int) -> int:
        together.wait(60)  # all three are in flight, or nothing is
        return one * one

    assert at_once(work, iter([3, 1, 2]), 3) == [9, 1, 4]


def test_after_an_error_nothing_more_is_asked() -> None:
    asked: list[int] = []

    def work(one: int) -> int:
        asked.append(one)
        raise ChatError("out of order")

    with pytest.raises(ChatError, match="out of order"):
        at_once(work, iter(range(1000)), 2)
    assert len(asked) < 20


def test_a_model_that_declines_gives_an_empty_answer() -> None:
    with stub_endpoint([Reply(None)]) as stub:
        assert endpoint(stub.base_url).complete(REQUEST) == ""
    assert len(stub.requests) == 1


def test_secrets_are_in_no_representation_and_no_message() -> None:
    with stub_endpoint([Reply(status=401)]) as stub:
        asked = endpoint(stub.base_url.replace("http://", "http://user:password@"))
        with pytest.raises(ChatError) as caught:
            asked.complete(REQUEST)
    for shown in (str(caught.value), asked.source, asked.host):
        assert "password" not in shown
        assert BEARER not in shown
    assert BEARER not in repr(asked)


def number(text: str) -> int:
    if not text.isdigit():
        raise DataError("no number")
    return int(text)


def test_what_makes_no_sense_is_asked_again_with_the_next_seed() -> None:
    model = Parrot(lambda request: "8" if request.seed == 102 else "As an AI, I cannot say.")
    assert ask(model, REQUEST, number, retries=3) == 8
    assert [request.seed for request in model.asked] == [100, 101, 102]


def test_nothing_sensible_in_all_retries_is_none() -> None:
    model = Parrot(lambda request: "")
    assert ask(model, REQUEST, number, retries=2) is None
    assert len(model.asked) == 3


def test_an_endpoint_out_of_order_is_not_taken_for_a_bad_answer() -> None:
    with (
        stub_endpoint([Reply(status=500)]) as stub,
        pytest.raises(ChatError, match="HTTP status 500"),
    ):
        ask(endpoint(stub.base_url, tries=1), REQUEST, number)
    assert len(stub.requests) == 1
