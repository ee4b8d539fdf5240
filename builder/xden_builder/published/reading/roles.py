"""What a file of a release is for, by its name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import Final, Literal, get_args

from xden1k.errors import DataError
from xden1k.values.settings import read_toml
from xden_builder.capture.tables import TomlTable

__all__ = ["DEFAULT_PATTERNS", "ROLES", "Role", "Roles", "read_roles"]

Role = Literal["mesh", "volume", "table", "image", "metadata"]
ROLES: Final[tuple[Role, ...]] = get_args(Role)

DEFAULT_PATTERNS: Final[Mapping[Role, tuple[str, ...]]] = MappingProxyType(
    {
        "mesh": ("*.glb", "*.gltf", "*.obj", "*.ply"),
        "volume": ("*.nii.gz", "*.nii"),
        "table": ("*.json",),
        "image": ("*.png", "*.jpg", "*.jpeg", "*.tif", "*.tiff", "*.bmp", "*.dcm", "*.exr"),
        "metadata": ("*.json",),
    }
)
"""Names by role, as globs without regard to case; ``metadata`` lies beside or above the objects."""
SCANNER: Final = "scanner"


@dataclass(frozen=True, slots=True)
class Roles:
    """How files are told apart, and which images are radiographs.

    Parameters
    ----------
    patterns
        Globs of names by role.
    scanner
        A ``scanner.toml`` that says which image is which view, what its pixels mean and where it
        was taken from, in the object frame; None: no image is a radiograph.
    """

    patterns: Mapping[Role, tuple[str, ...]] = field(default_factory=lambda: DEFAULT_PATTERNS)
    scanner: Path | None = None

    def __reduce__(self) -> tuple[type[Roles], tuple[dict[Role, tuple[str, ...]], Path | None]]:
        """Be pickled for workers, which a read-only mapping cannot be."""
        return Roles, (dict(self.patterns), self.scanner)

    def fits(self, path: PurePosixPath, role: Role) -> bool:
        """Whether a file's name goes with a role."""
        return any(fnmatch(path.name.lower(), glob.lower()) for glob in self.patterns[role])


def read_roles(path: Path) -> Roles:
    """Read a mapping file: a table ``[roles]`` of globs, and ``scanner`` for radiographs.

    Raises
    ------
    DataError
        If it is no TOML, a key is unknown or of a wrong kind, or the scanner file is not there.
    """
    table = TomlTable(path, "", read_toml(path))
    table.refuse_unknown(("roles", SCANNER))
    told = table.table("roles")
    told.refuse_unknown(ROLES)
    patterns = {
        role: _globs(told, role) if role in told else DEFAULT_PATTERNS[role] for role in ROLES
    }
    name = table.get_or_none(SCANNER, lambda value: isinstance(value, str), "the name of a file")
    scanner = None if name is None else path.parent / name
    if scanner is not None and not scanner.is_file():
        raise DataError(f"{path}: {SCANNER} must name a scanner.toml, no such file: {scanner}")
    return Roles(patterns, scanner)


def _globs(table: TomlTable, role: Role) -> tuple[str, ...]:
    value = table.get(role, _is_globs, "a glob such as *.glb, or a list of them")
    return (value,) if isinstance(value, str) else tuple(value)


def _is_globs(value: object) -> bool:
    several = value if isinstance(value, list) else [value]
    return bool(several) and all(isinstance(each, str) and each for each in several)
