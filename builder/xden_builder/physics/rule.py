"""What density the paper's rule, LAC / 0.17, reads: for one energy, and in a tube's beam.

``python -m xden_builder.physics.rule FIGURE.png`` draws the figure of the manual's page *What 0.17
does* and prints its tables.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from jaxtyping import Float
from tabulate import tabulate

from xden1k.errors import require
from xden1k.values.materials import Composition, load_materials, parse_composition
from xden1k.values.physics import PAPER_MAC_CM2_G
from xden_builder.physics.attenuation import mac_cm2_g
from xden_builder.physics.source import Tube
from xden_builder.physics.spectrum import effective_mac_cm2_g, tube_spectrum

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "PRINTED",
    "PrintedRow",
    "draw_rule",
    "printed_table",
    "times_table",
    "times_too_dense",
    "times_too_dense_in_beam",
]

PAPER_KEV: Final = 100.0
BEAM: Final = Tube(kv=100.0, filtration_cm={"Al": 0.25})
"""A tube at the paper's voltage; its filter is an assumption, the usual one of such scanners."""
HARD_BEAM: Final = BEAM.behind("Al", 0.75)
SHOWN: Final = {
    "water": "water",
    "pp": "polypropylene",
    "abs": "ABS",
    "wood_oak": "oak",
    "rubber_vulcanised": "rubber, vulcanised",
    "silicone": "silicone",
    "pvc_rigid": "PVC, rigid",
    "glass_soda_lime": "glass, soda-lime",
    "porcelain": "porcelain",
    "aluminium": "aluminium",
    "steel": "steel",
    "brass": "brass",
}
"""Materials of the library that are told of, and their names on the page."""
DRAWN: Final = (*("pp", "water", "pvc_rigid", "glass_soda_lime", "aluminium", "steel", "brass"),)
THICKNESSES_CM: Final = (0.1, 0.5, 2.0)
ENERGIES_KEV: Final = np.geomspace(30.0, 150.0, 121)
DEPTHS_CM: Final = np.geomspace(0.02, 10.0, 55)


@dataclass(frozen=True, slots=True)
class PrintedRow:
    """A row of Table 1 of the paper (arXiv 2512.10668), as printed, for 100 keV.

    Parameters
    ----------
    name
        Of the substance.
    composition
        What it is taken for here.
    density_g_cm3, mac_cm2_g, lac_per_cm
        As printed; the density of air, which is not, is that of dry air at 20 °C.
    """

    name: str
    composition: Composition
    density_g_cm3: float
    mac_cm2_g: float
    lac_per_cm: float


PRINTED: Final = tuple(
    PrintedRow(name, parse_composition(formula), density, mac, lac)
    for name, formula, density, mac, lac in (
        ("water, H₂O", "H2O:1", 1.0, 0.17, 0.17),
        ("air", "N:0.755 O:0.232 Ar:0.013", 1.2e-3, 0.15, 1.8e-4),
        ("glass, SiO₂", "SiO2:1", 2.4, 0.18, 0.432),
        ("polypropylene, C₃H₆", "C3H6:1", 0.9, 0.18, 0.16),
        ("rubber, C₅H₈", "C5H8:1", 1.2, 0.19, 0.22),
        ("wood, C₆H₁₀O₅", "C6H10O5:1", 0.8, 0.16, 0.12),
        ("aluminium", "Al:1", 2.7, 0.19, 0.51),
    )
)
"""Table 1 of the paper as printed; the LAC of rubber and of wood are not MAC times density."""


def printed_table() -> str:
    """Table 1 beside tabulated attenuation, in Markdown."""
    rows = [_printed_cells(row, float(mac_cm2_g(row.composition, PAPER_KEV))) for row in PRINTED]
    heads = ("substance", "g/cm³", "MAC, printed", "tabulated", "off")
    return _markdown(rows, (*heads, "LAC, printed", "tabulated", "off"))


def _printed_cells(row: PrintedRow, mac: float) -> list[str]:
    lac = mac * row.density_g_cm3
    return [
        row.name,
        f"{row.density_g_cm3:g}",
        f"{row.mac_cm2_g:g}",
        f"{mac:.4f}",
        _percent(row.mac_cm2_g / mac),
        f"{row.lac_per_cm:g}",
        f"{lac:.3g}",
        _percent(row.lac_per_cm / lac),
    ]


def _percent(ratio: float) -> str:
    return f"{100 * (ratio - 1):+.1f} %"


def times_too_dense(
    composition: Composition, energy_kev: Float[np.ndarray, "*e"] | float
) -> Float[np.ndarray, "*e"]:
    """Density by LAC / 0.17 over the true one, for photons of one energy.

    It does not depend on the density: it is the mass attenuation coefficient over 0.17.

    Examples
    --------
    >>> float(times_too_dense((("Fe", 1.0),), 100.0).round(2))
    2.19
    """
    return np.asarray(mac_cm2_g(composition, energy_kev) / PAPER_MAC_CM2_G)


def times_too_dense_in_beam(
    composition: Composition, density_g_cm3: float, thickness_cm: float, tube: Tube = BEAM
) -> float:
    """Density by LAC / 0.17 over the true one, for a slab in a tube's beam.

    LAC is that of the slab's transmission as an energy-integrating detector of caesium iodide
    measures it: without scatter, noise or saturation.

    Parameters
    ----------
    composition, density_g_cm3, thickness_cm
        Of the slab.
    tube
        Where the beam comes from.

    Examples
    --------
    >>> round(times_too_dense_in_beam((("Fe", 1.0),), 7.85, 0.1), 1)
    10.1
    """
    areal_g_cm2 = density_g_cm3 * thickness_cm
    mac = effective_mac_cm2_g(tube_spectrum(tube), composition, areal_g_cm2)
    return mac / PAPER_MAC_CM2_G


def times_table() -> str:
    """How many times too dense the rule reads each material, in Markdown."""
    library = load_materials()
    rows = []
    for name, shown in SHOWN.items():
        material = library[name]
        solid = (material.composition, material.density_nominal_g_cm3)
        factors = [
            float(times_too_dense(material.composition, PAPER_KEV)),
            *(times_too_dense_in_beam(*solid, thickness) for thickness in THICKNESSES_CM),
            times_too_dense_in_beam(*solid, THICKNESSES_CM[1], HARD_BEAM),
        ]
        rows.append([shown, f"{solid[1]:g}", *(f"{factor:.2f}" for factor in factors)])
    beams = [f"100 kV, {thickness:g} cm" for thickness in THICKNESSES_CM]
    hard = f"behind 10 mm Al, {THICKNESSES_CM[1]:g} cm"
    return _markdown(rows, ("material", "g/cm³", "100 keV", *beams, hard))


def _markdown(rows: Sequence[Sequence[str]], heads: Sequence[str]) -> str:
    aligned = ("left", *["right"] * (len(heads) - 1))
    text: str = tabulate(rows, heads, tablefmt="pipe", disable_numparse=True, colalign=aligned)
    return text


def draw_rule(path: Path) -> None:
    """Draw how many times too dense the rule reads materials, over energy and over thickness.

    Parameters
    ----------
    path
        The PNG to write.

    Raises
    ------
    MissingExtraError
        If matplotlib (extra ``view``) is not installed.
    """
    require("matplotlib", "view")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    by_energy, by_depth = figure.subplots(1, 2, sharey=True)
    library = load_materials()
    for number, name in enumerate(DRAWN):
        material, look = library[name], {"color": f"C{number}", "label": SHOWN[name]}
        by_energy.loglog(ENERGIES_KEV, times_too_dense(material.composition, ENERGIES_KEV), **look)
        solid = (material.composition, material.density_nominal_g_cm3)
        in_beam = [times_too_dense_in_beam(*solid, depth) for depth in DEPTHS_CM]
        by_depth.loglog(DEPTHS_CM, in_beam, **look)
    _dress(by_energy, "photons of one energy, keV", (30, 40, 60, 80, 100, 150))
    _dress(
        by_depth, "slab in a 100 kV beam (2.5 mm Al, CsI): thickness, cm", (0.02, 0.1, 0.5, 2, 10)
    )
    by_energy.set_ylabel("density by LAC / 0.17 over the true one")
    by_depth.legend(frameon=False, fontsize=9)
    figure.savefig(path, dpi=120, metadata={"Software": None})


def _dress(axes: Axes, label: str, ticks: Sequence[float]) -> None:
    axes.axhline(1, color="#1b1b1b", linewidth=0.9)
    axes.set_xlabel(label)
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_xticks([], minor=True)
    factors: list[Any] = [1, 1.5, 2, 3, 5, 10, 20, 50]
    axes.set_yticks(factors, [f"{factor:g}" for factor in factors])
    axes.set_yticks([], minor=True)
    axes.grid(visible=True, color="#e4e4e0", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def main(path: Path) -> None:
    """Draw the figure and print the tables of the page."""
    draw_rule(path)
    sys.stdout.write(f"{printed_table()}\n\n{times_table()}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
