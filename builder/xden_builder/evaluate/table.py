"""Tables of an evaluation, in Markdown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain
from typing import Final

import numpy as np

from xden_builder.evaluate.cells import HEADERS, error_cells, reprojection_cells, share_cell, table
from xden_builder.evaluate.methods import ABLATIONS, MODES
from xden_builder.evaluate.quality import SHOWN, Quality, QualityPair
from xden_builder.evaluate.run import Evaluation, ObjectResult, PartCheck
from xden_builder.poly.hardness import Hardness

__all__ = ["FAR_OFF", "calibration_rows", "flag_rows", "markdown"]

FAR_OFF: Final = 0.2
"""A density off by a larger share must be flagged."""
METHODS: Final = (
    ("paper", ("nothing",)),
    ("paper + mass", ("nothing",)),
    ("labels alone", MODES),
    ("labels alone + mass", MODES),
    ("poly", MODES),
    ("poly + mass", MODES),
)
GROUPS: Final[tuple[tuple[str, Callable[[PartCheck], bool]], ...]] = (
    ("all parts", lambda part: True),
    ("told by X-rays", lambda part: part.source == "xray"),
    ("told by the prior", lambda part: part.source == "prior"),
    ("without a flag", lambda part: not part.flags),
    ("with a flag", lambda part: bool(part.flags)),
)


def markdown(evaluation: Evaluation) -> str:
    """Write all tables: methods, calibration, flags, ablations."""
    objects = list(evaluation.objects.values())
    if not objects:
        return "0 simulated objects.\n"
    ablated = [each for each in objects if each.ablated]
    sections = [
        f"{len(objects)} simulated objects, {sum(len(o.parts['labels']) for o in objects)} parts. "
        "Means over objects, medians in brackets.",
        _shared_line(evaluation.shared),
        _method_table(objects),
        "Standard deviations, polychromatic fit without a weighed mass: share of parts within one "
        "and two of them (a normal distribution has 68 and 95 %).",
        table(("told", "parts", "number", "within 1 sd", "within 2 sd"), calibration_rows(objects)),
        "Mass and centre of mass, told the labels:",
        table(("figure", "within 1 sd", "within 2 sd"), _body_rows(objects)),
        f"Flags: parts off by more than {FAR_OFF:.0%}, and parts without any flag.",
        table(
            ("told", "off", "of these flagged", "not flagged", f"of these within {FAR_OFF:.0%}"),
            flag_rows(objects),
        ),
    ]
    if ablated:
        sections += [
            f"Ablations, {len(ablated)} of the objects, told the labels; all but the first by "
            "themselves.",
            _ablation_table(ablated),
        ]
    sections += _quality_sections([each for each in objects if each.quality])
    return "\n\n".join(sections) + "\n"


def _shared_line(shared: Hardness) -> str:
    return (
        f"By {shared.clues} labelled materials of {shared.objects} objects the beam has "
        f"{shared.filter_mm_cu:+.3f} ± {shared.sd_mm_cu:.3f} mm Cu beside what is told, images err "
        f"by {shared.image_scale:.2f} and compositions by {shared.composition_scale:.2f} of what "
        "is assumed: fits that are told the labels go by it."
    )


def _method_table(objects: Sequence[ObjectResult]) -> str:
    rows = [
        [method, mode, *error_cells([each.errors[method, mode] for each in objects])]
        for method, modes in METHODS
        for mode in modes
    ]
    return table(("method", "told", *HEADERS), rows)


def _ablation_table(objects: Sequence[ObjectResult]) -> str:
    return table(
        ("fit", *HEADERS),
        [[name, *error_cells([each.ablated[name] for each in objects])] for name in ABLATIONS],
    )


def _quality_sections(objects: Sequence[ObjectResult]) -> list[str]:
    """Write what the interior is worth: over all objects, and for some."""
    pairs = [each.quality for each in objects if each.quality is not None]
    if not pairs:
        return []
    drawn = [each.quality for each in objects if each.quality is not None and each.ablated]
    headers = ("", "PA", "LAT", "PA background", "LAT background")
    sections = []
    if drawn:
        sections += [
            f"Reprojection error of {len(drawn)} objects: mean absolute error of -ln T on the "
            "pixels whose ray meets the object, and beside it; mean and standard deviation over "
            "objects.",
            table(
                headers,
                [
                    ["annotated parts", *reprojection_cells([pair.interior for pair in drawn])],
                    ["outer surface alone", *reprojection_cells([pair.outside for pair in drawn])],
                ],
            ),
        ]
    shown: dict[str, QualityPair] = {}
    for pair in pairs:
        if pair.category in SHOWN:
            shown.setdefault(pair.category, pair)
    rows = [
        [category, prior, *_quality_columns(quality)]
        for category, pair in sorted(shown.items())
        for prior, quality in (("parts", pair.interior), ("outer surface", pair.outside))
    ]
    return [
        *sections,
        "Against the true density of voxels (in place of a CT), g/cm³, and the radiographs: mean "
        "absolute error of -ln T and correlation of T on the object.",
        table(("object", "known", "voxel MAE", "PA MAE", "LAT MAE", "PA corr.", "LAT corr."), rows),
    ]


def _quality_columns(quality: Quality) -> list[str]:
    maes = [f"{view.attenuation_mae:.3f}" for view in quality.views]
    correlations = [f"{view.transmission_corr:.3f}" for view in quality.views]
    return [f"{quality.voxel_mae_g_cm3:.3f}", *maes, *correlations]


def calibration_rows(objects: Sequence[ObjectResult]) -> list[list[str]]:
    """Share of parts within one and two standard deviations, by group and knowledge."""
    rows = []
    for mode in MODES:
        every = list(chain.from_iterable(each.parts[mode] for each in objects))
        for name, belongs in GROUPS:
            off = np.array(
                [
                    abs(part.density_g_cm3 - part.truth_g_cm3) / part.sd_g_cm3
                    for part in every
                    if belongs(part)
                ]
            )
            if off.size:
                rows.append([mode, name, str(off.size), share_cell(off <= 1), share_cell(off <= 2)])
    return rows


def _body_rows(objects: Sequence[ObjectResult]) -> list[list[str]]:
    mass = np.abs([each.body.mass for each in objects])
    com = np.abs([each.body.com for each in objects]).ravel()
    return [
        [name, share_cell(off <= 1), share_cell(off <= 2)]
        for name, off in (("mass", mass), ("centre of mass, each axis", com))
    ]


def flag_rows(objects: Sequence[ObjectResult]) -> list[list[str]]:
    """How many wrong densities are flagged, and how many unflagged ones are right."""
    rows = []
    for mode in MODES:
        every = list(chain.from_iterable(each.parts[mode] for each in objects))
        wrong = np.array(
            [abs(part.density_g_cm3 / part.truth_g_cm3 - 1) > FAR_OFF for part in every]
        )
        flagged = np.array([bool(part.flags) for part in every])
        rows.append(
            [
                mode,
                str(wrong.sum()),
                share_cell(flagged[wrong]),
                share_cell(~flagged),
                share_cell(~wrong[~flagged]),
            ]
        )
    return rows
