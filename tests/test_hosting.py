"""The files for a code host, which no host has run yet, say what the project does."""

from __future__ import annotations

import dataclasses
import importlib.util
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest
import yaml

import xden1k.cli
import xden_bench.cli
import xden_builder.cli
from xden_bench.serve.limits import Limits

ROOT: Final = Path(__file__).parents[1]
GITHUB: Final = ROOT / ".github"
if not GITHUB.is_dir():
    pytest.skip(
        "not in a source archive: these files are the repository's", allow_module_level=True
    )

WORKFLOWS: Final = sorted((GITHUB / "workflows").iterdir())
FORMS: Final = sorted(
    set((GITHUB / "ISSUE_TEMPLATE").iterdir()) - {GITHUB / "ISSUE_TEMPLATE/config.yml"}
)
PAGES: Final = (ROOT / "SECURITY.md", ROOT / "docs" / "releasing.md")
COMMANDS: Final = {
    "xden": xden1k.cli.cli.commands,
    "xden-bench": xden_bench.cli.cli.commands,
    "xden-build": xden_builder.cli.cli.commands,
}
MADE_AT_WORK: Final = {"preds.npz", "audit.jsonl"}
PINNED: Final = re.compile(r"uses: ([\w./-]+)@([0-9a-f]{40}) # v\d+\.\d+\.\d+$", re.MULTILINE)


def named(path: Path) -> str:
    return path.name


def read(path: Path) -> dict[Any, Any]:
    return yaml.safe_load(path.read_text())


def jobs(path: Path) -> dict[str, dict[str, Any]]:
    return read(path)["jobs"]


def steps(path: Path) -> Iterator[dict[str, Any]]:
    for job in jobs(path).values():
        yield from job.get("steps", ())


def runs(path: Path) -> list[str]:
    return [step["run"] for step in steps(path) if "run" in step]


def pythons(job: dict[str, Any]) -> list[str]:
    return job["strategy"]["matrix"]["python"]


def test_the_workflows_are_there() -> None:
    assert {"ci.yml", "release.yml", "weekly.yml"} <= {path.name for path in WORKFLOWS}


def test_changes_meet_the_script_on_every_python_that_is_supported() -> None:
    (job,) = jobs(GITHUB / "workflows" / "ci.yml").values()
    assert ".ci/run" in runs(GITHUB / "workflows" / "ci.yml")
    assert (ROOT / ".ci" / "run").stat().st_mode & 0o100
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    supported = re.findall(r"Python :: (3\.\d+)$", "\n".join(project["classifiers"]), re.MULTILINE)
    assert pythons(job) == supported
    assert project["requires-python"] == f">={supported[0]}"


def test_once_a_week_the_slow_tests_run_on_the_oldest_and_newest_python() -> None:
    weekly = GITHUB / "workflows" / "weekly.yml"
    (job,) = jobs(weekly).values()
    (check,) = jobs(GITHUB / "workflows" / "ci.yml").values()
    assert "make test-all" in runs(weekly)
    assert pythons(job) == [pythons(check)[0], pythons(check)[-1]]
    assert list(read(weekly)[True]) == [
        "schedule",
        "workflow_dispatch",
    ]  # YAML 1.1 reads on as True


def test_a_release_is_built_once_and_published_after_all_else() -> None:
    release = GITHUB / "workflows" / "release.yml"
    assert read(release)[True] == {"push": {"tags": ["v*"]}}
    todo, before = ["publish"], set()
    while todo:
        needs = jobs(release)[todo.pop()].get("needs", [])
        new = {needs} if isinstance(needs, str) else set(needs)
        before |= new
        todo += new
    assert before == jobs(release).keys() - {"publish"}
    assert sum("hatchling build" in run for run in runs(release)) == 1
    assert any("check_tag.py" in run for run in runs(release))


def test_only_the_release_says_who_it_is_and_nobody_writes_to_the_repository() -> None:
    allowed = {"release.yml": {"attestations", "id-token"}}
    for path in WORKFLOWS:
        said = [
            read(path)["permissions"],
            *(job.get("permissions", {}) for job in jobs(path).values()),
        ]
        writes = {scope for one in said for scope, how in one.items() if how != "read"}
        assert writes == allowed.get(path.name, set()), path.name


@pytest.mark.parametrize("path", WORKFLOWS, ids=named)
def test_actions_are_pinned_and_jobs_bounded(path: Path) -> None:
    text = path.read_text()
    for step in steps(path):
        if "uses" in step:
            assert step["uses"] in {f"{name}@{commit}" for name, commit in PINNED.findall(text)}
        if step.get("uses", "").startswith("actions/checkout@"):
            assert step["with"]["persist-credentials"] is False
    for job in jobs(path).values():
        if local := job.get("uses"):
            assert (ROOT / local).is_file()
        else:
            assert 0 < job["timeout-minutes"] <= 300
    assert read(path)["concurrency"]["group"]


def test_an_action_is_pinned_to_one_commit_everywhere() -> None:
    pins = {pin for path in WORKFLOWS for pin in PINNED.findall(path.read_text())}
    assert len(pins) == len({name for name, _ in pins})


@pytest.mark.parametrize("path", FORMS, ids=named)
def test_an_issue_form_is_one(path: Path) -> None:
    form = read(path)
    assert form.keys() == {"name", "description", "title", "labels", "body"}
    fields = [one for one in form["body"] if one["type"] != "markdown"]
    assert fields
    ids = [one["id"] for one in fields]
    assert len(ids) == len(set(ids))
    assert all(re.fullmatch(r"[a-z-]+", one) for one in ids)
    labels = [one["attributes"]["label"] for one in fields]
    assert len(labels) == len(set(labels))
    for one in form["body"]:
        check_element(one)


def check_element(element: dict[str, Any]) -> None:
    """Compare one element of a form with the host's documented rules."""
    kind, attributes = element["type"], element["attributes"]
    optional = {
        "markdown": {"value"},
        "input": {"description", "placeholder"},
        "textarea": {"description", "placeholder", "render"},
        "dropdown": {"description", "options"},
        "checkboxes": {"description", "options"},
    }[kind]
    needed = {"value"} if kind == "markdown" else {"label"}
    assert needed <= attributes.keys() <= needed | optional
    texts = [value for name, value in attributes.items() if name != "options"]
    options = attributes.get("options", ["-"])
    if kind == "checkboxes":
        assert all(one.keys() == {"label", "required"} for one in options)
        options = [one["label"] for one in options]
    else:
        assert element.get("validations", {"required": True}) == {"required": True}
    assert options
    assert len(options) == len(set(options))
    assert all(isinstance(one, str) and one for one in (*texts, *options))  # a bare yes is True
    assert "None" not in options


def test_the_form_for_an_entry_knows_the_tracks() -> None:
    fields = read(GITHUB / "ISSUE_TEMPLATE" / "leaderboard-entry.yml")["body"]
    (track,) = [one["attributes"]["options"] for one in fields if one.get("id") == "track"]
    (option,) = [one for one in COMMANDS["xden-bench"]["template"].params if one.name == "track"]
    assert sorted(track) == sorted(option.type.choices)


def test_forms_lead_somewhere_else_than_the_host_that_is_not_known() -> None:
    config = read(GITHUB / "ISSUE_TEMPLATE" / "config.yml")
    manual = (ROOT / "README.md").read_text()
    for link in config["contact_links"]:
        assert link.keys() == {"name", "url", "about"}
        assert link["url"] in manual


def test_every_path_that_has_owners_is_there() -> None:
    lines = (GITHUB / "CODEOWNERS").read_text().splitlines()
    paths = [line.lstrip("#").split()[0] for line in lines if line.lstrip("#").startswith("/")]
    assert "/benchmarks/results/" in paths
    assert [path for path in paths if not list(ROOT.glob(path.strip("/")))] == []


def test_the_page_says_that_nobody_owns_anything_yet() -> None:
    in_force = [line for line in (GITHUB / "CODEOWNERS").read_text().splitlines() if line[0] != "#"]
    says = "every path is a comment" in (ROOT / "docs" / "releasing.md").read_text()
    assert says == (not in_force)


@pytest.mark.parametrize(
    "path", [*PAGES, GITHUB / "workflows" / "release.yml", ROOT / "CONTRIBUTING.md"], ids=named
)
def test_commands_that_are_named_are_there(path: Path) -> None:
    text = path.read_text()
    for program, command in re.findall(
        r"(?<![\w./-])(xden(?:-bench|-build)?) ([a-z]\S*[a-z])", text
    ):
        assert command in COMMANDS[program], f"{program} {command}"
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    assert set(re.findall(r"`make (?:-j\d )?([a-z-]+)", text)) <= targets


@pytest.mark.parametrize("path", [*PAGES, ROOT / "CONTRIBUTING.md"], ids=named)
def test_files_that_are_named_are_there(path: Path) -> None:
    text = path.read_text()
    spans = set(re.findall(r"`([\w.-]+/[\w./-]+|[\w-]+\.[a-z]{2,5})`", text)) - MADE_AT_WORK
    around = (ROOT, GITHUB / "workflows")
    assert [one for one in spans if not any((place / one).exists() for place in around)] == []
    for link in re.findall(r"\]\(([^)]+)\)", text):
        file, _, _ = link.partition("#")  # headings are compared in tests/docs
        assert link.startswith("https://") or (path.parent / file).exists(), link


def test_the_limits_of_the_desk_are_as_told() -> None:
    rows = re.findall(r"^\| `(\w+)` \| (\d+) \|", (ROOT / "SECURITY.md").read_text(), re.MULTILINE)
    assert {name: int(value) for name, value in rows} == dataclasses.asdict(Limits())


def test_contributing_is_short() -> None:
    assert len((ROOT / "CONTRIBUTING.md").read_text().split()) < 200


def problems(tag: str, root: Path) -> list[str]:
    spec = importlib.util.spec_from_file_location("check_tag", GITHUB / "check_tag.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return list(module.problems(tag, root))


def checkout(root: Path, *, version: str, cited: str, heading: str) -> Path:
    (root / "pyproject.toml").write_text(f'[project]\nversion = "{version}"\n')
    (root / "CITATION.cff").write_text(f"cff-version: 1.2.0\nversion: {cited}\n")
    (root / "CHANGELOG.md").write_text(f"# Changelog\n\n## {heading}\n\n- Something.\n")
    return root


def test_a_tag_that_all_agree_on_is_released(tmp_path: Path) -> None:
    root = checkout(tmp_path, version="0.2.0", cited="0.2.0", heading="0.2.0 (2026-01-31)")
    assert problems("v0.2.0", root) == []


def test_a_tag_is_told_everything_that_contradicts_it(tmp_path: Path) -> None:
    root = checkout(tmp_path, version="0.2.0", cited="0.1.0", heading="0.2.0 (unreleased)")
    assert problems("v0.2", root) == [
        "pyproject.toml: version 0.2.0 is released by the tag v0.2.0, got v0.2",
        "CITATION.cff: version must be 0.2.0, got 0.1.0",
        "CHANGELOG.md: no heading '## 0.2.0 (YYYY-MM-DD)' with the day of the release",
    ]
