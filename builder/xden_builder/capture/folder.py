"""A capture folder: which objects there are, and each of them as one value."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

from xden1k.errors import DataError, MissingObjectError
from xden1k.values.arrays import Image
from xden1k.values.ply import CM_PER_UNIT
from xden1k.values.types import CAPTURED, SPLITS, Source, Split
from xden1k.values.views import XRayView
from xden_builder.capture.calibration import CalibratedView, calibrate
from xden_builder.capture.ct import CTReference, read_ct
from xden_builder.capture.ignored import ignore_name, masks, refuse_other_masks, without_ignored
from xden_builder.capture.meshes import MESH_SUFFIXES
from xden_builder.capture.origin import ORIGIN_NAME, files_digest, refuse_stale
from xden_builder.capture.parts import CapturePart, read_parts
from xden_builder.capture.pose import MeshScale, PoseTold, read_mesh_scale, read_pose
from xden_builder.capture.scanner import DATASET_VIEWS, ScannerFile, read_scanner
from xden_builder.capture.tables import CsvRow, number_or_nan, read_csv, refuse_wrong
from xden_builder.physics.source import Detector, Tube

__all__ = ["REGISTRATION_NAME", "Capture", "CaptureFolder", "ObjectRow"]

REGISTRATION_NAME = "registration.json"
"""Beside parts that were put into the scanner's frame: how."""
_REQUIRED = ("object_id", "category")
_OPTIONAL = (
    "mesh_units",
    "mass_g",
    "split",
    "source",
    "notes",
    "pose",
    "mesh_scale",
    "mesh_sd_mm",
)
_MOST_MESH_SD_MM = 5.0
"""Meshes that are farther off are none of the object."""
_MOST_MASS_G = 1e7
"""Ten tonnes: no scanner holds more."""


@dataclass(frozen=True, slots=True)
class ObjectRow:
    """One row of ``objects.csv``.

    Parameters
    ----------
    object_id, category
        Its name and its class.
    mesh_units
        ``cm``, ``mm``, ``m`` or ``in``.
    weighed_mass_g
        From a scale; None if it never was on one.
    split
        None where the builder may choose.
    source
        ``scan`` where the file does not say.
    notes
        Free text.
    pose
        Where its meshes are in the scanner's frame.
    mesh_scale
        What is known of the size of its meshes.
    mesh_sd_mm
        How far the surface of a part may lie inside or outside of the mesh's: a standard
        deviation.
    """

    object_id: str
    category: str
    mesh_units: str = "cm"
    weighed_mass_g: float | None = None
    split: Split | None = None
    source: Source = "scan"
    notes: str = ""
    pose: PoseTold = "near"
    mesh_scale: MeshScale = "known"
    mesh_sd_mm: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Capture:
    """What came off the scanner and the annotation desk for one object.

    Parameters
    ----------
    object_id, category, split, source, weighed_mass_g, notes
        As in ``objects.csv``; see :class:`ObjectRow`.
    tube
        None where the source is not known: attenuation only, no density.
    detector
        Scintillator and bits, where known.
    views
        The radiographs ``pa`` and ``lat``, in this order.
    audit_views
        Further radiographs that are not fitted.
    parts
        Sorted by name; they may overlap.
    flags
        What was noticed on reading, as ``VIEW:flag`` and ``PART:flag``.
    noise_sd
        By view, where a dark image was taken: standard deviation of the transmission behind
        something opaque.
    open_field
        By view, where a flat image was taken: light of the bare beam, in any unit.
    at_least
        By view, where any pixel is saturated: the transmission that each of those reaches at
        least; not a number elsewhere.
    pose, mesh_scale
        As in ``objects.csv``. The parts are as their files hold them, in cm.
    further_views
        Radiographs that are fitted beside ``pa`` and ``lat``.
    turned
        Names of the fitted views before which the object was turned by hand: the geometry of each
        is told roughly, and its pose is its own.
    mesh_units
        As in ``objects.csv``: of the files that the parts were read from.
    mesh_sd_cm
        How far the surface of each part may lie inside or outside of its mesh's: a standard
        deviation, ``mesh_sd_mm`` of ``objects.csv``.
    """

    object_id: str
    category: str
    split: Split | None
    source: Source
    weighed_mass_g: float | None
    notes: str
    tube: Tube | None
    detector: Detector
    views: tuple[XRayView, XRayView]
    audit_views: tuple[XRayView, ...]
    parts: tuple[CapturePart, ...]
    flags: tuple[str, ...]
    noise_sd: Mapping[str, float]
    open_field: Mapping[str, Image] = field(default_factory=dict)
    at_least: Mapping[str, Image] = field(default_factory=dict)
    pose: PoseTold = "near"
    mesh_scale: MeshScale = "known"
    further_views: tuple[XRayView, ...] = ()
    turned: frozenset[str] = frozenset()
    mesh_units: str = "cm"
    mesh_sd_cm: float = 0.0

    @property
    def fitted_views(self) -> tuple[XRayView, ...]:
        """``pa``, ``lat``, and the further views that are fitted."""
        return (*self.views, *self.further_views)

    @property
    def scale_sought(self) -> bool:
        """Whether how large its meshes are is found along with their pose, or was."""
        return self.mesh_scale == "unknown"

    @property
    def all_views(self) -> tuple[XRayView, ...]:
        """Every radiograph, those that are fitted first."""
        return (*self.fitted_views, *self.audit_views)


@dataclass(frozen=True)
class CaptureFolder:
    """A capture folder.

    A wrong ``objects.csv`` is an error of the folder, everything else of its object alone.

    Parameters
    ----------
    root
        Holds ``objects.csv``.
    parts_root
        Another folder of ``OBJECT_ID/parts/NAME.ply`` (or ``OBJECT_ID/mesh.glb``), in the same
        units, in place of the annotated meshes. ``OBJECT_ID/parts.csv`` there, if any, replaces the
        annotated one; without it a part keeps what the annotated one says of its name. Parts
        beside a ``registration.json`` stand in the scanner's frame, whatever ``objects.csv`` says.
        They are refused where a ``made_from.json`` beside them is not :meth:`made_from`.
    rows
        The objects by id; those of ``objects.csv`` where none are given. A folder of one row is
        small enough to be sent to another process.

    Raises
    ------
    DataError
        If ``objects.csv`` is missing or wrong; the message names row and column.
    """

    root: Path
    parts_root: Path | None = None
    rows: Mapping[str, ObjectRow] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not self.rows:
            object.__setattr__(self, "rows", _object_rows(self.root / "objects.csv"))

    @property
    def object_ids(self) -> tuple[str, ...]:
        """The objects, in the order of ``objects.csv``."""
        return tuple(self.rows)

    def read(self, object_id: str) -> Capture:
        """Read one object.

        Raises
        ------
        MissingObjectError
            If ``objects.csv`` has no such object.
        DataError
            If anything of it is missing or wrong; one line that names the file and the key.
        MissingExtraError
            If a package that decoding needs is not installed.
        """
        row = self._row(object_id)
        self._refuse_no_folder(object_id)
        meshes, _, _ = self._part_files(object_id)
        in_place = (meshes / REGISTRATION_NAME).is_file()
        scanner = self._scanner(object_id)
        views = {view.view.name: view for view in self._views(object_id, scanner)}
        pa, lat = (views[name].view for name in DATASET_VIEWS)
        parts, part_flags = self.parts(object_id)
        return Capture(
            object_id=row.object_id,
            category=row.category,
            split=row.split,
            source=row.source,
            weighed_mass_g=row.weighed_mass_g,
            notes=row.notes,
            tube=scanner.tube,
            detector=scanner.detector,
            views=(pa, lat),
            audit_views=tuple(v.view for name, v in views.items() if name in scanner.audit_names),
            parts=parts,
            flags=tuple(flag for view in views.values() for flag in view.flags) + part_flags,
            noise_sd={
                name: view.noise_sd for name, view in views.items() if view.noise_sd is not None
            },
            open_field={
                name: view.open_field for name, view in views.items() if view.open_field is not None
            },
            at_least={
                name: view.at_least for name, view in views.items() if view.at_least is not None
            },
            pose="near" if in_place else row.pose,
            mesh_scale=row.mesh_scale,
            further_views=tuple(views[name].view for name in scanner.further_names),
            turned=frozenset(name for name, stored in scanner.views.items() if stored.turned),
            mesh_units=row.mesh_units,
            mesh_sd_cm=row.mesh_sd_mm / 10,
        )

    def parts(self, object_id: str) -> tuple[tuple[CapturePart, ...], tuple[str, ...]]:
        """Read the parts of an object alone, and the flags of their meshes.

        Raises
        ------
        MissingObjectError
            If ``objects.csv`` has no such object.
        DataError
            As :func:`xden_builder.capture.parts.read_parts`; or if the parts were put before the
            scanner from something else than there is now.
        """
        self._refuse_no_folder(object_id)
        meshes, table, strict = self._part_files(object_id)
        if self.parts_root is not None and not meshes.is_dir():
            raise DataError(
                f"{meshes}: no meshes of this object: was it put in place ({self.parts_root}/"
                "index.html of `xden-build align` says why not, unless --objects left it out), or "
                "mended (mended.csv)?"
            )
        if (origin := meshes / ORIGIN_NAME).is_file():
            refuse_stale(origin, self.made_from(object_id))
        return read_parts(meshes, table, self._row(object_id).mesh_units, strict)

    def _refuse_no_folder(self, object_id: str) -> None:
        folder = self.root / self._row(object_id).object_id
        if not folder.is_dir():
            raise DataError(f"{folder}: no such folder, though objects.csv has a row for it")

    def copy_own_table(self, object_id: str, out: Path) -> None:
        """Put the table that the other folder of parts has of an object, if any, beside meshes."""
        _, table, is_own = self._part_files(object_id)
        if is_own and self.parts_root is not None:
            shutil.copyfile(table, out / table.name)

    def images(self, object_id: str) -> Mapping[str, Path]:
        """Return where the radiographs of an object are, those that are there, by view.

        Raises
        ------
        MissingObjectError
            If ``objects.csv`` has no such object.
        DataError
            If its ``scanner.toml`` is wrong.
        """
        folder = self.root / self._row(object_id).object_id
        views = self._scanner(object_id).views
        paths = {name: folder / stored.image for name, stored in views.items()}
        return {name: path for name, path in paths.items() if path.is_file()}

    def ct(self, object_id: str) -> CTReference | None:
        """Read the CT reference of an object, None where it has none.

        Raises
        ------
        MissingObjectError
            If ``objects.csv`` has no such object.
        DataError
            If ``ct.npz`` breaks the format.
        """
        path = self.root / self._row(object_id).object_id / "ct.npz"
        return read_ct(path) if path.is_file() else None

    def digest(self, object_id: str) -> str:
        """Return the SHA-256 over names and contents of everything :meth:`read` looks at.

        Raises
        ------
        MissingObjectError
            If ``objects.csv`` has no such object.
        DataError
            If its ``scanner.toml``, which says what else is read, is wrong.
        """
        row, files = repr(self._row(object_id)), files_digest(self._inputs(object_id))
        return hashlib.sha256(f"{row}\n{files}".encode()).hexdigest()

    def made_from(self, object_id: str) -> dict[str, str]:
        """Return what a pose of the object is found from, by what it is.

        Checksums of the images of fitted views (``radiographs``), of their ``masks`` and their
        ``geometry``, and of the annotated ``meshes``; and ``mesh_units``, ``pose`` and
        ``mesh_scale`` as told. Where parts come from another folder whose own origin is not known,
        ``meshes`` are left out.

        Raises
        ------
        MissingObjectError
            If ``objects.csv`` has no such object.
        DataError
            If its ``scanner.toml`` is wrong.
        """
        row, scanner = self._row(object_id), self._scanner(object_id)
        folder = self.root / object_id
        names = (*DATASET_VIEWS, *scanner.further_names)
        views = {name: scanner.views[name] for name in names if name in scanner.views}
        seen = {name: [one.geometry.to_dict(), one.turned] for name, one in views.items()}
        found = {
            "radiographs": files_digest((name, folder / one.image) for name, one in views.items()),
            "masks": files_digest((name, folder / ignore_name(name)) for name in views),
            "geometry": hashlib.sha256(json.dumps(seen).encode()).hexdigest(),
            "mesh_units": row.mesh_units,
            "pose": f"{row.pose}",
            "mesh_scale": row.mesh_scale,
        }
        parts, _, _ = self._part_files(object_id)
        if self.parts_root is None or (parts / ORIGIN_NAME).is_file():
            found["meshes"] = files_digest(_mesh_files(folder))
        return found

    def _row(self, object_id: str) -> ObjectRow:
        if object_id not in self.rows:
            raise MissingObjectError(f"{self.root / 'objects.csv'}: no object {object_id!r}")
        return self.rows[object_id]

    def _scanner_path(self, object_id: str) -> Path:
        own = self.root / object_id / "scanner.toml"
        return own if own.is_file() else self.root / "scanner.toml"

    def _scanner(self, object_id: str) -> ScannerFile:
        return read_scanner(self._scanner_path(object_id), self.root / object_id)

    def _views(self, object_id: str, scanner: ScannerFile) -> Iterator[CalibratedView]:
        """Yield the views that are fitted, then the audit views the object has an image of."""
        folder = self.root / object_id
        for name in DATASET_VIEWS:
            if name not in scanner.views:
                raise DataError(f"{self._scanner_path(object_id)}: views.{name} is missing")
        refuse_other_masks(folder, scanner.views)
        audited = scanner.audit_names
        for name in (*DATASET_VIEWS, *scanner.further_names, *audited):
            stored = scanner.views[name]
            if name not in audited or (folder / stored.image).is_file():
                seen = calibrate(name, stored, folder, self.root, scanner.detector)
                yield without_ignored(seen, folder / ignore_name(name))

    def _part_files(self, object_id: str) -> tuple[Path, Path, bool]:
        """Return folder of the meshes, table of the parts, and whether each row needs a mesh."""
        annotated = self.root / object_id
        if self.parts_root is None:
            return annotated, annotated / "parts.csv", True
        other = self.parts_root / object_id
        own_table = (other / "parts.csv").is_file()
        return other, (other if own_table else annotated) / "parts.csv", own_table

    def _inputs(self, object_id: str) -> Iterator[tuple[str, Path]]:
        """Yield every file that reading may open, under a name that does not tell the root."""
        folder = self.root / object_id
        yield "scanner.toml", self._scanner_path(object_id)
        for name, stored in self._scanner(object_id).views.items():
            yield f"views.{name}.image", folder / stored.image
            for key, source in (("flat", stored.flat), ("dark", stored.dark)):
                if isinstance(source, str):
                    yield f"views.{name}.{key}", self.root / source
        for path in masks(folder):  # a new one of a wrong name is refused, not passed over
            yield path.name, path
        meshes, table, _ = self._part_files(object_id)
        yield "parts.csv", table
        for name in (REGISTRATION_NAME, ORIGIN_NAME):
            yield name, meshes / name
        yield from _mesh_files(meshes)
        if (meshes / ORIGIN_NAME).is_file():  # then the annotated ones are looked at, too
            for name, path in _mesh_files(folder):
                yield f"annotated/{name}", path


def _mesh_files(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield the files that the meshes of an object are read from, and their names."""
    yield "mesh.glb", folder / "mesh.glb"
    for path in (folder / "parts").glob("*"):
        if path.suffix.lower() in MESH_SUFFIXES:
            yield f"parts/{path.name}", path


def _object_rows(path: Path) -> dict[str, ObjectRow]:
    rows: dict[str, ObjectRow] = {}
    lines: dict[str, int] = {}
    wrong: dict[int, DataError] = {}
    for row in read_csv(path, _REQUIRED, _OPTIONAL):
        object_id = row["object_id"]
        try:
            if (before := lines.setdefault(object_id, row.number)) != row.number:
                raise row.error("object_id", f"{object_id!r} stands in row {before} too")
            rows[object_id] = _object_row(row)
        except DataError as err:
            wrong[row.number] = err
    refuse_wrong(wrong)
    if not rows:
        raise DataError(f"{path}: no objects")
    return rows


def _object_row(row: CsvRow) -> ObjectRow:
    object_id = row["object_id"]
    if not re.fullmatch(r"[A-Za-z0-9._-]+", object_id) or object_id in (".", ".."):
        raise row.error("object_id", f"must be of A-Z a-z 0-9 . _ -, got {object_id!r}")
    return ObjectRow(
        object_id=object_id,
        category=row["category"],
        mesh_units=row.choice("mesh_units", tuple(CM_PER_UNIT), default="cm"),
        weighed_mass_g=_mass_g(row) if row["mass_g"] else None,
        split=cast(Split, row.choice("split", SPLITS)) if row["split"] else None,
        source=cast(Source, row.choice("source", CAPTURED, default="scan")),
        notes=row["notes"],
        pose=read_pose(row),
        mesh_scale=read_mesh_scale(row),
        mesh_sd_mm=_mesh_sd_mm(row) if row["mesh_sd_mm"] else 0.0,
    )


def _mass_g(row: CsvRow) -> float:
    mass_g = number_or_nan(row["mass_g"])
    if not 0 < mass_g <= _MOST_MASS_G:
        at_most = f", {_MOST_MASS_G:g} at most" * (mass_g > _MOST_MASS_G)
        said = f"must be a positive number of grams{at_most}, got {row['mass_g']!r}"
        raise row.error("mass_g", said)
    return mass_g


def _mesh_sd_mm(row: CsvRow) -> float:
    sd_mm = number_or_nan(row["mesh_sd_mm"])
    if not 0 <= sd_mm <= _MOST_MESH_SD_MM:
        most, told = f"{_MOST_MESH_SD_MM:g}", row["mesh_sd_mm"]
        raise row.error("mesh_sd_mm", f"must be a number of mm from 0 to {most}, got {told!r}")
    return sd_mm
