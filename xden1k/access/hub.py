"""Where the dataset lies on this machine, and how it gets there.

The first of these that is there: the ``root`` argument, the environment variable
``XDEN1K_ROOT``, the user's cache (filled by :func:`download`), the sample in the package. The
first two may be URLs, of which is fetched what is read: ``hf://datasets/OWNER/NAME@TAG``.
"""

from __future__ import annotations

import hashlib
import logging
import os
import shutil
import warnings
from functools import cache
from pathlib import Path

from xden1k.errors import DataError
from xden1k.format.cache import cache_folder
from xden1k.format.manifest import MANIFEST_NAME, Manifest
from xden1k.format.remote import RemotePath, root_of

__all__ = [
    "REPO_ID",
    "ROOT_VARIABLE",
    "SAMPLE",
    "cache_folder",
    "check_revision",
    "data_root",
    "download",
    "folder_digest",
]

REPO_ID = "zhangjxx/XDen-1K"
"""The Hub repository :func:`download` takes by default."""
ROOT_VARIABLE = "XDEN1K_ROOT"
"""The environment variable that names a dataset folder."""
SAMPLE = Path(__file__).parents[1] / "sample"
"""The dataset folder of a few simulated objects that ships in the package."""

_CURRENT = "current"

logger = logging.getLogger(__name__)


def data_root(root: str | os.PathLike[str] | None = None) -> Path | RemotePath:
    """Return the dataset folder to use: absolute, and with a manifest; of a URL, its commit.

    Parameters
    ----------
    root
        A dataset folder, or a URL that fsspec knows; None = ``XDEN1K_ROOT``, else the user's
        cache, else the packaged sample, with one warning that says so.

    Raises
    ------
    DataError
        If the folder named by the argument or the variable is not a dataset folder.
    """
    if root is not None:
        return _checked(root, "root")
    if from_environment := os.environ.get(ROOT_VARIABLE):
        return _checked(from_environment, ROOT_VARIABLE)
    if (pointer := cache_folder() / _CURRENT).is_file():
        return _checked(pointer.parent / pointer.read_text(encoding="utf-8"), str(pointer))
    _say_that_it_is_the_sample()
    return _checked(SAMPLE, "the packaged sample")


def _checked(root: str | os.PathLike[str], named_by: str) -> Path | RemotePath:
    folder = root_of(root if isinstance(root, str | RemotePath) else Path(root))
    if isinstance(folder, RemotePath):
        return folder  # reading its manifest says whether it is one
    folder = folder.expanduser().absolute()
    if not (folder / MANIFEST_NAME).is_file():
        why = f"it has no {MANIFEST_NAME}" if folder.is_dir() else "there is no such folder"
        raise DataError(f"{folder} (from {named_by}) is not a dataset folder: {why}")
    return folder


@cache
def _say_that_it_is_the_sample() -> None:
    warnings.warn(
        "using the small simulated sample of the package: get the dataset by `xden download`, or "
        f"set {ROOT_VARIABLE} to a dataset folder, for instance one made by `xden-build run` or "
        "`xden-build phantoms --as-dataset`",
        stacklevel=3,
    )


def check_revision(folder: Path | RemotePath, revision: object) -> None:
    """Refuse a revision other than the one that lies here; None is any.

    Raises
    ------
    DataError
        If ``revision`` is neither the folder's version, with or without a leading ``v``, nor the
        commit by which a downloaded folder is named.
    """
    here = Manifest.read(folder).version
    named = folder.name if isinstance(folder, Path) else None
    if revision is None or str(revision).removeprefix("v") == here or revision == named:
        return
    if folder == SAMPLE:
        raise DataError(
            f"revision {revision} was asked for, but nothing is downloaded: there is only the "
            f"sample in the package; get it by `xden download --revision {revision}`"
        )
    raise DataError(
        f"revision {revision} was asked for, but {folder} holds {here}: "
        f"get another by `xden download --revision {revision}`"
    )


def folder_digest(folder: Path | RemotePath) -> str:
    """Return what changes whenever the card, the manifest or a shard does; reads no shard.

    Of a URL, a shard that is changed without its manifest is an error when it is read.
    """
    digest = hashlib.sha256()
    for path in (folder / MANIFEST_NAME, folder / "README.md"):
        digest.update(path.read_bytes())
    if isinstance(folder, RemotePath):
        return digest.hexdigest()[:32]
    for file in Manifest.read(folder, damaged=True).files:
        stat = (folder / file.path).stat()
        digest.update(f"{file.path} {stat.st_size} {stat.st_mtime_ns}\n".encode())
    return digest.hexdigest()[:32]


def download(
    repo_id: str = REPO_ID, revision: str | None = None, *, manifest_sha256: str | None = None
) -> Path:
    """Fetch a dataset folder from the Hugging Face Hub into the user's cache, and verify it.

    It becomes the folder :func:`data_root` gives only when it is complete and its checksums are
    right. An interrupted download is resumed by the next call.

    Parameters
    ----------
    repo_id
        A dataset repository, ``owner/name``.
    revision
        A tag, branch or commit; None = the newest.
    manifest_sha256
        Checksum that its manifest must have; None = any.

    Returns
    -------
    Path
        The dataset folder, named by its commit.

    Raises
    ------
    DataError
        If the Hub cannot be reached, has no such repository or revision, or what it has is not
        a dataset folder of this project, arrives damaged, or has another manifest.
    """
    from huggingface_hub.errors import HfHubHTTPError, HFValidationError

    # The bases of the Hub's own error are OSError and the error of whichever HTTP client it has.
    failures: tuple[type[BaseException], ...] = (*HfHubHTTPError.__bases__, HFValidationError)
    try:
        return _download(repo_id, revision, manifest_sha256)
    except failures as err:
        reason = next(iter(str(err).strip().splitlines()), "") or type(err).__name__
        raise DataError(
            f"cannot download {repo_id} at {revision or 'its newest revision'}: {reason}"
        ) from err


def _download(repo_id: str, revision: str | None, manifest_sha256: str | None) -> Path:
    import huggingface_hub

    info = huggingface_hub.HfApi().dataset_info(repo_id, revision=revision)
    _check_layout(repo_id, [file.rfilename for file in info.siblings or ()])
    folder = cache_folder() / repo_id.replace("/", "--") / str(info.sha)
    if not folder.is_dir():
        partial = folder.with_name(f"{info.sha}.partial")
        huggingface_hub.snapshot_download(
            repo_id,
            repo_type="dataset",
            revision=info.sha,
            local_dir=partial,
            ignore_patterns=[".gitattributes"],
        )
        _verify_or_remove(partial)
        partial.rename(folder)
    _check_manifest(folder, repo_id, manifest_sha256)
    logger.info("%s at %s is in %s", repo_id, info.sha, folder)
    _make_current(folder)
    return folder


def _check_layout(repo_id: str, files: list[str]) -> None:
    if MANIFEST_NAME not in files:
        shown = ", ".join(sorted(files)[:5]) or "nothing"
        ours = "only folders that xden-build wrote can be read"
        release = f"it is the authors' release: xden import {REPO_ID} --out ROOT"
        raise DataError(
            f"the Hub repository {repo_id} is not laid out as this project's dataset folders: no "
            f"{MANIFEST_NAME} among its {len(files)} files ({shown} ...); "
            f"{release if repo_id == REPO_ID else ours}"
        )


def _verify_or_remove(folder: Path) -> None:
    from xden1k.folder.verify import verify_folder

    shutil.rmtree(folder / ".cache", ignore_errors=True)  # where the Hub's client keeps its notes
    if problems := verify_folder(folder):
        shutil.rmtree(folder)  # resuming would trust the damaged file
        raise DataError(f"the download has {len(problems)} problems; the first: {problems[0]}")


def _check_manifest(folder: Path, repo_id: str, expected: str | None) -> None:
    found = hashlib.sha256((folder / MANIFEST_NAME).read_bytes()).hexdigest()
    if expected not in (None, found):
        raise DataError(
            f"{repo_id} at {folder.name}: its manifest must have the sha256 {expected}, got {found}"
        )


def _make_current(folder: Path) -> None:
    """Point to the folder by a file replaced in one step, so that no reader sees half a change."""
    pointer = cache_folder() / _CURRENT
    fresh = pointer.with_suffix(".new")
    fresh.write_text(folder.relative_to(pointer.parent).as_posix(), encoding="utf-8")
    fresh.replace(pointer)
