"""Make the packaged table of tube spectra: ``python -m xden_builder.physics.spectrum.make_tables``.

Needs the extra ``tables`` (SpekPy; Poludniowski et al. 2021, doi:10.1002/mp.14945). The builder
itself reads the finished table and never imports this module.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import numpy as np
from jaxtyping import Float

from xden1k.errors import require
from xden_builder.physics.spectrum.tables import (
    ANODE_DEG,
    LOWEST_KEV,
    TABLE,
    TABLE_DISTANCE_CM,
    TABLE_KV,
    TABLE_SLOPES,
)

__all__ = ["made_fluence", "main", "table_text"]

_HEADER = """\
# Tungsten tube without filter: photons per cm2, keV and mAs at {distance:g} cm from the focal spot.
# Made by python -m xden_builder.physics.spectrum.make_tables with SpekPy {version}: physics casim,
# anode {anode:g} degrees, 1 keV bins (centres given), no filter and no air, from {lowest:g} keV up.
# Columns after the energy: slope of the ray, its offset towards the cathode per distance along the
# central ray; the values are those at a point {distance:g} cm along it, inverse square included.
"""


def made_fluence(kv: float, slope: float) -> Float[np.ndarray, "energies"]:
    """Compute one column of the table, for the bins from ``LOWEST_KEV`` to the voltage.

    Raises
    ------
    MissingExtraError
        If SpekPy is not installed.
    """
    tube = require("spekpy", "tables").Spek(
        kvp=kv,
        th=ANODE_DEG,
        dk=1.0,
        physics="casim",
        z=TABLE_DISTANCE_CM,
        x=slope * TABLE_DISTANCE_CM,
        mas=1.0,
    )
    energies_kev, fluence = tube.get_spectrum()
    return np.asarray(fluence[energies_kev > LOWEST_KEV])


def table_text() -> str:
    """Compute the whole table; about half a minute."""
    header = _HEADER.format(
        version=require("spekpy", "tables").__version__,
        anode=ANODE_DEG,
        lowest=LOWEST_KEV,
        distance=TABLE_DISTANCE_CM,
    )
    lines = [",".join(["kv", "energy_kev", *(f"{slope:.2f}" for slope in TABLE_SLOPES)])]
    for kv in TABLE_KV:
        columns = np.stack([made_fluence(kv, slope) for slope in TABLE_SLOPES], axis=1)
        for place, row in enumerate(columns):
            values = ",".join(f"{value:.5g}" for value in row)
            lines.append(f"{kv:g},{LOWEST_KEV + place + 0.5:g},{values}")
    return header + "\n".join(lines) + "\n"


def main() -> None:
    """Write the table into the package."""
    path = Path(str(files("xden_builder.physics.spectrum"))) / TABLE
    path.write_text(table_text(), encoding="utf-8")


if __name__ == "__main__":
    main()
