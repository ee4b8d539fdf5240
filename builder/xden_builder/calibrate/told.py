"""``calibration.toml``: which phantoms were scanned, and where they are in the images."""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from xden1k.errors import DataError
from xden1k.values.materials import Material, load_materials
from xden1k.values.settings import read_toml
from xden_builder.capture import ScannerFile, read_scanner
from xden_builder.capture.calibrated import is_date
from xden_builder.capture.tables import (
    CsvRow,
    TomlTable,
    is_number,
    is_positive,
    number_or_nan,
    read_csv,
)
from xden_builder.physics.attenuation import mac_cm2_g

__all__ = ["SCHEMA", "CalibrationFolder", "ToldBalls", "Wedge", "read_folder"]

SCHEMA: Final = "xden-calibration/1"
_KEYS = ("schema", "date", "valid_until", "tube", "wedges", "balls")
_WEDGE_KEYS = (
    *("scan", "view", "material", "density_g_cm3", "thickness_cm"),
    *("first_px", "last_px", "step_cm", "width_cm"),
)
OTHER_DENSITY: Final = 1.5
"""A piece is no lighter or denser than its material's range by more."""
HARD_KEV: Final = 100.0
OPAQUE_DEPTH: Final = 16.0
OPAQUE_CM: Final = 5.0
"""A step through which 1e-7 of photons of 100 keV come, and as thick as that, is told in mm: 35 cm
of aluminium, 6 cm of steel."""
_BALL_KEYS = ("scan", "table", "diameter_cm", "placed_within_cm", "placed_within_deg")


@dataclass(frozen=True, slots=True)
class Wedge:
    """Steps in one image.

    Parameters
    ----------
    scan, view
        Folder of the image, and the view it was taken in.
    material
        Of all steps.
    density_g_cm3
        Its density.
    thickness_cm
        Of each step along the beam, from the first to the last.
    first_px, last_px
        Row and column of the middle of the first and the last step.
    step_cm, width_cm
        Size of a step from one to the next, and across, before magnification.
    """

    scan: str
    view: str
    material: Material
    density_g_cm3: float
    thickness_cm: tuple[float, ...]
    first_px: tuple[float, float]
    last_px: tuple[float, float]
    step_cm: float
    width_cm: float

    @property
    def name(self) -> str:
        """How messages call it."""
        return f"{self.scan}/{self.view}: {self.material.name}"

    @property
    def along(self) -> Float[np.ndarray, "2"]:
        """Unit vector from the first step to the last, rows and columns; down for one step."""
        way = np.subtract(self.last_px, self.first_px)
        return np.asarray(way / np.linalg.norm(way)) if way.any() else np.array([1.0, 0.0])

    @property
    def centres_px(self) -> Float[np.ndarray, "steps 2"]:
        """Row and column of the middle of each step, evenly spaced."""
        return np.linspace(self.first_px, self.last_px, len(self.thickness_cm))


@dataclass(frozen=True, slots=True, eq=False)
class ToldBalls:
    """The ball phantom of one scan, seen in both views.

    Parameters
    ----------
    scan
        Folder of the images.
    centres_cm
        Shape (balls, 3): in the phantom's frame, which stands nearly as the object frame.
    diameter_cm
        Of each ball.
    placed_within_cm, placed_within_deg
        Standard deviation of where it stands, along each axis and about it.
    """

    scan: str
    centres_cm: Float[np.ndarray, "balls 3"]
    diameter_cm: float
    placed_within_cm: float
    placed_within_deg: float


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationFolder:
    """A folder of radiographs of phantoms.

    Parameters
    ----------
    root
        The folder.
    scanner
        What its ``scanner.toml`` tells, which the calibration corrects.
    date, valid_until
        Of the scans; and the last day they hold for, None where no day is set.
    tube
        Name of the tube; empty where none is told.
    wedges
        In the order of the file.
    balls
        None where there is no such scan.
    """

    root: Path
    scanner: ScannerFile
    date: datetime.date
    valid_until: datetime.date | None
    tube: str
    wedges: tuple[Wedge, ...]
    balls: ToldBalls | None


def read_folder(root: Path) -> CalibrationFolder:
    """Read ``scanner.toml`` and ``calibration.toml`` of a folder.

    Raises
    ------
    DataError
        If one is missing or wrong, a material is not in the library, or there is no phantom; one
        line that names the file and the key.
    """
    scanner, path = read_scanner(root / "scanner.toml"), root / "calibration.toml"
    if not path.is_file():
        raise DataError(f"{path}: no such file")
    table = TomlTable(path, "", read_toml(path))
    table.refuse_unknown(_KEYS)
    table.choice("schema", (SCHEMA,))
    wedges = table.get_or_none("wedges", _is_tables, "tables, each [[wedges]]") or []
    if not wedges and "balls" not in table:
        raise table.error("wedges", "and balls are missing, expected at least one phantom")
    date, valid_until = _read_dates(table, scanner)
    return CalibrationFolder(
        root=root,
        scanner=scanner,
        date=date,
        valid_until=valid_until,
        tube=_read_tube(table, scanner),
        wedges=tuple(
            _read_wedge(TomlTable(path, f"wedges[{place}].", values), scanner)
            for place, values in enumerate(wedges, start=1)
        ),
        balls=_read_balls(table.table("balls"), root) if "balls" in table else None,
    )


def _read_dates(
    table: TomlTable, scanner: ScannerFile
) -> tuple[datetime.date, datetime.date | None]:
    date = table.get("date", is_date, "a date, such as 2026-03-14")
    until = table.get_or_none("valid_until", is_date, "a date, such as 2027-03-14")
    if until is not None and until < date:
        raise table.error("valid_until", f"is {until}, before date, {date}")
    if scanner.taken not in (None, date):
        raise table.error("date", f"is {date}, but that of scanner.toml is {scanner.taken}")
    return date, until


def _read_tube(table: TomlTable, scanner: ScannerFile) -> str:
    name = table.get_or_none("tube", lambda value: isinstance(value, str), "a name") or ""
    told = scanner.tube.name if scanner.tube is not None else ""
    if name and told and name != told:
        raise table.error("tube", f"is {name!r}, but tube.name of scanner.toml is {told!r}")
    return name


def _read_wedge(table: TomlTable, scanner: ScannerFile) -> Wedge:
    table.refuse_unknown(_WEDGE_KEYS)
    material = _read_material(table)
    told = table.get_or_none("density_g_cm3", is_positive, "a positive number")
    density = material.density_nominal_g_cm3 if told is None else float(told)
    if not _is_density_of(material, density):
        raise table.error(
            "density_g_cm3",
            f"is {density:g}, but {material.name} has {material.density_low_g_cm3:g} to "
            f"{material.density_high_g_cm3:g} g/cm³",
        )
    thickness = table.get("thickness_cm", _is_thicknesses, "positive numbers, one a step")
    first = table.get("first_px", _is_place, "row and column")
    many = len(thickness) > 1
    last = (
        table.get("last_px", _is_place, "row and column") if many or "last_px" in table else first
    )
    if many == (first == last):
        raise table.error("last_px", "must differ from first_px where there are several steps only")
    if many and _is_opaque(material, density, max(thickness)):
        raise table.error(
            "thickness_cm",
            f"has {max(thickness):g}, and so many cm of {material.name} let no X-rays through: is "
            "it in mm?",
        )
    return Wedge(
        scan=table.get("scan", _is_name, "the name of a folder"),
        view=table.choice("view", tuple(scanner.views)),
        material=material,
        density_g_cm3=density,
        thickness_cm=tuple(map(float, thickness)),
        first_px=tuple(first),
        last_px=tuple(last),
        step_cm=float(table.get("step_cm", is_positive, "a positive number")),
        width_cm=float(table.get("width_cm", is_positive, "a positive number")),
    )


def _read_material(table: TomlTable) -> Material:
    known = load_materials()
    name = table.get("material", lambda value: isinstance(value, str), "a name")
    if name not in known:
        raise table.error("material", f"{name!r} is no name of the material library")
    return known[name]


def _coordinate(row: CsvRow, axis: str) -> float:
    if not np.isfinite(number := number_or_nan(row[axis])):
        raise row.error(axis, f"must be a number of cm, got {row[axis]!r}")
    return number


def _read_balls(table: TomlTable, root: Path) -> ToldBalls:
    table.refuse_unknown(_BALL_KEYS)
    path = root / table.get("table", _is_name, "the name of a CSV file")
    rows = read_csv(path, ("x_cm", "y_cm", "z_cm"), ("ball",))
    centres = [[_coordinate(row, axis) for axis in ("x_cm", "y_cm", "z_cm")] for row in rows]
    return ToldBalls(
        scan=table.get("scan", _is_name, "the name of a folder"),
        centres_cm=np.array(centres),
        diameter_cm=float(table.get("diameter_cm", is_positive, "a positive number")),
        placed_within_cm=_positive_or(table, "placed_within_cm", 0.5),
        placed_within_deg=_positive_or(table, "placed_within_deg", 2.0),
    )


def _positive_or(table: TomlTable, key: str, usual: float) -> float:
    return float(table.get_or_none(key, is_positive, "a positive number") or usual)


def _is_tables(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(each, dict) for each in value)


def _is_name(value: object) -> bool:
    return isinstance(value, str) and value not in ("", ".", "..") and Path(value).name == value


def _is_density_of(material: Material, density_g_cm3: float) -> bool:
    """Whether a piece of it may be so dense, alloys and cavities of castings included."""
    low, high = material.density_low_g_cm3, material.density_high_g_cm3
    return low / OTHER_DENSITY <= density_g_cm3 <= high * OTHER_DENSITY


def _is_opaque(material: Material, density_g_cm3: float, thickness_cm: float) -> bool:
    """Whether a step is thick, and not even the hardest photons come through."""
    (mac,) = mac_cm2_g(material.composition, np.array([HARD_KEV])).tolist()
    depth = mac * density_g_cm3 * thickness_cm
    return thickness_cm > OPAQUE_CM and bool(depth > OPAQUE_DEPTH)


def _is_thicknesses(value: object) -> bool:
    return isinstance(value, list) and len(value) > 0 and all(map(is_positive, value))


def _is_place(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(is_number, value))
