"""From what is typed to an import: source, roles, unit, objects, splits."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from xden1k.errors import DataError, require
from xden1k.values.types import Split
from xden_builder.pipeline.outcomes import BuildReport
from xden_builder.pipeline.splits import draw_splits, read_splits
from xden_builder.published.reading import (
    HubSource,
    Release,
    Roles,
    Unit,
    chosen_folders,
    find_source,
    open_release,
    read_roles,
    unit_of,
)
from xden_builder.published.reading.item import object_id_of
from xden_builder.published.reading.layout import ObjectFolder
from xden_builder.published.report import DryRun, dry_run
from xden_builder.published.run import ImportSettings, import_items

__all__ = ["Plan", "look", "plan"]


@dataclass(frozen=True, slots=True)
class Plan:
    """An import that is ready to be run.

    Parameters
    ----------
    told
        What it is going to do, one line.
    count
        Of objects.
    run
        Takes the folder to write and how, as :func:`xden_builder.published.run.import_items`.
    """

    told: str
    count: int
    run: Callable[..., BuildReport]


def look(
    source: str,
    *,
    objects: str = "",
    revision: str | None = None,
    size_unit: Unit | None = None,
    splits: Path | None = None,
    roles: Path | None = None,
) -> DryRun:
    """Look at a release without making anything; a table of splits is read all the same.

    Raises
    ------
    DataError
        If there is no release.
    """
    release = _opened(source, revision, roles)
    folders = chosen_folders(release, objects)
    _splits(release, splits)
    return dry_run(release, folders, size_unit)


def plan(
    source: str,
    *,
    objects: str = "",
    revision: str | None = None,
    size_unit: Unit | None = None,
    splits: Path | None = None,
    roles: Path | None = None,
) -> Plan:
    """Find everything that an import needs, and fetch the files.

    Raises
    ------
    DataError
        If there is no release, or something about it as a whole is not as expected.
    """
    release = _opened(source, revision, roles)
    if release.metadata is None:
        raise DataError(release.problem)
    folders = chosen_folders(release, objects)
    unit = size_unit or unit_of(release)
    drawn = _splits(release, splits)
    told = _announced(release, folders)
    run = partial(_fetch_and_import, release, folders, unit, drawn, _settings(roles))
    return Plan(told, len(folders), run)


def _opened(source: str, revision: str | None, roles: Path | None) -> Release:
    require("nibabel", "import")  # before objects fail for want of it, one by one
    told = Roles() if roles is None else read_roles(roles)
    return open_release(find_source(source, revision), told)


def _settings(roles: Path | None) -> ImportSettings:
    return ImportSettings(None if roles is None else read_roles(roles).scanner)


def _announced(release: Release, folders: Sequence[ObjectFolder]) -> str:
    """Say how much is read; of a repository, before it is downloaded."""
    needed, source = release.needed(folders), release.source
    size = sum(file.bytes for file in needed) / 1e6
    told = f"{source.name}: {len(folders)} of {len(release.layout.objects)} objects, {size:.1f} MB"
    if not isinstance(source, HubSource):
        return told
    missing, free = source.missing_bytes(needed), source.free_bytes()
    if missing > free:
        raise DataError(
            f"{source.name}: {missing / 1e6:.0f} MB are to be downloaded, {free / 1e6:.0f} MB are "
            f"free at {source.cached}: make room, or choose fewer by --objects"
        )
    return (
        f"{told} at commit {source.commit[:12]}, {missing / 1e6:.1f} MB to download to "
        f"{source.cached}, {free / 1e6:.0f} MB free"
    )


def _splits(release: Release, told: Path | None) -> Mapping[str, Split]:
    """Give every object of the release a split, whichever of them are imported."""
    categories = {}
    for folder in release.layout.objects:
        try:
            categories[object_id_of(folder.key)] = release.entry(folder.key).category
        except DataError:
            categories[object_id_of(folder.key)] = ""  # fails when it is read
    stated = {} if told is None else read_splits(told)
    if strange := sorted(stated.keys() - categories):
        raise DataError(f"{told}: expected ids of the release, got {strange[0]}")
    return draw_splits(categories, stated)


def _fetch_and_import(
    release: Release,
    folders: Sequence[ObjectFolder],
    unit: Unit,
    splits: Mapping[str, Split],
    settings: ImportSettings,
    out: Path,
    **how: object,
) -> BuildReport:
    needed = [file.path for file in release.needed(folders)]
    items = release.items(folders, release.source.fetch(needed).absolute(), unit)
    return import_items(items, splits, out, settings, source=release.source.name, **how)  # type: ignore[arg-type]
