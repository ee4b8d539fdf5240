"""The frozen scenes of a run: a folder with a list, the protocol, an archive an object, checksums.

::

    SCENES/  scenes.json  protocol.toml  objects/ID.npz  SHA256SUMS

The same dataset, protocol and version of MuJoCo make the same bytes on one platform.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from xden1k.errors import DataError, MissingObjectError, did_you_mean, require
from xden1k.folder.place import publish, staging
from xden1k.format.checksums import CHECKSUMS_NAME, file_sha256, listed_sums
from xden_bench.manip.arrays import read_arrays, write_arrays
from xden_bench.manip.item import Item
from xden_bench.manip.preparing import Chosen
from xden_bench.manip.protocol import PROTOCOL, ManipProtocol, load_manip_protocol

__all__ = ["Scenes", "mujoco_version", "open_scenes", "write_scenes"]

LIST_NAME: Final = "scenes.json"
PROTOCOL_NAME: Final = "protocol.toml"
OBJECTS: Final = "objects"
NOTHING: Final[Mapping[str, float]] = MappingProxyType({})


def mujoco_version() -> str:
    """Version of MuJoCo that is installed.

    Raises
    ------
    MissingExtraError
        If it is not.
    """
    version: str = require("mujoco", "sim").__version__
    return version


@dataclass(frozen=True, slots=True)
class Scenes:
    """Frozen scenes, sound and made for what is installed here.

    Parameters
    ----------
    path
        Their folder.
    facts
        Of the list: tier, dataset, split, rules by which objects were taken out.
    rules
        The protocol.
    sha256
        Of the checksums, so of everything.
    """

    path: Path
    facts: Mapping[str, Any]
    rules: ManipProtocol
    sha256: str

    @property
    def ids(self) -> tuple[str, ...]:
        """Of the objects, in the order of the list."""
        return tuple(one["object_id"] for one in self.facts["objects"])

    @property
    def varied(self) -> Mapping[str, float]:
        """Numbers by which they depart from the protocol; those as released have none."""
        found: Mapping[str, float] = self.facts.get("varied", {})
        return found

    def item(self, object_id: str) -> Item:
        """Read one object.

        Raises
        ------
        MissingObjectError
            If it is none of these.
        """
        if object_id not in self.ids:
            hint = did_you_mean(object_id, self.ids)
            raise MissingObjectError(f"{self.path}: no scene of {object_id}{hint}")
        return Item.of_arrays(read_arrays(self.path / OBJECTS / f"{object_id}.npz"))

    def refuse_others(self, facts: Mapping[str, Any], **expected: Any) -> None:
        """Refuse rows of other scenes.

        Parameters
        ----------
        facts
            Of a row.
        expected
            More that they must be.

        Raises
        ------
        DataError
            By the fact that is another.
        """
        for name, value in {"scenes_sha256": self.sha256, **expected}.items():
            if (found := facts[name]) != value:
                raise DataError(f"{self.path}: expected rows with {name} {value}, got {found}")

    def items(self) -> Iterator[Item]:
        """Read every object."""
        return map(self.item, self.ids)


def write_scenes(
    chosen: Chosen,
    rules: ManipProtocol,
    dataset: Mapping[str, Any],
    tier: str,
    out: Path,
    varied: Mapping[str, float] = NOTHING,
) -> None:
    """Freeze what was chosen; an older folder is replaced as a whole.

    Parameters
    ----------
    chosen
        The objects.
    rules
        The released protocol.
    dataset
        What tells the dataset and its split.
    tier
        Name of the tier.
    out
        The folder.
    varied
        Numbers by which the choice departs from the protocol.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    with staging(out) as beside:
        root = beside / out.name
        (root / OBJECTS).mkdir(parents=True)
        for item in chosen.items:
            write_arrays(root / OBJECTS / f"{item.object_id}.npz", item.arrays())
        facts = {
            "simulated": True,
            "protocol": rules.name,
            "protocol_sha256": rules.sha256,
            "mujoco": mujoco_version(),
            "tier": tier,
            "dataset": dict(dataset),
            "objects": [_facts(item) for item in chosen.items],
            "taken_out": chosen.taken_out,
            "not_needed": chosen.not_needed,
            **({"varied": dict(varied)} if varied else {}),
        }
        (root / LIST_NAME).write_text(json.dumps(facts, indent=2) + "\n")
        (root / PROTOCOL_NAME).write_bytes(PROTOCOL.read_bytes())
        files = sorted(path.relative_to(root).as_posix() for path in root.rglob("*.*"))
        sums = [f"{file_sha256(root / name)}  {name}\n" for name in files]
        (root / CHECKSUMS_NAME).write_text("".join(sums))
        publish(root, out)


def _facts(item: Item) -> dict[str, Any]:
    return {
        "object_id": item.object_id,
        "category": item.category,
        "stratum": item.stratum,
        "mass_g": item.mass.mass_g,
        "uniform_along_cm": item.along_cm(item.uniform_cm),
        "hulls": len(item.hulls),
        "candidates": len(item.grasps),
        "redrawn": sum(draw.redrawn for draws in item.draws.values() for draw in draws),
    }


def open_scenes(path: Path) -> Scenes:
    """Open frozen scenes.

    Raises
    ------
    DataError
        If a file is missing or was changed since, or they were made by another protocol or
        another version of MuJoCo.
    MissingExtraError
        If MuJoCo is not installed.
    """
    sums = listed_sums(path)
    if LIST_NAME not in sums:
        raise DataError(f"{path}: expected a folder of scenes, from `xden-bench manip prepare`")
    for name, digest in sums.items():
        if not (path / name).is_file() or file_sha256(path / name) != digest:
            raise DataError(f"{path / name}: missing, or changed since the scenes were frozen")
    facts = json.loads((path / LIST_NAME).read_text())
    rules = load_manip_protocol()
    for what, found, expected in (
        ("protocol", facts["protocol_sha256"], rules.sha256),
        ("MuJoCo", facts["mujoco"], mujoco_version()),
    ):
        if found != expected:
            raise DataError(
                f"{path}: made for another {what}, {found}, here is {expected}: prepare anew"
            )
    return Scenes(path, facts, rules, file_sha256(path / CHECKSUMS_NAME))
