"""Placing and pushing of an object: what statics foretells, and what the simulation does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np

from xden1k.export.si import MM_PER_CM
from xden1k.values.arrays import Vec3
from xden_bench.manip.closed_forms import push, tipping_angle_deg, weight_n
from xden_bench.manip.draws import between, keyed_generator
from xden_bench.manip.item import Item
from xden_bench.manip.mechanics_protocol import MechanicsProtocol
from xden_bench.manip.protocol import ManipProtocol, SolverRules
from xden_bench.manip.rest import watched_at_rest
from xden_bench.manip.standing import (
    Standing,
    standing_of,
    stays_at_edge,
    stays_pushed,
    tipping_tilt_deg,
)
from xden_bench.manip.support import Plane

__all__ = [
    "Creep",
    "EdgeTrial",
    "Mechanics",
    "PushTrial",
    "creep_of",
    "mechanics_of",
    "push_trials",
    "tilt_deg",
]


@dataclass(frozen=True, slots=True)
class EdgeTrial:
    """An object laid down at the edge of a table, as far out as an assumed centre of mass allows.

    Parameters
    ----------
    assumed
        ``true`` or ``uniform``; ``beyond`` is as far over the edge as those are inside.
    side
        Which end of the longest axis is over the edge.
    margin_cm
        Of the true centre inside what is left of the support: it is foretold to fall where that is
        negative.
    stays
        In simulation.
    """

    assumed: str
    side: int
    margin_cm: float
    stays: bool

    @property
    def agrees(self) -> bool:
        """Whether it does what is foretold."""
        return (self.margin_cm > 0) == self.stays


@dataclass(frozen=True, slots=True)
class PushTrial:
    """A push of an object.

    Parameters
    ----------
    friction, force_n, height_cm
        Of the table, of the push, and where it pushes above the table.
    load
        How far from below the centre of mass the table bears it, over the support's reach there: it
        is foretold to tip from 1 on.
    tips
        In simulation.
    """

    friction: float
    force_n: float
    height_cm: float
    load: float
    tips: bool

    @property
    def agrees(self) -> bool:
        """Whether it does what is foretold."""
        return (self.load > 1) == self.tips

    def is_near(self, band: float) -> bool:
        """Whether it is too near to the limit to decide anything."""
        return abs(self.load - 1) <= band


@dataclass(frozen=True, slots=True)
class Mechanics:
    """What came of one object that stands.

    Parameters
    ----------
    object_id
        Which.
    simulated_deg
        Tilt at which it tips.
    foretold_deg, uniform_deg
        The same by statics, for the true centre of mass and for the centroid; None where the
        centroid is beside the support.
    edges, pushes
        Trials; none at an edge towards which the support does not reach beyond the assumed centre.
    """

    object_id: str
    simulated_deg: float
    foretold_deg: float
    uniform_deg: float | None
    edges: tuple[EdgeTrial, ...]
    pushes: tuple[PushTrial, ...]


@dataclass(frozen=True, slots=True)
class Creep:
    """What an object does that lies on the table.

    Parameters
    ----------
    speed_mm_s
        Mean one of its centre of mass.
    penetration_mm
        Of its deepest contact.
    """

    speed_mm_s: float
    penetration_mm: float


def creep_of(item: Item, rules: ManipProtocol) -> Creep:
    """Watch an object at rest as long as the protocol of picks does."""
    rest = watched_at_rest(item.hulls, item.mass, rules, item.rest)
    return Creep(rest.speed_mm_s, MM_PER_CM * rest.penetration_cm)


def mechanics_of(item: Item, contact: SolverRules, rules: MechanicsProtocol) -> Mechanics | None:
    """Try one object; None for one that rolls.

    Parameters
    ----------
    item
        The object.
    contact
        Of the protocol of picks.
    rules
        Of placing and pushing.
    """
    standing = standing_of(item.hulls, item.mass, item.rest, contact, rules)
    if standing is None:
        return None
    (uniform_cm,) = item.rest.to_world(item.uniform_cm[None])
    return Mechanics(
        item.object_id,
        tipping_tilt_deg(standing, rules.tilt),
        tilt_deg(standing, standing.com_cm),
        tilt_deg(standing, uniform_cm) if _is_inside(standing, uniform_cm) else None,
        tuple(_edge_trials(standing, item, uniform_cm, rules)),
        tuple(push_trials(standing, rules, item.object_id)),
    )


def tilt_deg(standing: Standing, com_cm: Vec3) -> float:
    """Tilt from which an object tips over the nearest edge, for a centre of mass in the world."""
    return tipping_angle_deg(float(com_cm[2]), standing.support.margin_cm(com_cm[:2]))


def _is_inside(standing: Standing, com_cm: Vec3) -> bool:
    return standing.support.margin_cm(com_cm[:2]) > 0


def _edge_trials(
    standing: Standing, item: Item, uniform_cm: Vec3, rules: MechanicsProtocol
) -> Iterator[EdgeTrial]:
    """By both centres, and beyond what can hold, at both ends; where the support allows it."""
    along, com_cm, inside_cm = _across_edge(item), standing.com_cm[:2], rules.edge.inside_cm
    for side in (1, -1):
        normal = side * along
        for name, assumed_cm in (("true", com_cm), ("uniform", uniform_cm[:2])):
            edge_cm = standing.support.edge_cm(assumed_cm, normal, inside_cm)
            if edge_cm is not None:
                left = standing.support.clipped(normal, edge_cm)
                assert left is not None
                stays = stays_at_edge(standing, normal, edge_cm, rules.edge)
                yield EdgeTrial(name, side, left.margin_cm(com_cm), stays)
        stays = stays_at_edge(standing, normal, float(com_cm @ normal) - inside_cm, rules.edge)
        yield EdgeTrial("beyond", side, -inside_cm, stays)


def _across_edge(item: Item) -> Plane:
    """Horizontal direction of the longest axis."""
    flat = (item.rest.rotation @ item.long_axis)[:2]
    direction: Plane = flat / np.linalg.norm(flat)
    return direction


def push_trials(standing: Standing, rules: MechanicsProtocol, name: str) -> Iterator[PushTrial]:
    """Push an object as drawn.

    Parameters
    ----------
    standing
        The object.
    rules
        Of placing and pushing.
    name
        Of the object: the key of its draws.
    """
    com_cm, mass_g = standing.com_cm, standing.mass.mass_g
    for number in range(rules.push.draws):
        generator = keyed_generator(rules.seed, name, "push", number)
        friction = between(generator, rules.push.friction)
        force_n = between(generator, rules.push.force) * friction * weight_n(mass_g)
        height_cm = between(generator, (0, standing.height_cm))
        azimuth = between(generator, (0, 2 * pi))
        direction = np.array([cos(azimuth), sin(azimuth)])
        ahead_cm, behind_cm = (
            standing.support.reach_cm(com_cm[:2], sign * direction) for sign in (1, -1)
        )
        heights_cm = height_cm, float(com_cm[2])
        told = push(mass_g, force_n, friction, heights_cm, (ahead_cm, behind_cm))
        at_cm = told.normal_force_at_cm
        stays = stays_pushed(
            standing,
            force_n * direction,
            height_cm,
            friction,
            rules.push,
        )
        load = at_cm / ahead_cm if at_cm > 0 else -at_cm / behind_cm
        yield PushTrial(friction, force_n, height_cm, load, not stays)
