"""A twin as files: the release, and its truth beside it, never inside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float32
from PIL import Image

from xden1k.errors import require
from xden1k.values.mass import mass_of_meshes
from xden1k.values.physics import apparent_density_g_cm3
from xden_builder.capture.writing import write_json
from xden_builder.phantoms.catalogue import CATALOGUE
from xden_builder.phantoms.phantom import Phantom, Plan, make_phantom, plan_objects, random_numbers
from xden_builder.phantoms.realism import LIFELIKE
from xden_builder.phantoms.writer import Progress, each_object, refuse_filled
from xden_builder.published.twin.attenuation import fitted_lac_per_cm
from xden_builder.published.twin.conventions import Conventions, Variant, draw_conventions
from xden_builder.published.twin.defects import Defects, draw_defects
from xden_builder.published.twin.pose import Pose, pose_of
from xden_builder.published.twin.surface import flawed, scene, visible_surface
from xden_builder.published.twin.volume import lac_volume

__all__ = ["truth_path", "write_twin"]

TINY: Final = ("pliers", "mug", "hammer", "flashlight", "rubber_ball", "drawer_box")
"""Categories of the variant ``tiny``."""
CARD: Final = """---
license: cc-by-4.0
---
Simulated objects in the layout of a published release, made by `xden-build twin`.
"""


def truth_path(release: Path) -> Path:
    """Where the truth of a twin lies: beside it.

    Examples
    --------
    >>> truth_path(Path("data/twin")).as_posix()
    'data/twin.truth.json'
    """
    return release.with_name(f"{release.name}.truth.json")


def write_twin(
    out: Path,
    count: int,
    seed: int,
    variant: Variant,
    *,
    workers: int = 1,
    progress: Progress = lambda _: None,
) -> None:
    """Write a twin of the published release, made of phantoms.

    ``metadata.json`` comes last: without it nothing has a category or a size. The same arguments
    give the same bytes, whatever the number of processes.

    Parameters
    ----------
    out
        A folder that is empty or does not exist. The truth goes to :func:`truth_path`: for each
        object its place in both files (4 by 4, from cm in the phantom's frame), its parts with
        their densities, its mass and its flaws.
    count, seed
        How many objects, and which: categories come in a random order, each before any comes again.
    variant
        See :func:`draw_conventions`.
    workers
        Number of processes.
    progress
        Called with the id of each phantom that is done.

    Raises
    ------
    DataError
        If the folder is not empty, or an argument is out of range.
    """
    conventions = draw_conventions(variant, seed)
    plans = _plans(count, seed, variant)
    refuse_filled(out)
    (out / "dataset").mkdir(parents=True)
    numbers = {plan.object_id: number for number, plan in enumerate(plans)}
    task = partial(_write_object, out / "dataset", numbers, conventions, seed)
    told = list(each_object(task, plans, workers, progress))
    (out / "README.md").write_text(CARD, encoding="utf-8")
    objects = {str(number): truth for number, (_, truth) in enumerate(told)}
    release = {"variant": variant, "seed": seed, **conventions.to_dict()}
    write_json(truth_path(out), {"schema": "xden-twin/1", "release": release, "objects": objects})
    above = out / "dataset" if conventions.metadata_inside else out
    metadata = {str(number): entry for number, (entry, _) in enumerate(told)}
    write_json(above / "metadata.json", metadata)


def _plans(count: int, seed: int, variant: Variant) -> list[Plan]:
    """Choose phantoms, all categories in a drawn order."""
    names = TINY if variant == "tiny" else tuple(category.name for category in CATALOGUE)
    rounds = -(-count // len(names))
    every = plan_objects(rounds * len(names), seed, names)
    order = random_numbers(seed, "twin order").permutation(len(names))
    return [every[place * len(names) + pick] for place in range(rounds) for pick in order][:count]


def _write_object(
    dataset: Path,
    numbers: Mapping[str, int],
    conventions: Conventions,
    seed: int,
    object_id: str,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Write the folder of one object; return its metadata and its truth."""
    plan = Plan.of(seed, object_id)
    phantom, defects = make_phantom(plan, LIFELIKE), draw_defects(plan)
    bounds = np.array([part.mesh.bounds for part in phantom.parts])
    box = np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])
    pose = pose_of(box, plan, conventions)
    fitted = fitted_lac_per_cm(plan)
    lac_per_cm = [fitted[part.name] for part in phantom.parts]
    keys = _keys(phantom, conventions)
    folder = dataset / str(numbers[object_id])
    folder.mkdir()
    _write_mesh(folder / "mesh.glb", phantom, defects, pose, conventions)
    meshes = [part.mesh for part in phantom.parts]
    volume = lac_volume(meshes, lac_per_cm, pose, conventions)
    _write_nifti(folder / "optimized_lac.nii.gz", volume)
    if not defects.no_table:
        write_json(folder / "part_lac_density.json", _table(keys, lac_per_cm))
    if conventions.stray_images:
        _write_stray(folder / "view_0.png", volume)
    entry = _metadata(plan, pose, defects, conventions)
    return entry, _truth(phantom, defects, pose, dict(zip(keys, lac_per_cm, strict=True)))


def _keys(phantom: Phantom, conventions: Conventions) -> list[str]:
    if conventions.named_parts:
        return [part.name for part in phantom.parts]
    return [f"part_{number}" for number in range(len(phantom.parts))]


def _write_mesh(
    path: Path, phantom: Phantom, defects: Defects, pose: Pose, conventions: Conventions
) -> None:
    rng = phantom.plan.rng("twin surface")
    outer, inner = visible_surface(phantom, pose, conventions)
    surface = flawed(outer, inner, defects, rng)
    made = scene(surface, phantom, defects, conventions.texture_px, rng)
    path.write_bytes(made.export(file_type="glb"))  # type: ignore[no-untyped-call]


def _write_nifti(path: Path, volume: Float32[np.ndarray, "x y z"]) -> None:
    """Write a volume as the release has it: no affine but the identity, which means nothing."""
    nibabel = require("nibabel", "import")
    image = nibabel.Nifti1Image(volume, np.eye(4))
    image.set_sform(np.eye(4), code=2)
    nibabel.save(image, path)


def _write_stray(path: Path, volume: Float32[np.ndarray, "x y z"]) -> None:
    """Write a picture that is no radiograph, though it may look like one."""
    seen = volume.max(axis=0)
    Image.fromarray((255 * seen / max(float(seen.max()), 1e-6)).astype(np.uint8)).save(path)


def _table(keys: Sequence[str], lac_per_cm: Sequence[float]) -> dict[str, dict[str, float]]:
    return {
        key: {"LAC": lac, "Density": apparent_density_g_cm3(lac)}
        for key, lac in zip(keys, lac_per_cm, strict=True)
    }


def _metadata(plan: Plan, pose: Pose, defects: Defects, conventions: Conventions) -> dict[str, Any]:
    size_cm = (pose.extents_cm * defects.size_factors)[list(conventions.size_axes)]
    return {
        "category": plan.category.name.replace("_", " ").title(),
        "size": size_cm.round(2).tolist(),
    }


def _truth(
    phantom: Phantom, defects: Defects, pose: Pose, lac_per_cm: Mapping[str, float]
) -> dict[str, Any]:
    mass = phantom.mass_properties
    meshes = [part.mesh for part in phantom.parts]
    apparent = [apparent_density_g_cm3(lac) for lac in lac_per_cm.values()]
    return {
        "phantom": phantom.plan.object_id,
        "category": phantom.plan.kind,
        "mesh_matrix": pose.mesh.tolist(),
        "volume_matrix": pose.volume.tolist(),
        "extents_cm": pose.extents_cm.tolist(),
        "mass_g": mass.mass_g,
        "com_cm": mass.com_cm.tolist(),
        "apparent_mass_g": mass_of_meshes(meshes, apparent).mass_g,
        "defects": defects.to_dict(),
        "parts": [
            {
                "key": key,
                "name": part.name,
                "material": part.material,
                "density_g_cm3": part.density_g_cm3,
                "solid_share": part.solid_share,
                "volume_cm3": float(part.mesh.volume),
                "lac_per_cm": lac,
            }
            for part, (key, lac) in zip(phantom.parts, lac_per_cm.items(), strict=True)
        ],
    }
