"""``load_dataset`` without the alias: the same rows by the public interface of ``datasets``."""

from __future__ import annotations

import os
from typing import Any

from datasets.data_files import DataFilesDict, DataFilesList
from datasets.exceptions import DatasetGenerationError
from datasets.info import DatasetInfosDict
from datasets.load import BuilderConfigsParameters, DatasetModule
from huggingface_hub import DatasetCard

from xden1k.access.alias import NAME
from xden1k.access.hub import check_revision, data_root, folder_digest
from xden1k.access.rows import Rows, RowsConfig
from xden1k.errors import DataError
from xden1k.format.checksums import check_document
from xden1k.format.manifest import Manifest
from xden1k.format.remote import RemotePath

__all__ = ["load_dataset", "remote_module"]

_CONFIGS = ("default", "metadata")


def load_dataset(
    name: str | None = None,
    split: str | None = None,
    *,
    root: str | os.PathLike[str] | None = None,
    repo_id: str | None = None,
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
        ``train``, ``val``, ``test``, ``unseen``, a slice or a sum of them; None = a dict of all
        there are.
    root
        A dataset folder or a URL; None = as :func:`xden1k.data_root` finds it.
    repo_id
        In its place, a dataset repository on the Hub, ``owner/name``, read where it is.
    revision
        With ``repo_id`` a tag, branch or commit; else raises where the folder holds another
        version.
    streaming
        Read the shards while iterating, without writing a cache. Of a URL, only the columns asked
        for are fetched.
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
    if repo_id is not None:
        if root is not None:
            raise DataError("root and repo_id both say where the data is: give one of them")
        root, revision = f"hf://datasets/{repo_id}@{revision or 'main'}", None
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
    card = check_document(folder, "README.md")  # which features there are
    if isinstance(folder, RemotePath):
        infos, files = _infos(card), _remote_files(folder, manifest, name)
    else:
        manifest.check_files(folder)
        infos, files = DatasetInfosDict.from_directory(str(folder)), _files(manifest, name)
    return Rows(
        cache_dir=cache_dir,
        dataset_name=NAME,
        config_name=name,
        version=manifest.version,
        hash=folder_digest(folder),
        base_path=str(folder),
        info=infos.get(name),
        data_files=files,
        **options,
    )


def _files(manifest: Manifest, config: str) -> dict[str, list[str]]:
    return {
        split: [file.path for file in manifest.shards(config, split)] for split in manifest.splits
    }


def _remote_files(folder: RemotePath, manifest: Manifest, config: str) -> DataFilesDict:
    """Name the files of a config by their URLs, so that nothing looks for them."""
    lists = {
        split: [str(folder / path) for path in paths]
        for split, paths in _files(manifest, config).items()
    }
    return DataFilesDict(
        {
            split: DataFilesList(urls, origin_metadata=[(url,) for url in urls])
            for split, urls in lists.items()
        }
    )


def _infos(card: bytes) -> DatasetInfosDict:
    return DatasetInfosDict.from_dataset_card_data(DatasetCard(card.decode()).data)


def remote_module(folder: RemotePath) -> DatasetModule:
    """Return what ``datasets`` makes a builder from, of a folder at a URL."""
    manifest = Manifest.read(folder)
    configs = [
        RowsConfig(
            name=name,
            version=manifest.version,
            data_files=_remote_files(folder, manifest, name),
        )
        for name in _CONFIGS
    ]
    return DatasetModule(
        module_path="xden1k.access.rows",
        hash=folder_digest(folder),
        builder_kwargs={"base_path": str(folder), "dataset_name": NAME},
        builder_configs_parameters=BuilderConfigsParameters(
            builder_configs=configs, default_config_name=_CONFIGS[0]
        ),
        dataset_infos=_infos(check_document(folder, "README.md")),
    )
