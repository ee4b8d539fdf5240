"""The beam that the objects of a folder share, found from some of them before all are rebuilt.

What was found is kept in ``OUT.work/beam.json`` and holds as long as code, settings and most of the
objects that were asked stay as they are, and no more than :data:`GROWN` times as many would be
asked: one object that is mended or added changes nothing of the others.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, replace
from functools import partial
from typing import Any, Final, NamedTuple

from xden1k.values.cost import Meter
from xden_builder.capture import ObjectRow
from xden_builder.pipeline.remarks import is_calibrated
from xden_builder.pipeline.resumable import refuse_to_go_on
from xden_builder.pipeline.storage import (
    Place,
    inside,
    object_capture,
    read_bytes,
    write_bytes,
)
from xden_builder.pipeline.version import refuse_other_code
from xden_builder.poly.hardness import Hardness, join, pilots
from xden_builder.poly.survey import FILTERS_MM_CU, Clue
from xden_builder.reconstruct.clues import find_clues
from xden_builder.reconstruct.settings import BuildSettings
from xden_builder.workers import Answer

__all__ = ["BEAM_NAME", "SharedBeam", "shared_beam", "with_beam"]

BEAM_NAME: Final = "beam.json"
SCHEMA: Final = "xden-beam/2"
MOST: Final = 0.5
"""What was found holds while more than this share of the objects asked is unchanged."""
GROWN: Final = 2
"""And while no more than so many times as many would be asked."""


class Said(NamedTuple):
    """Clues of one object, the checksum of all they were made from, and what they took."""

    object_id: str
    digest: str
    clues: tuple[Clue, ...]
    processor_s: float


class SharedBeam(NamedTuple):
    """What was found, if any, and what it took; None if it was kept from an earlier run."""

    found: Hardness | None
    processor_s: float | None


class Kept(NamedTuple):
    """What was found before, the checksums of those that answered, and how many were asked."""

    found: Hardness
    digests: Mapping[str, str]
    asked: int


Run = Callable[
    [Callable[[ObjectRow], Any], Iterable[ObjectRow]],
    Generator[Answer[ObjectRow, Any], None, None],
]


def shared_beam(
    rows: Mapping[str, ObjectRow],
    settings: BuildSettings,
    made_by: str,
    places: tuple[Place, Place | None, Place],
    run: Run,
) -> SharedBeam:
    """Ask some objects what they say of the beam, and weigh it together.

    Parameters
    ----------
    rows
        Of all objects, by id.
    settings, made_by
        How they are rebuilt, and the checksum of that and the code.
    places
        Captures, other part meshes if any, work files; as workers see them.
    run
        Runs a task for each row, in processes or on a cluster.

    Raises
    ------
    OSError
        If a disk is full.
    OtherVersionError
        If a machine of the cluster has other code than this one.
    """
    captures, parts, work = places
    if (kept := _kept(work)) is not None:
        asked = [rows[name] for name in kept.digests if name in rows]
        now = _answers(run(partial(_digest, made_by, captures, parts), asked))
        same = sum(kept.digests[name] == digest for name, digest in now)
        if same > MOST * len(kept.digests) and len(pilots(rows)) <= GROWN * kept.asked:
            return SharedBeam(kept.found, None)
    task = partial(_ask, settings, made_by, captures, parts)
    chosen = pilots(rows)
    said = sorted(_answers(run(task, [rows[name] for name in chosen])))
    clues = {each.object_id: each.clues for each in said}
    found = join(clues, calibrated=is_calibrated(captures))
    write_bytes(inside(work, BEAM_NAME), _text(found, said, len(chosen)).encode())
    return SharedBeam(found, sum(each.processor_s for each in said))


def with_beam(settings: BuildSettings, found: Hardness | None) -> BuildSettings:
    """Return the settings by which the objects of a folder are rebuilt."""
    return settings if found is None else replace(settings, poly=found.applied(settings.poly))


def _answers(answers: Generator[Answer[ObjectRow, Any], None, None]) -> list[Any]:
    """Collect what came back; an object that says nothing is judged when it is rebuilt."""
    found = []
    with closing(answers):
        for _, answer in answers:
            refuse_to_go_on(answer)
            if not isinstance(answer, BaseException):
                found.append(answer)
    return found


def _digest(
    made_by: str, captures: Place, parts: Place | None, asked: ObjectRow
) -> tuple[str, str]:
    """Return id and checksum of an object, by a worker."""
    with object_capture(captures, parts, asked) as folder:
        content = f"{made_by}\n{folder.digest(asked.object_id)}"
        return asked.object_id, hashlib.sha256(content.encode()).hexdigest()


def _ask(
    settings: BuildSettings,
    made_by: str,
    captures: Place,
    parts: Place | None,
    asked: ObjectRow,
) -> Said:
    """Find the clues of one object, by a worker."""
    refuse_other_code(settings, made_by)
    meter = Meter()
    name, digest = _digest(made_by, captures, parts, asked)
    with object_capture(captures, parts, asked) as folder:
        clues = find_clues(folder.read(name), settings)
    return Said(name, digest, clues, meter.read().processor_s)


def _text(found: Hardness, said: Sequence[Said], asked: int) -> str:
    objects = {
        each.object_id: {"digest": each.digest, "clues": [asdict(clue) for clue in each.clues]}
        for each in said
    }
    values = {
        "schema": SCHEMA,
        "hardness": asdict(found),
        "filters_mm_cu": FILTERS_MM_CU,
        "asked": asked,
        "objects": objects,
    }
    return json.dumps(values, indent=1) + "\n"


def _kept(work: Place) -> Kept | None:
    """Read what was found before; None where there is nothing, or it is damaged."""
    content = read_bytes(inside(work, BEAM_NAME))
    if content is None:
        return None
    try:
        values = json.loads(content)
        if values["schema"] != SCHEMA:
            return None
        digests = {name: each["digest"] for name, each in values["objects"].items()}
        tubes = values["hardness"]["two_tubes_mm_cu"]
        pair = None if tubes is None else (tubes[0], tubes[1])
        rests_on = tuple(values["hardness"]["rests_on"])
        found = Hardness(**values["hardness"] | {"two_tubes_mm_cu": pair, "rests_on": rests_on})
        return Kept(found, digests, int(values.get("asked", len(digests))))
    except (ValueError, KeyError, TypeError, AttributeError, IndexError):
        return None
