"""The simulated gripper feels, holds and drops what mechanics says it must."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
import trimesh

from tests.phantoms import BAR, box_object
from xden1k.export.check import deviation
from xden1k.export.si import Inertial
from xden1k.values.mass import MassProperties, mass_of_meshes
from xden_bench.manip.closed_forms import slip_ratio
from xden_bench.manip.draws import Draw, keyed_generator
from xden_bench.manip.outcome import Trial
from xden_bench.manip.pose import Pose
from xden_bench.manip.protocol import load_manip_protocol
from xden_bench.manip.rest import rest_of
from xden_bench.manip.scene import OBJECT, WRIST, gripper_scene, table_scene
from xden_bench.manip.trial import pick

RULES = load_manip_protocol()
DOWN = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
ROD = trimesh.creation.box((24, 2.4, 2.4))
DRAW = Draw(friction=0.4, grip_force_n=15.0, shake_rad=0.04, shake_azimuth_rad=1.0, redrawn=0)


@cache
def rod() -> tuple[MassProperties, object]:
    """0.5 kg, and its scene."""
    mass = mass_of_meshes([ROD], [500 / ROD.volume])
    return mass, gripper_scene([ROD], mass, RULES).compile()


def picked(x_cm: float, draw: Draw = DRAW) -> Trial:
    """Pick the rod, that lies along x, so far from its centre."""
    rest, grasp = Pose(np.eye(3), np.array([0, 0, 1.2])), Pose(DOWN, np.array([x_cm, 0, 1.5]))
    return pick(rod()[1], rest, grasp, 2.4, draw, RULES)


def test_the_simulated_object_has_the_exact_mass_centre_and_inertia() -> None:
    wanted = box_object("bar-0009", BAR).mass_properties
    model = table_scene(
        [part.mesh for part in box_object("bar-0009", BAR).parts], wanted, RULES.solver
    )
    body = model.compile().body(OBJECT)
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, body.iquat)
    found = Inertial.of_principal(body.mass[0], body.ipos, body.inertia, axes.reshape(3, 3))
    assert deviation(found, Inertial.of(wanted)).largest < 1e-6


def thrown(turn_rad_s: list[float]) -> tuple[object, object, Inertial]:
    """The bar far above the table, turning; and its exact inertial."""
    one = box_object("bar-0009", BAR)
    spec = table_scene([part.mesh for part in one.parts], one.mass_properties, RULES.solver)
    spec.option.integrator, spec.option.timestep = mujoco.mjtIntegrator.mjINT_RK4, 2e-4
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[2], data.qvel[3:6] = 10.0, turn_rad_s
    mujoco.mj_forward(model, data)
    return model, data, Inertial.of(one.mass_properties)


def test_a_falling_object_turns_height_into_speed_without_loss() -> None:
    model, data, _ = thrown([0, 0, 0])
    start_m = data.body(OBJECT).xipos[2]
    mujoco.mj_step(model, data, nstep=1000)
    fallen_m = start_m - data.body(OBJECT).xipos[2]
    assert fallen_m == pytest.approx(9.81 * 0.2**2 / 2, rel=1e-6)
    assert data.qvel[2] ** 2 / 2 == pytest.approx(9.81 * fallen_m, rel=1e-6)


def test_a_spinning_object_keeps_the_momentum_and_energy_of_its_exact_inertia() -> None:
    model, data, exact = thrown([7.0, -5.0, 11.0])

    def momentum_and_energy() -> tuple[np.ndarray, float]:
        turn = data.body(OBJECT).xmat.reshape(3, 3)
        spin = data.qvel[3:6]  # in the object's frame
        momentum = exact.inertia_kg_m2 @ spin
        return turn @ momentum, float(spin @ momentum / 2)

    start, energy_j = momentum_and_energy()
    for _ in range(10):
        mujoco.mj_step(model, data, nstep=100)
        momentum, found_j = momentum_and_energy()
        np.testing.assert_allclose(momentum, start, atol=1e-6 * np.linalg.norm(start))
        assert found_j == pytest.approx(energy_j, rel=1e-6)
    turned = data.body(OBJECT).xmat.reshape(3, 3)
    assert np.abs(turned - np.eye(3)).max() > 0.5


def felt(load_kg: float) -> tuple[np.ndarray, np.ndarray]:
    """Force and torque at the wrist, with a load fixed 10 cm beside it."""
    spec = gripper_scene([ROD], rod()[0], RULES)
    load = spec.body(WRIST).add_body(pos=[0.1, 0, 0])
    load.explicitinertial, load.mass, load.ipos, load.inertia = True, load_kg, [0] * 3, [1e-4] * 3
    model = spec.compile()
    data = mujoco.MjData(model)
    data.joint("hand").qpos[2] = data.mocap_pos[0, 2] = 0.5
    mujoco.mj_step(model, data, nstep=300)
    return data.sensor("force").data, data.sensor("torque").data


def test_the_wrist_feels_the_weight_and_the_moment_of_half_a_kilogram_at_ten_centimetres() -> None:
    force, torque = np.array(felt(0.5)) - np.array(felt(1e-9))
    assert np.linalg.norm(force) == pytest.approx(4.905, rel=1e-3)
    assert np.linalg.norm(torque) == pytest.approx(0.4905, rel=2e-3)  # the weld gives a little


def test_a_rod_is_held_at_its_centre_and_lost_at_its_end() -> None:
    assert picked(0.0).outcome == "held"
    barely = replace(DRAW, friction=0.2, grip_force_n=15.5)
    assert picked(0.0, barely).outcome == "held"
    assert picked(10.0, barely).outcome == "slipped"
    ratios = [slip_ratio(500, 15.5, 0.2, lever_cm, patch_radius_cm=1) for lever_cm in (0, 10)]
    assert ratios[0] < 1 < ratios[1]


def test_a_rod_that_is_pressed_harder_turns_in_the_hand_and_stays_there() -> None:
    assert picked(10.0).outcome == "rotated"


@pytest.mark.slow
@pytest.mark.parametrize("x_cm", [1.0, 2.0, 3.0])
def test_the_tared_wrist_feels_the_lever_of_what_it_holds(x_cm: float) -> None:
    assert picked(x_cm).wrist_moment_nm == pytest.approx(0.5 * 9.81 * 0.01 * x_cm, rel=0.02)


@pytest.mark.slow
def test_a_rod_too_heavy_for_its_friction_is_lost_at_its_centre_too() -> None:
    assert picked(0.0, replace(DRAW, friction=0.1)).outcome == "slipped"


@pytest.mark.slow
def test_the_same_pick_gives_the_same_bits() -> None:
    assert picked(3.0) == picked(3.0)


def test_what_stood_on_end_comes_to_lie_and_does_not_creep() -> None:
    upright = trimesh.creation.box((2.4, 2.4, 24))
    mass = mass_of_meshes([upright], [1.0])
    rest = rest_of([upright], mass, RULES, keyed_generator("test"))
    assert rest.is_calm(RULES.rest)
    assert rest.pose.to_world(mass.com_cm[None])[0, 2] == pytest.approx(1.2, abs=0.01)
    assert abs(rest.pose.rotation[2, 2]) < 0.01


def test_what_is_never_calm_is_not_at_rest() -> None:
    mass = mass_of_meshes([ROD], [1.0])
    hasty = replace(RULES, rest=replace(RULES.rest, max_time_s=0.1, calm_time_s=0.05))
    assert not rest_of([ROD], mass, hasty, keyed_generator("test")).is_calm(RULES.rest)
