"""A folder comes to the Hub whole, under a tag that never moves; the client is the real one."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from tests.hub_server import Commit, Fault, HubServer
from tests.phantoms import objects
from xden1k.access.hub import REPO_ID
from xden1k.folder import open_folder, verify, write_folder, write_rows
from xden1k.folder.verify import verify_folder
from xden1k.format.checksums import CHECKSUMS_NAME, file_sha256, listed_sums
from xden1k.format.manifest import Manifest
from xden1k.format.records import object_row
from xden_builder.cli import cli
from xden_builder.pipeline.publish import parcel, push, repository

pytestmark = pytest.mark.filterwarnings("ignore:Use 'content=:DeprecationWarning")  # the client's
ROOT = Path(__file__).parents[2]
REPO = "owner/name"
TAG = "v1.2.0"


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("push") / "root"
    write_folder(objects()[:3], root, version="1.2.0", builder="test", shard_bytes=1)
    return root


@pytest.fixture
def root(written: Path, tmp_path: Path) -> Path:
    """A folder of three objects, in as many shards."""
    return Path(shutil.copytree(written, tmp_path / "root"))


@pytest.fixture
def later(tmp_path: Path) -> Path:
    """The next version, of two objects."""
    write_folder(objects()[:2], tmp_path / "later", version="1.3.0", builder="test", shard_bytes=1)
    return tmp_path / "later"


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the comparison of labels with meshes to the tests of verification."""
    monkeypatch.setattr(verify, "CAN_LABEL", False)


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli, ["push", *map(str, arguments)], catch_exceptions=False)


def refusal(result: Result) -> str:
    """Return the one line of a push that was refused."""
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    return line.removeprefix("Error: ")


def unpacked(hub: HubServer, out: Path, revision: str, repo_id: str = REPO) -> Path:
    """Write what a revision holds into a folder, without the Hub's own file."""
    for path, content in hub.repos[repo_id].tree(revision).items():
        if path != ".gitattributes":
            (out / path).parent.mkdir(parents=True, exist_ok=True)
            (out / path).write_bytes(content)
    return out


def test_a_push_is_one_commit_under_a_tag_and_verifies(
    hub: HubServer, root: Path, tmp_path: Path
) -> None:
    result = run(root, "--repo-id", REPO, "--json")
    assert (result.exit_code, result.stderr) == (0, "")
    pushed = json.loads(result.stdout)
    repo = hub.repos[REPO]
    assert repo.tags == {TAG: pushed["commit"]} == {TAG: repo.branches["main"]}
    assert len(repo.commits) == 2  # the first one is the Hub's
    assert pushed["url"] == f"{hub.url}/datasets/{REPO}/tree/{TAG}"
    assert sorted(pushed["uploaded"]) == sorted([*listed_sums(root), CHECKSUMS_NAME])
    there = unpacked(hub, tmp_path / "there", TAG)
    assert verify_folder(there) == []
    assert sum(pushed["uploaded"].values()) == sum(
        path.stat().st_size for path in there.rglob("*") if path.is_file()
    )
    same = {name for name in listed_sums(root) if name != "croissant.json"}
    assert {n: file_sha256(there / n) for n in same} == {n: file_sha256(root / n) for n in same}


def test_the_croissant_document_that_is_pushed_names_the_tag_and_the_day(
    hub: HubServer, root: Path
) -> None:
    push(root, REPO)
    croissant = json.loads(hub.repos[REPO].tree(TAG)["croissant.json"])
    urls = [each["contentUrl"] for each in croissant["distribution"] if "contentUrl" in each]
    where = f"{hub.url}/datasets/{REPO}/resolve/{TAG}/"
    assert urls == [where + file.path for file in Manifest.read(root).files]
    assert len(croissant["datePublished"]) == len("2025-12-31")


def test_the_same_folder_twice_is_no_new_commit_and_uploads_nothing(
    hub: HubServer, root: Path
) -> None:
    first = push(root, REPO)
    lines = len(hub.log)
    again = run(root, "--repo-id", REPO)
    assert again.exit_code == 0
    assert "nothing was pushed" in again.stderr
    assert [line for line in hub.log[lines:] if line.method in ("PUT", "POST")] == []
    assert push(root, REPO).commit == first.commit
    assert len(hub.repos[REPO].commits) == 2


def test_a_date_that_is_there_stays_until_the_next_version(
    hub: HubServer, root: Path, later: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = parcel.Parcel.of

    def long_ago(root: Path, facts: Facts, base_url: str, date: str) -> parcel.Parcel:
        return whole(root, facts, base_url, "2020-02-02")

    with monkeypatch.context() as patch:
        patch.setattr(parcel.Parcel, "of", long_ago)
        push(root, REPO)
    push(root, REPO)
    assert len(hub.repos[REPO].commits) == 2
    assert date_published(hub, TAG) == "2020-02-02"
    push(later, REPO)
    assert date_published(hub, "v1.3.0") > "2020-02-02"
    assert date_published(hub, TAG) == "2020-02-02"


def date_published(hub: HubServer, revision: str) -> str:
    return str(json.loads(hub.repos[REPO].tree(revision)["croissant.json"])["datePublished"])


def test_the_next_version_deletes_stale_shards_in_its_commit_and_leaves_the_old_tag(
    hub: HubServer, root: Path, later: Path, tmp_path: Path
) -> None:
    push(root, REPO)
    told = push(later, REPO, dry_run=True)
    pushed = push(later, REPO)
    assert told.deleted == pushed.deleted != ()
    assert told.uploaded == pushed.uploaded
    repo = hub.repos[REPO]
    assert sorted(repo.tags) == [TAG, "v1.3.0"]
    assert len(repo.commits) == 3
    assert verify_folder(unpacked(hub, tmp_path / "old", TAG)) == []
    assert verify_folder(unpacked(hub, tmp_path / "new", "v1.3.0")) == []
    assert open_folder(tmp_path / "new").ids() == open_folder(later).ids()
    assert push(root, REPO).commit == repo.tags[TAG]  # the old one is there, whatever main holds


def test_a_file_that_did_not_change_is_not_uploaded_again(
    hub: HubServer, root: Path, later: Path
) -> None:
    push(root, REPO)
    uploads = hub.count("^PUT")
    pushed = push(later, REPO)
    assert pushed.unchanged > 0
    assert 0 < hub.count("^PUT") - uploads < len(Manifest.read(later).files)


def test_a_tag_with_other_content_is_refused_and_stays(
    hub: HubServer, root: Path, tmp_path: Path
) -> None:
    commit = push(root, REPO).commit
    write_folder(objects()[:1], tmp_path / "other", version="1.2.0", builder="test")
    line = refusal(run(tmp_path / "other", "--repo-id", REPO))
    assert f"{REPO} has the tag {TAG} with other content" in line
    for folder in (root, tmp_path / "other"):
        assert file_sha256(folder / "manifest.json") in line
    assert hub.repos[REPO].tags == {TAG: commit}
    assert len(hub.repos[REPO].commits) == 2


def test_a_document_alone_that_changed_is_other_content_too(hub: HubServer, root: Path) -> None:
    push(root, REPO)
    card = root / "README.md"
    card.write_text(card.read_text() + "\nMore.\n")
    sums = listed_sums(root) | {"README.md": file_sha256(card)}
    (root / CHECKSUMS_NAME).write_text("".join(f"{sums[n]}  {n}\n" for n in sorted(sums)))
    assert f"sha256 of its README.md is {listed_sums(root)['README.md']}" not in (
        line := refusal(run(root, "--repo-id", REPO))
    )
    assert f"of this folder's {file_sha256(card)}" in line


def test_a_tag_that_is_missing_is_set_by_the_next_push(hub: HubServer, root: Path) -> None:
    hub.faults = [Fault("POST .*/tag/", cut_after=0, times=1)]
    assert "run again" in refusal(run(root, "--repo-id", REPO))
    assert hub.repos[REPO].tags == {}
    commit = hub.repos[REPO].branches["main"]
    assert push(root, REPO).commit == commit
    assert hub.repos[REPO].tags == {TAG: commit}


@pytest.mark.parametrize("same", [True, False])
def test_a_tag_that_a_faster_push_has_set_is_compared(
    hub: HubServer, root: Path, same: bool
) -> None:
    def other_push() -> None:
        repo = hub.repos[REPO]
        repo.tags[TAG] = repo.branches["main"] if same else next(iter(repo.commits))

    hub.faults = [Fault("POST .*/tag/", then=other_push)]
    if same:
        assert push(root, REPO).commit == hub.repos[REPO].tags[TAG]
    else:
        line = refusal(run(root, "--repo-id", REPO))
        assert "with other content: sha256 of its manifest.json is none" in line


def test_a_cut_upload_is_taken_up_where_it_ended(hub: HubServer, root: Path) -> None:
    hub.faults = [Fault("^PUT .*", cut_after=100, times=10**6)]
    assert "run again: what was uploaded is kept" in refusal(run(root, "--repo-id", REPO))
    assert hub.repos[REPO].tags == {}
    assert len(hub.repos[REPO].commits) == 1
    largest = max(root.glob("data/*.parquet"), key=lambda path: path.stat().st_size)
    hub.faults = [Fault(f"^PUT .*{file_sha256(largest)}", cut_after=100)]
    refusal(run(root, "--repo-id", REPO))
    kept = set(hub.repos[REPO].objects)
    hub.faults = []
    lines = len(hub.log)
    push(root, REPO)
    sent = {line.path.rpartition("/")[2] for line in hub.log[lines:] if line.method == "PUT"}
    assert sent == set(hub.repos[REPO].objects) - kept
    assert len(kept) == len(Manifest.read(root).files) - 1


def test_a_commit_whose_answer_is_lost_is_not_made_again(hub: HubServer, root: Path) -> None:
    hub.faults = [Fault("POST .*/commit/", cut_answer=True, times=1)]
    assert "run again" in refusal(run(root, "--repo-id", REPO))
    push(root, REPO)
    assert len(hub.repos[REPO].commits) == 2


def killed_push(hub: HubServer, root: Path, skip: int, cut_after: int) -> None:
    """Push in a process that is killed in the middle of a request."""
    running: list[subprocess.Popen[bytes]] = []
    hub.faults = [
        Fault("", skip=skip, cut_after=cut_after, times=1, then=lambda: running[0].kill())
    ]
    code = (
        "from xden1k.folder import verify; verify.CAN_LABEL = False; "
        "from xden_builder.cli import cli; cli()"
    )
    environment = {**os.environ, "HF_ENDPOINT": hub.url, "HF_HUB_DISABLE_XET": "1"}
    environment["PYTHONPATH"] = os.pathsep.join(
        str(ROOT / area) for area in (".", "builder", "benchmarks", "baselines")
    )
    command = [sys.executable, "-c", code, "push", str(root), "--repo-id", REPO]
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE) as process:  # noqa: S603
        running.append(process)
        _, said = process.communicate()
    hub.faults = []
    assert process.returncode == -signal.SIGKILL, said


@pytest.mark.parametrize("moments", [pytest.param(10, marks=pytest.mark.slow)], ids=["ten"])
def test_a_push_that_is_killed_at_any_moment_is_completed_by_the_next(
    hub: HubServer, root: Path, tmp_path: Path, moments: int
) -> None:
    push(root, REPO)
    requests = len([line for line in hub.log if "harness" not in line.path])
    rng = np.random.default_rng(moments)
    for number in range(moments):
        hub.repos.clear()
        killed_push(hub, root, int(rng.integers(requests)), int(rng.integers(20_000)))
        for repo in hub.repos.values():
            assert len(repo.commits) <= 2
            assert not repo.tags or verify_folder(unpacked(hub, tmp_path / f"{number}", TAG)) == []
        before = set(hub.repos[REPO].objects) if hub.repos else set()
        lines = len(hub.log)
        push(root, REPO)
        sent = {line.path.rpartition("/")[2] for line in hub.log[lines:] if line.method == "PUT"}
        assert not sent & before
        assert len(hub.repos[REPO].commits) == 2
        assert verify_folder(unpacked(hub, tmp_path / f"{number}-whole", TAG)) == []


def test_a_repository_that_changed_meanwhile_is_left_alone(
    hub: HubServer, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def someone_else(*_: object) -> None:
        repo = hub.repos[REPO]
        head = repo.commits[repo.branches["main"]]
        repo.commit("main", Commit(head.oid, "someone else's", head.tree))

    hub.make(REPO)
    monkeypatch.setattr("xden_builder.pipeline.publish.run.refuse_unsound", someone_else)
    assert "main has changed meanwhile" in refusal(run(root, "--repo-id", REPO))
    assert hub.repos[REPO].tags == {}


def test_a_file_that_changes_while_it_is_pushed_is_not_committed(
    hub: HubServer, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def change(*_: object) -> None:
        damage(root)

    monkeypatch.setattr("xden_builder.pipeline.publish.run.refuse_unsound", change)
    assert "changed while it was pushed" in refusal(run(root, "--repo-id", REPO))
    assert len(hub.repos[REPO].commits) == 1


@pytest.mark.parametrize(
    "where",
    [
        "POST .*/commit/",
        "^PUT",
        *(pytest.param(one, marks=pytest.mark.slow) for one in ("POST .*/tag/", "GET .*/refs")),
    ],
)
def test_a_limited_rate_is_waited_for(
    hub: HubServer, root: Path, where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    waited: list[float] = []
    monkeypatch.setattr(repository, "wait", waited.append)
    hub.make(REPO)
    hub.faults = [Fault(where, status=429, headers={"Retry-After": "7"}, times=3)]
    push(root, REPO)
    assert hub.repos[REPO].tags
    assert waited == ([] if where == "^PUT" else [7, 7, 7])  # the client itself waits for uploads


def test_a_rate_that_stays_limited_is_told_and_said(
    hub: HubServer, root: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(repository, "wait", lambda _: None)
    hub.faults = [Fault("POST .*/commit/", status=429, headers={"ratelimit": '"api";r=0;t=9'})]
    line = refusal(run(root, "--repo-id", REPO))
    assert "the Hub limits the rate of requests, also after 5 tries" in line
    assert caplog.messages == ["the Hub limits the rate of requests: waiting 9 s"] * 4


def no_token(hub: HubServer, patch: pytest.MonkeyPatch) -> None:
    patch.delenv("HF_TOKEN")


def token(name: str) -> Callable[[HubServer, pytest.MonkeyPatch], None]:
    return lambda _, patch: patch.setenv("HF_TOKEN", name)


def fault(*faults: Fault) -> Callable[[HubServer, pytest.MonkeyPatch], None]:
    return lambda hub, _: hub.faults.extend(faults)


def small_files_only(hub: HubServer, patch: pytest.MonkeyPatch) -> None:
    hub.largest = 1000


@pytest.mark.parametrize(
    ("trouble", "repo_id", "line"),
    [
        (no_token, REPO, "no token of the Hub: log in by `hf auth login`, or set HF_TOKEN"),
        (token("hf_read"), REPO, "the token of the Hub may only read: make one that may write"),
        (token("hf_nope"), REPO, "the Hub does not take this token"),
        (fault(), "nobody/name", "this token may not write there (You don't have the rights to"),
        (fault(), "a/b/c", "--repo-id must be OWNER/NAME, got 'a/b/c'"),
        (fault(Fault("^PUT", status=507)), REPO, "the Hub has no room for it, or takes no file"),
        (fault(Fault("^PUT", status=413)), REPO, "the Hub has no room for it, or takes no file"),
        (fault(Fault("/commit/", status=500)), REPO, "the Hub answered 500 (fault); run again"),
        (small_files_only, REPO, "File is too large"),
    ],
)
def test_trouble_with_the_hub_is_one_line_and_no_version(
    hub: HubServer,
    root: Path,
    monkeypatch: pytest.MonkeyPatch,
    trouble: Callable[[HubServer, pytest.MonkeyPatch], None],
    repo_id: str,
    line: str,
) -> None:
    trouble(hub, monkeypatch)
    assert line in refusal(run(root, "--repo-id", repo_id))
    assert all(not repo.tags and len(repo.commits) == 1 for repo in hub.repos.values())


def test_nothing_that_answers_is_one_line(
    root: Path, monkeypatch: pytest.MonkeyPatch, hub: HubServer
) -> None:
    from huggingface_hub import constants

    monkeypatch.setattr(constants, "ENDPOINT", "http://127.0.0.1:9")
    assert f"cannot push to {REPO}: [Errno 111]" in refusal(run(root, "--repo-id", REPO))


def damage(root: Path) -> str:
    shard = next(root.glob("data/*.parquet"))
    shard.write_bytes(shard.read_bytes()[:-9] + b"?" + shard.read_bytes()[-8:])
    return f"{root} does not verify"


def strange_file(root: Path) -> str:
    (root / "notes.txt").write_text("mine")
    return f"{root} holds 1 files that SHA256SUMS does not list (notes.txt)"


def lost_file(root: Path) -> str:
    (root / "eval.yaml").unlink()
    return f"{root / 'eval.yaml'} is missing: SHA256SUMS lists it"


def no_manifest(root: Path) -> str:
    (root / "manifest.json").unlink()
    return f"{root}: not a dataset folder"


def leak(root: Path) -> str:
    shutil.rmtree(root)
    rows = [object_row(obj) | {"split": "private"} for obj in objects()[:1]]
    write_rows(rows, root, version="1.2.0", builder="test")
    return "answers of the split private are published, in"


@pytest.mark.parametrize(
    "harm",
    [
        damage,
        leak,
        *(
            pytest.param(one, marks=pytest.mark.slow)
            for one in (strange_file, lost_file, no_manifest)
        ),
    ],
)
def test_a_folder_that_is_not_sound_is_not_pushed(
    hub: HubServer, root: Path, harm: Callable[[Path], str]
) -> None:
    assert harm(root) in refusal(run(root, "--repo-id", REPO))
    assert hub.repos == {}


def test_the_work_files_of_a_build_are_not_pushed_by_mistake(hub: HubServer, root: Path) -> None:
    work = root.with_name("root.work")
    work.mkdir()
    assert refusal(run(work, "--repo-id", REPO)).endswith(f"not a dataset folder: push {root}")


def test_what_the_hub_does_not_take_is_refused_before_anything_is_read(
    hub: HubServer, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(parcel, "FILE_BYTES", 1000)
        assert "the Hub takes no file above" in refusal(run(root, "--repo-id", REPO))
    monkeypatch.setattr(parcel, "FOLDER_FILES", 2)
    assert "shards, the Hub takes 2" in refusal(run(root, "--repo-id", REPO))
    assert hub.log == []


def test_a_repository_with_other_files_is_left_alone(hub: HubServer, root: Path) -> None:
    hub.make(REPO, {"model.bin": b"1", "README.md": b"---\n---\nmine"})
    line = refusal(run(root, "--repo-id", REPO))
    assert f"{REPO} holds 1 files of no dataset folder (model.bin)" in line
    assert len(hub.repos[REPO].commits) == 1


def test_a_tag_that_contradicts_the_version_or_is_no_tag_is_refused(
    hub: HubServer, root: Path
) -> None:
    line = refusal(run(root, "--repo-id", REPO, "--revision", "v1.3.0"))
    assert line == "the folder's version is 1.2.0, the tag says v1.3.0"
    for tag in ("main", "a b", "-x", "refs/pr/1"):
        assert "must be a tag" in refusal(run(root, "--repo-id", REPO, f"--revision={tag}"))
    assert run(root, "--repo-id", REPO, "--revision", "paper").exit_code == 0
    assert list(hub.repos[REPO].tags) == ["paper"]


def test_simulated_objects_go_to_the_papers_repository_only_on_purpose(
    hub: HubServer, root: Path
) -> None:
    for name in (REPO_ID, REPO_ID.lower()):
        line = refusal(run(root, "--repo-id", name))
        assert "every object of this folder is simulated" in line
    assert hub.log == []
    flag = "--i-know-these-are-simulated"
    assert run(root, "--repo-id", REPO_ID, flag).exit_code == 0
    assert hub.repos[REPO_ID].tags


def test_a_repository_is_made_private_on_request(hub: HubServer, root: Path) -> None:
    push(root, REPO, private=True)
    assert hub.repos[REPO].private
    push(root, "owner/open")
    assert not hub.repos["owner/open"].private


def test_a_pull_request_sets_no_tag_and_is_opened_once(hub: HubServer, root: Path) -> None:
    line = refusal(run(root, "--repo-id", REPO, "--create-pr"))
    assert "no pull request without it" in line
    repo = hub.make(REPO)
    opened = push(root, REPO, create_pr=True)
    assert opened.url == f"{hub.url}/datasets/{REPO}/discussions/1"
    assert (repo.tags, len(repo.pulls), len(repo.tree())) == ({}, 1, 1)
    again = push(root, REPO, create_pr=True)
    assert (again.url, len(repo.pulls)) == (opened.url, 1)
    repo.branches["main"] = repo.pulls["refs/pr/1"]  # merged
    assert push(root, REPO).commit == repo.pulls["refs/pr/1"] == repo.tags[TAG]


def test_a_dry_run_needs_no_token_and_changes_nothing(
    hub: HubServer, root: Path, later: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    push(root, REPO)
    monkeypatch.delenv("HF_TOKEN")
    lines = len(hub.log)
    text = run(later, "--repo-id", REPO, "--dry-run").stdout
    assert "pretty_name: XDen-1K, simulated objects" in text
    for name in ("manifest.json", "metadata/train.parquet"):
        assert f" B  {name}" in text
    deleted = [line.split()[1] for line in text.splitlines() if line.startswith("delete ")]
    assert deleted == [f"data/train-0000{n}-of-00002.parquet" for n in (0, 1)]
    assert "nothing was pushed, this is a dry run" in text
    assert {line.method for line in hub.log[lines:]} == {"GET"}
    new = run(later, "--repo-id", "owner/new", "--dry-run")
    assert new.exit_code == 0
    assert "the repository is not there, or not to be seen without a token" in new.stderr


def test_a_dry_run_without_a_hub_says_what_it_cannot_know(
    root: Path, monkeypatch: pytest.MonkeyPatch, hub: HubServer
) -> None:
    from huggingface_hub import constants

    monkeypatch.setattr(constants, "ENDPOINT", "http://127.0.0.1:9")
    result = run(root, "--repo-id", REPO, "--dry-run", "--json")
    values: dict[str, Any] = json.loads(result.stdout)
    assert "would be deleted, is not known" in values["note"]
    assert len(values["uploaded"]) == len(listed_sums(root)) + 1
    assert hub.log == []
