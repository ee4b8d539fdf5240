"""What the metrics of one object cannot be, whatever was predicted."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from math import erf, exp, isclose, isfinite, isnan, log, sqrt
from typing import Final

from xden_bench.scoring.metrics import METRICS
from xden_bench.scoring.protocol import Protocol, Rules

__all__ = ["contradictions"]

ROUNDING: Final = 1e-9
"""Relative and absolute."""
CRPS_SHARE: Final = erf(sqrt(log(2) / 2))
"""Least CRPS of a normal prediction as a share of its absolute error e, 0.595. The derivative by
the deviation s is 2 phi(e / s) - 1 / sqrt(pi), zero where (e / s)² = ln 2; there only the term
e erf(e / s / sqrt(2)) is left. It holds for each voxel, so also for two means that weigh the voxels
alike, CRPS and density MAE. There is no bound above: a wide deviation scores badly however right
the mean is."""
Values = Mapping[str, float]


def contradictions(values: Values, protocol: Rules) -> Iterator[str]:
    """Say what the metrics of one object contradict.

    Parameters
    ----------
    values
        By name.
    protocol
        The rules they were made by.

    Examples
    --------
    >>> from xden_bench.scoring.protocol import load_protocol
    >>> next(contradictions({"com_l1_cm": 1.0, "com_l2_cm": 2.0}, load_protocol("v1")))
    'com_l2_cm <= com_l1_cm <= sqrt(3) com_l2_cm'
    """
    if not isinstance(protocol, Protocol):
        yield from _segment_contradictions(values)
        return
    if bad := [name for name, value in values.items() if not (isfinite(value) and value >= 0)]:
        yield f"{bad[0]} is finite and not negative"
        return
    for rule, (names, holds) in _IDENTITIES.items():
        if names <= values.keys() and not holds(values, protocol):
            yield rule


def _segment_contradictions(values: Values) -> Iterator[str]:
    """Say what the metrics of segments contradict; where there is one region, A and B are none."""
    known = {name: value for name, value in values.items() if not isnan(value)}
    for name, value in known.items():
        if not (value >= 0 and _at_most(value, METRICS[name].best)):
            yield f"0 <= {name} <= {METRICS[name].best:g}"
    if "iou_c" not in known or ("iou_a" in known) != ("iou_b_material" in known):
        yield "iou_c is known, iou_a where iou_b_material is"
    elif "iou_a" in known and not _at_most(known["iou_a"], known["iou_b_material"]):
        yield "iou_a <= iou_b_material"


def _masses_agree(one: Values, protocol: Protocol) -> bool:
    """Whether the logarithmic error and the ratio are of the same two masses."""
    limit = protocol.mass_ratio_limit
    if _same(one["mass_alde"], log(limit)):
        return one["mass_mnre"] <= 1 / limit + ROUNDING
    return one["mass_alde"] < log(limit) and _same(one["mass_mnre"], exp(-one["mass_alde"]))


def _error_is_of_the_ratio(one: Values, protocol: Protocol) -> bool:
    """Whether the relative error is that of a mass too small or too large by the ratio."""
    ratio, error = one["mass_mnre"], one["mass_mape"]
    return _same(error, 1 - ratio) or _same((1 + error) * ratio, 1)


def _same(one: float, other: float) -> bool:
    return isclose(one, other, rel_tol=ROUNDING, abs_tol=ROUNDING)


def _at_most(lower: float, higher: float) -> bool:
    return lower <= higher + ROUNDING * (1 + abs(higher))


_IDENTITIES: Final[Mapping[str, tuple[set[str], Callable[[Values, Protocol], bool]]]] = {
    "com_l2_cm <= com_l1_cm <= sqrt(3) com_l2_cm": (
        {"com_l1_cm", "com_l2_cm"},
        lambda one, _: (
            _at_most(one["com_l2_cm"], one["com_l1_cm"])
            and _at_most(one["com_l1_cm"], sqrt(3) * one["com_l2_cm"])
        ),
    ),
    "mass_mnre = exp(-mass_alde), below its limit": ({"mass_mnre", "mass_alde"}, _masses_agree),
    "mass_mape = 1 - mass_mnre or 1 / mass_mnre - 1": (
        {"mass_mape", "mass_mnre"},
        _error_is_of_the_ratio,
    ),
    "nonuniformity_error <= 1": (
        {"nonuniformity_error"},
        lambda one, _: _at_most(one["nonuniformity_error"], 1),
    ),
    "density_crps_g_cm3 >= 0.595 density_mae_g_cm3": (
        {"density_crps_g_cm3", "density_mae_g_cm3"},
        lambda one, _: _at_most(CRPS_SHARE * one["density_mae_g_cm3"], one["density_crps_g_cm3"]),
    ),
    "density_within_1sd <= density_within_2sd <= 1": (
        {"density_within_1sd", "density_within_2sd"},
        lambda one, _: (
            _at_most(one["density_within_1sd"], one["density_within_2sd"])
            and _at_most(one["density_within_2sd"], 1)
        ),
    ),
}
