"""``load_dataset`` without the alias: the same rows by the public interface of ``datasets``."""

from __future__ import annotations

import os
from typing import Any

from datasets.exceptions import DatasetGenerationError
from datasets.info import DatasetInfosDict

from xden1k.access.alias import NAME
from xden1k.access.hub import check_revision, data_root, folder_digest
from xden1k.access.rows import Rows
from xden1k.errors import DataError
from xden1k.format.checksums import check_document
from xden1k.format.manifest import Manifest

__all__ = ["load_dataset"]

_CONFIGS = ("default", "metadata")


def load_dataset(
    name: str | None = None,
    split: str | None = None,
    *,
    root: str | os.PathLike[str] | None = None,
    revision: str | None = None,
    streaming: bool = False,
    num_proc: int | None = None,
    cache_dir: str | os.PathLike[str] | None = None,
    **options: Any,
) -> Any:
    """Rows as ``datasets.load_dataset("xden1k", ...)`` gives them, array columns decoded.

    Parameters
    ----------
    name
        ``default`` (everything; also None) or ``metadata`` (the light columns).
    split
        ``train``, ``val``, ``test``, a slice or a sum of them; None = a dict of all there are.
    root
        A dataset folder; None = as :func:`xden1k.data_root` finds it.
    revision
        Raises where the folder holds another version.
    streaming
        Read the shards while iterating, without writing a cache.
    num_proc
        Processes that write the cache.
    cache_dir
        Where the cache lies; None = where ``datasets`` has it.
    **options
        Of the Parquet builder of ``datasets``: ``columns``, ``filters``, ``features`` ...

    Returns
    -------
    datasets.Dataset or datasets.IterableDataset, or a dict of them

    Raises
    ------
    DataError
        If there is no such config, the folder is no dataset folder or holds another revision, or
        a file of it is missing or cut short.
    """
    builder = _builder(name or "default", root, revision, cache_dir, options)
    if streaming:
        return builder.as_streaming_dataset(split=split)
    try:
        builder.download_and_prepare(num_proc=num_proc)
    except DatasetGenerationError as err:
        if isinstance(err.__cause__, DataError):
            raise err.__cause__ from None
        raise
    return builder.as_dataset(split=split)


def _builder(
    name: str,
    root: str | os.PathLike[str] | None,
    revision: str | None,
    cache_dir: str | os.PathLike[str] | None,
    options: dict[str, Any],
) -> Rows:
    if name not in _CONFIGS:
        raise DataError(f"config must be one of {_CONFIGS}, got {name!r}")
    folder = data_root(root)
    check_revision(folder, revision)
    manifest = Manifest.read(folder)
    manifest.check_files(folder)
    check_document(folder, "README.md")  # which features there are
    return Rows(
        cache_dir=cache_dir,
        dataset_name=NAME,
        config_name=name,
        version=manifest.version,
        hash=folder_digest(folder),
        base_path=str(folder),
        info=DatasetInfosDict.from_directory(str(folder)).get(name),
        data_files={
            split: [file.path for file in manifest.shards(name, split)] for split in manifest.splits
        },
        **options,
    )
