"""A stand-in for the Hub's HTTP interface on the loopback address, for the real client.

Dataset repositories with immutable commits, branches, tags and pull requests, large files apart
(LFS), tokens and namespaces; a log of every request; and faults to switch on: cut connections,
rate limits, a full remote. Not here: Xet storage, the viewer, gating, git itself.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

import yaml

MAIN = "main"
LARGE_BYTES = 10_000_000
LARGE_NAMES = (".parquet", ".h5", ".npz", ".zip")
"""Endings of files that the Hub stores apart, whatever their size."""
ATTRIBUTES = "".join(f"*{name} filter=lfs diff=lfs merge=lfs -text\n" for name in LARGE_NAMES)
PAGE = 1000
MESSAGES = {401: "Invalid username or password.", 403: "Forbidden", 404: "Not Found"}


@dataclass(frozen=True)
class Blob:
    """Content of one file; ``large`` if it is stored apart."""

    content: bytes
    large: bool

    @property
    def sha256(self) -> str:
        return hashlib.sha256(self.content).hexdigest()

    @property
    def oid(self) -> str:
        """Git's name of what the repository itself holds: the content, or the pointer to it."""
        text = self.content
        if self.large:
            text = b"version https://git-lfs.github.com/spec/v1\noid sha256:%s\nsize %d\n" % (
                self.sha256.encode(),
                len(self.content),
            )
        return hashlib.sha1(b"blob %d\0%s" % (len(text), text)).hexdigest()  # noqa: S324

    def entry(self, path: str) -> dict[str, Any]:
        size = len(self.content)
        values = {"type": "file", "path": path, "size": size, "oid": self.oid}
        if self.large:
            values["lfs"] = {"oid": self.sha256, "size": size, "pointerSize": 130}
        return values


@dataclass(frozen=True)
class Commit:
    """A tree, and what it followed."""

    parent: str
    title: str
    tree: Mapping[str, Blob]

    @property
    def oid(self) -> str:
        names = "".join(f"{path} {blob.oid}\n" for path, blob in sorted(self.tree.items()))
        return hashlib.sha1(f"{self.parent}\n{self.title}\n{names}".encode()).hexdigest()  # noqa: S324


@dataclass
class Repo:
    """A dataset repository."""

    private: bool = False
    commits: dict[str, Commit] = field(default_factory=dict)
    branches: dict[str, str] = field(default_factory=dict)
    tags: dict[str, str] = field(default_factory=dict)
    pulls: dict[str, str] = field(default_factory=dict)
    objects: dict[str, bytes] = field(default_factory=dict)
    """Large files that were uploaded, committed or not."""

    def commit(self, ref: str, commit: Commit) -> str:
        self.commits[commit.oid] = commit
        (self.pulls if ref.startswith("refs/pr/") else self.branches)[ref] = commit.oid
        return commit.oid

    def find(self, revision: str) -> str | None:
        """Name the commit of a branch, a tag, a pull request or a commit."""
        for names in (self.branches, self.tags, self.pulls):
            if revision in names:
                return names[revision]
        near = [oid for oid in self.commits if len(revision) >= 7 and oid.startswith(revision)]
        return near[0] if near else None

    def tree(self, revision: str = MAIN) -> dict[str, bytes]:
        """Content of every file at a revision."""
        oid = self.find(revision)
        assert oid, f"no revision {revision}"
        return {path: blob.content for path, blob in self.commits[oid].tree.items()}


@dataclass(frozen=True)
class Account:
    """Whose a token is, and what it may do."""

    name: str
    role: str = "write"
    namespaces: tuple[str, ...] = ()


@dataclass
class Fault:
    """What goes wrong with the next requests that match, so many times.

    With ``status`` it is answered; with ``cut_after`` the connection ends after so many bytes of
    the body, sent or received; with ``cut_answer`` the request is served, and its answer lost.
    ``then`` is called at that moment. The first ``skip`` requests that match go well.
    """

    pattern: str
    status: int = 0
    message: str = "fault"
    headers: Mapping[str, str] = field(default_factory=dict)
    cut_after: int | None = None
    cut_answer: bool = False
    times: int = 10**9
    skip: int = 0
    then: Callable[[], object] = lambda: None


@dataclass
class Request:
    """One line of the log."""

    method: str
    path: str
    status: int = 0
    received: int = 0
    sent: int = 0

    def __str__(self) -> str:
        return f"{self.method} {self.path}"


class Refused(Exception):
    """An answer that is an error."""

    def __init__(self, status: int, code: str = "", message: str = "") -> None:
        super().__init__(message or MESSAGES.get(status, ""))
        self.status, self.code = status, code


class Cut(Exception):
    """The connection ends here."""


class HubServer(ThreadingHTTPServer):
    """The whole Hub; :func:`running_hub` starts and stops one."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.url = f"http://127.0.0.1:{self.server_address[1]}"
        self.accounts = {
            "hf_write": Account("owner", namespaces=("owner", "zhangjxx")),
            "hf_read": Account("owner", role="read", namespaces=("owner",)),
        }
        self.lock = threading.RLock()
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.repos: dict[str, Repo] = {}
        self.faults: list[Fault] = []
        self.log: list[Request] = []
        self.largest = 10**18
        """Bytes of the largest file it takes."""

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Nothing: a client that was killed is what these tests are about."""

    def sent(self, pattern: str = "") -> int:
        """Bytes of bodies that were sent in answer to the requests that match."""
        return sum(line.sent for line in self.log if re.search(pattern, str(line)))

    def count(self, pattern: str) -> int:
        """Return how many requests matched and were answered well."""
        return sum(line.status < 400 for line in self.log if re.search(pattern, str(line)))

    def make(self, repo_id: str, files: Mapping[str, bytes] | None = None, **options: Any) -> Repo:
        """Make a repository, as the website would."""
        repo = self.repos[repo_id] = Repo(**options)
        tree = {".gitattributes": Blob(ATTRIBUTES.encode(), large=False)}
        for path, content in (files or {}).items():
            tree[path] = Blob(content, _is_large(path, len(content)))
        repo.commit(MAIN, Commit("", "initial commit", tree))
        return repo


@contextmanager
def running_hub() -> Iterator[HubServer]:
    """A hub that answers until the end of the block."""
    with HubServer() as hub:
        thread = threading.Thread(target=hub.serve_forever, args=(0.01,), daemon=True)
        thread.start()
        try:
            yield hub
        finally:
            hub.shutdown()
            thread.join()


def _is_large(path: str, size: int) -> bool:
    return path.endswith(LARGE_NAMES) or size > LARGE_BYTES


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    server: HubServer
    line: Request

    def log_message(self, *_: object) -> None:
        """Nothing: the log is the server's."""

    def _answer(self) -> None:
        self.line = Request(self.command, self.path)
        self.server.log.append(self.line)
        fault = self._fault()
        try:
            if fault and fault.cut_after is not None and self.command in ("PUT", "POST"):
                self._read(fault.cut_after)
                fault.then()
                raise Cut
            if fault and not fault.status and fault.cut_after is None:
                fault.then()
            self.body = self._read(self._length())
            if fault and fault.status:
                raise Refused(fault.status, "", fault.message)
            with self.server.lock:
                status, body, headers = self._route()
            if fault and fault.cut_answer:
                raise Cut
        except Refused as err:
            status, headers = err.status, dict(fault.headers) if fault else {}
            headers |= {"X-Error-Message": str(err)} | (
                {"X-Error-Code": err.code} if err.code else {}
            )
            body = json.dumps({"error": str(err)}).encode()
        except Cut:
            self.close_connection = True
            return
        self._send(status, body, headers, fault)

    do_GET = do_HEAD = do_POST = do_PUT = do_DELETE = _answer

    def _fault(self) -> Fault | None:
        with self.server.lock:
            for fault in self.server.faults:
                if fault.times > 0 and re.search(fault.pattern, str(self.line)):
                    if fault.skip > 0:
                        fault.skip -= 1
                        continue
                    fault.times -= 1
                    return fault
        return None

    def _length(self) -> int:
        return int(self.headers.get("Content-Length") or 0)

    def _read(self, count: int) -> bytes:
        if self.headers.get("Transfer-Encoding") == "chunked":
            body = self._chunks(count)
        else:
            body = self.rfile.read(min(count, self._length()))
            if len(body) < min(count, self._length()):
                raise Cut  # the client is gone
        self.line.received += len(body)
        return body

    def _chunks(self, _: int) -> bytes:
        body = b""
        while size := int(self.rfile.readline() or b"0", 16):
            body += self.rfile.read(size)
            self.rfile.readline()
        self.rfile.readline()
        return body

    def _send(
        self, status: int, body: bytes, headers: Mapping[str, str], fault: Fault | None
    ) -> None:
        self.line.status = status
        self.send_response(status)
        for name, value in headers.items():
            self.send_header(name, value)
        if "Content-Length" not in headers:
            self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if self.command == "HEAD" or status == 304:
            return
        if fault and fault.cut_after is not None:
            body, self.close_connection = body[: fault.cut_after], True
            fault.then()
        self.line.sent += len(body)  # before the client can look
        self.wfile.write(body)

    # Who asks, and for what

    def _account(self) -> Account | None:
        token = (self.headers.get("Authorization") or "").removeprefix("Bearer ")
        if token and token not in self.server.accounts:
            raise Refused(401, "", "Invalid credentials in Authorization header")
        return self.server.accounts.get(token)

    def _repo(self, repo_id: str, *, write: bool = False) -> Repo:
        account, repo = self._account(), self.server.repos.get(repo_id)
        mine = account is not None and repo_id.split("/")[0] in account.namespaces
        if repo is None or (repo.private and not mine):
            raise Refused(404 if account else 401, "RepoNotFound", "Repository not found")
        if write and account is None:
            raise Refused(401)
        if write and not (mine and account and account.role == "write"):
            raise Refused(403, "", f"You don't have write access to {repo_id}")
        return repo

    def _commit(self, repo: Repo, revision: str) -> tuple[str, Commit]:
        oid = repo.find(unquote(revision))
        if oid is None:
            raise Refused(404, "RevisionNotFound", f"Invalid rev id: {revision}")
        return oid, repo.commits[oid]

    def _json(self) -> dict[str, Any]:
        values: dict[str, Any] = json.loads(self.body)
        return values

    def _route(self) -> tuple[int, bytes, dict[str, str]]:
        path = urlsplit(self.path).path
        for method, pattern, answer in ROUTES:
            if method == self.command.replace("HEAD", "GET") and (
                found := re.fullmatch(pattern, path)
            ):
                given = {name: unquote(value or "") for name, value in found.groupdict().items()}
                made = answer(self, **given)
                if isinstance(made, tuple):
                    return made
                return 200, json.dumps(made).encode(), {"Content-Type": "application/json"}
        raise Refused(404, "", f"no such page: {self.line}")

    # Accounts and repositories

    def whoami(self) -> Any:
        account = self._account()
        if account is None:
            raise Refused(401)
        orgs = [{"name": name} for name in account.namespaces if name != account.name]
        token = {"type": "access_token", "accessToken": {"displayName": "t", "role": account.role}}
        return {"type": "user", "name": account.name, "orgs": orgs, "auth": token}

    def create(self) -> Any:
        account, values = self._account(), self._json()
        if account is None:
            raise Refused(401)
        namespace = values.get("organization") or account.name
        repo_id = f"{namespace}/{values['name']}"
        if account.role != "write" or namespace not in account.namespaces:
            raise Refused(
                403, "", f"You don't have the rights to create a dataset under {namespace}"
            )
        if repo_id in self.server.repos:
            raise Refused(409, "", "You already created this dataset repo")
        private = values.get("visibility") == "private" or bool(values.get("private"))
        self.server.make(repo_id, private=private)
        return {"url": f"{self.server.url}/datasets/{repo_id}", "name": repo_id}

    def validate(self) -> Any:
        text = self._json()["content"]
        try:
            yaml.safe_load(text.split("---\n")[1])
        except (IndexError, yaml.YAMLError) as err:
            raise Refused(400, "", str(err)) from err
        return {"errors": [], "warnings": []}

    def info(self, repo_id: str, revision: str = MAIN) -> Any:
        repo = self._repo(repo_id)
        oid, commit = self._commit(repo, revision or MAIN)
        siblings = [{"rfilename": path} for path in sorted(commit.tree)]
        values = {"id": repo_id, "sha": oid, "private": repo.private, "siblings": siblings}
        return values | {"downloads": 0, "likes": 0, "tags": [], "disabled": False, "gated": False}

    def refs(self, repo_id: str) -> Any:
        repo = self._repo(repo_id)
        return {
            kind: [
                {"name": name, "ref": prefix + name, "targetCommit": oid}
                for name, oid in names.items()
            ]
            for kind, prefix, names in (
                ("branches", "refs/heads/", repo.branches),
                ("tags", "refs/tags/", repo.tags),
                ("pullRequests", "", repo.pulls),
                ("converts", "", {}),
            )
        }

    def tag(self, repo_id: str, revision: str) -> Any:
        repo = self._repo(repo_id, write=True)
        oid, _ = self._commit(repo, revision)
        if (name := self._json()["tag"]) in repo.tags:
            raise Refused(409, "", f"Tag reference exists already: {name}")
        repo.tags[name] = oid
        return {}

    # Trees and files

    def tree(self, repo_id: str, revision: str, folder: str = "") -> Any:
        _, commit = self._commit(self._repo(repo_id), revision)
        query = parse_qs(urlsplit(self.path).query)
        prefix = f"{folder}/" if folder else ""
        inside = {path for path in commit.tree if path.startswith(prefix)}
        folders = {
            "/".join(path.split("/")[:n]) for path in inside for n in range(1, path.count("/") + 1)
        }
        if not inside:
            raise Refused(404, "EntryNotFound", f"{folder} does not exist")
        deep = query.get("recursive", ["false"])[0].lower() == "true"
        entries = [_folder(path) for path in sorted(folders - {folder}) if path.startswith(prefix)]
        entries += [commit.tree[path].entry(path) for path in sorted(inside)]
        if not deep:
            entries = [each for each in entries if "/" not in each["path"][len(prefix) :]]
        start = int(query.get("cursor", ["0"])[0])
        headers = {"Content-Type": "application/json"}
        if len(entries) > start + PAGE:
            here, more = urlsplit(self.path).path, f"recursive={deep}&cursor={start + PAGE}"
            headers["Link"] = f'<{self.server.url}{here}?{more}>; rel="next"'
        return 200, json.dumps(entries[start : start + PAGE]).encode(), headers

    def paths(self, repo_id: str, revision: str) -> Any:
        _, commit = self._commit(self._repo(repo_id), revision)
        wanted = parse_qs(self.body.decode()).get("paths", [])
        found = [commit.tree[path].entry(path) for path in wanted if path in commit.tree]
        folders = [path for path in wanted if any(p.startswith(f"{path}/") for p in commit.tree)]
        return found + [_folder(path) for path in folders]

    def resolve(self, repo_id: str, revision: str, path: str) -> Any:
        oid, commit = self._commit(self._repo(repo_id), revision)
        if path not in commit.tree:
            raise Refused(404, "EntryNotFound", f"{path} does not exist")
        blob = commit.tree[path]
        etag = f'"{blob.sha256 if blob.large else blob.oid}"'
        headers = {"ETag": etag, "X-Repo-Commit": oid, "Accept-Ranges": "bytes"}
        if blob.large:
            headers |= {"X-Linked-Etag": etag, "X-Linked-Size": str(len(blob.content))}
        if self.headers.get("If-None-Match") == etag:
            return 304, b"", headers
        wanted = re.fullmatch(r"bytes=(\d*)-(\d*)", self.headers.get("Range") or "")
        if not wanted:
            return 200, blob.content, headers | {"Content-Length": str(len(blob.content))}
        size, (first, last) = len(blob.content), wanted.groups()
        start = int(first) if first else max(size - int(last), 0)
        end = min(int(last) + 1, size) if first and last else size
        if start >= size:
            raise Refused(416)
        headers["Content-Range"] = f"bytes {start}-{end - 1}/{size}"
        return 206, blob.content[start:end], headers

    # Uploads and commits

    def preupload(self, repo_id: str, revision: str) -> Any:
        repo = self._repo(repo_id, write=True)
        _, commit = self._commit(repo, revision)
        return {
            "files": [
                {
                    "path": each["path"],
                    "uploadMode": "lfs" if _is_large(each["path"], each["size"]) else "regular",
                    "shouldIgnore": False,
                    "oid": _known(commit.tree.get(each["path"])),
                }
                for each in self._json()["files"]
            ]
        }

    def batch(self, repo_id: str) -> Any:
        repo = self._repo(repo_id, write=True)
        return {
            "transfer": "basic",
            "objects": [self._upload(repo_id, repo, each) for each in self._json()["objects"]],
        }

    def _upload(self, repo_id: str, repo: Repo, each: dict[str, Any]) -> dict[str, Any]:
        if each["size"] > self.server.largest:
            return each | {"error": {"code": 413, "message": "File is too large"}}
        if each["oid"] in repo.objects:
            return each
        href = f"{self.server.url}/lfs/{repo_id}/{each['oid']}"
        return each | {"actions": {"upload": {"href": href}, "verify": {"href": href}}}

    def put(self, repo_id: str, oid: str) -> Any:
        if hashlib.sha256(self.body).hexdigest() != oid:
            raise Refused(400, "", "the content is not what its name says")
        self.server.repos[repo_id].objects[oid] = self.body
        return {}

    def verify(self, repo_id: str, oid: str) -> Any:
        if oid not in self.server.repos[repo_id].objects:
            raise Refused(404)
        return {}

    def commit(self, repo_id: str, revision: str) -> Any:
        as_pull = "create_pr" in parse_qs(urlsplit(self.path).query)
        repo = self._repo(repo_id, write=True)
        if revision not in repo.branches:
            raise Refused(404, "RevisionNotFound", f"no branch {revision}")
        head = repo.branches[revision]
        lines = [json.loads(line) for line in self.body.splitlines()]
        header = lines[0]["value"]
        if header.get("parentCommit", head) != head and not as_pull:
            raise Refused(412, "", "A commit has happened since. Please refresh and try again.")
        tree = dict(repo.commits[head].tree)
        for line in lines[1:]:
            _apply(line["key"], line["value"], tree, repo.objects)
        ref = f"refs/pr/{len(repo.pulls) + 1}" if as_pull else revision
        oid = repo.commit(ref, Commit(head, header["summary"], tree))
        where = f"{self.server.url}/datasets/{repo_id}"
        pull = {"pullRequestUrl": f"{where}/discussions/{len(repo.pulls)}"} if as_pull else {}
        return {"commitUrl": f"{where}/commit/{oid}", "commitOid": oid, **pull}


def _apply(
    key: str, value: dict[str, Any], tree: dict[str, Blob], objects: Mapping[str, bytes]
) -> None:
    path = value["path"]
    if key == "file":
        tree[path] = Blob(base64.b64decode(value["content"]), large=False)
    elif key == "lfsFile":
        if value["oid"] not in objects:
            raise Refused(400, "", f"{path}: its object was never uploaded")
        tree[path] = Blob(objects[value["oid"]], large=True)
    elif path not in tree:
        raise Refused(404, "EntryNotFound", "A file with this name doesn't exist")
    else:
        del tree[path]


def _folder(path: str) -> dict[str, Any]:
    return {"type": "directory", "path": path, "oid": "0" * 40, "size": 0}


def _known(blob: Blob | None) -> str | None:
    if blob is None:
        return None
    return blob.sha256 if blob.large else blob.oid


def duplicates(lines: list[Request]) -> dict[str, int]:
    """Requests that were made more than once and answered well."""
    counts = Counter(str(line) for line in lines if line.status < 400)
    return {line: count for line, count in counts.items() if count > 1}


_ID, _REV = r"(?P<repo_id>[^/]+/[^/]+)", r"(?P<revision>[^/]+)"
ROUTES: tuple[tuple[str, str, Callable[..., Any]], ...] = (
    ("GET", "/api/whoami-v2", _Handler.whoami),
    ("POST", "/api/repos/create", _Handler.create),
    ("POST", "/api/validate-yaml", _Handler.validate),
    ("GET", f"/api/datasets/{_ID}(?:/revision/{_REV})?", _Handler.info),
    ("GET", f"/api/datasets/{_ID}/refs", _Handler.refs),
    ("POST", f"/api/datasets/{_ID}/tag/{_REV}", _Handler.tag),
    ("GET", f"/api/datasets/{_ID}/tree/{_REV}(?:/(?P<folder>.+))?", _Handler.tree),
    ("POST", f"/api/datasets/{_ID}/paths-info/{_REV}", _Handler.paths),
    ("POST", f"/api/datasets/{_ID}/preupload/{_REV}", _Handler.preupload),
    ("POST", f"/api/datasets/{_ID}/commit/{_REV}", _Handler.commit),
    ("POST", rf"/datasets/{_ID}\.git/info/lfs/objects/batch", _Handler.batch),
    ("PUT", f"/lfs/{_ID}/(?P<oid>[0-9a-f]+)", _Handler.put),
    ("POST", f"/lfs/{_ID}/(?P<oid>[0-9a-f]+)", _Handler.verify),
    ("GET", f"/datasets/{_ID}/resolve/{_REV}/(?P<path>.+)", _Handler.resolve),
)
