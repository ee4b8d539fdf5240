"""Where the data is found, and the download: whole and verified, or not at all."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import huggingface_hub
import pytest
from huggingface_hub.errors import HfHubHTTPError, OfflineModeIsEnabled

from tests.phantoms import objects
from xden1k.access import hub
from xden1k.errors import DataError
from xden1k.folder import open_folder, write_folder


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("hub") / "root"
    write_folder(objects()[:2], root, version="1.2.0", builder="test")
    return root


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty user's cache, and no variable set."""
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv(hub.ROOT_VARIABLE, raising=False)
    hub._say_that_it_is_the_sample.cache_clear()
    return tmp_path / "cache" / "xden1k"


def fake_folder(root: Path, version: str = "0.0.1") -> Path:
    root.mkdir(parents=True)
    (root / "manifest.json").write_text(f'{{"version": "{version}"}}')
    return root


def test_argument_then_variable_then_cache_then_sample(
    tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hub, "SAMPLE", fake_folder(tmp_path / "sample"))
    with pytest.warns(UserWarning, match=r"simulated sample.*xden download.*XDEN1K_ROOT"):
        assert hub.data_root() == tmp_path / "sample"
    assert hub.data_root() == tmp_path / "sample"  # a second warning would be an error here
    fake_folder(cache / "owner--name" / "abc")
    (cache / "current").write_text("owner--name/abc")
    assert hub.data_root() == cache / "owner--name" / "abc"
    monkeypatch.setenv(hub.ROOT_VARIABLE, str(fake_folder(tmp_path / "variable")))
    assert hub.data_root() == tmp_path / "variable"
    assert hub.data_root(fake_folder(tmp_path / "argument")) == tmp_path / "argument"


def test_a_wrong_folder_is_an_error_that_says_who_named_it_and_never_the_sample(
    tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(DataError, match=r"nowhere \(from root\) is not a dataset folder"):
        hub.data_root(tmp_path / "nowhere")
    cache.mkdir(parents=True)
    (cache / "current").write_text("gone")
    with pytest.raises(DataError, match=r"gone \(from .*current\) is not a dataset folder"):
        hub.data_root()
    monkeypatch.setenv(hub.ROOT_VARIABLE, str(tmp_path))
    with pytest.raises(DataError, match=r"\(from XDEN1K_ROOT\) is not a dataset folder"):
        hub.data_root()


def test_a_relative_root_becomes_absolute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake_folder(tmp_path / "here")
    monkeypatch.chdir(tmp_path)
    assert hub.data_root("here") == tmp_path / "here"


@pytest.mark.parametrize(
    ("platform", "variable", "expected"),
    [
        ("linux", "XDG_CACHE_HOME", "base/xden1k"),
        ("win32", "LOCALAPPDATA", "base/xden1k"),
        ("linux", None, "home/.cache/xden1k"),
        ("darwin", None, "home/Library/Caches/xden1k"),
        ("win32", None, "home/AppData/Local/xden1k"),
    ],
)
def test_the_cache_is_where_the_platform_has_it(
    platform: str,
    variable: str | None,
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr("sys.platform", platform)
    if variable:
        monkeypatch.setenv(variable, str(tmp_path / "base"))
    assert hub.cache_folder() == tmp_path / expected


def test_only_the_revision_that_lies_here_is_accepted(written: Path) -> None:
    for revision in (None, "1.2.0", "v1.2.0"):
        hub.check_revision(written, revision)
    for revision in ("1.2.1", "main", "nope"):
        with pytest.raises(DataError, match=rf"revision {revision} was asked for.*holds 1\.2\.0"):
            hub.check_revision(written, revision)


def test_the_digest_changes_with_the_manifest_the_card_and_each_shard(
    written: Path, tmp_path: Path
) -> None:
    root = tmp_path / "copy"
    shutil.copytree(written, root)
    digests = {hub.folder_digest(root)}
    assert digests == {hub.folder_digest(written)}  # a copy that keeps the times is the same data
    for path in (root / "manifest.json", root / "README.md"):
        path.write_text(path.read_text() + "\n")
        digests.add(hub.folder_digest(root))
    for shard in root.glob("*/*.parquet"):
        os.utime(shard, ns=(1, 1))
        digests.add(hub.folder_digest(root))
    assert len(digests) == 3 + len(list(root.glob("*/*.parquet")))


class FakeHub:
    """The Hub as huggingface_hub shows it: one repository, one commit."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self.calls, self.error = folder, [], None
        monkeypatch.setattr(huggingface_hub.HfApi, "dataset_info", self.dataset_info)
        monkeypatch.setattr(huggingface_hub, "snapshot_download", self.snapshot_download)

    def dataset_info(self, repo_id: str, *, revision: str | None = None) -> Any:
        if self.error:
            raise self.error
        files = [path for path in self.folder.rglob("*") if path.is_file()]
        names = [SimpleNamespace(rfilename=str(path.relative_to(self.folder))) for path in files]
        return SimpleNamespace(sha=f"sha-of-{revision}", siblings=names)

    def snapshot_download(self, repo_id: str, *, local_dir: Path, **options: Any) -> None:
        self.calls.append((repo_id, options["repo_type"], options["revision"]))
        shutil.copytree(self.folder, local_dir, dirs_exist_ok=True)
        (local_dir / ".cache").mkdir(exist_ok=True)


@pytest.fixture
def remote(written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakeHub:
    return FakeHub(shutil.copytree(written, tmp_path / "remote"), monkeypatch)


def test_a_download_is_verified_pinned_to_its_commit_and_becomes_the_root(
    remote: FakeHub, cache: Path
) -> None:
    folder = hub.download("owner/name", "v1.2.0")
    assert folder == cache / "owner--name" / "sha-of-v1.2.0" == hub.data_root()
    assert remote.calls == [("owner/name", "dataset", "sha-of-v1.2.0")]
    assert open_folder(folder).ids() == ("bar-0001", "bar-0002")
    assert not (folder / ".cache").exists()
    assert sorted(path.name for path in cache.iterdir()) == ["current", "owner--name"]
    hub.download("owner/name", "v2")
    assert hub.data_root().name == "sha-of-v2"
    hub.download("owner/name", "v1.2.0")  # is there already: nothing to fetch
    assert len(remote.calls) == 2
    assert hub.data_root() == folder


def test_a_download_with_another_manifest_than_asked_for_never_becomes_the_root(
    remote: FakeHub, cache: Path
) -> None:
    with pytest.raises(DataError, match=r"its manifest must have the sha256 abc, got [0-9a-f]{64}"):
        hub.download("owner/name", "v1", manifest_sha256="abc")
    assert not (cache / "current").exists()
    expected = open_folder(remote.folder).manifest_sha256
    assert hub.download("owner/name", "v1", manifest_sha256=expected) == hub.data_root()


def test_a_damaged_download_never_becomes_the_root_and_is_not_resumed(
    remote: FakeHub, cache: Path
) -> None:
    shard = next(remote.folder.glob("data/*.parquet"))
    shard.write_bytes(shard.read_bytes()[:-1] + b"?")
    with pytest.raises(DataError, match=shard.name):
        hub.download("owner/name")
    assert list((cache / "owner--name").iterdir()) == []
    assert not (cache / "current").exists()


def test_an_interrupted_download_is_kept_to_be_resumed(
    remote: FakeHub, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(repo_id: str, *, local_dir: Path, **options: Any) -> None:
        local_dir.mkdir(parents=True)
        (local_dir / "README.md").write_text("half")
        raise ConnectionError("peer closed the connection\nand more")

    with monkeypatch.context() as patch:
        patch.setattr(huggingface_hub, "snapshot_download", interrupted)
        with pytest.raises(DataError, match=r"^cannot download owner/name.*peer closed.*n$"):
            hub.download("owner/name", "v1")
    assert (cache / "owner--name" / "sha-of-v1.partial" / "README.md").exists()
    assert hub.download("owner/name", "v1") == hub.data_root()


def test_a_repository_of_another_layout_is_refused_before_anything_is_fetched(
    remote: FakeHub,
) -> None:
    (remote.folder / "manifest.json").unlink()
    with pytest.raises(DataError, match=r"owner/name is not laid out as.*only folders that xden-"):
        hub.download("owner/name")
    with pytest.raises(DataError, match=f"authors' release: xden import {hub.REPO_ID} --out ROOT$"):
        hub.download(hub.REPO_ID)
    assert remote.calls == []


@pytest.mark.parametrize(
    "error",
    [
        OfflineModeIsEnabled("offline mode is enabled"),
        HfHubHTTPError.__bases__[0]("offline mode is enabled"),
        OSError("offline mode is enabled"),
    ],
)
def test_what_the_hub_says_becomes_one_line(remote: FakeHub, error: Exception) -> None:
    remote.error = error
    with pytest.raises(DataError, match=r"^cannot download o/n at v9: offline mode is enabled$"):
        hub.download("o/n", "v9")


def test_a_malformed_repository_name_becomes_one_line() -> None:
    with pytest.raises(DataError, match=r"^cannot download a/b/c at its newest revision: Repo id"):
        hub.download("a/b/c")
