"""What the data themselves answer of the questions of a datasheet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Final

import numpy as np

from xden1k.documents.facts import Facts
from xden1k.documents.questions import COMMENTS, QUESTIONS
from xden1k.documents.statements import (
    disturbed_text,
    label_voxels_text,
    licence_text,
    materials_text,
    provenance_text,
    published_text,
    radiographs_text,
    shapes_text,
)
from xden1k.values.types import PRIVATE, UNSEEN, Split

__all__ = ["answer", "answered_by_data", "unanswered"]

Answer = Callable[[Facts], str]
"""Text, or nothing where the data cannot tell."""


def answer(facts: Facts, key: str) -> str:
    """Answer a question: what the data tell, then what the maintainer says; empty if neither."""
    told = _DATA.get(key, _nothing)(facts)
    said = facts.answers.by_key.get(key, "")
    if key.endswith(f".{COMMENTS}"):
        return said or "None."
    return "\n\n".join(text for text in (told, said) if text)


def unanswered(facts: Facts) -> list[str]:
    """Keys of the questions that neither the data nor the maintainer answer."""
    return [key for key in QUESTIONS if not answer(facts, key)]


def answered_by_data(facts: Facts) -> list[str]:
    """Keys of the questions that the data answer."""
    return [key for key, of in _DATA.items() if of(facts)]


def _nothing(_: Facts) -> str:
    return ""


def _always(text: str) -> Answer:
    return lambda _: text


def _if_simulated(text: str) -> Answer:
    """Answer where every object is simulated; else only the maintainer knows."""
    return lambda facts: text if facts.simulated else ""


def _if_drawn(text: str) -> Answer:
    """Answer where this project's own simulator drew every object."""
    return lambda facts: text if facts.manifest.builder.startswith("xden-build phantoms") else ""


def _by_source(texts: Mapping[str, str]) -> Answer:
    return lambda facts: "\n\n".join(texts[source] for source in facts.manifest.sources)


def _if_ours(text: str) -> Answer:
    """Answer where the folder was made by a command of this project."""

    def told(facts: Facts) -> str:
        builder = facts.manifest.builder
        return text.format(builder=builder) if builder.startswith("xden-build") else ""

    return told


def _licence(facts: Facts) -> str:
    if facts.manifest.on_partnext:
        return f"{licence_text(facts.manifest)}."
    return "[CC-BY-4.0](https://creativecommons.org/licenses/by/4.0/), without a fee."


def _instances(facts: Facts) -> str:
    told = filter(None, [shapes_text(facts.manifest), provenance_text(facts.manifest)])
    return "\n\n".join(["Everyday objects, one in a row, of one type.", *told])


def _count(facts: Facts) -> str:
    return f"{_totals(facts)}\n\n{_table('category', 'objects', _strings(facts, 'category'))}"


def _strings(facts: Facts, column: str) -> list[str]:
    return list(facts.table[column].to_pylist())


def _totals(facts: Facts) -> str:
    masses = _masses(facts)
    known = masses[np.isfinite(masses)]
    parts = [len(names) for names in facts.table["part_names"].to_pylist()]
    lines = [
        f"- {len(parts)} objects, {len(set(_strings(facts, 'category')))} categories",
        f"- {sum(parts)} parts, {min(parts)} to {max(parts)} an object",
    ]
    if len(known):
        low, middle, high = (
            f"{mass:,.0f}" if mass >= 100 else f"{mass:.3g}"
            for mass in np.quantile(known, (0, 0.5, 1))
        )
        lines.append(f"- masses {low} to {high} g, median {middle} g")
    return "\n".join(lines)


def _masses(facts: Facts) -> np.ndarray:
    return np.array(facts.table["mass_g"].to_pylist(), dtype=float)


def _targets(facts: Facts) -> str:
    text = (
        "Density, as a field of voxel means and as a figure of each part with its standard "
        "deviation; mass, centre of mass and inertia; the material of each part."
    )
    if private := facts.manifest.splits.get(PRIVATE):
        text += f" Those of the {private} objects of the split `{PRIVATE}` are withheld."
    return text


def _missing(facts: Facts) -> str:
    weighed = len(facts.table) - facts.table["weighed_mass_g"].null_count
    lines = [
        "What was never measured is null, what follows from an unknown figure is not a number.\n",
        f"- weighed on a scale: {weighed} of {len(facts.table)} objects",
        f"- without a mass, as a density is unknown or withheld: "
        f"{int((~np.isfinite(_masses(facts))).sum())}",
    ]
    if without := sum(facts.manifest.without_radiographs.values()):
        lines.append(f"- without radiographs: {without}")
    if counts := facts.manifest.labels:
        lines.append(f"- without a material that could be published: {counts['no_material']} parts")
    return "\n".join(lines)


def _content(facts: Facts) -> str:
    text = (
        "Two radiographs (PA and LAT) as transmissions, closed part meshes, a grid of labels, and "
        "grids of density and of filled shares: `README.md` lists every column."
    )
    told = (one(facts.manifest) for one in (radiographs_text, disturbed_text))
    return " ".join(filter(None, [text, *told]))


def _splits(facts: Facts) -> str:
    counts = ", ".join(f"`{name}` {count}" for name, count in facts.manifest.splits.items())
    return (
        f"{counts} objects: to learn from, to choose by, to be judged by"
        + (f", `{UNSEEN}` to be judged by on categories of its own" * _has(facts, UNSEEN))
        + (f", and `{PRIVATE}` for a judgement whose answers nobody has" * _has(facts, PRIVATE))
        + ". An object is in one split alone."
    )


def _has(facts: Facts, split: Split) -> bool:
    return split in facts.manifest.splits


def _errors(facts: Facts) -> str:
    flags = (
        _table("flag", "objects and parts", facts.flags)
        if facts.flags
        else "No object and no part carries a flag."
    )
    return "\n\n".join(
        [
            f"**Labels of voxels.** {label_voxels_text(facts.manifest)}",
            f"**Labels of materials.** {materials_text(facts.manifest)}",
            "**Densities.** `part_density_sd_g_cm3` is the standard deviation of each; "
            "radiographs have the noise of their detector.",
            f"**Flags.**\n\n{flags}",
        ]
    )


def _table(what: str, of: str, values: Iterable[str]) -> str:
    lines = [f"| {what} | {of} |", "| --- | ---: |"]
    lines += [f"| {value} | {count} |" for value, count in sorted(Counter(values).items())]
    return "\n".join(lines)


def _done(facts: Facts) -> str:
    how = [_PROCESSED[source] for source in facts.manifest.density_sources]
    return "\n\n".join(filter(None, [*how, published_text(facts.manifest)]))


_PROCESSED: Final = {
    "xray": "`xray`: one attenuation coefficient per part was fitted to both radiographs, and "
    "turned into a density by the tube's energy and the material. Each part is taken to be "
    "homogeneous.",
    "prior": "`prior`: the radiographs could not see the part; its density is that of its "
    "material, with the material's spread as its standard deviation.",
    "weighed": "`weighed`: densities were scaled so that the object has the mass a scale gave.",
    "truth": "`truth`: the density is the one the simulator used, exact by construction; it was "
    "not reconstructed from the radiographs.",
    "withheld": "`withheld`: known, but not published: the benchmark's organiser scores with it.",
    "none": "`none`: only the attenuation was fitted; the part has no density, and its object no "
    "mass.",
}

_ACQUIRED: Final = {
    "scan": "Scanned objects: two radiographs of the object and a mesh of each part, annotated by "
    "people. `meta_json` has the geometry of each view.",
    "ct": "Objects from a CT: the two views are line integrals through a measured volume. They "
    "have no detector's noise of their own.",
    "published": "Objects of the authors' release: its meshes, attenuation volumes and tables of "
    "parts, as downloaded. `meta_json` names the commit and the checksum of each file.",
    "phantom": "Simulated objects: shapes and materials were drawn by a program, and the "
    "radiographs computed from them with a simulated scanner. Nobody made, scanned or weighed "
    "these objects. Results on them do not carry over to real objects by themselves.",
}
_MECHANISMS: Final = {
    "scan": "Scanned objects: an X-ray scanner and an annotation of the parts. `xden-build audit` "
    "projects the rebuilt parts again and compares them with the radiographs.",
    "ct": "Objects from a CT: a program that integrates along rays.",
    "published": "Objects of the authors' release: `xden import`, which registers mesh and volume "
    "and says in `meta_json` how well they agree.",
    "phantom": "Simulated objects: a program, with the settings that `meta_json` holds. "
    "`xden verify` compares mass, centre of mass, inertia and grids with the meshes.",
}
_DOES_NOT_APPLY: Final = "This does not apply: no people are in the dataset."


def _consequences(facts: Facts) -> str:
    private = _has(facts, PRIVATE)
    return (
        f"Objects of different sources (here: {', '.join(facts.manifest.sources)}) must not be "
        "mixed in a ranking without saying so. Each part is taken to be homogeneous. How often a "
        "category occurs here says nothing of how often it occurs elsewhere. The reference of "
        f"every {'other ' * private}split ships with the data, so honesty of a benchmark result is "
        "declared and checked, not enforced."
        + f" That of `{PRIVATE}` is sealed: its organiser scores."
        * private
    )


_DATA: Final[Mapping[str, Answer]] = {
    "motivation.purpose": _always(
        "To learn and to measure what is inside everyday objects: density, mass, centre of mass "
        "and inertia, from radiographs, pictures or shape."
    ),
    "composition.instances": _instances,
    "composition.count": _count,
    "composition.sample": _if_drawn(
        "A sample: the simulator can draw any number of objects of each category. They are as its "
        "authors imagine everyday objects, and represent no population of real ones."
    ),
    "composition.content": _content,
    "composition.targets": _targets,
    "composition.missing": _missing,
    "composition.relations": _always("Objects have a `category` in common, and nothing else."),
    "composition.splits": _splits,
    "composition.errors": _errors,
    "composition.self_contained": _always(
        "It is self-contained: nothing is fetched from elsewhere."
    ),
    "composition.confidential": _if_simulated("No: a program drew all of it."),
    "composition.offensive": _if_simulated("No: shapes and radiographs of everyday objects."),
    "composition.subpopulations": _if_simulated(_DOES_NOT_APPLY),
    "composition.individuals": _if_simulated("No: no people are in the dataset."),
    "composition.sensitive": _if_simulated("No: no people are in the dataset."),
    "collection.acquired": _by_source(_ACQUIRED),
    "collection.mechanisms": _by_source(_MECHANISMS),
    "collection.sampling": _if_drawn(
        "Each category in turn, over and over; an object is drawn by a random number generator "
        "from a seed, its category and its number."
    ),
    "collection.people": _if_simulated(
        "Nobody: a program drew, computed and labelled all of it. There were no annotators, no "
        "crowdworkers and no participants, so nobody was paid."
    ),
    "collection.timeframe": _if_simulated(
        "None: nothing was collected. The program gives the same bytes on any day."
    ),
    "collection.ethical_review": _if_simulated("None: no people took part, and none are in it."),
    "collection.directly": _if_simulated(_DOES_NOT_APPLY),
    "collection.notified": _if_simulated(_DOES_NOT_APPLY),
    "collection.consent": _if_simulated(_DOES_NOT_APPLY),
    "collection.revocation": _if_simulated(_DOES_NOT_APPLY),
    "collection.impact": _if_simulated(_DOES_NOT_APPLY),
    "preprocessing.done": _done,
    "preprocessing.raw": _if_drawn(
        "Not in this folder. `xden-build phantoms` makes the captures of the same objects, with "
        "the counts of the simulated detector."
    ),
    "preprocessing.software": _if_ours("Yes: {builder}, free software (Apache-2.0)."),
    "uses.other_tasks": _always(
        "Recognising materials, reconstruction from few views, and simulation: `xden export` "
        "writes objects for simulators of rigid bodies."
    ),
    "uses.consequences": _consequences,
    "uses.not_for": _always(
        "Not for medical use, nor for security screening, nor for any decision about a real "
        "object of the same kind: two kettles are not alike inside."
    ),
    "distribution.how": _always(
        "As a folder of Parquet files with checksums, which `xden-build push` publishes on the "
        "Hugging Face Hub. The folder itself has no DOI."
    ),
    "distribution.when": _always(
        "`croissant.json` of a published version has the day (`datePublished`)."
    ),
    "distribution.license": _licence,
    "distribution.restrictions": _if_drawn("No: nothing in it was taken from third parties."),
    "maintenance.updates": _always(
        "Errors are corrected in a new version; a published version never changes, and "
        "`manifest.json` and `SHA256SUMS` tell one from another."
    ),
    "maintenance.retention": _if_simulated(_DOES_NOT_APPLY),
    "maintenance.older_versions": _always(
        "An older version stays under its tag, which `xden-build push` never moves, as long as "
        "the host keeps it."
    ),
}
