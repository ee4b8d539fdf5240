"""Scenes are frozen, rows are made in as many goes as it takes, tables compare like with like."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from tests.phantoms import Box, box_object
from xden1k.errors import DataError, MissingObjectError
from xden1k.folder import open_folder, write_folder
from xden1k.values.mass import mass_of_meshes
from xden_bench.cli import cli
from xden_bench.manip import running
from xden_bench.manip.choosing import Chooser, by_name, controls
from xden_bench.manip.closed_forms import slip_ratio
from xden_bench.manip.draws import Draw
from xden_bench.manip.grasps import Grasps
from xden_bench.manip.item import Item
from xden_bench.manip.outcome import Trial
from xden_bench.manip.pose import Pose
from xden_bench.manip.preparing import Chosen, Examiner, choose
from xden_bench.manip.protocol import Tier, load_manip_protocol
from xden_bench.manip.rows import read_rows
from xden_bench.manip.running import Tries, Variant, run_rows
from xden_bench.manip.scenes import Scenes, open_scenes, write_scenes
from xden_bench.manip.slipping import slip_trials
from xden_bench.manip.table import lines

RULES = load_manip_protocol()
DOWN = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
DATASET = {"revision": "0.1.0", "manifest_sha256": "0" * 64, "split": "test"}
PLACES_CM = (-9.0, -4.0, 0.0, 4.0, 9.0)
"""Along a bar of 20 cm, where its candidates are."""


@cache
def bar(name: str, heavy_end_cm: float) -> Item:
    """A bar of 20 cm along x, its centre of mass so far from the middle; it weighs 0.5 kg."""
    whole = trimesh.creation.box((20, 2.4, 2.4))
    even = mass_of_meshes([whole], [500 / whole.volume])
    mass = replace(even, com_cm=np.array([heavy_end_cm, 0, 0]))
    count = len(PLACES_CM)
    centres = np.array([[x, 0, 1.5] for x in PLACES_CM])
    score = np.linspace(1, 0.9, count)
    rotation = np.tile(DOWN, (count, 1, 1))
    return Item(
        object_id=name,
        category=name.split("-")[0],
        stratum="off" if heavy_end_cm else "balanced",
        mass=mass,
        homogeneous=even,
        uniform_cm=np.zeros(3),
        long_axis=np.array([1.0, 0, 0]),
        hulls=(whole,),
        rest=Pose(np.eye(3), np.array([0, 0, 1.2])),
        grasps=Grasps(score, np.full(count, 2.4), rotation, centres),
        draws={"easy": (Draw(0.4, 15.0, 0.04, 1.0, 0), Draw(0.3, 20.0, 0.04, 2.0, 1))},
    )


@pytest.fixture
def scenes(tmp_path: Path) -> Scenes:
    items = (bar("hammer-1", 8.8), bar("chisel-1", -4.4), bar("ruler-1", 0.0))
    chosen = Chosen(items, {"heavy": ("safe-1",)}, 7)
    write_scenes(chosen, RULES, DATASET, "quick", tmp_path / "scenes")
    return open_scenes(tmp_path / "scenes")


def levered(model: object, rest: Pose, grasp: Pose, width_cm: float, draw: Draw, rules: object):
    """A gripper without a simulator: holds what it takes less than 3 cm from the middle."""
    del model, rest, width_cm, draw, rules
    held = abs(grasp.origin_cm[0]) < 3
    return Trial("held" if held else "slipped", 0.01 * abs(grasp.origin_cm[0]), 1.0, 0)


@pytest.fixture
def unsimulated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(running, "pick", levered)


AS_RELEASED = Variant({})
OWN_PROCESS = [sys.executable, "-c", "from xden_bench.cli import cli; cli()", "manip"]


def tries(scenes: Scenes, *names: str, variant: Variant = AS_RELEASED) -> Tries:
    items = {one.object_id: one for one in scenes.items()}
    every = controls(items, scenes.rules)
    return Tries(scenes, by_name(every, names) if names else tuple(every), variant)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.json"))}


def test_an_item_comes_back_from_its_arrays_as_it_was() -> None:
    item = bar("hammer-1", 8.8)
    again = Item.of_arrays(item.arrays())
    assert again.draws == item.draws
    assert again.arrays().keys() == item.arrays().keys()
    for name, values in item.arrays().items():
        np.testing.assert_array_equal(again.arrays()[name], values, err_msg=name)


def test_the_lever_is_across_the_closing_axis() -> None:
    item = bar("hammer-1", 8.8)
    assert item.lever_cm(2, item.mass.com_cm) == pytest.approx(8.8)
    assert item.lever_cm(2, np.array([0, 1.0, 5.0])) == pytest.approx(0)


def test_the_same_choice_makes_the_same_bytes(tmp_path: Path, scenes: Scenes) -> None:
    chosen = Chosen(tuple(scenes.items()), {"heavy": ("safe-1",)}, 7)
    write_scenes(chosen, RULES, DATASET, "quick", tmp_path / "again")
    assert open_scenes(tmp_path / "again").sha256 == scenes.sha256


@pytest.mark.parametrize("name", ["objects/hammer-1.npz", "scenes.json", "protocol.toml"])
def test_a_scene_that_was_changed_is_refused_by_its_file(scenes: Scenes, name: str) -> None:
    with (scenes.path / name).open("ab") as file:
        file.write(b" ")
    with pytest.raises(DataError, match=f"{name}: missing, or changed since"):
        open_scenes(scenes.path)


def test_scenes_of_another_mujoco_or_protocol_are_refused(scenes, monkeypatch) -> None:
    from xden_bench.manip import scenes as module

    monkeypatch.setattr(module, "mujoco_version", lambda: "3.0.0")
    with pytest.raises(DataError, match=r"made for another MuJoCo, 4.*, here is 3.0.0"):
        open_scenes(scenes.path)
    monkeypatch.setattr(module, "load_manip_protocol", lambda: replace(RULES, sha256="f" * 64))
    with pytest.raises(DataError, match="made for another protocol"):
        open_scenes(scenes.path)


def test_a_folder_without_scenes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="expected a folder of scenes"):
        open_scenes(tmp_path)


def test_an_object_that_is_not_there_is_named_with_its_neighbour(scenes: Scenes) -> None:
    with pytest.raises(MissingObjectError, match=r"no scene of hammer-2; did you mean hammer-1"):
        scenes.item("hammer-2")


def test_each_control_takes_the_candidate_that_its_name_says(scenes, tmp_path, unsimulated) -> None:
    run_rows(tries(scenes), tmp_path / "rows", {})
    rows = {row.name: row for row in read_rows(sorted((tmp_path / "rows").glob("*.json")))}
    places = {
        name: [PLACES_CM[trial.candidate] for trial in row.objects[0].trials]
        for name, row in rows.items()
    }
    assert places["top"] == [-9, -9]
    assert places["uniform"] == [0, 0]
    assert places["true"] == [9, 9]
    assert places["true-5cm"] == [4, 4]
    assert places["true+8cm"] == [9, 9]
    assert len(rows) == 4 + 2 * len(RULES.shifts_cm)


def test_a_run_that_is_cut_off_goes_on_and_gives_the_same_rows(
    scenes: Scenes, tmp_path: Path, unsimulated: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_rows(tries(scenes, "random", "true"), tmp_path / "whole", {})
    asked: list[str] = []
    tried = Tries.tried

    def cut(self: Tries, object_id: str) -> np.ndarray:
        asked.append(object_id)
        if asked.count("chisel-1") == 1 and object_id == "chisel-1":
            raise KeyboardInterrupt
        return tried(self, object_id)

    monkeypatch.setattr(Tries, "tried", cut)
    with pytest.raises(KeyboardInterrupt):
        run_rows(tries(scenes, "random", "true"), tmp_path / "cut", {})
    assert contents(tmp_path / "cut") == {}
    run_rows(tries(scenes, "random", "true"), tmp_path / "cut", {})
    assert asked == ["hammer-1", "chisel-1", "chisel-1", "ruler-1"]
    assert contents(tmp_path / "cut") == contents(tmp_path / "whole")


def test_rows_that_choose_alike_share_a_trial(scenes, tmp_path, monkeypatch) -> None:
    picked: list[tuple[float, int]] = []

    def counted(*arguments: object) -> Trial:
        picked.append((arguments[2].origin_cm[0], arguments[4].shake_azimuth_rad))
        return levered(*arguments)

    monkeypatch.setattr(running, "pick", counted)
    tries(scenes).tried("ruler-1")
    assert len(picked) == len(set(picked)) == 2 * len(PLACES_CM)


def test_a_table_says_which_row_is_better_on_which_stratum(scenes, tmp_path, unsimulated) -> None:
    few = tries(scenes, "top", "uniform", "true", "true+8cm", "true-8cm")
    run_rows(few, tmp_path / "rows", {})
    found = lines(read_rows(sorted((tmp_path / "rows").glob("*.json"))), RULES.statistics)
    by_key = {(line.stratum, line.name): line for line in found}
    uniform, true = by_key["off", "uniform"], by_key["off", "true"]
    # without a simulator the middle holds: the true centre, far from it, loses every trial
    assert (uniform.success, true.success) == (1, 0)
    assert true.against["uniform"].difference.mean == -1
    assert true.against["uniform"].objects.worse == 2
    assert true.against["uniform"].without_one == (-1, -1)
    assert uniform.axial_error_cm == pytest.approx((8.8 + 4.4) / 2)
    assert by_key["balanced", "true"].success == 1
    assert true.expected == 0
    assert by_key["off", "top"].expected is None


@pytest.mark.slow
def test_a_figure_needs_the_ladder(scenes, tmp_path, unsimulated) -> None:
    paths = [str(path) for path in run_rows(tries(scenes), tmp_path / "rows", {"commit": None})]
    asked = ["manip", "table", "--figure", str(tmp_path / "ladder.png")]
    alone = [path for path in paths if Path(path).stem in ("uniform", "true")]
    done = CliRunner().invoke(cli, [*asked, *alone])
    assert done.exit_code == 1
    assert "a figure needs rows of the ladder" in done.output
    done = CliRunner().invoke(cli, [*asked, *paths])
    assert done.exit_code == 0, done.output
    assert "Simulated picks" in done.output
    assert (tmp_path / "ladder.png").stat().st_size > 10_000


def test_two_rows_of_one_name_are_refused_before_a_trial(scenes, tmp_path) -> None:
    true = Chooser("true", "top", {})
    twice = Tries(scenes, (true, replace(true, submission_sha256="0" * 64)), AS_RELEASED)
    with pytest.raises(DataError, match="two rows of the name 'true'"):
        run_rows(twice, tmp_path / "rows", {})
    assert not (tmp_path / "rows").exists()


def test_a_row_says_the_command_that_makes_it_again(scenes, tmp_path, unsimulated) -> None:
    asked = ["manip", "run", str(scenes.path), "--control", "true", "--out", str(tmp_path / "rows")]
    done = CliRunner().invoke(cli, asked)
    assert done.exit_code == 0, done.output
    facts = json.loads((tmp_path / "rows" / "true.json").read_text())
    assert facts["command"] == f"xden-bench {' '.join(asked)}"


def verified(row: Path, scenes: Path, *more: object):
    asked = ["manip", "verify", str(row), str(scenes), *map(str, more)]
    return CliRunner().invoke(cli, asked)


@pytest.fixture
def made(scenes: Scenes, tmp_path: Path, unsimulated: None) -> Path:
    """A row of the true centre, with another friction and steps of another length."""
    asked = ["manip", "run", str(scenes.path), "--control", "top", "--control", "true"]
    varied = ["--friction-scale", "0.9", "--vary", "timestep_s=0.001"]
    done = CliRunner().invoke(cli, [*asked, *varied, "--out", str(tmp_path / "rows")])
    assert done.exit_code == 0, done.output
    return tmp_path / "rows" / "true.json"


def test_a_row_comes_out_again_to_the_byte(scenes: Scenes, made: Path) -> None:
    before = made.read_bytes()
    done = verified(made, scenes.path)
    assert done.exit_code == 0, done.output
    assert "true.json: the same bytes; not verifiable: command, " in done.output
    assert made.read_bytes() == before


def test_a_row_that_was_touched_is_told_by_the_place(scenes: Scenes, made: Path) -> None:
    values = json.loads(made.read_text())
    values["objects"][1]["trials"]["wrist_moment_nm"][0] += 1e-6
    values["varied"]["friction_scale"] = 0.95
    made.write_text(json.dumps(values) + "\n")
    done = verified(made, scenes.path, "--json")
    assert done.exit_code == 1
    told = json.loads(done.stdout)
    assert [one["where"] for one in told["deviations"]] == [
        "objects[1].trials.wrist_moment_nm[0]",
        "varied.friction_scale",
    ]
    assert "other bytes, 2 values differ" in verified(made, scenes.path).output


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("scenes_sha256", "f" * 64, "expected rows with scenes_sha256 "),
        ("command", "rm -r /", "the command must be `xden-bench manip run ...`"),
        ("command", "xden-bench manip run s --out r --vary a", "expected NAME=VALUE, got 'a'"),
        ("method", "truer", "no control 'truer'"),
    ],
)
def test_a_row_that_cannot_be_made_again_is_told_why(scenes, made, name, value, said) -> None:
    made.write_text(json.dumps({**json.loads(made.read_text()), name: value}))
    done = verified(made, scenes.path)
    assert done.exit_code == 1
    assert said in done.output


ENTERED = {"command": "xden-bench manip run", "xden_version": "0.1.0", "commit": "a" * 40}


def leaderboard(folder: Path, *, check: bool = False):
    asked = ["leaderboard", "--results", str(folder / "results"), "--out", str(folder / "L.md")]
    return CliRunner().invoke(cli, [*asked, *(["--check"] if check else [])])


@pytest.fixture
def entered(scenes: Scenes, tmp_path: Path, unsimulated: None) -> Path:
    """A folder with no entries, and beside it the rows of a table."""
    (tmp_path / "results").mkdir()
    method = Chooser("eye|1", "nearest", {one.object_id: one.uniform_cm for one in scenes.items()})
    few = tries(scenes, "uniform", "true", "true+8cm", "true-8cm")
    seen = replace(method, inputs=("mesh", "xray"), submission_sha256="b" * 64)
    every = replace(few, choosers=(*few.choosers, seen))
    run_rows(every, tmp_path / "picks" / "manip-v1", ENTERED)
    return tmp_path


def test_the_leaderboard_has_the_rows_that_are_entered(entered: Path) -> None:
    assert leaderboard(entered).exit_code == 0
    text = (entered / "L.md").read_text()
    off, balanced = text.split("### Stratum ")[1:]
    assert "2 objects, 2 trials of each" in off
    assert "| *true*" in off
    assert r"| eye\|1 " in off
    assert "mesh, xray" in off
    assert "*true+8cm*" not in text
    assert "1 objects, 2 trials of each" in balanced
    assert leaderboard(entered, check=True).exit_code == 0
    (entered / "picks" / "manip-v1" / "eye-1-bbbbbbbb.json").unlink()
    assert leaderboard(entered, check=True).exit_code == 1


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("commit", "a" * 40 + "-dirty", "expected a row by the code of a commit, got 'aa"),
        ("commit", None, "expected a row by the code of a commit, got None"),
        ("homogeneous", True, "departs from the protocol"),
        ("varied", {"timestep_s": 0.001}, "departs from the protocol"),
    ],
)
def test_a_row_that_cannot_be_made_again_is_not_entered(entered, name, value, said) -> None:
    for path in (entered / "picks" / "manip-v1").glob("*.json"):
        path.write_text(json.dumps({**json.loads(path.read_text()), name: value}))
    done = leaderboard(entered)
    assert done.exit_code == 1
    assert said in done.output
    assert not (entered / "L.md").exists()


def test_a_table_needs_the_rows_that_all_are_compared_with(scenes, tmp_path, unsimulated) -> None:
    paths = run_rows(tries(scenes, "true", "top"), tmp_path / "rows", {})
    with pytest.raises(DataError, match="compared with 'uniform', but there is no row of it"):
        lines(read_rows(paths), RULES.statistics)


def test_rows_of_other_variants_or_twice_are_no_table(scenes, tmp_path, unsimulated) -> None:
    (one,) = run_rows(tries(scenes, "true"), tmp_path / "one", {})
    stiff = Variant({"timestep_s": 0.001})
    (other,) = run_rows(tries(scenes, "uniform", variant=stiff), tmp_path / "other", {})
    with pytest.raises(DataError, match=r"uniform.json: varied is .*timestep_s.*no rows of one"):
        read_rows([one, other])
    with pytest.raises(DataError, match="two rows of the name 'true'"):
        read_rows([one, one])


def of_split(folder: Path, split: str, *items: Item, **facts: object) -> list[Path]:
    """Rows of uniform and true on objects of a split, without a simulator."""
    where = folder / split
    write_scenes(Chosen(items, {}, 0), RULES, {**DATASET, "split": split}, "quick", where)
    paths = run_rows(tries(open_scenes(where), "uniform", "true"), folder / f"{split}-rows", {})
    for path in paths:
        path.write_text(json.dumps(json.loads(path.read_text()) | facts))
    return list(paths)


def joined(*paths: Path):
    return CliRunner().invoke(cli, ["manip", "table", "--joined", *map(str, paths), "--json"])


def test_a_joined_table_has_the_objects_of_both_splits(tmp_path: Path, unsimulated: None) -> None:
    here = of_split(tmp_path, "test", bar("hammer-1", 8.8), bar("ruler-1", 0.0))
    there = of_split(tmp_path, "unseen", bar("chisel-1", 2.0), bar("ruler-2", 0.0))
    found = {
        (one["stratum"], one["name"]): one
        for one in json.loads(joined(*here, *there).stdout)["lines"]
    }
    # true takes the end of the hammer, which is lost, and the middle of the chisel, which is held
    assert found["off", "true"]["success"] == 0.5
    assert found["off", "uniform"]["success"] == 1
    assert found["off", "true"]["against"]["uniform"]["objects"]["worse"] == 1
    shown = CliRunner().invoke(cli, ["manip", "table", "--joined", *map(str, here + there)])
    assert "splits test and unseen joined" in shown.output
    apart = CliRunner().invoke(cli, ["manip", "table", *map(str, here + there)])
    assert "scenes_sha256 is" in apart.output


@pytest.mark.parametrize(
    ("item", "facts", "said"),
    [
        (bar("hammer-1", 8.8), {}, "'hammer-1' is in two of the tables"),
        (bar("axe-1", 8.8), {"tier": "full"}, "tier is 'full', in"),
        (bar("axe-1", 8.8), {"dataset": {"manifest_sha256": "1" * 64}}, "of another dataset"),
    ],
)
def test_tables_that_do_not_belong_together_are_not_joined(
    tmp_path: Path, unsimulated: None, item: Item, facts: dict[str, object], said: str
) -> None:
    here = of_split(tmp_path, "test", bar("hammer-1", 8.8), bar("ruler-1", 0.0))
    there = of_split(tmp_path, "unseen", item, bar("ruler-2", 0.0), **facts)
    done = joined(*here, *there)
    assert done.exit_code == 1
    assert said in done.output
    alone = joined(*here, there[0])
    assert alone.exit_code == 1


def test_a_row_of_one_split_alone_is_not_joined(tmp_path: Path, unsimulated: None) -> None:
    here = of_split(tmp_path, "test", bar("hammer-1", 8.8), bar("ruler-1", 0.0))
    there = of_split(tmp_path, "unseen", bar("axe-1", 8.8), bar("ruler-2", 0.0))
    done = joined(*here, there[0])
    assert done.exit_code == 1
    assert "no row of 'true' beside" in done.output


def test_what_is_no_row_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("{}")
    with pytest.raises(DataError, match=r"a.json: expected a row"):
        read_rows([tmp_path / "a.json"])


def test_a_variant_of_a_number_that_is_none_is_refused(scenes: Scenes) -> None:
    variant = Variant({"torsional_friction": 0.02})
    with pytest.raises(DataError, match=r"no number 'torsional_friction'; did you mean"):
        _ = tries(scenes, variant=variant).rules
    assert (
        tries(scenes, variant=Variant({"noslip_iterations": 0.0})).rules.solver.noslip_iterations
        == 0
    )


def test_a_scaled_friction_reaches_the_trial_and_the_row(scenes, tmp_path, monkeypatch) -> None:
    felt: list[float] = []

    def rubbed(model, rest, grasp, width_cm, draw, rules) -> Trial:
        felt.append(draw.friction)
        return levered(model, rest, grasp, width_cm, draw, rules)

    monkeypatch.setattr(running, "pick", rubbed)
    slick = tries(scenes, "true", variant=Variant({}, friction_scale=0.5))
    (row,) = read_rows(run_rows(slick, tmp_path / "rows", {}))
    assert sorted(set(felt)) == [0.15, 0.2]
    assert [one.friction for one in row.objects[0].trials] == [0.2, 0.15]
    assert row.facts["varied"] == {"friction_scale": 0.5}


def test_scenes_of_other_hulls_say_so_in_their_rows(scenes, tmp_path, unsimulated) -> None:
    chosen = Chosen(tuple(scenes.items()), {}, 0)
    write_scenes(chosen, RULES, DATASET, "quick", tmp_path / "few", {"max_hulls": 32})
    few = replace(tries(scenes, "true"), scenes=open_scenes(tmp_path / "few"))
    (row,) = read_rows(run_rows(few, tmp_path / "rows", {}))
    assert row.facts["varied"] == {"max_hulls": 32}


def by_ratio(model, rest, grasp, width_cm, draw, rules) -> Trial:
    """A pick of a bar whose centre is in its middle, by a patch of 1.2 cm."""
    del model, rest, width_cm, rules
    ratio = slip_ratio(500, draw.grip_force_n, draw.friction, abs(grasp.origin_cm[0]), 1.2)
    return Trial("held" if ratio < 1 else "rotated", 0.0, 0.0, 0)


@pytest.fixture
def bars(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Scenes, Scenes, list[Path]]:
    """A bar, the same and another, and the rows of the two by the slip ratio alone."""
    every = (bar("ruler-1", 0.0), bar("ruler-2", 0.0))
    for name, items in (("one", every[:1]), ("both", every)):
        write_scenes(Chosen(items, {}, 0), RULES, DATASET, "quick", tmp_path / name)
    one, both = open_scenes(tmp_path / "one"), open_scenes(tmp_path / "both")
    monkeypatch.setattr(running, "pick", by_ratio)
    return one, both, list(run_rows(tries(both), tmp_path / "rows", {}))


def test_the_closed_form_finds_the_patch_that_it_was_told(bars) -> None:
    one, both, paths = bars
    asked = ["manip", "slip", str(both.path), *map(str, paths), "--chosen-on", str(one.path)]
    told = json.loads(CliRunner().invoke(cli, [*asked, "--json"]).stdout)
    for part in ("chosen_on", "tested_on"):
        assert told[part]["agreement"] == 1
        assert told[part]["trials"] == 2 * len(PLACES_CM)
    assert told["tested_on"]["radius_cm"] == told["chosen_on"]["radius_cm"]
    assert "agrees with 100.0%" in CliRunner().invoke(cli, asked).output


def test_a_disagreement_has_the_cause_that_its_trial_shows(bars) -> None:
    _, both, paths = bars
    trial = slip_trials(both, read_rows(paths))[0]
    lost = replace(trial.trial, lever_cm=0.0, outcome="slipped")
    assert replace(trial, trial=lost).cause(1.2) == "dropped"
    assert replace(trial, trial=lost, beside_cm=2.1).cause(1.2) == "beside"
    assert replace(trial, trial=replace(lost, outcome="rotated")).cause(1.2) == "turned"
    assert replace(trial, trial=replace(lost, lever_cm=90.0, outcome="held")).cause(1.2) == "caught"
    at_limit = 1.2 * math.sqrt((2 * lost.friction * lost.grip_force_n / 4.905) ** 2 - 1)
    assert replace(trial, trial=replace(lost, lever_cm=at_limit)).cause(1.2) == "near"


def test_rows_of_other_scenes_have_no_slip_ratio(bars) -> None:
    one, _, paths = bars
    with pytest.raises(DataError, match="expected rows with scenes_sha256"):
        slip_trials(one, read_rows(paths))


HEADED = (
    Box("handle", (-16, -1.3, 0), (0, 1.3, 2.6), 0.7),
    Box("head", (0, -2, 0), (4, 2, 4), 7.8, material="steel"),
)
EVEN = (Box("bar", (-10, -1.3, 0), (10, 1.3, 2.6), 1.0),)
BALL = (Box("block", (-6, -6, -6), (6, 6, 6), 0.3),)
SAFE = (Box("safe", (-8, -8, -8), (8, 8, 8), 7.8),)


@pytest.fixture(scope="module")
def tools(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mallet, a ruler, a block that is too wide and a safe that is too heavy."""
    root = tmp_path_factory.mktemp("tools") / "dataset"
    objects = [
        box_object("block-0001", BALL, category="block"),
        box_object("mallet-0001", HEADED, category="mallet"),
        box_object("ruler-0001", EVEN, category="ruler"),
        box_object("safe-0001", SAFE, category="safe"),
    ]
    write_folder(objects, root, version="0.1.0", builder="tests")
    return root


@pytest.mark.slow
def test_objects_are_chosen_by_their_stratum_and_the_others_told_by_rule(tools, tmp_path) -> None:
    rules = replace(
        RULES,
        grasps=replace(RULES.grasps, surface_points=1500, collision_points=1000),
    )
    folder = open_folder(tools)
    examiner = Examiner(folder, rules, 1, tmp_path)
    chosen = choose(folder.ids("test"), examiner, Tier(2, 2, 1))
    assert [(one.object_id, one.stratum) for one in chosen.items] == [
        ("mallet-0001", "off"),
        ("ruler-0001", "balanced"),
    ]
    assert chosen.taken_out["wide"] == ("block-0001",)
    assert chosen.taken_out["heavy"] == ("safe-0001",)
    mallet = chosen.items[0]
    exact = folder.object("mallet-0001").mass_properties
    np.testing.assert_allclose(mallet.mass.com_cm, exact.com_cm, atol=1e-6)
    assert mallet.along_cm(mallet.uniform_cm) == pytest.approx(-5.0, abs=1.0)
    assert (mallet.grasps.centre_cm[:, 2] > 0.5 + 0.85 - 1e-9).all()


def test_a_density_that_is_unknown_is_refused_by_the_object(tmp_path: Path) -> None:
    objects = [box_object("bar-0001", EVEN, density_known=False)]
    write_folder(objects, tmp_path / "data", version="0.1.0", builder="tests")
    folder = open_folder(tmp_path / "data")
    with pytest.raises(DataError, match="bar-0001: expected the density of every part"):
        choose(folder.ids("test"), Examiner(folder, RULES, 1, tmp_path), Tier(1, 1, 1))


@pytest.mark.slow
def test_the_commands_lead_from_a_dataset_to_a_table(tools: Path, tmp_path: Path) -> None:
    def told(*arguments: str) -> dict:
        done = CliRunner().invoke(cli, ["manip", *arguments, "--json"])
        assert done.exit_code == 0, done.output
        return json.loads(done.stdout)

    scenes, rows = str(tmp_path / "scenes"), str(tmp_path / "rows")
    assert told("prepare", str(tools), "--out", scenes)["taken_out"]["wide"] == ["block-0001"]
    asked = ("run", scenes, "--control", "true", "--control", "uniform", "--out", rows)
    made = told(*asked)["rows"]
    found = {(one["stratum"], one["name"]): one for one in told("table", *made)["lines"]}
    assert found["off", "true"]["success"] > found["off", "uniform"]["success"]
    assert found["balanced", "true"]["success"] == found["balanced", "uniform"]["success"]
    first = [json.loads(Path(path).read_text())["objects"] for path in made]
    told(*asked, "--workers", "2")
    assert [json.loads(Path(path).read_text())["objects"] for path in made] == first
    assert told("show", "mallet-0001", scenes)["stratum"] == "off"


def elsewhere(*arguments: object) -> dict:
    """What a command tells that runs in a process of its own."""
    asked = [*OWN_PROCESS, *map(str, arguments), "--json"]
    done = subprocess.run(asked, capture_output=True, check=True)  # noqa: S603
    return json.loads(done.stdout)


@pytest.mark.slow
def test_two_processes_make_the_same_scenes_and_the_same_rows(tools: Path, tmp_path: Path) -> None:
    for name in ("one", "other"):
        elsewhere("prepare", tools, "--out", tmp_path / name)
    one, other = (open_scenes(tmp_path / name) for name in ("one", "other"))
    assert one.sha256 == other.sha256
    asked = ["run", one.path, "--control", "uniform", "--control", "random", "--out"]
    for row in elsewhere(*asked, tmp_path / "rows")["rows"]:
        assert verified(Path(row), other.path).exit_code == 0


@pytest.mark.slow
def test_the_mechanics_of_bars_are_those_of_statics(scenes: Scenes) -> None:
    asked = ["manip", "mechanics", str(scenes.path)]
    done = CliRunner().invoke(cli, [*asked, "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert all(one["speed_mm_s"] < 0.2 for one in told["resting"].values())
    assert len(told["objects"]) == 3
    for one in told["objects"]:
        assert one["simulated_deg"] == pytest.approx(one["foretold_deg"], abs=1)
        assert {trial["assumed"]: trial["stays"] for trial in one["edges"]}["beyond"] is False
    assert "3 of 3 objects stand" in CliRunner().invoke(cli, asked).output


@pytest.mark.slow
def test_a_picture_shows_a_row_of_frames_for_each_pick(scenes: Scenes, tmp_path: Path) -> None:
    from PIL import Image

    asked = ["show", "hammer-1", scenes.path, "--regime", "easy", "--json", "--picture"]
    # a process of its own: MuJoCo asks once what it can draw with
    done = subprocess.run(  # noqa: S603
        [*OWN_PROCESS, *asked, "hammer.png"],
        capture_output=True,
        cwd=tmp_path,
        check=False,
    )
    if b"pictures need EGL" in done.stderr:
        pytest.skip("neither EGL nor OSMesa")
    assert json.loads(done.stdout)["outcomes"] == {"uniform": "rotated", "true": "held"}
    with Image.open(tmp_path / "hammer.png") as picture:
        assert picture.size == (5 * 240, 2 * 240)
        assert np.asarray(picture).std() > 10


def test_a_draw_that_there_is_not_is_refused(scenes: Scenes, tmp_path: Path) -> None:
    asked = ["manip", "show", "hammer-1", str(scenes.path), "--regime", "easy", "--draw", "2"]
    done = CliRunner().invoke(cli, [*asked, "--picture", str(tmp_path / "hammer.png")])
    assert done.exit_code == 1
    assert done.output == "Error: --draw: hammer-1 has 2 draws, 0 to 1\n"
    assert not (tmp_path / "hammer.png").exists()


def test_scenes_of_another_dataset_do_not_try_a_submission(
    scenes: Scenes, tmp_path: Path, submission: Callable[..., Path], dataset: Path
) -> None:
    asked = ["manip", "run", str(scenes.path), str(submission()), "--root", str(dataset)]
    done = CliRunner().invoke(cli, [*asked, "--out", str(tmp_path / "rows")])
    assert done.exit_code == 1
    assert "of another dataset, 000000000000, than" in done.output
    assert not (tmp_path / "rows").exists()


@pytest.fixture
def two_bars(tmp_path: Path, reference) -> Scenes:
    """Scenes under the names of two objects of the dataset of the tests."""
    items = (
        replace(bar("hammer-1", 8.8), object_id="bar-0002"),
        replace(bar("ruler-1", 0.0), object_id="hollow-0002"),
    )
    dataset = {"revision": "0.1.0", "manifest_sha256": reference.manifest_sha256, "split": "test"}
    write_scenes(Chosen(items, {}, 0), RULES, dataset, "quick", tmp_path / "two")
    return open_scenes(tmp_path / "two")


def test_the_row_of_a_method_comes_out_again_by_its_file_or_by_its_command(
    two_bars: Scenes, tmp_path: Path, dataset: Path, unsimulated: None
) -> None:
    def asked(*words: object) -> str:
        done = CliRunner().invoke(cli, [*map(str, words), "--root", str(dataset)])
        assert done.exit_code == 0, done.output
        return done.output

    preds, out = tmp_path / "water.npz", tmp_path / "rows"
    asked("baseline", "water", "--out", preds)
    asked("manip", "run", two_bars.path, preds, "--no-controls", "--out", out)
    (row,) = out.glob("water-*.json")
    for more in ((), ("--submission", preds)):
        assert "the same bytes" in asked("manip", "verify", row, two_bars.path, *more)
    asked("baseline", "zero", "--out", tmp_path / "zero.npz")
    done = verified(row, two_bars.path, "--root", dataset, "--submission", tmp_path / "zero.npz")
    assert done.exit_code == 1
    assert "zero.npz is not the row's submission" in done.output


def test_a_submission_is_tried_at_the_centre_of_its_score(
    reference, submission: Callable[..., Path]
) -> None:
    from xden_bench.manip.choosing import submitted

    items = {"bar-0002": bar("hammer-1", 8.8), "hollow-0002": bar("ruler-1", 0.0)}
    path = submission(lambda name, grid: 0 * grid if name == "hollow-0002" else grid)
    chooser = submitted(path, items, reference)
    np.testing.assert_allclose(chooser.centres_cm["bar-0002"], [25 / 18, 1, 2], atol=0.02)
    np.testing.assert_allclose(chooser.centres_cm["hollow-0002"], 0, atol=1e-6)
    assert chooser.without_mass == ("hollow-0002",)
    assert isinstance(chooser, Chooser)
