"""The beam that the objects of a folder share, found from some of them before all are rebuilt.

What was found is kept in ``OUT.work/beam.json`` and holds as long as code, settings and most of the
objects that answered stay as they are, and no more than :data:`GROWN` times as many would be asked:
one object that is mended or added changes nothing of the others. Each answer is kept there as it
comes, so that whoever answered before a run was stopped is not asked again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
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
"""What was found holds while more than this share of the objects that answered is unchanged."""
GROWN: Final = 2
"""And while no more than so many times as many would be asked: others had failed, or were not yet
there."""


class Said(NamedTuple):
    """Clues of one object, the checksum of all they were made from, and what they just took."""

    object_id: str
    digest: str
    clues: tuple[Clue, ...]
    processor_s: float

    @classmethod
    def from_dict(cls, object_id: str, values: Mapping[str, Any]) -> Said:
        """Read what :meth:`to_dict` gives."""
        clues = tuple(_clue(**clue) for clue in values["clues"])
        return cls(object_id, str(values["digest"]), clues, 0.0)

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return {"digest": self.digest, "clues": [asdict(clue) for clue in self.clues]}


class SharedBeam(NamedTuple):
    """What was found, if any, and what it took; None if it was kept from an earlier run."""

    found: Hardness | None
    processor_s: float | None


class Kept(NamedTuple):
    """What objects said before, and what was found once all had answered."""

    said: Mapping[str, Said]
    found: Hardness | None


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
    on_asked: Callable[[int, int], None] = lambda *_: None,
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
    on_asked
        Told as they answer: how many have, of how many.

    Raises
    ------
    OSError
        If a disk is full.
    OtherVersionError
        If a machine of the cluster has other code than this one.
    """
    captures, parts, work = places
    chosen = pilots(rows)
    kept = _kept(work)
    again = [rows[name] for name in kept.said if name in rows]
    digest = partial(_digest, made_by, captures, parts)
    digests = dict(_answers(run(digest, again))) if again else {}
    same = [each for name, each in kept.said.items() if digests.get(name) == each.digest]
    enough = len(same) > MOST * len(kept.said) and len(chosen) <= GROWN * len(kept.said)
    if kept.found is not None and enough:
        return SharedBeam(kept.found, None)
    said = {each.object_id: each for each in same if each.object_id in chosen}
    on_asked(len(said), len(chosen))
    task = partial(_ask, settings, made_by, captures, parts)
    for each in _answers(run(task, [rows[name] for name in chosen if name not in said])):
        said[each.object_id] = each
        _write(work, Kept(said, None))
        on_asked(len(said), len(chosen))
    if kept.found is not None and said.keys() == kept.said.keys() and len(same) == len(said):
        return SharedBeam(kept.found, None)  # those that had failed failed again
    said = dict(sorted(said.items()))
    clues = {name: each.clues for name, each in said.items()}
    found = join(clues, calibrated=is_calibrated(captures))
    _write(work, Kept(said, found))
    return SharedBeam(found, sum(each.processor_s for each in said.values()))


def with_beam(settings: BuildSettings, found: Hardness | None) -> BuildSettings:
    """Return the settings by which the objects of a folder are rebuilt."""
    return settings if found is None else replace(settings, poly=found.applied(settings.poly))


def _answers(answers: Generator[Answer[ObjectRow, Any], None, None]) -> Iterator[Any]:
    """Yield what comes back; an object that says nothing is judged when it is rebuilt."""
    with closing(answers):
        for _, answer in answers:
            refuse_to_go_on(answer)
            if not isinstance(answer, BaseException):
                yield answer


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


def _write(work: Place, kept: Kept) -> None:
    """Write what :func:`_kept` reads, at once or not at all."""
    values = {
        "schema": SCHEMA,
        "hardness": None if kept.found is None else asdict(kept.found),
        "filters_mm_cu": FILTERS_MM_CU,
        "objects": {name: kept.said[name].to_dict() for name in sorted(kept.said)},
    }
    write_bytes(inside(work, BEAM_NAME), (json.dumps(values, indent=1) + "\n").encode())


def _kept(work: Place) -> Kept:
    """Read what was said and found before; nothing where there is nothing, or it is damaged."""
    content = read_bytes(inside(work, BEAM_NAME))
    try:
        values = json.loads(content or "{}")
        if values.get("schema") != SCHEMA:
            return Kept({}, None)
        said = {name: Said.from_dict(name, each) for name, each in values["objects"].items()}
        return Kept(said, _hardness(values["hardness"]))
    except (ValueError, KeyError, TypeError, AttributeError, IndexError):
        return Kept({}, None)


def _clue(name: str, log_ratio: Sequence[float], **sds: float) -> Clue:
    ratios = tuple(map(float, log_ratio))
    if len(ratios) != len(FILTERS_MM_CU):
        raise ValueError(name)
    return Clue(str(name), ratios, **{key: float(sd) for key, sd in sds.items()})


def _hardness(values: Mapping[str, Any] | None) -> Hardness | None:
    if values is None:
        return None
    tubes, rests_on = values["two_tubes_mm_cu"], tuple(values["rests_on"])
    pair = None if tubes is None else (tubes[0], tubes[1])
    return Hardness(**{**values, "two_tubes_mm_cu": pair, "rests_on": rests_on})
