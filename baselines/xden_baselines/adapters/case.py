"""A case folder of GaussianProperty, lifted to 3D by a vote of the views.

::

    CASE/  images/001.png       RGBA pictures
           seg/001_s.npy        int32 (rows, columns): -1 background, 0 in no part, k = part k
           NAME.txt             a line for each part: PATH,CAPTION,MATERIAL,LOW-HIGH,Shore X
           transforms.json      cameras in the object's frame, as in a scene folder: not by the
                                original, which lifts nothing

PATH ends in ``01/02.png``: view 1, part 2. Views without a segmentation have no vote.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float, Integer, Shaped

from xden1k.access.samples import SampleView
from xden1k.errors import DataError
from xden1k.values.arrays import Points
from xden_baselines.adapters.cloud import Cloud
from xden_baselines.adapters.files import read_json, read_npy, read_text
from xden_baselines.gaussian_property.voting import winners
from xden_baselines.geometry import SKIN, near_surface, voxel_centres_cm
from xden_baselines.views.pictures import Pictures, visible
from xden_baselines.views.rendering import Surface
from xden_baselines.views.scenes import read_scene

__all__ = ["parse_answers", "read_case"]

CM_PER_M = 100.0

Part = tuple[int, int]
"""View and part, as the original counts them."""


def parse_answers(text: str) -> tuple[Mapping[Part, str], int]:
    r"""Read the material of each part of each view.

    Returns
    -------
    materials
        By view and part.
    unparsed
        How many lines gave none: errors that were recorded, and answers of another form.

    Examples
    --------
    >>> parse_answers("gpt_input/01/02.png,a lid, red,wood,40-60,Shore D\n01/03.png,error,-1")
    ({(1, 2): 'wood'}, 1)
    """
    materials: dict[Part, str] = {}
    unparsed = 0
    for line in filter(None, map(str.strip, text.splitlines())):
        # from the right: captions hold commas
        fields = [field.strip() for field in line.rsplit(",", 3)]
        place = re.search(r"(\d{1,6})/(\d{1,6})\.png$", fields[0].partition(",")[0])
        if len(fields) < 4 or place is None or not fields[1] or "," not in fields[0]:
            unparsed += 1
        else:
            materials[int(place[1]), int(place[2])] = fields[1]
    return materials, unparsed


def read_case(
    case: Path,
    sample: SampleView,
    densities_g_cm3: Callable[[Shaped[np.ndarray, "materials"]], Float[np.ndarray, "materials"]],
) -> Cloud:
    """Let each voxel at the surface take the material that most views give it.

    Ties go to the first in the alphabet. The cloud is in metres, in the object's frame.

    Parameters
    ----------
    case
        The folder.
    sample
        The object.
    densities_g_cm3
        Gives the densities of materials.

    Raises
    ------
    DataError
        If a file is missing or breaks its format, or no voxel gets a vote.
    """
    answers, unparsed = parse_answers(read_text(case / f"{case.name}.txt"))
    if not answers:
        raise DataError(f"{case}: none of {unparsed} lines gives a material")
    names, which = np.unique(np.array(list(answers.values())), return_inverse=True)
    pictures = read_scene(case, Surface(np.asarray(sample.outer_mesh.triangles)))
    segmentations = _segmentations(case, pictures)
    surface = near_surface(sample)
    points = voxel_centres_cm(sample, surface)
    ballots = np.zeros((len(points), len(names)), dtype=np.int64)
    material = dict(zip(answers, which.tolist(), strict=True))
    for view, (number, segmentation) in segmentations.items():
        votes = _votes(points, pictures, view, SKIN * sample.voxel_size_cm, segmentation)
        for part in np.unique(votes).tolist():
            if (number, part) in material:
                ballots[votes == part, material[number, part]] += 1
    chosen = winners(ballots)
    if not (voted := chosen >= 0).any():
        raise DataError(f"{case}: no part with a material is seen on the object")
    density = densities_g_cm3(names)[chosen[voted]]
    return Cloud(points[voted] / CM_PER_M, density, "g/cm3", unread=unparsed)


def _segmentations(
    case: Path, pictures: Pictures
) -> dict[int, tuple[int, Integer[np.ndarray, "rows columns"]]]:
    """For each picture that has one: its number, and its segmentation."""
    found: dict[int, tuple[int, np.ndarray]] = {}
    for view, frame in enumerate(read_json(case / "transforms.json")["frames"]):
        stem = Path(frame["file_path"]).stem
        path = case / "seg" / f"{stem}_s.npy"
        if not path.exists():
            continue
        segmentation, shape = read_npy(path), pictures.masks.shape[1:]
        if segmentation.dtype.kind != "i" or segmentation.shape != shape:
            got = f"{segmentation.dtype} {segmentation.shape}"
            raise DataError(f"{path}: expected whole numbers of shape {shape}, got {got}")
        if not stem.isdecimal():
            raise DataError(f"{path}: pictures are numbered, as 001.png, got {stem}")
        found[view] = (int(stem), segmentation)
    if not found:
        raise DataError(f"{case}: no picture has a segmentation in seg/")
    return found


def _votes(
    points_cm: Points,
    pictures: Pictures,
    view: int,
    tolerance_cm: float,
    segmentation: Integer[np.ndarray, "rows columns"],
) -> Integer[np.ndarray, "points"]:
    """Which part each point shows in a view; 0 where none."""
    seen, pixels = visible(points_cm, pictures, view, tolerance_cm=tolerance_cm)
    votes = np.zeros(len(points_cm), dtype=np.int64)
    votes[seen] = segmentation[pixels[:, 0], pixels[:, 1]].clip(min=0)
    return votes
