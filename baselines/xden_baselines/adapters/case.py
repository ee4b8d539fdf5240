"""A case folder of GaussianProperty, lifted to 3D by a vote of the views.

::

    CASE/  images/001.png       RGBA pictures
           seg/001_s.npy        int32 (rows, columns): -1 background, k = part k; 0 is the largest
                                mask and what no other mask holds, a part as any other
           NAME.txt             an answer for each part: PATH,CAPTION,MATERIAL,LOW-HIGH,Shore X
           transforms.json      cameras in the object's frame, as in a scene folder: not by the
                                original, which lifts nothing

PATH ends in ``01/02.png``: view 1, part 2. An answer may be the text of the model, over more than
one line, or what the original makes of GPT's: the printed ``Choice(... content='...' ...)``. Views
without a segmentation have no vote.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

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
NOT_SEEN: Final = -1
"""The label of a point that a view does not show; the original's for the background."""
_RECORD = re.compile(r"^([^,\n]*)\.png,", re.MULTILINE)
_PLACE = re.compile(r"(?:^|.*/)(\d{1,6})/(\d{1,6})")
_CONTENT = re.compile(r"""\bcontent=('(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*")""")
"""A string as Python prints it."""
_SHORE = re.compile(r",([^,]+),[^,\d]*\d[^,]*,\s*<?Shore\s+[AD]", re.IGNORECASE)
"""After a caption, which may hold commas: material, hardness, scale."""


def parse_answers(text: str) -> tuple[Mapping[Part, str], int]:
    r"""Read the material of each part of each view, in lower case.

    Returns
    -------
    materials
        By view and part.
    unparsed
        How many answers gave none: errors that were recorded, and answers of another form.

    Examples
    --------
    >>> parse_answers("gpt_input/01/02.png,a lid, red,Wood,40-60,Shore D\n01/03.png,error,-1")
    ({(1, 2): 'wood'}, 1)
    """
    records = list(_RECORD.finditer(text))
    ends = [*(record.start() for record in records[1:]), len(text)]
    materials: dict[Part, str] = {}
    unparsed = 0
    for record, end in zip(records, ends, strict=True):
        place = _PLACE.fullmatch(record[1])
        material = _material(text[record.end() : end])
        if place is None or material is None:
            unparsed += 1
        else:
            materials[int(place[1]), int(place[2])] = material
    return materials, unparsed


def _material(answer: str) -> str | None:
    """Material of one answer; None if it names none."""
    printed = _CONTENT.search(answer)
    try:
        said = str(ast.literal_eval(printed[1])) if printed else answer
    except (SyntaxError, ValueError):  # an escape that Python does not print
        return None
    found = _SHORE.findall(said)
    name = found[-1].strip(" \t\n*_`\"'()[]<>.").lower() if found else ""
    return name or None


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
        raise DataError(f"{case}: none of {unparsed} answers gives a material")
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
    """Which part each point shows in a view; :data:`NOT_SEEN` where none."""
    seen, pixels = visible(points_cm, pictures, view, tolerance_cm=tolerance_cm)
    votes = np.full(len(points_cm), NOT_SEEN, dtype=np.int64)
    votes[seen] = segmentation[pixels[:, 0], pixels[:, 1]].clip(min=NOT_SEEN)
    return votes
