"""The datasheet of a dataset folder: how it was made, and what it is not good for.

Its questions are those of Gebru et al., Datasheets for Datasets (doi:10.1145/3458723).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np
import pyarrow as pa

from xden1k.documents.card import provenance_text
from xden1k.format.manifest import Manifest
from xden1k.values.types import PRIVATE

__all__ = ["DATASHEET_COLUMNS", "datasheet_text"]

DATASHEET_COLUMNS = (
    *("category", "source", "flags", "weighed_mass_g", "mass_g"),
    *("part_names", "part_density_source", "part_flags"),
)
"""Columns the datasheet is computed from."""


def datasheet_text(manifest: Manifest, table: pa.Table) -> str:
    """Text of ``DATASHEET.md``.

    Parameters
    ----------
    manifest
        Of the folder.
    table
        :data:`DATASHEET_COLUMNS` of every object.
    """
    return f"""# Datasheet

Made by {manifest.builder}, data version {manifest.version}, settings {_settings(manifest)}.

## Motivation

To learn and to measure what is inside everyday objects: density, mass, centre of mass and
inertia, from radiographs, pictures or shape.

## Composition

{provenance_text(manifest)}

{_composition(table)}

{_categories(table)}

{_flags(table)}

{_labels(table)}

## Collection

{_collection(manifest)}

## Processing

{_processing(manifest)}

## Uses

For research on physical properties of objects. Not for medical use, nor for security screening,
nor for any decision about a real object of the same kind: two kettles are not alike inside.
Objects of different sources ({", ".join(manifest.sources)}) must not be mixed in a ranking without
saying so. {_honesty(manifest)}

## Distribution and maintenance

Data: CC-BY-4.0. Errors are corrected in a new version; a published version never changes, and
`manifest.json` and `SHA256SUMS` tell one from another.
"""


def _honesty(manifest: Manifest) -> str:
    which, sealed = "every split", ""
    if PRIVATE in manifest.splits:
        which = "every other split"
        sealed = f"\nThat of `{PRIVATE}` is sealed: its organiser scores."
    return (
        f"The reference of {which} ships with the data, so honesty of a benchmark result is\n"
        f"declared and checked, not enforced.{sealed}"
    )


def _settings(manifest: Manifest) -> str:
    return f"`{manifest.config_sha256[:12]}`" if manifest.config_sha256 else "not recorded"


def _composition(table: pa.Table) -> str:
    masses = np.array(table["mass_g"].to_pylist(), dtype=float)
    known = masses[np.isfinite(masses)]
    parts = [len(names) for names in table["part_names"].to_pylist()]
    weighed = len(table) - table["weighed_mass_g"].null_count
    lines = [
        f"- {len(table)} objects, {len(set(table['category'].to_pylist()))} categories",
        f"- {sum(parts)} parts, {min(parts)} to {max(parts)} an object",
        f"- weighed on a scale: {weighed}",
        f"- without a mass, as the density of a part is unknown: {len(masses) - len(known)}",
    ]
    if len(known):
        low, middle, high = np.quantile(known, (0, 0.5, 1))
        lines.append(f"- masses {low:.3g} to {high:.3g} g, median {middle:.3g} g")
    return "\n".join(lines)


def _categories(table: pa.Table) -> str:
    return _count_table("category", "objects", table["category"].to_pylist())


def _flags(table: pa.Table) -> str:
    flags = [flag for row in table["flags"].to_pylist() for flag in row]
    flags += [flag for row in table["part_flags"].to_pylist() for part in row for flag in part]
    if not flags:
        return "No object and no part carries a flag."
    return _count_table("flag", "objects and parts", flags)


def _labels(table: pa.Table) -> str:
    """Say what the label grid does not show."""
    flags = [part for row in table["part_flags"].to_pylist() for part in row]
    thin = sum("thinner_than_labels" in part for part in flags)
    return (
        f"Of {len(flags)} parts {thin} carry the flag `thinner_than_labels`: their label voxels\n"
        "err by more than a fifth about the volume of their mesh. Their meshes are whole."
    )


def _count_table(what: str, of: str, values: Iterable[str]) -> str:
    lines = [f"| {what} | {of} |", "| --- | ---: |"]
    lines += [f"| {value} | {count} |" for value, count in sorted(Counter(values).items())]
    return "\n".join(lines)


def _collection(manifest: Manifest) -> str:
    return "\n\n".join(_COLLECTED[source] for source in manifest.sources)


_COLLECTED = {
    "scan": "Scanned objects: two radiographs of the object and a mesh of each part, annotated by "
    "people. `meta_json` has the geometry of each view.",
    "ct": "Objects from a CT: the two views are line integrals through a measured volume. They "
    "have no detector's noise of their own.",
    "phantom": "Simulated objects: shapes and materials were drawn by a program, and the "
    "radiographs computed from them with a simulated scanner. Nobody made, scanned or weighed "
    "these objects. Results on them do not carry over to real objects by themselves.",
}


def _processing(manifest: Manifest) -> str:
    return "\n\n".join(_PROCESSED[source] for source in manifest.density_sources)


_PROCESSED = {
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
