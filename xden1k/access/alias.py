"""The name ``xden1k`` for ``datasets.load_dataset``.

``import xden1k`` calls :func:`register`. It does not import ``datasets``: if that is not loaded
yet, a finder waits for the import of ``datasets.load`` and patches it then. The library has no
way to register a name, so inner parts are touched: ``dataset_module_factory``, which turns a name
into a module to load, four fields of the ``DatasetModule`` it returns, and ``register_feature``.
Where they are missing, a warning names :func:`xden1k.load_dataset`, which patches nothing.
"""

from __future__ import annotations

import functools
import importlib.util
import os
import sys
import warnings
from collections.abc import Callable, Iterable
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from xden1k.format.remote import RemotePath

__all__ = ["NAME", "register"]

NAME = "xden1k"
"""What ``load_dataset`` is given, and the name of the dataset in its cache."""

_MODULE = "datasets.load"
_FACTORY = "dataset_module_factory"
_FIELDS = {"module_path", "hash", "builder_kwargs", "dataset_infos"}


def register() -> None:
    """Make ``datasets.load_dataset("xden1k")`` work, now or as soon as ``datasets`` is imported.

    Calling it again changes nothing.
    """
    if _MODULE in sys.modules:
        _patch(sys.modules[_MODULE])
    elif not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())


class _Finder:
    """Finds ``datasets.load`` as the other finders do, and patches it once it has run."""

    def find_spec(
        self, name: str, path: Iterable[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name != _MODULE:
            return None
        sys.meta_path.remove(self)
        try:
            spec = importlib.util.find_spec(name)
        finally:
            sys.meta_path.insert(0, self)
        if spec is not None and spec.loader is not None:
            run = spec.loader.exec_module
            # On the instance, so that the loader stays of its own class, with its own abilities.
            vars(spec.loader)["exec_module"] = functools.partial(_run_and_patch, run)
        return spec


def _run_and_patch(run: Callable[[ModuleType], None], module: ModuleType) -> None:
    run(module)
    _patch(module)


def _patch(load: ModuleType) -> None:
    if not _has_known_names(load):
        warnings.warn(
            f'load_dataset("{NAME}") is not available: this version of datasets has other names '
            "inside than the known ones; use xden1k.load_dataset() instead",
            stacklevel=2,
        )
        return
    import xden1k.format.features  # noqa: F401  (registers the array columns)

    original = getattr(load, _FACTORY)
    if not hasattr(original, "xden1k"):
        factory = _with_alias(original)
        setattr(load, _FACTORY, factory)
        # This module copies the name; it is there if datasets was imported before xden1k.
        if hasattr(inspect := sys.modules.get("datasets.inspect"), _FACTORY):
            setattr(inspect, _FACTORY, factory)


def _has_known_names(load: ModuleType) -> bool:
    fields = getattr(getattr(load, "DatasetModule", None), "__dataclass_fields__", {})
    features = sys.modules.get("datasets.features.features")
    return (
        hasattr(load, _FACTORY)
        and fields.keys() >= _FIELDS
        and hasattr(features, "register_feature")
    )


def _with_alias(original: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(original)
    def factory(path: str, *args: Any, **options: Any) -> Any:
        if path == NAME:
            return _resolve(original, *args, **options)
        return _with_arrays(path, original(path, *args, **options), options)

    vars(factory)["xden1k"] = True
    return factory


def _resolve(
    original: Callable[..., Any],
    revision: object = None,
    download_config: object = None,
    download_mode: object = None,
    data_dir: str | os.PathLike[str] | None = None,
    **options: Any,
) -> Any:
    """Load the data root's folder, but under our name, by our builder, and never stale."""
    from dataclasses import replace

    from xden1k.access.hub import check_revision, folder_digest
    from xden1k.format.checksums import check_document
    from xden1k.format.manifest import Manifest
    from xden1k.format.remote import RemotePath

    root, inside = _root_and_inside(data_dir)
    check_revision(root, revision)
    if isinstance(root, RemotePath):
        from xden1k.access.loading import remote_module

        return remote_module(root)
    Manifest.read(root).check_files(root)  # else a damaged shard is an error that names no file
    check_document(root, "README.md")  # which splits and files there are
    module = original(
        str(root),
        download_config=download_config,
        download_mode=download_mode,
        data_dir=inside,
        **options,
    )
    is_parquet = module.module_path.endswith(".parquet")
    return replace(
        module,
        module_path="xden1k.access.rows" if is_parquet else module.module_path,
        hash=folder_digest(root),
        builder_kwargs={**module.builder_kwargs, "dataset_name": NAME, "data_dir": inside},
        dataset_infos=_infos(module, inside, options.get("data_files")),
    )


def _infos(module: Any, *chosen: Any) -> Any:
    """Return what the card says of splits and columns: nothing of files that the user chose.

    So does ``datasets`` from 5.0.1 on; older versions would miss the splits that were not chosen.
    """
    return None if any(chosen) else module.dataset_infos


def _with_arrays(path: str, module: Any, options: dict[str, Any]) -> Any:
    """Let our builder read what another path or a Hub id turned out to be, if it is ours."""
    if not (_has_known_fields(module) and module.module_path.endswith(".parquet")):
        return module
    folder = Path(path).expanduser()
    if folder.is_dir():
        digest = _digest_of(folder)
    else:  # on the Hub, where the hash is the commit's
        digest = str(module.hash) if _lists_our_columns(module) else None
    if digest is None:
        return module
    from dataclasses import replace
    from hashlib import sha256

    which = [options.get(name) for name in ("data_dir", "data_files")]
    fresh = sha256(f"{NAME} {digest} {which}".encode()).hexdigest()[:32]
    infos = _infos(module, *which)
    return replace(module, module_path="xden1k.access.rows", hash=fresh, dataset_infos=infos)


def _has_known_fields(module: Any) -> bool:
    return getattr(type(module), "__dataclass_fields__", {}).keys() >= _FIELDS


def _digest_of(folder: Path) -> str | None:
    """Return what changes with a dataset folder; None where it is none."""
    from xden1k.access.hub import folder_digest
    from xden1k.format.manifest import MANIFEST_NAME, Manifest

    if not (folder / MANIFEST_NAME).is_file():
        return None
    Manifest.read(folder).check_files(folder)
    return folder_digest(folder)


def _lists_our_columns(module: Any) -> bool:
    from xden1k.format.schema import ARRAY_COLUMNS

    infos = getattr(module, "dataset_infos", None) or {}
    return any((info.features or {}).keys() >= ARRAY_COLUMNS.keys() for info in infos.values())


def _root_and_inside(
    data_dir: str | os.PathLike[str] | None,
) -> tuple[Path | RemotePath, str | None]:
    """Return the dataset folder, and the folder inside it that alone is to be read, if one is."""
    from xden1k.access.hub import data_root
    from xden1k.errors import DataError
    from xden1k.format.manifest import MANIFEST_NAME
    from xden1k.format.remote import RemotePath, is_url

    if data_dir is None or is_url(data_dir):
        return data_root(data_dir), None
    named = Path(data_dir).expanduser()
    if named.is_absolute() or (named / MANIFEST_NAME).is_file():
        return data_root(named), None
    root = data_root()
    if isinstance(root, RemotePath):
        raise DataError(f"data_dir={os.fspath(data_dir)!r} is not there: {root} is read as a whole")
    if not (root / named).is_dir():
        raise DataError(
            f"data_dir={os.fspath(data_dir)!r} is neither a dataset folder ({named.absolute()} "
            f"has no {MANIFEST_NAME}) nor a folder inside {root}"
        )
    return root, os.fspath(data_dir)
