"""The sealed truth gives the numbers of the open one, to nobody without the key, unchanged."""

from __future__ import annotations

import hashlib
import hmac
import json
import os
import shutil
import stat
import tracemalloc
import zipfile
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.bench.sealing import KEY, OTHER_KEY, Sealed, sealed_dataset, write_dataset
from xden1k.errors import DataError
from xden1k.folder import open_folder
from xden1k.predictions import SubmissionMeta, write_predictions
from xden1k.values.types import PRIVATE
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import score
from xden_bench.scoring.submission import validate
from xden_bench.sealed import (
    InputsReference,
    Key,
    SealedReference,
    SealedTruth,
    check_sealed,
    container,
    read_key,
    seal,
    write_key,
)
from xden_bench.sealed.answers import answers_bytes, answers_row
from xden_bench.sealed.container import SealWriter
from xden_bench.sealed.division import private_ids

keys = st.binary(min_size=32, max_size=32).map(Key)


@pytest.fixture(scope="module")
def reference(sealed: Sealed) -> SealedReference:
    return SealedReference(sealed.public, PRIVATE, sealed.truth())


# The key


def test_a_key_is_read_as_written_and_only_its_owner_may_read_it(tmp_path: Path) -> None:
    path = tmp_path / "organiser.key"
    written = write_key(path)
    assert read_key(path) == written
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert write_key(tmp_path / "other.key").secret != written.secret


def test_a_key_is_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "organiser.key"
    before = write_key(path)
    with pytest.raises(DataError, match="exists, and a key is never overwritten"):
        write_key(path)
    assert read_key(path) == before


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o777])
def test_a_key_that_others_may_read_is_refused(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "organiser.key"
    write_key(path)
    path.chmod(mode)
    with pytest.raises(DataError, match=f"mode {mode:03o}: chmod 600 "):
        read_key(path)


@pytest.mark.parametrize(
    "text", [b"", b"xden-key/1 00", b"xden-key/2 " + b"0" * 64, b"xden-key/1 " + b"0" * 65, b"\xff"]
)
def test_another_file_is_no_key(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / "organiser.key"
    path.write_bytes(text)
    path.chmod(0o600)
    with pytest.raises(DataError, match="not a key of xden-bench keygen"):
        read_key(path)


def test_a_key_does_not_print_its_secret() -> None:
    shown = f"{KEY} {KEY!r} {KEY.id}"
    assert KEY.secret.hex() not in shown
    assert repr(KEY.secret) not in shown
    assert KEY.id != OTHER_KEY.id
    with pytest.raises(DataError, match="a key has 32 bytes, got 16"):
        Key(bytes(16))


def test_secrets_are_the_hmac_they_are_said_to_be() -> None:
    expected = hmac.new(KEY.secret, b"salt\0abc\0mug-1", hashlib.sha512).digest()
    assert KEY.derive("salt", "abc", "mug-1") == expected


# The division


@settings(max_examples=60)
@given(
    st.dictionaries(st.text("abc", min_size=1), st.sampled_from("ABCDE"), min_size=2, max_size=40),
    st.floats(0.01, 0.99),
    keys,
)
def test_each_category_gives_its_share_rounded_down_or_up(
    categories: dict[str, str], share: float, key: Key
) -> None:
    chosen = private_ids(categories, share, key)
    assert chosen < categories.keys()
    assert len(chosen) == min(max(int(share * len(categories) + 0.5), 1), len(categories) - 1)
    given_by = Counter(categories[one] for one in chosen)
    for name, size in Counter(categories.values()).items():
        assert abs(given_by[name] - share * size) < 1
    assert private_ids(dict(reversed(categories.items())), share, key) == chosen


def test_only_the_key_tells_which_objects_are_private() -> None:
    categories = {f"mug-{number:03d}": "mug" for number in range(40)}
    draws = {private_ids(categories, 0.5, Key(bytes([n]) * 32)) for n in range(20)}
    assert len(draws) == 20
    counts = Counter(one for draw in draws for one in draw)
    assert all(1 <= counts[one] <= 19 for one in categories)


@pytest.mark.parametrize("share", [0.0, 1.0, -1.0, 2.0, float("nan")])
def test_a_share_is_between_nothing_and_all(share: float) -> None:
    with pytest.raises(DataError, match="share must be more than 0 and less than 1"):
        private_ids({"a": "mug", "b": "mug"}, share, KEY)


def test_one_object_cannot_be_divided() -> None:
    with pytest.raises(DataError, match="two objects are the least to divide, got 1"):
        private_ids({"a": "mug"}, 0.5, KEY)


# The numbers


def predictions(reference: Reference, path: Path, ids: tuple[str, ...]) -> Path:
    meta = SubmissionMeta(
        method="test",
        dataset_revision=reference.revision,
        manifest_sha256=reference.manifest_sha256,
        config="default",
        split=reference.split,
        inputs=("mesh",),
        training_data=(),
        external_data=False,
    )

    def grid(object_id: str) -> np.ndarray:
        draw = np.random.default_rng([*object_id.encode()])
        return np.kron(draw.uniform(0, 5, (4, 4, 4)), np.ones((16, 16, 16))).astype(np.float32)

    write_predictions(path, meta, ((one, grid(one)) for one in ids))
    return path


def test_every_truth_is_the_open_one_to_the_last_bit(
    sealed: Sealed, reference: SealedReference
) -> None:
    whole = Reference(sealed.whole, "test")
    assert reference.ids == sealed.made.private_ids
    assert sorted((*sealed.made.private_ids, *sealed.made.test_ids)) == list(whole.ids)
    for object_id in reference.ids:
        for target in ("density", "apparent_density"):
            one, other = reference.truth(object_id, target), whole.truth(object_id, target)
            assert one.density_g_cm3.tobytes() == other.density_g_cm3.tobytes()
            assert one.envelope.tobytes() == other.envelope.tobytes()
            assert one.origin_cm.tobytes() == other.origin_cm.tobytes()
            assert (one.category, one.source, one.voxel_size_cm, one.parts) == (
                *(other.category, other.source, other.voxel_size_cm, other.parts),
            )


def test_scores_are_those_of_the_open_truth_to_the_last_bit(
    sealed: Sealed, reference: SealedReference, tmp_path: Path
) -> None:
    whole = Reference(sealed.whole, "test")
    hidden = predictions(reference, tmp_path / "hidden.npz", reference.ids)
    shown = predictions(whole, tmp_path / "shown.npz", whole.ids)
    by_seal = {one.object_id: one for one in score(hidden, reference, load_protocol()).objects}
    by_folder = {one.object_id: one for one in score(shown, whole, load_protocol()).objects}
    assert by_seal == {one: by_folder[one] for one in reference.ids}
    assert all(value > 0 for one in by_seal.values() for value in one.metrics.values())


def test_a_private_split_is_not_scored_without_its_answers(sealed: Sealed) -> None:
    with pytest.raises(DataError, match="the answers of the split private are sealed: scoring"):
        Reference(sealed.public, PRIVATE)


def test_a_submission_is_checked_without_the_answers(sealed: Sealed, tmp_path: Path) -> None:
    inputs = InputsReference(sealed.public, PRIVATE)
    sound = predictions(inputs, tmp_path / "sound.npz", inputs.ids)
    codes = [one.code for one in validate(sound, inputs, load_protocol())]
    assert codes == ["W503"]  # mass everywhere
    short = predictions(inputs, tmp_path / "short.npz", inputs.ids[1:])
    codes = [one.code for one in validate(short, inputs, load_protocol())]
    assert codes == ["E301", "W503"]
    assert np.isnan(inputs.truth(inputs.ids[0]).density_g_cm3).all()


def test_memory_does_not_grow_with_the_objects(reference: SealedReference) -> None:
    def peak(ids: tuple[str, ...]) -> int:
        tracemalloc.start()
        for object_id in ids:
            reference.truth(object_id)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    reference.truth(reference.ids[0])  # what is opened once
    assert peak(reference.ids) < 1.2 * peak(reference.ids[:1])


def test_answers_come_back_as_they_were(sealed: Sealed) -> None:
    row = sealed.whole.row(sealed.made.private_ids[0])
    again = answers_row(answers_bytes(row))
    assert again.keys() < row.keys()
    assert {name: row[name] for name in again} == again
    unknown = row | {"density": None, "mass_g": float("nan"), "weighed_mass_g": None}
    assert repr(answers_row(answers_bytes(unknown))["mass_g"]) == "nan"
    assert answers_row(answers_bytes(unknown))["density"] is None


def test_answers_of_another_version_are_refused() -> None:
    with pytest.raises(DataError, match="sealed by another version: columns"):
        answers_row(b'{"object_id": "a", "weight": 1}')


# The commitments


def test_a_commitment_can_be_made_again_by_hand(sealed: Sealed) -> None:
    object_id = sealed.made.private_ids[0]
    row, manifest = sealed.whole.row(object_id), sealed.made.manifest_sha256
    salt = hmac.new(KEY.secret, f"salt\0{manifest}\0{object_id}".encode(), "sha512").digest()
    digest = hashlib.sha256(salt + answers_bytes(row)).hexdigest()
    published = json.loads((sealed.out / "public" / "commitments.json").read_text())
    assert published["objects"][object_id] == digest
    assert sealed.made.manifest_sha256 == sealed.public.manifest_sha256


def test_every_sealed_answer_is_the_one_committed_to(sealed: Sealed) -> None:
    assert check_sealed(sealed.truth()) == []


def test_an_organiser_cannot_change_an_answer_afterwards(sealed: Sealed, tmp_path: Path) -> None:
    path, (victim, *_) = tmp_path / "changed.xden", sealed.made.private_ids
    with zipfile.ZipFile(path, "w") as archive:
        writer = SealWriter(archive, sealed.made.manifest_sha256, KEY)
        for object_id in sealed.made.private_ids:
            row = sealed.whole.row(object_id)
            heavier = {"mass_g": np.nextafter(row["mass_g"], np.inf).item()}
            writer.add(row | (heavier if object_id == victim else {}))
    (problem,) = check_sealed(sealed.truth(path))
    assert f"the answers of {victim} are not those committed to in" in problem


# The file


Rewrite = Callable[[dict[str, bytes]], None]


def rewritten(
    sealed: Sealed, path: Path, change: Rewrite, method: int = zipfile.ZIP_STORED
) -> Path:
    """Copy the sealed truth with its members changed, as a zip with nothing wrong."""
    with zipfile.ZipFile(sealed.path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    change(members)
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def test_another_key_is_one_clear_line(sealed: Sealed) -> None:
    line = f"was sealed with the key {KEY.id}, this is {OTHER_KEY.id}$"
    with pytest.raises(DataError, match=line):
        sealed.truth(key=OTHER_KEY)


def test_another_key_under_the_same_name_opens_nothing(sealed: Sealed, tmp_path: Path) -> None:
    def renamed(members: dict[str, bytes]) -> None:
        text = members["seal.json"].decode().replace(KEY.id, OTHER_KEY.id)
        members["seal.json"] = text.encode()

    truth = sealed.truth(rewritten(sealed, tmp_path / "s.xden", renamed), OTHER_KEY)
    assert len(check_sealed(truth)) == len(sealed.made.private_ids)


@pytest.mark.slow
def test_the_seal_of_another_dataset_is_refused(sealed: Sealed, tmp_path: Path) -> None:
    write_dataset(tmp_path / "whole", 1, frozenset(sealed.made.test_ids))
    other = sealed_dataset(tmp_path / "whole", tmp_path / "out")
    with pytest.raises(DataError, match="belongs to the dataset of manifest"):
        sealed.truth(other.path)
    with pytest.raises(DataError, match="belongs to the dataset of manifest"):
        SealedTruth(sealed.path, other.public, KEY)

    def moved(members: dict[str, bytes]) -> None:
        here, there = sealed.made.manifest_sha256, other.made.manifest_sha256
        members["seal.json"] = members["seal.json"].decode().replace(here, there).encode()

    assert other.made.private_ids == sealed.made.private_ids
    passed_off = rewritten(sealed, tmp_path / "s.xden", moved)
    for problem in check_sealed(other.truth(passed_off)):
        assert problem.endswith("was changed after it was sealed")


def test_the_commitments_of_another_dataset_are_refused(sealed: Sealed, tmp_path: Path) -> None:
    public = Path(shutil.copytree(sealed.out / "public", tmp_path / "public"))
    path = public / "commitments.json"
    text = path.read_text()
    path.write_text(text.replace(sealed.made.manifest_sha256, "0" * 64))
    with pytest.raises(DataError, match=r"commitments.json belongs to the dataset of manifest 0"):
        SealedTruth(sealed.path, open_folder(public), KEY)
    path.write_text(text.replace(sealed.made.private_ids[0], "bolt-9999"))
    with pytest.raises(DataError, match="its objects are not those of the split private"):
        SealedTruth(sealed.path, open_folder(public), KEY)
    path.unlink()
    with pytest.raises(DataError, match=r"no commitments.json: nothing is sealed here"):
        SealedTruth(sealed.path, open_folder(public), KEY)


def swap(members: dict[str, bytes]) -> None:
    one, other = [name for name in members if name != "seal.json"][:2]
    members[one], members[other] = members[other], members[one]


def drop(members: dict[str, bytes]) -> None:
    members.popitem()


def add(members: dict[str, bytes]) -> None:
    members["answers/more"] = b"x"


def no_header(members: dict[str, bytes]) -> None:
    del members["seal.json"]


def other_schema(members: dict[str, bytes]) -> None:
    members["seal.json"] = members["seal.json"].replace(b"xden-sealed/1", b"xden-sealed/2")


def no_json(members: dict[str, bytes]) -> None:
    members["seal.json"] = b"[" * 100_000


def too_large(members: dict[str, bytes]) -> None:
    for name in [name for name in members if name != "seal.json"]:
        members[name] = bytes(container.MAX_MEMBER_BYTES + 1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (swap, "was changed after it was sealed"),
        (drop, "its 7 objects are not the 8 of"),
        (add, "its 9 objects are not the 8 of"),
        (no_header, "not a sealed truth: no seal.json"),
        (other_schema, "not of schema xden-sealed/1: .*schema is 'xden-sealed/2'"),
        (no_json, "not of schema xden-sealed/1"),
        (too_large, f"has {(8 << 20) + 1} bytes, over {8 << 20}"),
    ],
)
def test_a_changed_file_is_refused(
    sealed: Sealed, tmp_path: Path, change: Rewrite, message: str
) -> None:
    path = rewritten(sealed, tmp_path / "s.xden", change, zipfile.ZIP_DEFLATED)
    with pytest.raises(DataError, match=message) as caught:
        sealed.truth(path).answers(sealed.made.private_ids[0])
    assert "\n" not in str(caught.value)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_doubled_member_is_refused(sealed: Sealed, tmp_path: Path) -> None:
    path = Path(shutil.copy(sealed.path, tmp_path / "s.xden"))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(f"answers/{sealed.made.private_ids[0]}", b"x")
    with pytest.raises(DataError, match="its 9 objects are not the 8 of"):
        sealed.truth(path)


@pytest.mark.parametrize("data", [b"", b"PK", b"no zip", os.urandom(2000)])
def test_another_file_is_no_sealed_truth(sealed: Sealed, tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "s.xden"
    path.write_bytes(data)
    with pytest.raises(DataError, match="not a whole sealed truth"):
        sealed.truth(path)


@pytest.mark.slow
@settings(
    max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.data())
def test_a_file_with_a_changed_byte_is_refused_or_says_the_same(
    sealed: Sealed, tmp_path: Path, data: st.DataObject
) -> None:
    spoilt = bytearray(sealed.path.read_bytes())
    for _ in range(data.draw(st.integers(1, 3))):
        spoilt[data.draw(st.integers(0, len(spoilt) - 1))] ^= data.draw(st.integers(1, 255))
    path = tmp_path / "s.xden"
    path.write_bytes(spoilt)
    said_the_same_or_refused(sealed, path)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.data())
def test_a_file_cut_short_is_refused(sealed: Sealed, tmp_path: Path, data: st.DataObject) -> None:
    whole = sealed.path.read_bytes()
    path = tmp_path / "s.xden"
    path.write_bytes(whole[: data.draw(st.integers(0, len(whole) - 1))])
    with pytest.raises(DataError, match="not a whole sealed truth"):
        sealed.truth(path)


def said_the_same_or_refused(sealed: Sealed, path: Path) -> None:
    with suppress(DataError):
        truth = sealed.truth(path)
        for object_id, answers in sealed.answers.items():
            assert truth.answers(object_id) == answers


# What is made


def test_nothing_is_overwritten_and_nothing_sealed_twice(sealed: Sealed, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    with pytest.raises(DataError, match="exists: remove it yourself, or choose another"):
        seal(sealed.whole, KEY, tmp_path / "out")
    with pytest.raises(DataError, match="it has a split private already"):
        seal(sealed.public, KEY, tmp_path / "again")


def test_a_seal_that_fails_leaves_nothing(
    sealed: Sealed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(self: SealWriter, row: object) -> None:
        raise DataError("no room")

    monkeypatch.setattr(SealWriter, "add", fails)
    with pytest.raises(DataError, match="no room"):
        seal(sealed.whole, KEY, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
