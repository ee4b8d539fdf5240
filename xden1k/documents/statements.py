"""Sentences on a dataset that more than one of its documents says, all from its manifest."""

from __future__ import annotations

from typing import Final

from xden1k.format.manifest import Manifest
from xden1k.format.shapes import ON_PARTNEXT

__all__ = [
    "dataset_title",
    "disturbed_text",
    "label_voxels_text",
    "licence_text",
    "materials_text",
    "provenance_text",
    "published_text",
    "radiographs_text",
    "shapes_text",
]


def dataset_title(manifest: Manifest) -> str:
    """Name of a dataset, which says so where nothing in it is real, or all of it is imported."""
    disturbed = ", disturbed radiographs" if manifest.disturbed else ""
    if 0 < manifest.on_partnext == manifest.objects:
        return f"XDen-1K, {ON_PARTNEXT}{disturbed}"
    if manifest.sources.keys() == {"published"}:
        return f"XDen-1K, imported from the authors' release{disturbed}"
    return f"XDen-1K{', simulated objects' * manifest.simulated}{disturbed}"


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
    "published": "{} imported from the authors' release",
}
_DENSITIES: Final = {
    "xray": "measured by X-ray",
    "prior": "assumed from the material alone",
    "weighed": "corrected by a scale",
    "truth": "the simulator's truth",
    "none": "unknown (attenuation only)",
    "withheld": "withheld (the split private)",
}


def disturbed_text(manifest: Manifest) -> str:
    """Say what was done to the radiographs of a copy; empty where nothing was."""
    if (told := manifest.disturbed) is None:
        return ""
    return (
        f"Disturbed on purpose: a copy of the folder with the manifest `{told.of[:12]}` in which "
        f"radiographs {told.radiographs} (seed {told.seed}). All else is as it was. It shows how "
        "much a method needs of its radiographs; scores on it are no entries of the benchmark."
    )


def published_text(manifest: Manifest) -> str:
    """Say what was taken from the authors' release, and what was changed; empty without it."""
    return _PUBLISHED if "published" in manifest.sources else ""


_PUBLISHED: Final = (
    "Objects of the source `published` are the XDen-1K authors' release (CC-BY-4.0), changed: the "
    "meshes of their parts were made from its attenuation volume, grids from these. "
    "`part_lac_per_cm` is its attenuation and `apparent_density` its density, LAC / 0.17, as "
    "published; `density` with its standard deviation is this project's estimate from attenuation, "
    "thickness and the likeliest materials, not the authors'. `meta_json` of each object has what "
    "it was made from, how well mesh and volume agree (`registration`) and the beam that was taken "
    "(`fit`)."
)


def shapes_text(manifest: Manifest) -> str:
    """Say whose shapes objects have that are simulated on others' models; empty without any."""
    if not (count := manifest.on_partnext):
        return ""
    return (
        f"{count} of {manifest.objects} objects are {ON_PARTNEXT} (arXiv:2510.20155). Their "
        "surfaces and the names of their parts are others' work; what they are made of, their "
        "sizes, walls and insides were drawn at random, and nothing of them was ever measured."
    )


def licence_text(manifest: Manifest) -> str:
    """Say under what terms the data are."""
    if not manifest.on_partnext:
        return "CC-BY-4.0"
    return (
        "CC-BY-4.0, but for the shapes: models in PartNeXt come from Objaverse, ABO and 3D-FUTURE, "
        "each under a licence of its own, which is not known here. Do not pass on this folder "
        "unless the licence of every shape in it allows that"
    )


def radiographs_text(manifest: Manifest) -> str:
    """Say how many objects have no radiographs; empty where all have theirs."""
    if not (without := sum(manifest.without_radiographs.values())):
        return ""
    return (
        f"{without} of {manifest.objects} objects have no radiographs: `xray_pa`, `xray_lat`, "
        "their shapes and previews are null, `views` is empty. None was computed in their place."
    )


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
    if manifest.sources.keys() - {"phantom", "published"}:
        said.append(_ANNOTATED_MATERIALS)
    if "published" in manifest.sources:
        said.append(_LIKELIEST_MATERIALS)
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
_LIKELIEST_MATERIALS: Final = (
    "The authors' release tells no material: `part_materials` of its objects are the likeliest by "
    "attenuation, thickness and the part's name, a family where no member is, else empty."
)


def _counted_materials(manifest: Manifest) -> list[str]:
    if not (counts := manifest.labels):
        return []
    told = counts["parts"] - manifest.density_sources.get("withheld", 0)
    return [
        f"Of {told} parts whose material may be told, {counts['no_material']} have no label, and "
        f"the radiographs cast doubt on {counts['material_doubted']} (`label_doubted`)."
    ]
