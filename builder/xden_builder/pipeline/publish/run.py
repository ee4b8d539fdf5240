"""Push a dataset folder: look, verify, upload, one commit, then the tag.

Large files go up first and are seen by nobody; the commit makes the version appear as a whole,
and the tag comes last. Whatever is cut off in between, the next push takes up: an object that was
uploaded is not uploaded again, a commit that is there is not made again, a tag that is missing is
set.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

from huggingface_hub import CommitOperationAdd, CommitOperationDelete
from huggingface_hub.errors import HfHubHTTPError

from xden1k.access.hub import REPO_ID
from xden1k.documents.facts import Facts, read_facts
from xden1k.documents.maintainer import Answers
from xden1k.errors import DataError
from xden1k.folder.verify import refuse_unsound
from xden1k.format.checksums import CHECKSUMS_NAME
from xden1k.format.manifest import MANIFEST_NAME, Manifest
from xden_builder.pipeline.publish.parcel import CROISSANT_NAME, Parcel, published_on, read_folder
from xden_builder.pipeline.publish.repository import (
    AGAIN,
    BRANCH,
    HubError,
    Repository,
    one_line,
    patiently,
)

__all__ = ["Pushed", "push"]

ATTRIBUTES = ".gitattributes"
"""The Hub's own file in every repository: which files are stored apart."""
MOST_PULLS = 20
"""Pull requests that are looked through for the same content."""


@dataclass(frozen=True)
class Pushed:
    """What a push did, or would do.

    Parameters
    ----------
    repo_id, tag
        Where to.
    url
        Of the version; of the pull request if there is one.
    commit
        The commit of the version; empty before there is one.
    uploaded
        Bytes of each new or changed file.
    unchanged
        Number of files that were there.
    deleted
        Files of an older version that are in this one no more.
    note
        What else there is to say; empty if nothing.
    """

    repo_id: str
    tag: str
    url: str
    commit: str
    uploaded: dict[str, int]
    unchanged: int
    deleted: tuple[str, ...]
    note: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Values of JSON's types."""
        names = ("repo_id", "tag", "url", "commit", "uploaded", "unchanged", "note")
        return {name: getattr(self, name) for name in names} | {"deleted": list(self.deleted)}


@dataclass(frozen=True)
class _Plan:
    """What has to change on ``main``."""

    parcel: Parcel
    head: str
    changed: list[str]
    deleted: list[str]

    @property
    def nothing(self) -> bool:
        return not self.changed and not self.deleted


def push(
    root: Path,
    repo_id: str,
    *,
    tag: str | None = None,
    private: bool = False,
    create_pr: bool = False,
    dry_run: bool = False,
    simulated_too: bool = False,
    on_row: Callable[[], object] = lambda: None,
) -> Pushed:
    """Publish a dataset folder as one version of a dataset repository on the Hub.

    Parameters
    ----------
    root
        The dataset folder.
    repo_id
        ``owner/name``; made if it is not there.
    tag
        Name of the version on the Hub; None = ``v`` and the manifest's version.
    private
        Make the repository private, if it has to be made.
    create_pr
        Open a pull request in place of a commit; the push after its merge sets the tag.
    dry_run
        Look and verify only; needs no token.
    simulated_too
        Allow simulated objects in the repository of the paper.
    on_row
        Called after each object that was verified.

    Raises
    ------
    DataError
        If the folder does not verify or may not be pushed, the tag is there with other content,
        the repository holds other files, or the Hub refuses or cannot be reached.
    """
    root = root.absolute()
    manifest = read_folder(root)
    tag = _checked_tag(tag, manifest)
    _refuse_simulated(manifest, repo_id, simulated_too)
    _refuse_foreign_shapes(manifest)
    repository = Repository(repo_id)
    if not dry_run:
        with one_line(repo_id):
            repository.refuse_readers()
    work = _Push(repository, root, manifest, tag, private, create_pr)
    if dry_run:
        return work.dry(on_row)
    with one_line(repo_id):
        return work.run(on_row)


def _checked_tag(tag: str | None, manifest: Manifest) -> str:
    tag = f"v{manifest.version}" if tag is None else tag
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", tag) or tag == BRANCH:
        raise DataError(f"--revision must be a tag of A-Z a-z 0-9 . _ -, got {tag!r}")
    number = tag.removeprefix("v")
    if re.fullmatch(r"\d+\.\d+\.\d+", number) and number != manifest.version:
        raise DataError(f"the folder's version is {manifest.version}, the tag says {tag}")
    return tag


def _refuse_foreign_shapes(manifest: Manifest) -> None:
    if manifest.on_partnext:
        raise DataError(
            f"{manifest.on_partnext} of {manifest.objects} objects of this folder have shapes of "
            "PartNeXt, each under a licence of its own: they are not published from here"
        )


def _refuse_simulated(manifest: Manifest, repo_id: str, simulated_too: bool) -> None:
    if manifest.simulated and repo_id.lower() == REPO_ID.lower() and not simulated_too:
        raise DataError(
            f"every object of this folder is simulated, {REPO_ID} is the paper's repository of "
            "scans: choose another, or say --i-know-these-are-simulated"
        )


@dataclass
class _Push:
    """One push under way."""

    repository: Repository
    root: Path
    manifest: Manifest
    tag: str
    private: bool
    create_pr: bool

    def dry(self, on_row: Callable[[], object]) -> Pushed:
        """Say what a push would do, as far as can be seen from here."""
        note, plan = "", _Plan(self._parcel(""), "", [], [])
        try:
            with one_line(self.repository.repo_id):
                head = self.repository.head()
                if head is None:
                    note = "the repository is not there, or not to be seen without a token"
                elif done := self._done():
                    return done
                else:
                    plan = self._plan(head)
        except HubError as err:
            said = str(err).removesuffix(f"; {AGAIN}")
            note = f"{said}; what is there unchanged, or would be deleted, is not known"
        refuse_unsound(self.root, on_row)
        changed = plan.changed if plan.head else plan.parcel.names
        return self._pushed(plan, "", changed, note)

    def run(self, on_row: Callable[[], object]) -> Pushed:
        """Do it."""
        head = self.repository.head()
        if head is not None and (done := self._done()):
            return done
        if head is None and self.create_pr:
            raise DataError(f"{self.repository.repo_id} is not there: no pull request without it")
        plan = None if head is None else self._plan(head)
        refuse_unsound(self.root, on_row)
        plan = plan or self._plan(self._make())
        if self.create_pr:
            return self._open_pull(plan)
        commit = plan.head if plan.nothing else str(self._commit(plan).oid)
        self._set_tag(commit, plan.parcel)
        return self._pushed(plan, commit, plan.changed)

    def _parcel(self, revision: str) -> Parcel:
        """Make what is pushed, dated today; if just that stands at a revision, as it is dated."""
        there = self.repository.document(revision, CROISSANT_NAME) if revision else b""
        if date := published_on(there):
            parcel = self._parcel_of(date)
            if parcel.made[CROISSANT_NAME] == there:
                return parcel
        return self._parcel_of(datetime.now(UTC).date().isoformat())

    def _parcel_of(self, date: str) -> Parcel:
        return Parcel.of(self.root, self.facts, self.repository.address(self.tag), date)

    @cached_property
    def facts(self) -> Facts:
        """What the documents of the folder say."""
        return read_facts(self.root, self.manifest, Answers.of_folder(self.root))

    def _compare(self, revision: str) -> tuple[Parcel, list[str], set[str]]:
        """Return what is pushed, names of what differs at a revision, and names of all there."""
        there, parcel = self.repository.files(revision), self._parcel(revision)
        changed = [name for name in parcel.names if not _same(parcel, name, there.get(name))]
        return parcel, changed, there.keys() - {ATTRIBUTES}

    def _done(self) -> Pushed | None:
        """Return what is there under the tag, if it is this version; None if there is no tag.

        Raises
        ------
        DataError
            If the tag is there with other content.
        """
        tags, pulls = self.repository.refs()
        if self.tag not in tags:
            return self._done_in_pull(pulls) if self.create_pr else None
        parcel, changed, there = self._compare(self.tag)
        if changed or there - set(parcel.names):
            raise DataError(self._taken(parcel))
        plan = _Plan(parcel, tags[self.tag], [], [])
        return self._pushed(plan, plan.head, [], "this version is there, nothing was pushed")

    def _done_in_pull(self, pulls: list[str]) -> Pushed | None:
        for name in pulls[:MOST_PULLS]:
            parcel, changed, _ = self._compare(name)
            if not changed:
                url = self.repository.address("").replace("/resolve//", f"/discussions/{name[8:]}")
                plan = _Plan(parcel, "", [], [])
                return self._pushed(plan, "", [], "this pull request is there", url=url)
        return None

    def _taken(self, parcel: Parcel) -> str:
        name = self.repository.repo_id
        there = dict(
            line.split("  ", 1)[::-1]
            for line in self.repository.document(self.tag, CHECKSUMS_NAME).decode().splitlines()
        )
        differs = [n for n in parcel.sums if there.get(n) != parcel.sums[n]] or [MANIFEST_NAME]
        file = MANIFEST_NAME if MANIFEST_NAME in differs else differs[0]
        return (
            f"{name} has the tag {self.tag} with other content: sha256 of its {file} is "
            f"{there.get(file, 'none')}, of this folder's {parcel.sums[file]}; a tag is never "
            "moved: give the data a new version"
        )

    def _plan(self, head: str) -> _Plan:
        """Compare with ``main``; what an older version of ours left is deleted, no other file.

        Raises
        ------
        DataError
            If the repository holds other files.
        """
        parcel, changed, there = self._compare(head)
        lines = self.repository.document(head, CHECKSUMS_NAME).decode(errors="replace").splitlines()
        ours = {line.partition("  ")[2] for line in lines} | {CHECKSUMS_NAME}
        deleted = sorted(there - set(parcel.names))
        if others := [name for name in deleted if name not in ours]:
            raise DataError(
                f"{self.repository.repo_id} holds {len(others)} files of no dataset folder "
                f"({', '.join(others[:3])}{' ...' if len(others) > 3 else ''}): remove them "
                "there, or choose another repository"
            )
        return _Plan(parcel, head, changed, deleted)

    def _make(self) -> str:
        """Make the repository; its first commit is the Hub's."""
        repo_id = self.repository.repo_id
        patiently(
            lambda: self.repository.api.create_repo(
                repo_id, repo_type="dataset", private=self.private or None, exist_ok=True
            )
        )
        head = self.repository.head()
        if head is None:
            raise DataError(f"{repo_id} was made, and is not to be seen: run again")
        return head

    def _commit(self, plan: _Plan) -> Any:
        """Upload what is missing, then make all of it one commit on top of what was seen."""
        parcel, api = plan.parcel, self.repository.api
        additions = [
            CommitOperationAdd(name, parcel.made.get(name) or str(parcel.root / name))
            for name in plan.changed
        ]
        repo_id = self.repository.repo_id
        patiently(
            lambda: api.preupload_lfs_files(
                repo_id, additions, repo_type="dataset", create_pr=self.create_pr, free_memory=False
            )
        )
        for each in additions:
            if each.upload_info.sha256.hex() != parcel.sha256(each.path_in_repo):
                raise DataError(f"{self.root / each.path_in_repo} changed while it was pushed")
        return patiently(
            lambda: api.create_commit(
                repo_id,
                [*additions, *map(CommitOperationDelete, plan.deleted)],
                commit_message=f"Version {self.manifest.version}, {self.manifest.objects} objects",
                repo_type="dataset",
                create_pr=self.create_pr,
                parent_commit=plan.head,
            )
        )

    def _open_pull(self, plan: _Plan) -> Pushed:
        if plan.nothing:
            return self._pushed(plan, plan.head, [], f"{BRANCH} holds this version already")
        made = self._commit(plan)
        note = "push again without --create-pr when it is merged: that sets the tag"
        return self._pushed(plan, str(made.oid), plan.changed, note, url=str(made.pr_url))

    def _set_tag(self, commit: str, parcel: Parcel) -> None:
        try:
            patiently(
                lambda: self.repository.api.create_tag(
                    self.repository.repo_id, tag=self.tag, revision=commit, repo_type="dataset"
                )
            )
        except HfHubHTTPError as err:
            if err.response.status_code != 409:
                raise
            if self.repository.refs()[0].get(self.tag) != commit:  # another push was faster
                raise DataError(self._taken(parcel)) from err

    def _pushed(
        self, plan: _Plan, commit: str, changed: list[str], note: str = "", url: str = ""
    ) -> Pushed:
        parcel = plan.parcel
        return Pushed(
            repo_id=self.repository.repo_id,
            tag=self.tag,
            url=url or self.repository.address(self.tag).replace("/resolve/", "/tree/").rstrip("/"),
            commit=commit,
            uploaded={name: parcel.size(name) for name in changed},
            unchanged=len(parcel.names) - len(changed),
            deleted=tuple(plan.deleted),
            note=note,
        )


def _same(parcel: Parcel, name: str, there: tuple[str, bool] | None) -> bool:
    if there is None:
        return False
    digest, apart = there
    return digest == (parcel.sha256(name) if apart else parcel.git_oid(name))
