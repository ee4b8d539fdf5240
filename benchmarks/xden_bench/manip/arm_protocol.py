"""The numbers of what an arm's joints bear, read from a file that never changes once released."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from xden1k.values.settings import read_toml, settings_of

__all__ = ["ArmProtocol", "JointRules", "PlaceRules", "load_arm_protocol"]

PROTOCOL: Final = Path(__file__).with_name("arm-v1.toml")
"""The released one."""


@dataclass(frozen=True, slots=True)
class PlaceRules:
    """Where the object lies before the arm, and where the pads are in its hand."""

    reach_cm: float
    azimuths: int
    tool_cm: float


@dataclass(frozen=True, slots=True)
class JointRules:
    """Which joints bring the pads to a grasp, and when none do."""

    home_pull: float
    max_error_cm: float
    max_error_deg: float
    lift_steps: int


@dataclass(frozen=True, slots=True)
class ArmProtocol:
    """Every number, by the tables of the file.

    Parameters
    ----------
    name
        Printed with every number.
    place, joints
        The tables of the file.
    """

    name: str
    place: PlaceRules
    joints: JointRules


def load_arm_protocol(path: Path = PROTOCOL) -> ArmProtocol:
    """Read a protocol.

    Raises
    ------
    DataError
        If the file is not TOML, has an unknown key, or lacks a needed one.

    Examples
    --------
    >>> load_arm_protocol().place.azimuths
    8
    """
    values = read_toml(path)
    for name, kind in (("place", PlaceRules), ("joints", JointRules)):
        values[name] = settings_of(kind, values.get(name, {}), f"{path}: [{name}]")
    return settings_of(ArmProtocol, values, str(path))
