"""Who needs a person: flags, their order, and what a run says of them."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from click.testing import CliRunner

from xden1k.access.hub import SAMPLE
from xden1k.errors import DataError
from xden1k.folder import open_folder, write_folder
from xden_builder.cli import cli
from xden_builder.commands import run as run_command
from xden_builder.pipeline.run import BuildReport, Outcome
from xden_builder.poly.hardness import Hardness
from xden_builder.triage import report as triage_report
from xden_builder.triage.card import Card, make_card
from xden_builder.triage.findings import find
from xden_builder.triage.flags import flag_kinds
from xden_builder.triage.page import is_report, render
from xden_builder.triage.pictures import draw


def row(object_id: str = "mug-1", *flags: str, parts: dict[str, list[str]] | None = None) -> Any:
    """A row of the dataset, as far as findings are made of it."""
    parts = parts or {"body": []}
    return {
        "object_id": object_id,
        "category": "mug",
        "flags": list(flags),
        "mass_g": 225.0,
        "weighed_mass_g": None,
        "part_names": list(parts),
        "part_flags": list(parts.values()),
        "meta_json": json.dumps({"uncertainty": {"mass_sd_g": 4.5}}),
    }


def outcome(*args: Any, **parts: list[str]) -> Outcome:
    return Outcome(args[0], "built", findings=find(row(*args, parts=parts)))


def test_grave_flags_stand_before_the_others_so_that_the_first_remark_is_the_gravest() -> None:
    severities = [kind.severity for kind in flag_kinds().values()]
    assert severities == sorted(severities, key=("needs_you", "information").index)


def test_every_flag_says_in_one_sentence_what_it_means_and_what_to_do() -> None:
    for kind in flag_kinds().values():
        for text in (kind.meaning, kind.remedy):
            assert text, kind
            assert not text.endswith("."), kind
            assert not text.strip("`")[0].isupper() or text.startswith("LAC"), kind


def test_flags_of_parts_named_like_flags_and_with_colons_stay_with_their_parts() -> None:
    found = find(row("mug-1", "pa:saturated", parts={"pa:hidden": ["starved"], "b": ["hidden"]}))
    assert {str(remark) for remark in found.remarks} == {
        *("pa:saturated", "pa:hidden:starved", "b:hidden")
    }
    assert {remark.of for remark in found.remarks} == {"pa", "pa:hidden", "b"}


@pytest.mark.parametrize(
    ("flags", "severity"),
    [((), None), (("pa:saturated",), "information"), (("lat:not_seen",), "needs_you")],
)
def test_an_object_is_as_grave_as_its_gravest_flag(flags: tuple[str, ...], severity: str) -> None:
    assert find(row("mug-1", *flags)).severity == severity


def test_a_flag_of_another_version_needs_a_person_and_comes_first() -> None:
    found = find(row("mug-1", "pa:not_seen", "haunted"))
    assert str(found.needs_you[0]) == "haunted"


def test_the_worst_object_comes_first_and_what_failed_needs_a_person() -> None:
    report = BuildReport(
        (
            outcome("a", body=["uncertain"]),
            outcome("b", body=["label_doubted"]),
            outcome("c", "pa:does_not_fit"),
            outcome("d", "pa:does_not_fit", "lat:does_not_fit"),
            outcome("e"),
            Outcome("f", "failed", "no image"),
        )
    )
    assert [found.object_id for found in report.judged] == ["d", "c", "b", "a", "e"]
    assert report.to_dict()["needs_you"] == 4


def test_masses_that_are_not_known_are_null_in_the_report() -> None:
    of_no_density = row() | {"mass_g": math.nan, "meta_json": "{}"}
    report = BuildReport((Outcome("mug-1", "built", findings=find(of_no_density)),))
    (told,) = report.to_dict()["objects"]
    assert (told["mass_g"], told["mass_sd_g"]) == (None, None)
    json.dumps(told, allow_nan=False)


def test_the_summary_names_grave_flags_with_one_remedy_each_and_counts_the_rest(
    capsys: pytest.CaptureFixture[str], tmp_path: Any
) -> None:
    report = BuildReport(
        (
            outcome("a", body=["uncertain"]),
            outcome("b", body=["label_doubted"], lid=["label_doubted", "starved"]),
            outcome("c", "lat:not_seen"),
        )
    )
    run_command._echo_report(report, tmp_path / "out")
    first, second, third, _ = capsys.readouterr().out.splitlines()
    assert first.startswith("needs you: c: lat:not_seen (check `mesh_units`")
    assert second == (
        "needs you: b: body:label_doubted, lid:label_doubted (check the label, and all "
        "others of the object if several are doubted: they may be another object's; if it is "
        "right, check that its mesh lies where the part does, is as thick, is hollow where it is, "
        "and is not another part's; where it is dark in the image, that dark image and bits are as "
        "told)"
    )
    assert third == "for information: 1 of 3 objects have other flags"


class Bar:
    """Stands for tqdm's."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def set_postfix_str(self, text: str, refresh: bool) -> None:
        self.told.append(text)

    def update(self) -> None:
        pass

    def write(self, *_: Any, **__: Any) -> None:
        pass


def test_progress_says_how_many_need_a_person_so_far() -> None:
    bar = Bar()
    progress = run_command._Progress(bar)
    for one in (outcome("a"), outcome("b", "pa:not_seen"), Outcome("c", "failed", "no image")):
        progress.add(one)
    assert bar.told == ["1 need you", "2 need you"]


SHADOW_BOX = [10, 20, 29, 39]
HOSTILE = "<script>alert('x')</script>\" onload=\"alert(1)"


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two objects of the sample: a sound one, and one with a hostile name, note and a shadow."""
    sample = open_folder(SAMPLE).objects()
    thin, other = next(sample), next(sample)
    sound = replace(thin, parts=tuple(replace(part, flags=()) for part in thin.parts))
    box = {"content_box": None, "content_g": 0.0, "content_share": 0.0}
    box |= {"shadow_box": SHADOW_BOX, "shadow_g": 3.0, "shadow_share": 0.2}
    faulty = replace(
        other,
        category=f"={HOSTILE}",
        flags=("pa:unexplained_shadow",),
        parts=(replace(other.parts[0], name=HOSTILE, flags=("starved",)), *other.parts[1:]),
        weighed_mass_g=2 * other.mass_g,
        meta={
            "notes": HOSTILE,
            "reprojection": {
                "pa": {"transmission_corr": 0.98, "transmission_mae": 0.01, "unexplained": box}
            },
        },
    )
    out = tmp_path_factory.mktemp("triage") / "dataset"
    write_folder([sound, faulty], out, version="0.1.0", builder="tests")
    return out


@pytest.fixture(scope="module")
def report(dataset: Path, in_this_process: None) -> Path:
    """The report of it, beside it."""
    work = dataset.with_name("dataset.work")
    work.mkdir()
    ended = (Outcome("mug-9", "failed", f"{HOSTILE}: no TIFF"),)
    last_run = BuildReport(ended, Hardness(0.1, 0.01, 40, 20, None, 1.0, 1.0))
    (work / "build_report.json").write_text(json.dumps(last_run.to_dict()))
    ran = CliRunner().invoke(cli, ["report", str(dataset), "--json"])
    assert ran.exit_code == 0, ran.output
    told = json.loads(ran.stdout)
    assert (told["objects"], told["needs_you"], told["not_shown"]) == (2, 1, [])
    return Path(told["page"]).parent


class Page(HTMLParser):
    """Everything that a browser would act on."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


def test_the_page_asks_nobody_for_anything_and_runs_nothing_of_the_data(report: Path) -> None:
    text = (report / "index.html").read_text()
    page = Page(text)
    assert len(page.all("script")) == len(page.all("style")) == 1
    assert not any(name.startswith("on") for _, attributes in page.tags for name in attributes)
    for _, attributes in page.tags:
        for source in (attributes.get("src"), attributes.get("href")):
            assert (
                source is None
                or source.startswith(("data:image/webp", "#"))
                or (source == "objects.csv")
            )
    assert "http" not in re.sub(r"http-equiv|data:image[^\"]+", "", text)
    (policy,) = [each["content"] for each in page.all("meta") if "http-equiv" in each]
    assert policy is not None
    assert policy.startswith("default-src 'none'; img-src data:;")
    for tag in ("style", "script"):
        (body,) = re.findall(rf"<{tag}>(.*?)</{tag}>", text, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(body.encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{digest}'" in policy


def test_the_worst_object_is_first_open_and_framed_where_the_shadow_is(report: Path) -> None:
    page = Page((report / "index.html").read_text())
    worst, sound = (each for each in page.all("details") if each["class"] == "object")
    assert worst["data-severity"] == "needs_you"
    assert worst["data-flags"] == "unexplained_shadow starved"
    assert sound["data-flags"] == ""
    assert len(page.all("img")) == 2 * 2 * 3
    frames = page.all("rect")
    assert [frame["class"] for frame in frames] == ["shadow"] * 3


def test_what_could_not_be_built_stands_on_the_page(report: Path) -> None:
    text = (report / "index.html").read_text()
    assert "mug-9" in text
    assert "&lt;script&gt;alert(&#39;x&#39;)" in text


def test_objects_that_the_last_run_could_not_build_are_said_to_be_of_an_earlier_one(
    dataset: Path, report: Path, tmp_path: Path, in_this_process: None
) -> None:
    path = dataset.with_name("dataset.work") / "build_report.json"
    before = path.read_bytes()
    ended = [Outcome(each, "failed", "no tube") for each in open_folder(dataset).ids()]
    path.write_text(json.dumps(BuildReport(tuple(ended)).to_dict()))
    ran = CliRunner().invoke(cli, ["report", str(dataset), "-o", str(tmp_path / "out")])
    path.write_bytes(before)
    assert ran.exit_code == 0, ran.output
    text = (tmp_path / "out" / "index.html").read_text()
    assert f"objects need you; {len(ended)} failed in the last run" in ran.output
    assert f"could not build {len(ended)} of the objects below" in text
    assert "Not shown" not in text


def test_what_all_objects_show_stands_on_the_page(report: Path) -> None:
    page = (report / "index.html").read_text()
    assert "The whole folder" in page
    assert "the told filter does not explain these images: 0.10 ± 0.01 mm Cu more would" in page


def test_the_table_has_the_figures_and_no_formula(report: Path) -> None:
    table = pd.read_csv(report / "objects.csv")
    assert list(table["severity"].fillna("")) == ["needs_you", ""]
    assert table["category"][0] == f"'={HOSTILE}"
    assert table["pa_shadow_share"][0] == 0.2
    assert table["weighed_mass_g"][0] == pytest.approx(2 * table["mass_g"][0])


def test_a_weighed_object_is_on_the_chart_at_the_ratio_of_its_masses(report: Path) -> None:
    (circle,) = Page((report / "index.html").read_text()).all("circle")
    assert circle["class"] == "needs_you"
    assert float(circle["cy"] or 0) == pytest.approx(186, abs=1)  # a half: at the lower edge


def test_parts_without_density_show_their_attenuation(dataset: Path, tmp_path: Path) -> None:
    card = make_card(dataset, open_folder(dataset).ids()[0])
    unknown = {"density_g_cm3": math.nan, "density_sd_g_cm3": math.nan, "lac_per_cm": 0.321}
    parts = tuple(replace(part, **unknown) for part in card.parts)
    render([replace(card, parts=parts)], [], [], "dataset", tmp_path / "index.html")
    text = (tmp_path / "index.html").read_text()
    assert text.count(">0.321<") == len(parts)
    assert "density, g/cm³" not in text


def test_a_frame_encloses_the_box_and_the_picture_reaches_as_far(dataset: Path) -> None:
    obj = next(open_folder(dataset).objects())
    view = obj.views[0]
    rows, columns = view.transmission.shape
    corner = draw(obj, view, {"shadow_box": [0, 0, 1, 1]})
    (frame,) = corner.frames
    assert (frame.left, frame.top) == (0, 0)
    assert 0 < frame.width < 0.2
    middle = draw(obj, view, {"content_box": [rows // 2, columns // 2, rows // 2, columns // 2]})
    (frame,) = middle.frames
    assert frame.left < 0.5 < frame.left + frame.width or frame.width < 0.1
    assert draw(obj, view, {"content_box": None}).frames == ()


def test_another_folder_is_not_replaced_by_a_report_and_an_older_report_is(
    dataset: Path, report: Path, tmp_path: Path, in_this_process: None
) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    ran = CliRunner().invoke(cli, ["report", str(dataset), "-o", str(tmp_path)])
    assert ran.exit_code == 1
    assert f"{tmp_path} is not a report" in ran.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]
    (tmp_path / "thesis.txt").unlink()
    for name, text in (("objects.csv", "object_id,category\n"), ("index.html", "<p>mine</p>")):
        (tmp_path / name).write_text(text)  # a lab's own table, then with a page of its own
        ran = CliRunner().invoke(cli, ["report", str(dataset), "-o", str(tmp_path)])
        assert f"{tmp_path} is not a report" in ran.stderr
        assert (tmp_path / name).read_text() == text
    before = (report / "index.html").read_bytes()
    assert CliRunner().invoke(cli, ["report", str(dataset)]).exit_code == 0
    assert (report / "index.html").read_bytes() == before


def test_a_report_of_an_earlier_version_is_known_for_one(tmp_path: Path) -> None:
    page = tmp_path / "index.html"
    for title, ours in (("mugs: what needs you", True), ("what needs you", False)):
        page.write_text(f'<!doctype html>\n<meta charset="utf-8">\n<title>{title}</title>')
        assert is_report(page) == ours


@pytest.mark.parametrize(
    "content",
    [
        b"[]",
        pytest.param(b"[" * 100_000, id="nested"),
        b'{"objects": [{"obj',
        b"\xff\xfe\x00",
        b'{"schema": "xden-build-report/1", "objects": [], "remarks": []}',
        b'{"schema": "xden-build-report/3", "objects": [{"id": "a"}], "remarks": []}',
        b'{"schema": "xden-build-report/3", "objects": [], "remarks": ["text"]}',
        b'{"schema": "xden-build-report/3", "objects": [],'
        b' "remarks": [{"severity": "odd", "text": ""}]}',
    ],
)
def test_a_damaged_file_of_the_last_run_is_one_line_and_the_page_is_made(
    dataset: Path, report: Path, tmp_path: Path, content: bytes, in_this_process: None
) -> None:
    path = dataset.with_name("dataset.work") / "build_report.json"
    before = path.read_bytes()
    path.write_bytes(content)
    ran = CliRunner().invoke(cli, ["report", str(dataset), "-o", str(tmp_path / "out")])
    path.write_bytes(before)
    assert ran.exit_code == 0, ran.output
    assert f"{path}: expected xden-build-report/3, got something else" in ran.stderr
    assert (tmp_path / "out" / "index.html").is_file()


def test_a_damaged_object_is_listed_and_the_others_are_shown(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_this_process: None
) -> None:
    bad, _ = open_folder(dataset).ids()

    def make(root: Path, object_id: str) -> Card:
        if object_id == bad:
            raise DataError("its row is damaged")
        return make_card(root, object_id)

    monkeypatch.setattr(triage_report, "make_card", make)
    ran = CliRunner().invoke(cli, ["report", str(dataset), "-o", str(tmp_path / "out")])
    assert ran.exit_code == 3
    assert "of 1 objects need you; 1 could not be drawn" in ran.stdout
    assert f"failed: {bad}: its row is damaged" in ran.stderr
    assert "its row is damaged" in (tmp_path / "out" / "index.html").read_text()
