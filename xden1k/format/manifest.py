"""The manifest of a dataset folder: what it holds, made by what, and the checksum of each file."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from xden1k.errors import DataError
from xden1k.format.checksums import check_document, footer_sha256
from xden1k.format.remote import RemoteFile, RemotePath

__all__ = [
    "MANIFEST_NAME",
    "SCHEMA",
    "SCHEMA_WITHOUT_RADIOGRAPHS",
    "DataFile",
    "Disturbed",
    "Manifest",
]

SCHEMA = "xden-dataset/1"
SCHEMA_WITHOUT_RADIOGRAPHS = "xden-dataset/2"
"""The same, but some objects have no radiographs, at which a reader of the first would fail."""
MANIFEST_NAME = "manifest.json"


@dataclass(frozen=True, slots=True)
class DataFile:
    """One Parquet file.

    Parameters
    ----------
    path
        Relative to the folder, with slashes.
    config
        ``default`` (``data/``) or ``metadata`` (``metadata/``).
    split
        ``train``, ``val``, ``test``, ``unseen`` or ``private``.
    rows
        Number of rows, one per object.
    bytes
        Size of the file.
    num_bytes
        Size of the rows in Arrow memory.
    sha256
        Checksum of the file, hexadecimal.
    footer_sha256
        Checksum of its footer, which is read before every use; empty in older folders.
    """

    path: str
    config: str
    split: str
    rows: int
    bytes: int
    num_bytes: int
    sha256: str
    footer_sha256: str = ""

    def remote(self, root: RemotePath) -> RemoteFile:
        """Open the file at a URL.

        Raises
        ------
        DataError
            If it is not there, cut short, or its footer is another.
        """
        try:
            return RemoteFile(root / self.path, self.bytes, self.sha256, self.footer_sha256)
        except FileNotFoundError as err:
            raise DataError(f"{root / self.path} is missing: the manifest lists it") from err

    def check(self, root: Path | RemotePath) -> None:
        """Refuse a file that is not there, not of its size, or whose footer is another.

        Raises
        ------
        DataError
            With the file, and what was expected and found.
        """
        if isinstance(root, RemotePath):
            self.remote(root)
            return
        path = root / self.path
        hint = f"`xden verify {root}` lists every such file"
        if not path.is_file():
            raise DataError(f"{path} is missing: the manifest lists it, {self.bytes} bytes; {hint}")
        if (size := path.stat().st_size) != self.bytes:
            raise DataError(
                f"{path}: {size} bytes, the manifest says {self.bytes}: cut short or changed; "
                f"{hint}"
            )
        if self.footer_sha256 and footer_sha256(path) != self.footer_sha256:
            raise DataError(f"{path}: its footer is not the manifest's: damaged or changed; {hint}")


@dataclass(frozen=True, slots=True)
class Disturbed:
    """What was done on purpose to the radiographs of a copy of a folder.

    Parameters
    ----------
    radiographs
        Clause of which they are the subject.
    seed
        Of what was drawn.
    of
        Checksum of the manifest of the folder that was copied, hexadecimal.
    """

    radiographs: str
    seed: int
    of: str


@dataclass(frozen=True, slots=True)
class Manifest:
    """What a dataset folder holds.

    Parameters
    ----------
    version
        Of the data, ``MAJOR.MINOR.PATCH``.
    builder
        Name and version of the program that made it.
    config_sha256
        Checksum of the settings it was made with; empty where there were none.
    splits
        Objects in each split.
    sources
        Objects from each source: ``scan``, ``phantom``, ``ct``, ``published``.
    density_sources
        Parts with each source of density: ``xray``, ``prior``, ``weighed``, ``truth``, ``none``,
        ``withheld``.
    files
        The Parquet files, sorted by path.
    labels
        Parts by what their labels show, :data:`~xden1k.format.label_counts.LABEL_COUNTS`; empty in
        older folders.
    without_radiographs
        Objects without radiographs in each split that has some.
    disturbed
        What was done to the radiographs of a copy of another folder; None where nothing was.
    on_partnext
        Objects that are simulated materials on shapes of PartNeXt.
    """

    version: str
    builder: str
    config_sha256: str
    splits: dict[str, int]
    sources: dict[str, int]
    density_sources: dict[str, int]
    files: tuple[DataFile, ...]
    labels: dict[str, int] = field(default_factory=dict)
    without_radiographs: dict[str, int] = field(default_factory=dict)
    disturbed: Disturbed | None = None
    on_partnext: int = 0

    @property
    def schema(self) -> str:
        """What a reader must know of: the first schema, unless radiographs are missing."""
        return SCHEMA_WITHOUT_RADIOGRAPHS if self.without_radiographs else SCHEMA

    @property
    def objects(self) -> int:
        """Number of objects."""
        return sum(self.splits.values())

    @property
    def simulated(self) -> bool:
        """Whether no object was ever on a scanner."""
        return self.sources.keys() <= {"phantom"}

    @property
    def has_radiographs(self) -> bool:
        """Whether any object has radiographs."""
        return sum(self.without_radiographs.values()) < self.objects

    def shards(self, config: str = "default", split: str | None = None) -> tuple[DataFile, ...]:
        """Files of one config, of one split or of all."""
        return tuple(
            file for file in self.files if file.config == config and split in (None, file.split)
        )

    def check_files(self, root: Path | RemotePath) -> None:
        """Refuse a folder in which a file is missing, of another size, or has another footer.

        Raises
        ------
        DataError
            With the first such file.
        """
        for file in self.files:
            file.check(root)

    def to_json(self) -> str:
        """Text of ``manifest.json``."""
        values = {"schema": self.schema, "name": "xden1k", "objects": self.objects} | asdict(self)
        for name in ("without_radiographs", "disturbed", "on_partnext"):
            if not values[name]:  # a folder of which there is nothing to tell keeps its bytes
                del values[name]
        return json.dumps(values, indent=2, ensure_ascii=False) + "\n"

    @classmethod
    def read(cls, root: Path | RemotePath, *, damaged: bool = False) -> Manifest:
        """Read the manifest of a dataset folder.

        Parameters
        ----------
        root
            The folder.
        damaged
            Take it although it is not the one that the list of checksums names.

        Raises
        ------
        DataError
            If there is none, it is not one of ours, or not the one in the list of checksums.
        """
        path = root / MANIFEST_NAME
        try:
            content = path.read_bytes() if damaged else check_document(root, MANIFEST_NAME)
            return cls._from_dict(json.loads(content))
        except DataError:
            raise
        except FileNotFoundError as err:
            missing = isinstance(root, Path) and not root.is_dir()
            why = "there is no such folder" if missing else f"no {MANIFEST_NAME}{_found(root)}"
            raise DataError(f"{root}: not a dataset folder: {why}") from err
        except (ValueError, TypeError, KeyError) as err:
            known = f"{SCHEMA} or {SCHEMA_WITHOUT_RADIOGRAPHS}"
            raise DataError(f"{path}: not a manifest of schema {known}: {err!r}") from err

    @classmethod
    def _from_dict(cls, values: dict[str, Any]) -> Manifest:
        if values["schema"] not in (SCHEMA, SCHEMA_WITHOUT_RADIOGRAPHS):
            raise ValueError(f"schema is {values['schema']}")
        names = ("version", "builder", "config_sha256", "splits", "sources", "density_sources")
        files = tuple(DataFile(**file) for file in values["files"])
        return cls(
            **{name: values[name] for name in names},
            files=files,
            labels=dict(values.get("labels", {})),
            without_radiographs=dict(values.get("without_radiographs", {})),
            disturbed=Disturbed(**values["disturbed"]) if "disturbed" in values else None,
            on_partnext=int(values.get("on_partnext", 0)),
        )


def _found(root: Path | RemotePath) -> str:
    """Say what a URL holds in its place."""
    if not isinstance(root, RemotePath):
        return ""
    try:
        names = root.names()
    except FileNotFoundError:
        return ", there is nothing"
    shown = ", ".join(names[:5]) or "nothing"
    return f" among {shown}{' ...' * (len(names) > 5)}; only what xden-build wrote can be read"
