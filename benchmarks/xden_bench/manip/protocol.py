"""The numbers of the manipulation benchmark, read from a file that never changes once released."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from xden1k.format.checksums import file_sha256
from xden1k.values.settings import read_toml, settings_of
from xden_bench.manip.draws import Regime

__all__ = [
    "PROTOCOL",
    "GraspRules",
    "GripperRules",
    "HullRules",
    "ManipProtocol",
    "ObjectRules",
    "RestRules",
    "SolverRules",
    "StatisticsRules",
    "Tier",
    "TrialRules",
    "load_manip_protocol",
]

PROTOCOL: Final = Path(__file__).with_name("manip-v1.toml")
"""The released one."""


@dataclass(frozen=True, slots=True)
class Tier:
    """How much is tried: objects of each stratum, and draws of each object in each regime."""

    off: int
    balanced: int
    draws: int


@dataclass(frozen=True, slots=True)
class ObjectRules:
    """Which objects are tried, and when one belongs to a stratum."""

    max_mass_g: float
    max_width_cm: float
    off_cm: float
    balanced_cm: float
    min_candidates: int


@dataclass(frozen=True, slots=True)
class HullRules:
    """How the outer surface becomes convex pieces, and how good they must be."""

    max_hulls: int
    max_volume_error: float
    max_contact_error_cm: float


@dataclass(frozen=True, slots=True)
class GraspRules:
    """How candidates are sampled."""

    surface_points: int
    friction: float
    min_width_cm: float
    max_width_cm: float
    approaches_deg: Sequence[float]
    max_tilt_deg: float
    clearance_cm: float
    collision_points: int
    min_points_between: int
    table_clearance_cm: float


@dataclass(frozen=True, slots=True)
class GripperRules:
    """The floating gripper; boxes are x, y, z in the tool frame."""

    finger_cm: Sequence[float]
    finger_reach_cm: float
    palm_cm: Sequence[float]
    max_opening_cm: float
    base_mass_g: float
    palm_mass_g: float
    finger_mass_g: float
    armature_kg: float
    damping_n_s_m: float
    weld_solref: Sequence[float]
    mimic_solref: Sequence[float]

    @property
    def palm_front_cm(self) -> float:
        """Where the palm ends and the fingers begin, along the approach."""
        return self.finger_reach_cm - self.finger_cm[2]


@dataclass(frozen=True, slots=True)
class SolverRules:
    """Contact in MuJoCo, in its own units."""

    timestep_s: float
    impratio: float
    noslip_iterations: int
    torsional_friction_m: float
    rolling_friction_m: float
    solref: Sequence[float]
    solimp: Sequence[float]
    table_friction: float


@dataclass(frozen=True, slots=True)
class RestRules:
    """How an object comes to rest, and what counts as rest."""

    drop_cm: float
    tilt_deg: float
    max_time_s: float
    calm_time_s: float
    max_speed_mm_s: float
    max_turn_deg_s: float
    max_penetration_cm: float


@dataclass(frozen=True, slots=True)
class TrialRules:
    """A pick: where the gripper goes when, and what counts as success."""

    retreat_cm: float
    wait_s: float
    descend_s: float
    close_s: float
    lift_s: float
    lift_cm: float
    hold_s: float
    shake_s: float
    shake_hz: float
    shake_rad: Sequence[float]
    min_rise_held_cm: float
    min_rise_shaken_cm: float
    min_rise_in_hand_cm: float
    max_turn_deg: float
    max_load: float
    max_best_load: float


@dataclass(frozen=True, slots=True)
class StatisticsRules:
    """Of the bootstrap over objects."""

    resamples: int
    seed: int


@dataclass(frozen=True, slots=True)
class ManipProtocol:
    """Every number of the benchmark; ``sha256`` is that of the file they come from.

    Parameters
    ----------
    name
        Printed with every number.
    seed
        Of every draw, beside its key.
    shifts_cm
        Of the ladder, along the longest axis.
    tiers, regimes
        By name.
    objects, hulls, grasps, gripper, solver, rest, trial, statistics
        The tables of the file.
    sha256
        Of the file.
    """

    name: str
    seed: int
    shifts_cm: Sequence[float]
    tiers: Mapping[str, Tier]
    regimes: Mapping[str, Regime]
    objects: ObjectRules
    hulls: HullRules
    grasps: GraspRules
    gripper: GripperRules
    solver: SolverRules
    rest: RestRules
    trial: TrialRules
    statistics: StatisticsRules
    sha256: str

    @property
    def max_best_weight_n(self) -> float:
        """Heaviest weight of which enough draws are in every regime."""
        return self.trial.max_best_load * min(one.most_friction_n for one in self.regimes.values())


TABLES: Final[Mapping[str, type[Any]]] = {
    "objects": ObjectRules,
    "hulls": HullRules,
    "grasps": GraspRules,
    "gripper": GripperRules,
    "solver": SolverRules,
    "rest": RestRules,
    "trial": TrialRules,
    "statistics": StatisticsRules,
}
NAMED_TABLES: Final[Mapping[str, type[Any]]] = {"tiers": Tier, "regimes": Regime}


def load_manip_protocol(path: Path = PROTOCOL) -> ManipProtocol:
    """Read a protocol.

    Raises
    ------
    DataError
        If the file is not TOML, has an unknown key, or lacks a needed one.

    Examples
    --------
    >>> load_manip_protocol().trial.lift_cm
    20.0
    """
    values = read_toml(path)
    for name, kind in TABLES.items():
        values[name] = settings_of(kind, values.get(name, {}), f"{path}: [{name}]")
    for name, kind in NAMED_TABLES.items():
        values[name] = {
            key: settings_of(kind, table, f"{path}: [{name}.{key}]")
            for key, table in values.get(name, {}).items()
        }
    values["sha256"] = file_sha256(path)
    return settings_of(ManipProtocol, values, str(path))
