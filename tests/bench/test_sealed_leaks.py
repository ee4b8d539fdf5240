"""Nothing in a public folder depends on, or holds, an answer of a private object."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.bench.sealing import ANSWERS, KEY, Sealed, sealed_dataset, secrets_of, write_dataset
from xden1k.documents.maintainer import Answers
from xden1k.folder import open_folder
from xden1k.folder.verify import verify_folder
from xden1k.folder.withheld import ANSWER_COLUMNS
from xden1k.format.schema import ARRAY_COLUMNS
from xden1k.values.types import PRIVATE

FIGURES = [
    name
    for name in ANSWER_COLUMNS
    if name not in (*ARRAY_COLUMNS, "meta_json", "part_density_source")
]


def contents(root: Path) -> dict[str, bytes]:
    return {
        path.relative_to(root).as_posix(): path.read_bytes()
        for path in root.rglob("*")
        if path.is_file()
    }


@pytest.mark.slow
def test_other_answers_of_the_private_objects_give_the_same_public_bytes(
    sealed: Sealed, tmp_path: Path
) -> None:
    """The strongest there is: what is published is no function of what is hidden."""
    changed = frozenset(sealed.made.private_ids)
    other = sealed_dataset(write_dataset(tmp_path / "whole", 1, changed), tmp_path / "out")
    for object_id in changed:
        for name in FIGURES:
            assert other.whole.row(object_id, [name]) != sealed.whole.row(object_id, [name])
    ours, theirs = contents(sealed.out / "public"), contents(other.out / "public")
    assert {name for name in ours.keys() | theirs if ours.get(name) != theirs.get(name)} == {
        "commitments.json",
        "SHA256SUMS",  # which lists it
    }
    assert sealed.path.read_bytes() != other.path.read_bytes()


def unpacked(path: Path) -> bytes:
    """Bytes of a file; of a Parquet file, footer as it is, and the values without compression.

    Without the shares and labels, which are megabytes of the shape.
    """
    data = path.read_bytes()
    if path.suffix == ".parquet":
        plain, table = io.BytesIO(), pq.read_table(path)
        shape = {"labels", "occupancy", "envelope"} & set(table.column_names)
        pq.write_table(
            table.drop_columns(list(shape)), plain, compression="none", use_dictionary=False
        )
        data += plain.getvalue()
    return data


def test_no_answer_of_a_private_object_lies_in_any_file(sealed: Sealed) -> None:
    files = [path for path in sealed.out.rglob("*") if path.is_file()]
    haystack = b"".join(map(unpacked, files))
    for object_id in sealed.made.private_ids[::4]:
        row = sealed.whole.row(object_id)
        for name in FIGURES:
            for secret in secrets_of(row[name]):
                assert secret not in haystack, (object_id, name, secret)
        for name in ("density", "apparent_density"):
            assert bytes(row[name]) not in haystack
    # the same search finds the answers that stay
    open_row = sealed.whole.row(sealed.made.test_ids[0])
    for name in FIGURES:
        assert any(secret in haystack for secret in secrets_of(open_row[name])), name
    assert bytes(open_row["density"]) in haystack


def test_no_column_of_a_parquet_file_but_the_id_has_statistics(sealed: Sealed) -> None:
    for path in (sealed.out / "public").rglob("*.parquet"):
        footer = pq.ParquetFile(path).metadata
        for group in range(footer.num_row_groups):
            columns = [footer.row_group(group).column(i) for i in range(footer.num_columns)]
            shown = {c.path_in_schema for c in columns if c.statistics is not None}
            assert shown == {"object_id"}


def test_the_seed_and_the_checksum_that_would_confirm_it_are_gone(sealed: Sealed) -> None:
    folder = sealed.public
    assert folder.manifest.config_sha256 == ""
    for row in folder.rows(columns=["meta_json", "split"]):
        keys = json.loads(row["meta_json"]).keys()
        assert keys == ({"views"} if row["split"] == PRIVATE else {"views", "fit"})


def test_open_objects_keep_everything_else(sealed: Sealed) -> None:
    folder = sealed.public
    for object_id in (*sealed.made.test_ids, *folder.ids("train")):
        row, before = folder.row(object_id), sealed.whole.row(object_id)
        assert {**row, "meta_json": ""} == {**before, "meta_json": ""}


def test_what_the_maintainer_answered_stays_with_the_public_folder(sealed: Sealed) -> None:
    assert Answers.of_folder(sealed.public.root) == ANSWERS
    assert "A lottery." in (sealed.public.root / "DATASHEET.md").read_text(encoding="utf-8")


def test_the_public_folder_is_sound(sealed: Sealed) -> None:
    assert verify_folder(sealed.out / "public") == []


@pytest.mark.slow
def test_the_same_folder_and_key_give_the_same_bytes(sealed: Sealed, tmp_path: Path) -> None:
    again = sealed_dataset(sealed.whole.root, tmp_path / "out", KEY)
    assert contents(again.out) == contents(sealed.out)
    assert again.made == sealed.made


def test_the_files_say_only_what_anyone_may_know(sealed: Sealed) -> None:
    values = json.loads((sealed.out / "public" / "commitments.json").read_text())
    assert values.keys() == {"schema", "split", "key_id", "manifest_sha256", "rule", "objects"}
    assert tuple(values["objects"]) == open_folder(sealed.out / "public").ids(PRIVATE)
    assert KEY.secret.hex() not in json.dumps(values)
    assert KEY.secret not in sealed.path.read_bytes()
