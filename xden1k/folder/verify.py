"""Check a dataset folder: every file against its checksum, every row against the format."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pyarrow as pa

from xden1k.errors import DataError
from xden1k.folder.withheld import leaks
from xden1k.folder.writer import OBJECT_ID
from xden1k.format.checksums import CHECKSUMS_NAME, file_sha256, listed_sums
from xden1k.format.manifest import MANIFEST_NAME, DataFile, Manifest
from xden1k.format.records import has_radiographs, mass_columns, row_object
from xden1k.format.schema import (
    DATA_SCHEMA,
    LIGHT_COLUMNS,
    METADATA_SCHEMA,
    NULLABLE_COLUMNS,
    PREVIEW_COLUMNS,
    RADIOGRAPH_COLUMNS,
)
from xden1k.format.shards import Row, ShardReader
from xden1k.values.closed import edge_faults
from xden1k.values.mass import mass_of_meshes
from xden1k.values.types import (
    ALL_SPLITS,
    FIELD_SIZE,
    LABEL_SIZE,
    PRIVATE,
    SOURCES,
    UNSEEN,
    DensityField,
    DensityObject,
)

__all__ = ["refuse_unsound", "row_problems", "verify_folder"]

CAN_LABEL = all(find_spec(name) for name in ("numba", "manifold3d"))
"""Whether the extra ``build`` is there, with which labels are compared with the meshes."""
LABEL_TOLERANCE = 1e-5
"""Share of all label voxels whose centres lie so close to a face that rounding decides."""
MASS_TOLERANCE = 1e-5
"""Relative: stored mass and centre of mass against those of the stored meshes."""
FIELD_TOLERANCE = 0.05
"""Relative: mass of the field against that of the meshes."""
SHARE_STEP = 1 / 255
"""Between stored shares."""
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"

Report = Callable[[str], None]


def verify_folder(root: Path, on_row: Callable[[], object] = lambda: None) -> list[str]:
    """Check a dataset folder.

    Parameters
    ----------
    root
        The folder.
    on_row
        Called after each object, for a progress bar.

    Returns
    -------
    list of str
        Every problem found, one line each; none if the folder is sound.
    """
    problems: list[str] = []
    try:
        manifest = Manifest.read(root, damaged=True)
    except DataError as err:
        return [str(err)]
    _check_sums(root, manifest, problems.append)
    _check_files(root, manifest, problems.append)
    for split in manifest.splits:
        _check_split(root, manifest, split, problems.append, on_row)
    _check_unseen(root, manifest, problems.append)
    return problems


def refuse_unsound(root: Path, on_row: Callable[[], object] = lambda: None) -> None:
    """Check a dataset folder as :func:`verify_folder` does, and raise if there is a problem.

    Raises
    ------
    DataError
        With the first problem, and how many there are.
    """
    if problems := verify_folder(root, on_row):
        raise DataError(
            f"{root} does not verify, {len(problems)} problems, the first: {problems[0]}; "
            f"`xden verify {root}` lists them all"
        )


def _check_sums(root: Path, manifest: Manifest, report: Report) -> None:
    """Check the documents; a data file's sum must be the manifest's, which is checked elsewhere."""
    if not (root / CHECKSUMS_NAME).is_file():
        report(f"{CHECKSUMS_NAME}: missing")
        return
    listed = listed_sums(root)
    sums = {file.path: file.sha256 for file in manifest.files}
    for name in sorted({MANIFEST_NAME, *sums} - listed.keys()):
        report(f"{name}: {CHECKSUMS_NAME} does not list it")
    for name, digest in listed.items():
        if name not in sums and not (root / name).is_file():
            report(f"{name}: missing, {CHECKSUMS_NAME} lists it")
        elif (sums.get(name) or file_sha256(root / name)) != digest:
            report(f"{name}: its sha256 is not the one in {CHECKSUMS_NAME}")


def _check_files(root: Path, manifest: Manifest, report: Report) -> None:
    for file in manifest.files:
        path = root / file.path
        size = path.stat().st_size if path.is_file() else None
        if size is None:
            report(f"{file.path}: missing, {MANIFEST_NAME} lists it")
        elif size != file.bytes:
            report(f"{file.path}: {size} bytes, {MANIFEST_NAME} says {file.bytes}")
        elif file_sha256(path) != file.sha256:
            report(f"{file.path}: its sha256 is not the one in {MANIFEST_NAME}")
    found = {path.relative_to(root).as_posix() for path in root.glob("*/*.parquet")}
    for name in sorted(found - {file.path for file in manifest.files}):
        report(f"{name}: {MANIFEST_NAME} does not list it, but it would be loaded")


def _check_unseen(root: Path, manifest: Manifest, report: Report) -> None:
    """Check that no category of the split ``unseen`` is in one to learn from or to be judged by."""
    categories = {split: _categories(root, manifest, split) for split in manifest.splits}
    unseen = categories.pop(UNSEEN, frozenset())
    for split, others in categories.items():
        if shared := sorted(unseen & others):
            report(f"categories of the split {UNSEEN} are in {split} too: {', '.join(shared)}")


def _categories(root: Path, manifest: Manifest, split: str) -> frozenset[str]:
    """Categories of a split by its light file; none where that cannot be read, told elsewhere."""
    try:
        names = [
            ShardReader(root / file.path).column("category")
            for file in manifest.shards("metadata", split)
        ]
    except DataError:
        return frozenset()
    return frozenset(name for column in names for name in column)


def _check_split(
    root: Path, manifest: Manifest, split: str, report: Report, on_row: Callable[[], object]
) -> None:
    """Check the rows of one split, one in memory at a time."""
    light = {
        row["object_id"]: row
        for file in manifest.shards("metadata", split)
        for row in _rows(root, file, METADATA_SCHEMA, report)
    }
    last, without = "", 0
    for file in manifest.shards(split=split):
        for row in _rows(root, file, DATA_SCHEMA, report):
            say = partial(_report_at, report, f"{file.path}: {row['object_id']}")
            if row["object_id"] <= last:
                say(f"ids must be unique and ascending, this one follows {last}")
            if row["split"] != split:
                say(f"split is {row['split']!r} in a file of {split}")
            _compare(row, light.get(row["object_id"]), say)
            for problem in (*row_problems(row), *_mislabelled(row)):
                say(problem)
            last = row["object_id"]
            without += not has_radiographs(row)
            on_row()
    if without != (told := manifest.without_radiographs.get(split, 0)):
        report(f"{split}: {without} objects without radiographs, {MANIFEST_NAME} says {told}")


def _report_at(report: Report, where: str, problem: str) -> None:
    report(f"{where}: {problem}")


def _rows(root: Path, file: DataFile, schema: pa.Schema, report: Report) -> Iterator[Row]:
    """Rows of a file, until it cannot be read; a missing one is reported elsewhere."""
    if not (root / file.path).is_file():
        return
    try:
        reader = ShardReader(root / file.path)
        if reader.schema.equals(schema) and reader.rows == file.rows:
            yield from reader
        elif reader.rows != file.rows:
            report(f"{file.path}: {reader.rows} rows, {MANIFEST_NAME} says {file.rows}")
        else:
            report(f"{file.path}: {_schema_difference(reader.schema, schema)}")
    except DataError as err:
        report(str(err))


def _schema_difference(found: pa.Schema, wanted: pa.Schema) -> str:
    for name in wanted.names:
        if name not in found.names:
            return f"no column {name}"
        if found.field(name).type != wanted.field(name).type:
            return f"{name} is {found.field(name).type}, not {wanted.field(name).type}"
    return f"columns are {found.names}, not {wanted.names}"


def _compare(row: Row, light: Row | None, say: Report) -> None:
    if light is None:
        say("not in the metadata")
        return
    # repr: not a number is equal to itself here
    different = [name for name in LIGHT_COLUMNS if repr(row[name]) != repr(light[name])]
    if different:
        say(f"differs from the metadata in {', '.join(different)}")


def row_problems(row: Row) -> list[str]:
    """Check one encoded row.

    Returns
    -------
    list of str
        Every problem found; none if the row is sound.
    """
    withheld = ("apparent_density",) if row["split"] == PRIVATE else ()
    nullable = (*NULLABLE_COLUMNS, *withheld, *_absent_radiographs(row))
    missing = [name for name, value in row.items() if value is None and name not in nullable]
    if missing:
        return [f"null in {', '.join(sorted(missing))}"]
    if problems := list(_identity_problems(row)):
        return problems
    try:
        obj = row_object(row)
    except DataError as err:
        return [str(err).removeprefix(f"{row['object_id']}: ")]
    return [
        *_answer_problems(row),
        *_label_problems(obj),
        *_mesh_problems(obj),
        *_field_problems(obj),
        *_mass_problems(row, obj),
    ]


def _absent_radiographs(row: Row) -> tuple[str, ...]:
    """Columns of the radiographs, where there are none at all: one alone is never null."""
    return () if has_radiographs(row) else RADIOGRAPH_COLUMNS


def _identity_problems(row: Row) -> Iterator[str]:
    if not OBJECT_ID.fullmatch(row["object_id"]):
        yield "object_id must be of A-Z a-z 0-9 . _ -"
    for name, known in (("split", ALL_SPLITS), ("source", SOURCES)):
        if row[name] not in known:
            yield f"{name} must be one of {known}, got {row[name]!r}"
    for name in PREVIEW_COLUMNS:
        if row[name] is not None and not row[name].startswith(PNG_SIGNATURE):
            yield f"{name} is not a PNG"


def _answer_problems(row: Row) -> Iterator[str]:
    if row["split"] == PRIVATE and (names := leaks(row)):
        yield f"answers of the split {PRIVATE} are published, in {', '.join(names)}"


def _label_problems(obj: DensityObject) -> Iterator[str]:
    if (highest := int(obj.labels.max())) > len(obj.parts):
        yield f"labels reach {highest}, but there are {len(obj.parts)} parts"
    if not highest and "thinner_than_labels" not in obj.flags:
        yield "labels are empty, and no flag thinner_than_labels says that its parts are thinner"
    excess = obj.occupancy - obj.envelope
    if (excess > 1.5 * SHARE_STEP).any():
        yield f"occupancy exceeds the envelope by up to {float(excess.max()):.3f}"


def _mislabelled(row: Row) -> Iterator[str]:
    """Compare labels with the part that holds each voxel's centre, by the meshes."""
    if not CAN_LABEL:
        return
    from xden1k.rays import CubeGrid, voxel_labels

    try:
        obj = row_object(row)
    except DataError:  # told by row_problems
        return
    meshes, voxel_cm = [part.mesh for part in obj.parts], obj.voxel_size_cm
    grid = CubeGrid(obj.origin_cm - voxel_cm / 4, voxel_cm / 2, LABEL_SIZE)
    try:
        labels = voxel_labels(meshes, range(len(meshes)), grid)
    except DataError:  # an open mesh: told by row_problems
        return
    if (off := int((labels != obj.labels).sum())) > LABEL_TOLERANCE * labels.size:
        yield f"labels are not those of the meshes in {off} of {labels.size} voxels"


def _mesh_problems(obj: DensityObject) -> Iterator[str]:
    for part in obj.parts:
        if any(edge_faults(np.asarray(part.mesh.faces))):
            yield f"mesh of part {part.name} is not closed"
        elif len(part.mesh.faces) and not part.mesh.volume > 0:
            yield f"mesh of part {part.name} has volume {part.mesh.volume:.3g} cm³"
    if not any(len(part.mesh.faces) for part in obj.parts):
        yield "no part has a mesh"


def _field_problems(obj: DensityObject) -> Iterator[str]:
    if obj.apparent_density is not None:
        apparent = [part.apparent_density_g_cm3 for part in obj.parts]
        yield from _one_field_problems("apparent_density", obj.apparent_density, apparent, obj)
    densities = [part.density_g_cm3 for part in obj.parts]
    if (obj.density is None) != bool(np.isnan(densities).any()):
        yield "density must be null exactly where the density of a part is unknown"
    elif obj.density is not None:
        yield from _one_field_problems("density", obj.density, densities, obj)


def _one_field_problems(
    name: str, field: DensityField, densities: Sequence[float], obj: DensityObject
) -> Iterator[str]:
    """Check that voxel means are possible, and hold the mass of the meshes."""
    highest = np.nanmax([0.0, *densities])
    possible = highest * 1.001 * (obj.occupancy + SHARE_STEP)
    if (bad := int((field.density_g_cm3 > possible).sum())) > 0:
        yield f"{name}: {bad} voxels are denser than their share of the densest part"
    known = [0.0 if np.isnan(density) else density for density in densities]
    mass = mass_of_meshes([part.mesh for part in obj.parts], known).mass_g
    if abs(field.mass_g - mass) > FIELD_TOLERANCE * mass:
        yield f"{name}: the field holds {field.mass_g:.6g} g, the meshes {mass:.6g} g"


def _mass_problems(row: Row, obj: DensityObject) -> Iterator[str]:
    mass, edge_cm = obj.mass_properties, FIELD_SIZE * obj.voxel_size_cm
    scales = {"mass_g": mass.mass_g, "com_cm": edge_cm, "inertia_g_cm2": mass.mass_g * edge_cm**2}
    for name, values in mass_columns(mass).items():
        tolerance = MASS_TOLERANCE * np.nan_to_num(scales[name])
        if not np.isclose(row[name], values, rtol=0, atol=tolerance, equal_nan=True).all():
            yield f"{name} is {row[name]}, the meshes and densities give {values}"
    for name in ("mass_g", "weighed_mass_g"):
        if row[name] is not None and row[name] <= 0:
            yield f"{name} must be positive, got {row[name]}"
