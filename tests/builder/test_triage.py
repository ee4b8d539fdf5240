"""Who needs a person: flags, their order, and what a run says of them."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from xden_builder.commands import run as run_command
from xden_builder.pipeline.run import BuildReport, Outcome
from xden_builder.triage.findings import find
from xden_builder.triage.flags import flag_kinds


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
    assert second == "needs you: b: body:label_doubted, lid:label_doubted (check the label)"
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
