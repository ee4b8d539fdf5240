"""A datasheet asks all that is to be asked, and says nothing that nobody knows."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests import phantoms
from xden1k.access.hub import SAMPLE
from xden1k.documents.answers import answered_by_data, unanswered
from xden1k.documents.datasheet import datasheet_text
from xden1k.documents.maintainer import ANSWERS_NAME, Answers, template_text
from xden1k.documents.questions import QUESTIONS, SECTIONS, number
from xden1k.errors import DataError
from xden1k.folder import write_rows
from xden1k.folder.documents import folder_facts, renew_datasheet
from xden1k.folder.verify import verify_folder
from xden1k.folder.withheld import withhold
from xden1k.format.checksums import CHECKSUMS_NAME, listed_sums
from xden1k.format.manifest import Manifest
from xden1k.format.records import decode_array, object_row

RELEASE = {"version": "1.2.3", "builder": "xden-build phantoms 1"}
ABOUT_PEOPLE = [
    *("composition.subpopulations", "composition.individuals", "composition.sensitive"),
    *("collection.people", "collection.directly", "collection.notified", "collection.consent"),
    *("collection.revocation", "collection.impact", "maintenance.retention"),
]
FUNDED = Answers.parse(b'[motivation]\nfunding = "A lottery."\n', "a file")


@pytest.fixture(scope="module")
def rows() -> list[dict[str, Any]]:
    """A plate that labels lose, and three more objects."""
    thin = phantoms.Box("plate", (-1, -1, 1), (1, 1, 1.001), 1.0, material="glass")
    plated = phantoms.box_object("a-plate", (*phantoms.CUBE, thin), category="plate", split="val")
    return [object_row(obj) for obj in (plated, *phantoms.objects()[:3])]


@pytest.fixture(scope="module")
def written(rows: list[dict[str, Any]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that no test may change."""
    out = tmp_path_factory.mktemp("datasheet") / "folder"
    write_rows(rows, out, **RELEASE)
    return out


@pytest.fixture
def folder(written: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(written, tmp_path / "folder"))


def datasheet(folder: Path) -> str:
    return (folder / "DATASHEET.md").read_text(encoding="utf-8")


def contents(folder: Path) -> dict[str, bytes]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def test_all_57_questions_are_asked_once_and_in_order(written: Path) -> None:
    sizes = [len(questions) for _, questions in SECTIONS.values()]
    assert sizes == [4, 16, 12, 4, 6, 7, 8]  # of the seven sections of Gebru et al.
    asked = re.findall(r"^### (\d\.\d+) (.+)$", datasheet(written), re.MULTILINE)
    assert asked == [(number(key), question) for key, question in QUESTIONS.items()]
    wanted = [f"{i}.{k}" for i, size in enumerate(sizes, start=1) for k in range(1, size + 1)]
    assert [at for at, _ in asked] == wanted


def test_simulated_objects_answer_that_nobody_is_in_them_or_was_paid(written: Path) -> None:
    assert not {*ABOUT_PEOPLE} & {*unanswered(folder_facts(written, Answers()))}
    assert "nobody was paid" in datasheet(written)


def test_what_only_people_know_of_scans_is_listed_as_unanswered(
    rows: list[dict[str, Any]], tmp_path: Path
) -> None:
    scans = [row | {"source": "scan"} for row in rows[:2]] + rows[2:]
    write_rows(scans, tmp_path / "folder", version="1.0.0", builder="me")
    text, _, left = datasheet(tmp_path / "folder").partition("## Unanswered questions\n")
    assert "nobody was paid" not in text
    for key in (*ABOUT_PEOPLE, "motivation.funding", "maintenance.contact"):
        assert f"- {number(key)} `{key}`: {QUESTIONS[key]}" in left
    assert left.count("\n- ") == text.count("*Unanswered.*")


def test_answers_of_the_maintainer_are_kept_with_the_folder_and_follow_the_data(
    rows: list[dict[str, Any]], tmp_path: Path
) -> None:
    said = Answers.parse(
        b'[motivation]\nfunding = "A lottery."\n[uses]\nnot_for = "Nor for fun."', "a file"
    )
    write_rows(rows, tmp_path / "one", **RELEASE, answers=said)
    write_rows(rows, tmp_path / "two", **RELEASE, answers=said)
    assert contents(tmp_path / "one") == contents(tmp_path / "two")
    assert verify_folder(tmp_path / "one") == []
    assert Answers.of_folder(tmp_path / "one") == said
    assert ANSWERS_NAME in listed_sums(tmp_path / "one")
    text = datasheet(tmp_path / "one")
    assert "### 1.3 Who funded the creation, by which grant?\n\nA lottery.\n" in text
    assert "two kettles are not alike inside.\n\nNor for fun.\n" in text
    assert "motivation.funding" not in text


def test_a_datasheet_written_anew_is_the_one_written_at_first(
    rows: list[dict[str, Any]], folder: Path, tmp_path: Path
) -> None:
    before = contents(folder)
    write_rows(rows, tmp_path / "told", **RELEASE, answers=FUNDED)
    renew_datasheet(folder, FUNDED)
    assert contents(folder) == contents(tmp_path / "told")
    assert verify_folder(folder) == []
    renew_datasheet(folder, Answers())
    assert contents(folder) == before


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[motivation]\nfundng = 'x'", "unknown key motivation.fundng; did you mean motivation.fu"),
        ("[motivaton]\nfunding = 'x'", "unknown key motivaton; did you mean motivation"),
        ("funding = 'x'", "unknown key funding; sections are .motivation., .composition."),
        ("[motivation]\nfunding = 3", "motivation.funding must be a text in quotes, got 3"),
        ("[motivation", "not valid TOML"),
        ("\xff", "not valid TOML"),
    ],
)
def test_answers_that_nobody_would_read_are_refused(text: str, message: str) -> None:
    with pytest.raises(DataError, match=f"^captures/datasheet.toml: {message}"):
        Answers.parse(text.encode("latin-1"), "captures/datasheet.toml")


def test_a_file_of_answers_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"mine\.toml: cannot be read: No such file"):
        Answers.read(tmp_path / "mine.toml")


def test_every_key_of_the_template_is_taken(written: Path) -> None:
    answered = answered_by_data(folder_facts(written, Answers()))
    text = template_text(answered)
    assert Answers.parse(text.encode(), "template").by_key == {}
    filled = re.sub(r'^# (\w+) = ""$', r'\1 = "yes"', text, flags=re.MULTILINE)
    assert Answers.parse(filled.encode(), "template").by_key == dict.fromkeys(QUESTIONS, "yes")
    assert list(tomllib.loads(text)) == list(SECTIONS)
    assert text.count("(answered from the data; yours follows)\n") == len(answered) > 30


def loop_over_parts(row: dict[str, Any]) -> list[tuple[int, float]]:
    """Label voxels of each part, and the volume of a closed mesh by the divergence theorem."""
    labels = decode_array(row, "labels")
    corners = decode_array(row, "mesh_vertices").astype(float)[decode_array(row, "mesh_faces")]
    owner = decode_array(row, "face_part")
    found = []
    for part in range(1, len(row["part_names"]) + 1):
        volume = sum(np.linalg.det(face) for face in corners[owner == part]) / 6
        found.append((int((labels == part).sum()), volume))
    return found


def test_parts_that_labels_lose_are_counted_in_manifest_card_and_datasheet(
    rows: list[dict[str, Any]], written: Path
) -> None:
    parts = off = none = 0
    for row in rows:
        for voxels, volume in loop_over_parts(row):
            parts, none = parts + 1, none + (voxels == 0)
            off += abs(voxels * (row["voxel_size_cm"] / 2) ** 3 / volume - 1) > 0.2
    assert (parts, off, none) == (7, 1, 1)
    counts = Manifest.read(written).labels
    assert counts == {
        **{"parts": 7, "voxels_err": 1, "no_voxels": 1},
        **{"no_material": 0, "material_doubted": 0},
    }
    said = "Of 7 parts 1 have label voxels that err by more than a fifth"
    assert said in datasheet(written)
    assert said in (written / "README.md").read_text(encoding="utf-8")


def test_materials_of_a_rebuild_are_said_to_err_on_purpose_and_counted(
    rows: list[dict[str, Any]], tmp_path: Path
) -> None:
    first = {
        "part_density_source": ["xray", "prior"],
        "part_materials": ["", "glass"],
        "part_flags": [[], ["label_doubted"]],
    }
    write_rows([rows[0] | first, *rows[1:]], tmp_path / "folder", **RELEASE)
    said = "be told, 1 have no label, and the radiographs cast doubt on 1 (`label_doubted`)."
    for name in ("README.md", "DATASHEET.md"):
        text = (tmp_path / "folder" / name).read_text(encoding="utf-8")
        assert "which err on purpose" in text
        assert said in text


def test_withheld_materials_do_not_count_as_missing(
    rows: list[dict[str, Any]], tmp_path: Path
) -> None:
    write_rows([withhold(row) for row in rows], tmp_path / "folder", **RELEASE)
    counts = Manifest.read(tmp_path / "folder").labels
    assert (counts["no_material"], counts["voxels_err"]) == (0, 1)
    said = "Of 0 parts whose material may be told, 0 have no label"
    assert said in datasheet(tmp_path / "folder")


def without_counts(folder: Path) -> None:
    """Make the manifest one of an older folder."""
    values = json.loads((folder / "manifest.json").read_text())
    del values["labels"]
    (folder / "manifest.json").write_text(json.dumps(values))


def test_an_older_folder_without_counts_says_so(folder: Path) -> None:
    without_counts(folder)
    sums = (folder / CHECKSUMS_NAME).read_text().splitlines()
    kept = [line for line in sums if "manifest.json" not in line]
    (folder / CHECKSUMS_NAME).write_text("\n".join([*kept, ""]))
    renew_datasheet(folder, Answers())
    assert "How many parts that is was not counted in this folder." in datasheet(folder)


def test_a_folder_without_checksums_is_not_touched(folder: Path) -> None:
    (folder / CHECKSUMS_NAME).unlink()
    before = contents(folder)
    with pytest.raises(DataError, match="no SHA256SUMS: not a whole dataset folder"):
        renew_datasheet(folder, FUNDED)
    assert contents(folder) == before


def test_metadata_that_are_damaged_are_named(folder: Path) -> None:
    path = folder / "metadata/test.parquet"
    content = bytearray(path.read_bytes())
    content[4:1000] = bytes(996)
    path.write_bytes(content)
    with pytest.raises(DataError, match=r"metadata/test\.parquet: cannot be read as Parquet: "):
        renew_datasheet(folder, FUNDED)


def test_the_packaged_sample_can_be_described() -> None:
    facts = folder_facts(SAMPLE, Answers())
    assert f"- {facts.manifest.objects} objects, " in datasheet_text(facts)
