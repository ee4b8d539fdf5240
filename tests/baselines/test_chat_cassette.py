"""Recorded answers: the key, replay, what a crash leaves, and what may not be on file."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.baselines.chat_stub import Reply, stub_endpoint
from xden1k.errors import DataError
from xden_baselines.chat.asking import at_once
from xden_baselines.chat.cassette import Recorder, Replayer, read_answers
from xden_baselines.chat.endpoint import MAX_TOKENS, ChatError, Endpoint
from xden_baselines.chat.request import ChatRequest, png
from xden_baselines.chat.settings import chat_settings, open_chat

PICTURE = png(np.full((2, 3, 3), 9, dtype=np.uint8))
REQUEST = ChatRequest("materials/1", "mug-0001", "What is it made of?", (PICTURE,))


def recorded(path: Path, texts: list[str], *requests: ChatRequest) -> list[str]:
    with stub_endpoint([Reply(text) for text in texts]) as stub:
        recorder = Recorder(Endpoint(stub.base_url, "qwen", "sk-secret", pause_s=0), path)
        answers = [recorder.complete(request) for request in requests]
        recorder.close()
    return answers


CHANGES = {
    "prompt": "materials/2",
    "text": "What is it?",
    "images": (),
    "seed": 101,
    "temperature": 0.0,
}


@pytest.mark.parametrize("changed", CHANGES)
def test_whatever_an_answer_depends_on_changes_the_key(changed: str) -> None:
    other = replace(REQUEST, **{changed: CHANGES[changed]})
    assert other.key("qwen", MAX_TOKENS) != REQUEST.key("qwen", MAX_TOKENS)
    assert REQUEST.key("llama", MAX_TOKENS) != REQUEST.key("qwen", MAX_TOKENS)
    assert REQUEST.key("qwen", 501) != REQUEST.key("qwen", 500)


def test_the_key_stays_what_it_was() -> None:
    # A change of this value orphans every cassette there is.
    plain = ChatRequest("materials/1", "mug-0001", "What is it made of?", (PICTURE,))
    assert (
        plain.key("qwen", 500) == "1446aee22c2d52a41636e7820f09b451a29a236278a0066e62415e39b4e3213e"
    )


def test_a_picture_that_is_packed_otherwise_has_the_same_key() -> None:
    pixels = np.arange(600, dtype=np.uint8).reshape(10, 20, 3)
    loose = io.BytesIO()
    PIL.Image.fromarray(pixels).save(loose, format="PNG", compress_level=0)
    files = (png(pixels), loose.getvalue())
    assert files[0] != files[1]
    keys = {replace(REQUEST, images=(file,)).key("qwen", 500) for file in files}
    assert len(keys) == 1
    others = (png(pixels[::-1]), png(pixels.reshape(20, 10, 3)))
    assert len(keys | {replace(REQUEST, images=(one,)).key("qwen", 500) for one in others}) == 3


def test_the_object_is_no_part_of_the_key() -> None:
    assert replace(REQUEST, about="mug-0002").key("qwen", MAX_TOKENS) == REQUEST.key(
        "qwen", MAX_TOKENS
    )


@given(st.text(max_size=50))
def test_any_answer_comes_back_as_it_was(
    tmp_path_factory: pytest.TempPathFactory, text: str
) -> None:
    path = tmp_path_factory.mktemp("cassette") / "answers.jsonl"
    path.write_text(json.dumps({"key": REQUEST.key("qwen", MAX_TOKENS), "text": text}) + "\n")
    assert Replayer("qwen", path).complete(REQUEST) == text


def test_what_was_recorded_is_replayed_without_an_endpoint(tmp_path: Path) -> None:
    path = tmp_path / "answers.jsonl"
    second = replace(REQUEST, seed=101)
    assert recorded(path, ["oak", "line\nbreak ü"], REQUEST, second) == ["oak", "line\nbreak ü"]
    replayer = Replayer("qwen", path)
    assert [replayer.complete(each) for each in (second, REQUEST)] == ["line\nbreak ü", "oak"]


def test_a_recorder_asks_only_for_what_it_has_not(tmp_path: Path) -> None:
    path = tmp_path / "answers.jsonl"
    recorded(path, ["oak"], REQUEST)
    assert recorded(path, ["pine"], REQUEST, replace(REQUEST, seed=101)) == ["oak", "pine"]
    assert len(path.read_text().splitlines()) == 2


def test_a_miss_names_prompt_object_and_seed(tmp_path: Path) -> None:
    path = tmp_path / "answers.jsonl"
    recorded(path, ["oak"], REQUEST)
    with pytest.raises(ChatError, match=r"mug-0001: .*qwen to the prompt materials/1, seed 5 "):
        Replayer("qwen", path).complete(replace(REQUEST, seed=5))
    with pytest.raises(ChatError, match="no answer of llama"):
        Replayer("llama", path).complete(REQUEST)


def test_the_hash_tells_answers_apart_but_not_their_order(tmp_path: Path) -> None:
    second = replace(REQUEST, seed=101)
    one, other, changed = (tmp_path / name for name in ("one", "other", "changed"))
    recorded(one, ["oak", "pine"], REQUEST, second)
    recorded(other, ["pine", "oak"], second, REQUEST)
    recorded(changed, ["oak", "fir"], REQUEST, second)
    sources = [Replayer("qwen", path).source for path in (one, other, changed)]
    assert sources[0] == sources[1] != sources[2]
    assert sources[0].startswith("qwen, replay:")


def test_no_secret_and_no_picture_is_on_the_cassette(tmp_path: Path) -> None:
    path = tmp_path / "answers.jsonl"
    recorded(path, ["oak"], REQUEST)
    (line,) = path.read_text().splitlines()
    assert "sk-secret" not in line
    assert set(json.loads(line)) == {
        "about",
        "host",
        "key",
        "model",
        "prompt",
        "seed",
        "text",
        "time",
    }


@pytest.mark.parametrize("kept", [1, 20, 100])
def test_a_line_cut_off_by_a_crash_costs_that_answer_alone(tmp_path: Path, kept: int) -> None:
    path = tmp_path / "answers.jsonl"
    second = replace(REQUEST, seed=101)
    recorded(path, ["oak", "pine"], REQUEST, second)
    first, last = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(first + last[:kept])
    assert read_answers(path) == {REQUEST.key("qwen", MAX_TOKENS): "oak"}
    assert recorded(path, ["fir"], second) == ["fir"]
    assert read_answers(path) == {
        REQUEST.key("qwen", MAX_TOKENS): "oak",
        second.key("qwen", MAX_TOKENS): "fir",
    }


def test_an_answer_is_on_file_before_it_is_used(tmp_path: Path) -> None:
    path = tmp_path / "answers.jsonl"
    with stub_endpoint([Reply("oak"), Reply(status=400)]) as stub:
        recorder = Recorder(Endpoint(stub.base_url, "qwen"), path)
        recorder.complete(REQUEST)
        with pytest.raises(ChatError, match="400"):
            recorder.complete(replace(REQUEST, seed=101))
        recorder.close()
    assert list(read_answers(path).values()) == ["oak"]


def test_threads_record_what_they_all_ask_once(tmp_path: Path) -> None:
    path = tmp_path / "answers.jsonl"
    requests = [replace(REQUEST, seed=seed) for seed in (1, 2, 3, 1, 2, 3)]
    with stub_endpoint([Reply("oak", after_s=0.01)]) as stub:
        recorder = Recorder(Endpoint(stub.base_url, "qwen"), path)
        assert at_once(recorder.complete, requests, 6) == ["oak"] * 6
        recorder.close()
    assert path.read_text().count("\n") == len(read_answers(path)) == 3


def test_tokens_and_patience_come_from_the_settings() -> None:
    environment = {
        "XDEN_VLM_MODE": "live",
        "XDEN_VLM_MODEL": "qwen",
        "XDEN_VLM_BASE_URL": "http://127.0.0.1:1/v1",
        "XDEN_VLM_TIMEOUT_S": "7.5",
        "XDEN_VLM_MAX_TOKENS": "4000",
    }
    model = open_chat(chat_settings(environment))
    assert isinstance(model, Endpoint)
    assert (model.timeout_s, model.max_tokens) == (7.5, 4000)
    fewer = chat_settings(environment | {"XDEN_VLM_MAX_TOKENS": "10"})
    assert fewer.fingerprint != chat_settings(environment).fingerprint


def test_two_recorders_do_not_write_into_one_cassette(tmp_path: Path) -> None:
    path = tmp_path / "answers.jsonl"
    first = Recorder(Endpoint("http://127.0.0.1:1/v1", "qwen"), path)
    with pytest.raises(DataError, match="another process records into this cassette"):
        Recorder(Endpoint("http://127.0.0.1:1/v1", "qwen"), path)
    first.close()
    Recorder(Endpoint("http://127.0.0.1:1/v1", "qwen"), path).close()


@pytest.mark.parametrize("line", ["no json", "[]", "7", '{"key": "a"}', '{"key": 1, "text": "a"}'])
def test_a_line_that_is_no_answer_is_named(tmp_path: Path, line: str) -> None:
    path = tmp_path / "answers.jsonl"
    path.write_text(f'{{"key": "a", "text": "b"}}\n{line}\n')
    with pytest.raises(DataError, match=r"answers\.jsonl, line 2: "):
        read_answers(path)


def test_a_cassette_that_is_not_there_is_no_empty_one(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot be read: No such file"):
        Replayer("qwen", tmp_path / "none.jsonl")
    with pytest.raises(DataError, match="cannot be begun: No such file"):
        Recorder(Endpoint("http://127.0.0.1:1/v1", "qwen"), tmp_path / "no" / "folder.jsonl")


def test_each_mode_opens_its_own_kind_of_model(tmp_path: Path) -> None:
    path = tmp_path / "answers.jsonl"
    common = {
        "XDEN_VLM_MODEL": "qwen",
        "XDEN_VLM_BASE_URL": "http://127.0.0.1:1/v1",
        "XDEN_VLM_API_KEY": "sk-secret",
        "XDEN_VLM_CASSETTE": str(path),
    }
    assert open_chat(chat_settings({})) is None
    live = open_chat(chat_settings(common | {"XDEN_VLM_MODE": "live"}))
    assert live == Endpoint("http://127.0.0.1:1/v1", "qwen", "sk-secret")
    recorder = open_chat(chat_settings(common | {"XDEN_VLM_MODE": "record"}))
    assert isinstance(recorder, Recorder)
    recorder.close()
    replayer = open_chat(chat_settings(common | {"XDEN_VLM_MODE": "replay"}))
    assert type(replayer) is Replayer


LIVE = {"XDEN_VLM_MODE": "live", "XDEN_VLM_BASE_URL": "http://a/v1", "XDEN_VLM_MODEL": "a"}


@pytest.mark.parametrize(
    ("environment", "message"),
    [
        ({"XDEN_VLM_MODE": "on"}, "XDEN_VLM_MODE must be one of .*, got 'on'"),
        ({"XDEN_VLM_MODE": "live"}, "also needs XDEN_VLM_BASE_URL, XDEN_VLM_MODEL"),
        ({"XDEN_VLM_MODE": "replay", "XDEN_VLM_MODEL": "a"}, "also needs XDEN_VLM_CASSETTE"),
        ({"XDEN_VLM_BASE_URL": "http://a"}, "XDEN_VLM_MODE does not say what for"),
        ({"XDEN_VLM_FALLBACK": "me"}, r"XDEN_VLM_FALLBACK must be one of \('train', 'none'\), got"),
        ({"XDEN_VLM_TIMEOUT_S": "soon"}, "XDEN_VLM_TIMEOUT_S must be a number, got 'soon'"),
        ({"XDEN_VLM_IN_FLIGHT": "0"}, "XDEN_VLM_IN_FLIGHT must be positive and .* 1000, got 0"),
        ({"XDEN_VLM_TIMEOUT_S": "inf"}, "XDEN_VLM_TIMEOUT_S must be .* at most 86400, got inf"),
        *[
            (LIVE | {"XDEN_VLM_BASE_URL": url}, r"XDEN_VLM_BASE_URL must be [^@]*/v1$")
            for url in ("localhost:8000/v1", "http://[::1/v1", "http://a@h:99999", "ftp://h/v1")
        ],
        *[
            (LIVE | {"XDEN_VLM_API_KEY": key}, "XDEN_VLM_API_KEY must be ASCII without line ends$")
            for key in ("sk-abc\n", "schl\u00fcssel")
        ],
    ],
)
def test_settings_that_do_not_go_together_are_refused(
    environment: dict[str, str], message: str
) -> None:
    with pytest.raises(DataError, match=message):
        chat_settings(environment)


def test_settings_do_not_show_the_key() -> None:
    assert "sk-secret" not in repr(chat_settings({"XDEN_VLM_API_KEY": "sk-secret"}))
