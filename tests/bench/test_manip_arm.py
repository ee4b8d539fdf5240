"""An arm's joints bear what mechanics says, by a made-up arm; another robot is refused.

The made-up arm has the names of the real one and is much simpler: upright at zero, every link on
one line, its hinges in turn about that line and across it.
"""

from __future__ import annotations

import json
from dataclasses import replace
from math import cos, pi, sin
from pathlib import Path

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner, Result
from scipy.spatial.transform import Rotation

from xden1k.errors import DataError
from xden1k.values.mass import MassProperties, mass_of_meshes
from xden_bench.cli import cli
from xden_bench.manip.arm import MODEL, Arm, ArmModel, load_arm
from xden_bench.manip.arm_protocol import load_arm_protocol
from xden_bench.manip.draws import Draw
from xden_bench.manip.grasps import Grasps
from xden_bench.manip.item import Item
from xden_bench.manip.pose import Pose, turn_between_deg
from xden_bench.manip.preparing import Chosen
from xden_bench.manip.protocol import load_manip_protocol
from xden_bench.manip.scenes import Scenes, open_scenes, write_scenes
from xden_bench.manip.torques import burden_of

RULES, MANIP = load_arm_protocol(), load_manip_protocol()
G = 9.81
DOWN = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
HEIGHTS_M = (0.0, 0.3, 0.0, 0.35, 0.0, 0.35, 0.1)
"""Of each link above the one before."""
MASSES_KG = (3.0, 2.0, 1.5, 2.5, 1.0, 1.2, 0.7)
AXES = ("0 0 1", "0 1 0") * 3 + ("0 0 1",)
CENTRE_M, SPIN = 0.05, 0.004
"""Of each link and of the hand: height of its centre above its joint, and its moments, kg·m²."""
HAND_M, HAND_KG, FINGER_M, FINGER_KG = 0.1, 0.8, 0.06, 0.02
HOME = (0.0, 0.3, 0.0, 1.7, 0.0, pi - 2.0, 0.0)


def inertial(mass_kg: float) -> str:
    return f'<inertial pos="0 0 {CENTRE_M}" mass="{mass_kg}" diaginertia="{SPIN} {SPIN} {SPIN}"/>'


def made_up() -> str:
    """An MJCF whose meshes are not there."""
    text = "".join(
        f'<body name="finger{one}" pos="0 0 {FINGER_M}"><geom type="mesh" mesh="lost"/>'
        f'<inertial pos="0 0 0" mass="{FINGER_KG}" diaginertia="1e-5 1e-5 1e-5"/>'
        f'<joint name="finger_joint{one}" type="slide" axis="0 {side} 0" range="0 0.04"/></body>'
        for one, side in ((1, 1), (2, -1))
    )
    text = f'<body name="hand" pos="0 0 {HAND_M}">{inertial(HAND_KG)}{text}</body>'
    for number in range(7, 0, -1):
        at = number - 1
        text = (
            f'<body name="link{number}" pos="0 0 {HEIGHTS_M[at]}">{inertial(MASSES_KG[at])}'
            f'<joint name="joint{number}" axis="{AXES[at]}" range="-2.9 2.9" damping="3" '
            f'armature="0.2"/><geom type="mesh" mesh="lost"/>{text}</body>'
        )
    home = " ".join(map(str, HOME))
    return (
        '<mujoco model="made-up"><compiler angle="radian"/><option gravity="0 0 -1.6"/>'
        f'<asset><mesh name="lost" file="lost.stl"/></asset><worldbody>{text}</worldbody>'
        f'<keyframe><key name="home" qpos="{home} 0.04 0.04"/></keyframe></mujoco>'
    )


def checkout(folder: Path, text: str) -> Path:
    """A folder with a model where a checkout has it."""
    path = folder / MODEL
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return folder


@pytest.fixture
def model(tmp_path: Path) -> ArmModel:
    return load_arm(checkout(tmp_path / "menagerie", made_up()), RULES)


@pytest.fixture
def arm(model: ArmModel) -> Arm:
    return model.empty()


def bodies() -> list[tuple[float, float]]:
    """Height and mass of everything that weighs, upright."""
    bases = np.cumsum(HEIGHTS_M)
    hand = bases[-1] + HAND_M
    links = [(base + CENTRE_M, mass) for base, mass in zip(bases, MASSES_KG, strict=True)]
    return [*links, (hand + CENTRE_M, HAND_KG), *[(hand + FINGER_M, FINGER_KG)] * 2]


def lumps(load: tuple[float, float] | None = None) -> list[tuple[float, float, float]]:
    """Mass, its moments about its own joint: of what joint 2 swings below joint 4, and above it."""
    found = []
    every = bodies() + ([load] if load else [])
    elbow = HEIGHTS_M[1] + HEIGHTS_M[3]
    # link 1 stands below joint 2, links 2 and 3 below joint 4
    for base, group in ((HEIGHTS_M[1], every[1:3]), (elbow, every[3:])):
        own = [1e-5 if mass == FINGER_KG else SPIN for _, mass in group]
        found.append(
            (
                sum(mass for _, mass in group),
                sum(mass * (height - base) for height, mass in group),
                sum(
                    mass * (height - base) ** 2 + spin
                    for (height, mass), spin in zip(group, own, strict=True)
                ),
            )
        )
    return found


def two_links(q: tuple[float, float], v: tuple[float, float], a: tuple[float, float], parts):
    """Torques of a planar arm of two links, from upright: as in any textbook of robotics."""
    (_, first, swing), (mass, second, spin) = parts
    length = HEIGHTS_M[3]
    reach, sway = second * length * cos(q[1]), second * length * sin(q[1])
    fall = second * sin(q[0] + q[1])
    shoulder = (
        (swing + mass * length**2 + spin + 2 * reach) * a[0]
        + (spin + reach) * a[1]
        - sway * (2 * v[0] * v[1] + v[1] ** 2)
        - G * ((first + mass * length) * sin(q[0]) + fall)
    )
    elbow = spin * (a[0] + a[1]) + reach * a[0] + sway * v[0] ** 2 - G * fall
    return shoulder, elbow


def spread(two: tuple[float, float]) -> np.ndarray:
    """Numbers of joints 2 and 4, the others at zero."""
    return np.array([0, two[0], 0, two[1], 0, 0, 0])


@pytest.mark.parametrize("seed", range(5))
def test_torques_are_those_of_a_planar_arm_of_two_links(arm: Arm, seed: int) -> None:
    q, v, a = (tuple(each) for each in np.random.default_rng(seed).uniform(-2, 2, (3, 2)))
    found = arm.torques_nm(spread(q), spread(v), spread(a))
    np.testing.assert_allclose(found[[1, 3]], two_links(q, v, a, lumps()), rtol=1e-9)


def ball(mass_g: float) -> MassProperties:
    """A small ball at the origin of its frame, with the moments of no other body."""
    return MassProperties(mass_g, np.zeros(3), np.eye(3) * SPIN * 1e7)


def test_an_object_in_the_hand_adds_its_weight_at_its_lever(model: ArmModel) -> None:
    held = Pose(np.eye(3), np.array([0.0, 0.0, 4.0]))
    holding, still = model.holding(ball(500.0), held), np.zeros(7)
    flat = spread((pi / 2, 0.0))
    added = holding.torques_nm(flat, still, still) - model.empty().torques_nm(flat, still, still)
    lever_m = sum(HEIGHTS_M) + HAND_M + 0.01 * RULES.place.tool_cm + 0.04 - HEIGHTS_M[1]
    assert added[1] == pytest.approx(-0.5 * G * lever_m, rel=1e-9)
    assert added[3] == pytest.approx(-0.5 * G * (lever_m - HEIGHTS_M[3]), rel=1e-9)
    assert added[5] == pytest.approx(-0.5 * G * (lever_m - HEIGHTS_M[3] - HEIGHTS_M[5]), rel=1e-9)
    np.testing.assert_allclose(added[[0, 2, 4, 6]], 0, atol=1e-12)


def test_an_object_in_a_moving_hand_adds_its_inertia(model: ArmModel) -> None:
    holding = model.holding(ball(500.0), Pose(DOWN, np.array([0.0, 0.0, 4.0])))
    height_m = sum(HEIGHTS_M) + HAND_M + 0.01 * RULES.place.tool_cm + 0.04
    q, v, a = (0.4, 1.1), (0.7, -0.9), (2.0, 1.0)
    found = holding.torques_nm(spread(q), spread(v), spread(a))
    wanted = two_links(q, v, a, lumps((height_m, 0.5)))
    np.testing.assert_allclose(found[[1, 3]], wanted, rtol=1e-9)


@pytest.mark.parametrize("azimuth", [0.0, 1.0, 2.5])
def test_the_joints_that_are_found_bring_the_pads_to_the_pose(arm: Arm, azimuth: float) -> None:
    about = Rotation.from_euler("z", azimuth).as_matrix()
    wanted = Pose(about @ DOWN, np.array([45.0, 3.0, 12.0]))
    joints = arm.reached(wanted, arm.home)
    assert joints is not None
    found = arm.tool(joints)
    np.testing.assert_allclose(found.origin_cm, wanted.origin_cm, atol=RULES.joints.max_error_cm)
    assert turn_between_deg(found.rotation, wanted.rotation) < RULES.joints.max_error_deg


def moves(arm: Arm, joints: np.ndarray) -> np.ndarray:
    """How the tool moves and turns with each joint, by differences, shape (12, 7)."""

    def placed(at: np.ndarray) -> np.ndarray:
        tool = arm.tool(at)
        return np.concatenate([tool.origin_cm, tool.rotation.ravel()])

    steps = 1e-5 * np.eye(7)
    return np.array([placed(joints + step) - placed(joints - step) for step in steps]).T / 2e-5


def test_no_joints_with_the_same_pose_are_nearer_to_home(arm: Arm) -> None:
    joints = arm.reached(Pose(DOWN, np.array([45.0, 3.0, 12.0])), arm.home)
    assert joints is not None
    _, sizes, ways = np.linalg.svd(moves(arm, joints))
    assert sizes[-1] < 1e-6 < sizes[-2]  # seven joints for six freedoms: one way is left
    assert ways[-1] @ (joints - arm.home) == pytest.approx(0, abs=1e-3)
    assert np.abs(joints - arm.home).max() > 0.1


def test_what_is_too_far_is_out_of_reach(arm: Arm) -> None:
    assert arm.reached(Pose(DOWN, np.array([150.0, 0, 10])), arm.home) is None


def bar(com_along_cm: float, tilt_rad: float = 0.0) -> Item:
    """A bar of 20 cm and 1 kg, to be grasped in its middle, its mass so far from there."""
    whole = trimesh.creation.box((20, 2.4, 2.4))
    even = mass_of_meshes([whole], [1000 / whole.volume])
    tilt = Rotation.from_euler("y", tilt_rad).as_matrix()
    return Item(
        object_id="bar-1",
        category="bar",
        stratum="off" if com_along_cm else "balanced",
        mass=replace(even, com_cm=np.array([0, com_along_cm, 0])),
        homogeneous=even,
        uniform_cm=np.zeros(3),
        long_axis=np.array([0, 1.0, 0]),
        hulls=(whole,),
        rest=Pose(np.eye(3), np.array([3.0, -7.0, 1.2])),
        grasps=Grasps(
            np.ones(1), np.full(1, 2.4), (tilt @ DOWN)[None], np.array([[3.0, -7.0, 1.5]])
        ),
        draws={"easy": (Draw(0.4, 20.0, 0.04, 1.0, 0),)},
    )


def test_a_vertical_last_joint_bears_nothing_and_a_tilted_one_its_share(model: ArmModel) -> None:
    upright, tilted, even = (
        burden_of(model, item, 0, MANIP.trial) for item in (bar(5.0), bar(5.0, 0.3), bar(0.0, 0.3))
    )
    assert upright.last_nm == pytest.approx(0, abs=1e-3)  # as far as the pose is exact
    # the bar's mass is 5 cm across the plane in which the approach is tilted
    assert tilted.last_nm == pytest.approx(1.0 * G * 0.05 * sin(0.3), rel=1e-2)
    assert even.last_nm == pytest.approx(0, abs=1e-3)
    assert tilted.lift_nm > tilted.last_nm
    assert upright.out_of_reach == 0


def test_what_the_object_adds_is_its_weight_times_levers_and_not_the_arms(model: ArmModel) -> None:
    heavy = bar(0.0)
    light = replace(heavy, mass=replace(heavy.mass, mass_g=heavy.mass.mass_g / 2))
    one, half = (burden_of(model, item, 0, MANIP.trial) for item in (heavy, light))
    assert half.added_nm == pytest.approx(one.added_nm / 2, rel=1e-6)
    assert one.mean_nm - half.mean_nm < one.added_nm / 2 + 1e-9
    assert one.mean_nm > 3 * one.added_nm


def test_where_the_object_lies_on_the_table_decides_nothing(model: ArmModel) -> None:
    here = bar(5.0, 0.3)
    by = np.array([11.0, 4.0, 0.0])
    there = replace(
        here,
        rest=replace(here.rest, origin_cm=here.rest.origin_cm + by),
        grasps=replace(here.grasps, centre_cm=here.grasps.centre_cm + by),
    )
    first, second = (burden_of(model, item, 0, MANIP.trial) for item in (here, there))
    assert first.last_nm == pytest.approx(second.last_nm, rel=1e-9)
    assert first.mean_nm == pytest.approx(second.mean_nm, rel=1e-9)


def test_a_grasp_that_no_azimuth_reaches_is_refused_by_its_object(model: ArmModel) -> None:
    far = replace(model, rules=replace(RULES, place=replace(RULES.place, reach_cm=200.0)))
    with pytest.raises(DataError, match="bar-1: grasp 0 is out of the arm's reach from all 8"):
        burden_of(far, bar(5.0), 0, MANIP.trial)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("no XML", "expected an MJCF model: "),
        (
            made_up().replace("joint7", "wrist"),
            "another robot: expected the joints .* wrist",
        ),
        (made_up().replace('"hand"', '"flange"'), "another robot: expected the body 'hand'"),
        (made_up().replace('"home"', '"start"'), "another robot: expected the keyframe 'home'"),
        (
            made_up().replace(inertial(0.8), '<geom size="1"/>'),
            "expected an inertial of the body",
        ),
        (made_up().replace("-2.9 2.9", "0 0"), "expected the range of the joint 'joint1'"),
        ("<mujoco/>", "another robot: expected the joints joint1, .*, got none"),
    ],
)
def test_another_robot_is_refused_by_what_it_lacks(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(DataError, match=rf"panda.xml: {said}"):
        load_arm(checkout(tmp_path, text), RULES)


def test_a_folder_without_the_model_is_told_what_was_looked_for_and_where(tmp_path: Path) -> None:
    with pytest.raises(DataError) as told:
        load_arm(tmp_path, RULES)
    assert str(told.value) == (
        f"{tmp_path / MODEL}: not found; expected a checkout of mujoco_menagerie with {MODEL} in it"
    )


@pytest.fixture
def scenes(tmp_path: Path) -> Scenes:
    items = (bar(5.0, 0.3), replace(bar(0.0), object_id="bar-2"))
    write_scenes(
        Chosen(items, {}, 0),
        MANIP,
        {"revision": "0.1.0", "manifest_sha256": "0" * 64, "split": "test"},
        "quick",
        tmp_path / "scenes",
    )
    return open_scenes(tmp_path / "scenes")


def asked(*arguments: object) -> Result:
    return CliRunner().invoke(cli, ["manip", *map(str, arguments)])


@pytest.fixture
def rows(scenes: Scenes, tmp_path: Path) -> list[Path]:
    controls = [word for name in ("uniform", "true") for word in ("--control", name)]
    done = asked("run", scenes.path, *controls, "--out", tmp_path / "rows", "--json")
    assert done.exit_code == 0, done.output
    return [Path(path) for path in json.loads(done.stdout)["rows"]]


def test_rows_get_torques_only_with_the_users_own_arm(scenes, rows, model, tmp_path) -> None:
    command = ["arm", scenes.path, *rows, "--menagerie", tmp_path / "menagerie"]
    told = json.loads(asked(*command, "--json").stdout)
    assert told["sha256"] == model.sha256
    off, balanced = (
        {one["name"]: one for one in told["lines"] if one["stratum"] == stratum}
        for stratum in ("off", "balanced")
    )
    assert off["true"]["figures"]["last_nm"]["mean"] == pytest.approx(G * 0.05 * sin(0.3), rel=1e-2)
    assert off["true"]["against"]["uniform"]["last_nm"]["mean"] == 0  # the only grasp there is
    assert balanced["true"]["figures"]["last_nm"]["mean"] == pytest.approx(0, abs=1e-3)
    shown = asked(*command).output
    assert shown.startswith("Simulated; arm-v1, franka_emika_panda/panda.xml")
    assert "last joint" in shown
    table = asked("table", *rows)
    assert "joint" not in table.output


def test_rows_of_other_scenes_or_masses_have_no_torques(scenes, rows, model, tmp_path) -> None:
    for name, value in (("scenes_sha256", "f" * 64), ("homogeneous", True)):
        facts = [json.loads(path.read_text()) | {name: value} for path in rows]
        others = [path.with_suffix(".other.json") for path in rows]
        for path, values in zip(others, facts, strict=True):
            path.write_text(json.dumps(values))
        done = asked("arm", scenes.path, *others, "--menagerie", tmp_path / "menagerie")
        assert done.exit_code == 1
        assert f"expected rows with {name}" in done.output
