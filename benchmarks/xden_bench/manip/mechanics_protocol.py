"""The numbers of placing and pushing, read from a file that never changes once released."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from xden1k.values.settings import read_toml, settings_of

__all__ = [
    "EdgeRules",
    "MechanicsProtocol",
    "PushRules",
    "SupportRules",
    "TiltRules",
    "load_mechanics_protocol",
]

PROTOCOL: Final = Path(__file__).with_name("mechanics-v1.toml")
"""The released one."""


@dataclass(frozen=True, slots=True)
class SupportRules:
    """On what an object stands, and whether it stands at all."""

    max_height_cm: float
    min_margin_cm: float


@dataclass(frozen=True, slots=True)
class TiltRules:
    """How the angle is found at which an object tips."""

    max_angle_deg: float
    halvings: int
    friction: float
    time_s: float
    max_turn_deg: float


@dataclass(frozen=True, slots=True)
class EdgeRules:
    """How an object is laid down at the edge of a table."""

    inside_cm: float
    time_s: float
    max_turn_deg: float


@dataclass(frozen=True, slots=True)
class PushRules:
    """What pushes are drawn, and near which limit they decide nothing."""

    draws: int
    friction: Sequence[float]
    force: Sequence[float]
    time_s: float
    timestep_s: float
    solref: Sequence[float]
    max_turn_deg: float
    band: float


@dataclass(frozen=True, slots=True)
class MechanicsProtocol:
    """Every number of placing and pushing, by the tables of the file.

    Parameters
    ----------
    name
        Printed with every number.
    seed
        Of every draw, beside its key.
    support, tilt, edge, push
        The tables of the file.
    """

    name: str
    seed: int
    support: SupportRules
    tilt: TiltRules
    edge: EdgeRules
    push: PushRules


TABLES: Final[Mapping[str, type[Any]]] = {
    "support": SupportRules,
    "tilt": TiltRules,
    "edge": EdgeRules,
    "push": PushRules,
}


def load_mechanics_protocol(path: Path = PROTOCOL) -> MechanicsProtocol:
    """Read a protocol.

    Raises
    ------
    DataError
        If the file is not TOML, has an unknown key, or lacks a needed one.

    Examples
    --------
    >>> load_mechanics_protocol().edge.inside_cm
    0.5
    """
    values = read_toml(path)
    for name, kind in TABLES.items():
        values[name] = settings_of(kind, values.get(name, {}), f"{path}: [{name}]")
    return settings_of(MechanicsProtocol, values, str(path))
