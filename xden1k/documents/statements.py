"""Sentences on a dataset that more than one of its documents says, all from its manifest."""

from __future__ import annotations

from typing import Final

from xden1k.format.manifest import Manifest

__all__ = [
    "dataset_title",
    "label_voxels_text",
    "materials_text",
    "provenance_text",
]


def dataset_title(manifest: Manifest) -> str:
    """Name of a dataset, which says so where nothing in it is real."""
    return "XDen-1K, simulated objects" if manifest.simulated else "XDen-1K"


def provenance_text(manifest: Manifest) -> str:
    """Say what the objects and their densities are, so that nobody takes one for another."""
    objects = ", ".join(_SOURCES[name].format(n) for name, n in manifest.sources.items())
    densities = ", ".join(f"{n} {_DENSITIES[name]}" for name, n in manifest.density_sources.items())
    parts = sum(manifest.density_sources.values())
    return (
        f"**Where it comes from.** Objects: {objects}. Densities of the {parts} parts: {densities}."
    )


_SOURCES: Final = {
    "scan": "{} scanned",
    "ct": "{} with views computed from a CT",
    "phantom": "{} simulated, which were never on a scanner",
}
_DENSITIES: Final = {
    "xray": "measured by X-ray",
    "prior": "assumed from the material alone",
    "weighed": "corrected by a scale",
    "truth": "the simulator's truth",
    "none": "unknown (attenuation only)",
    "withheld": "withheld (the split private)",
}


def label_voxels_text(manifest: Manifest) -> str:
    """Say what the label grid does not show, and of how many parts."""
    counts = manifest.labels
    counted = (
        f"Of {counts['parts']} parts {counts['voxels_err']} have label voxels that err by more "
        f"than a fifth about the volume of their mesh, and {counts['no_voxels']} have none. "
        if counts
        else "How many parts that is was not counted in this folder. "
    )
    return (
        "A label names the part that holds the centre of its voxel, so that `labels` loses what "
        f"is thinner than a voxel. {counted}The builder flags them, and objects of which nothing "
        "is left, `thinner_than_labels`. Volumes, masses and the shares of `occupancy` and "
        "`envelope` come from the meshes and lack nothing."
    )


def materials_text(manifest: Manifest) -> str:
    """Say how far the materials can be trusted: some are wrong or missing on purpose."""
    return " ".join([*_materials(manifest), *_counted_materials(manifest)])


def _materials(manifest: Manifest) -> list[str]:
    judged = manifest.density_sources.keys() - {"truth", "withheld"}
    said = []
    if manifest.simulated and not judged:
        said.append(_TRUE_MATERIALS)
    elif "phantom" in manifest.sources:
        said.append(_ERRING_MATERIALS)
    if not manifest.simulated:
        said.append(_ANNOTATED_MATERIALS)
    return said


_TRUE_MATERIALS: Final = (
    "`part_materials` of these simulated objects are those that the simulator used, not labels "
    "that err; captures of the same objects have some that err on purpose. A material does not "
    "tell pores: a foamed part has the name of its solid."
)
_ERRING_MATERIALS: Final = (
    "`part_materials` of simulated objects that were rebuilt are the labels of their captures, "
    "which err on purpose, as annotators do: unless the captures were made with `--tidy` or "
    "`--ideal`, of 100 parts about 5 are labelled as another material of the same family, and 5 "
    "not at all. They are not the truth, which is with the captures."
)
_ANNOTATED_MATERIALS: Final = (
    "`part_materials` of objects that are not simulated are what annotators took the parts for."
)


def _counted_materials(manifest: Manifest) -> list[str]:
    if not (counts := manifest.labels):
        return []
    told = counts["parts"] - manifest.density_sources.get("withheld", 0)
    return [
        f"Of {told} parts whose material may be told, {counts['no_material']} have no label, and "
        f"the radiographs cast doubt on {counts['material_doubted']} (`label_doubted`)."
    ]
