"""From radiographs and path lengths to one attenuation coefficient per part."""

from xden_builder.fit.adam import fit_lac_adam
from xden_builder.fit.compare import SolverComparison, compare_solvers
from xden_builder.fit.lac import fit_lac
from xden_builder.fit.values import PAPER_OBJECTIVE, AdamSettings, FitSettings, LacFit

__all__ = [
    "PAPER_OBJECTIVE",
    "AdamSettings",
    "FitSettings",
    "LacFit",
    "SolverComparison",
    "compare_solvers",
    "fit_lac",
    "fit_lac_adam",
]
