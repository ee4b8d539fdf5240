"""Simulated objects: closed, disjoint, whole, of known stuff, always the same."""

from __future__ import annotations

import itertools
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from manifold3d import Manifold

from xden1k.errors import DataError, MissingObjectError
from xden1k.rays import disjoint_regions, object_grids, outer_surface
from xden1k.values.materials import load_materials
from xden_builder.phantoms import (
    CATALOGUE,
    Phantom,
    PhantomPart,
    Plan,
    Scanner,
    make_phantom,
    plan_objects,
)
from xden_builder.phantoms.archetypes import ARCHETYPES
from xden_builder.phantoms.catalogue import read_catalogue
from xden_builder.phantoms.scanner import VIEWS
from xden_builder.phantoms.shapes import CRUMB_CM3, from_mesh

NAMES = [category.name for category in CATALOGUE]


def sampled(count: int) -> list[object]:
    """Every category; all but each one in ``count`` are slow tests."""
    return [
        pytest.param(name, marks=[pytest.mark.slow] * (place % count > 0))
        for place, name in enumerate(NAMES)
    ]


@pytest.fixture(scope="module", params=sampled(48))
def phantom(request: pytest.FixtureRequest) -> Phantom:
    return make_phantom(Plan.of(11, f"{request.param}-0000"))


def assert_closed(phantom: Phantom) -> None:
    for part in phantom.parts:
        assert part.mesh.is_watertight, part.name
        assert part.mesh.is_winding_consistent, part.name
        assert float(part.mesh.volume) > 1e-4, part.name


def assert_disjoint(phantom: Phantom) -> None:
    """No part owns space of another, as rays see it: booleans err where facets nearly coincide."""
    meshes = [part.mesh for part in phantom.parts]
    cut = disjoint_regions(meshes, range(len(meshes)))
    for part, left in zip(phantom.parts, cut, strict=True):
        assert left is part.mesh, f"{part.name} overlaps another part"


def loose_bodies(part: PhantomPart) -> list[Manifold]:
    """Bodies of a part that do not hang together, each with its own cavities."""
    shells = sorted(from_mesh(part.mesh).decompose(), key=lambda shell: abs(shell.volume()))
    bodies = [[shell] for shell in shells if shell.volume() > CRUMB_CM3]
    for cavity in (shell for shell in shells if shell.volume() < -CRUMB_CM3):
        next(body for body in bodies if encloses(body[0], cavity)).append(cavity)
    return [Manifold.compose(body) for body in bodies]


def encloses(outer: Manifold, inner: Manifold) -> bool:
    """Whether a box around one surface, the larger, holds the other's."""
    (low, high), (least, most) = (np.split(np.array(s.bounding_box()), 2) for s in (outer, inner))
    larger = outer.volume() > abs(inner.volume())
    return larger and bool((low <= least).all() and (most <= high).all())


def touches(one: Manifold, other: Manifold) -> bool:
    """Whether two bodies meet if one is nudged by half a tenth of a millimetre.

    What lies in a closed cavity has no gap to its walls as ``min_gap`` sees it.
    """
    nudges = 0.005 * np.concatenate([np.eye(3), -np.eye(3)])
    return one.min_gap(other, 0.02) < 0.005 and any(
        (one.translate(tuple(nudge)) ^ other).volume() > 1e-9 for nudge in nudges.tolist()
    )


def assert_nothing_floats(phantom: Phantom) -> None:
    """Every loose body of every part touches another, so that all hang together."""
    bodies = [body for part in phantom.parts for body in loose_bodies(part)]
    groups = list(range(len(bodies)))
    for i, j in itertools.combinations(range(len(bodies)), 2):
        if groups[i] != groups[j] and touches(bodies[i], bodies[j]):
            groups = [groups[i] if group == groups[j] else group for group in groups]
    assert len(set(groups)) == 1


def test_parts_are_closed_and_wound_outwards(phantom: Phantom) -> None:
    assert_closed(phantom)


def test_parts_do_not_overlap(phantom: Phantom) -> None:
    assert_disjoint(phantom)


def test_no_part_floats(phantom: Phantom) -> None:
    assert_nothing_floats(phantom)


def test_object_is_of_everyday_size_and_centred(phantom: Phantom) -> None:
    corners = np.concatenate([part.mesh.bounds for part in phantom.parts])
    low, high = corners.min(axis=0), corners.max(axis=0)
    np.testing.assert_allclose(low + high, 0.0, atol=1e-6)
    assert 2.0 <= (high - low).max() <= 60.0
    size = np.sort(high - low)[::-1]
    least, most = phantom.plan.category.size_cm
    assert 0.75 * least <= np.hypot(size[0], size[1])
    assert size[0] <= 1.45 * most  # a mug is wider with its handle, a box across its corners


def test_object_fits_the_scanner(phantom: Phantom) -> None:
    _, scanner = Scanner().setting_for(phantom)
    for view in VIEWS:
        geometry = scanner.geometry(view)
        for part in phantom.parts:
            columns, rows, _ = geometry.project(part.mesh.vertices).T
            assert 4 < columns.min() < columns.max() < 507
            assert 4 < rows.min() < rows.max() < 507


def test_materials_and_densities_are_the_librarys(phantom: Phantom) -> None:
    for part in phantom.parts:
        material = load_materials()[part.material]
        assert material.name == part.material
        assert material.density_low_g_cm3 <= part.density_g_cm3 <= material.density_high_g_cm3
        assert all(0.0 <= value <= 1.0 for value in part.color_rgb)


def test_parts_are_named_uniquely_and_sorted(phantom: Phantom) -> None:
    names = [part.name for part in phantom.parts]
    assert names == sorted(set(names))
    assert all(name.replace("_", "").isalnum() for name in names)


def test_parts_of_one_role_are_of_one_batch(phantom: Phantom) -> None:
    batches = {(p.role, p.material, p.density_g_cm3, p.color_rgb) for p in phantom.parts}
    assert len(batches) == len({part.role for part in phantom.parts})


def test_same_object_twice_is_the_same_to_the_bit(phantom: Phantom) -> None:
    again = make_phantom(phantom.plan)
    for part, other in zip(phantom.parts, again.parts, strict=True):
        assert part.density_g_cm3 == other.density_g_cm3
        assert part.mesh.vertices.tobytes() == other.mesh.vertices.tobytes()
        assert part.mesh.faces.tobytes() == other.mesh.faces.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_shape_stays_sound_over_many_draws(name: str) -> None:
    for seed in range(12):
        phantom = make_phantom(Plan.of(seed, f"{name}-0001"))
        assert_closed(phantom)
        assert_disjoint(phantom)
        assert_nothing_floats(phantom)
        test_object_fits_the_scanner(phantom)
        test_object_is_of_everyday_size_and_centred(phantom)


@pytest.mark.parametrize("name", sampled(24))
def test_every_role_of_a_category_has_its_materials(name: str) -> None:
    category = CATALOGUE[NAMES.index(name)]
    archetype, roles = ARCHETYPES[category.archetype], set()
    for seed in range(4):  # a sleeve, for one, is there in some only
        pieces = archetype.build(np.random.default_rng(seed), category.size_cm[0])
        roles |= {piece.role for piece in pieces}
    assert roles <= set(category.materials) <= set(archetype.roles.split())


def test_every_archetype_is_used() -> None:
    assert {category.archetype for category in CATALOGUE} == set(ARCHETYPES)


def test_catalogue_covers_the_families_and_sizes_of_the_paper() -> None:
    assert len(CATALOGUE) == 137
    assert {category.family for category in CATALOGUE} == {
        *("hand tools", "kitchenware", "cookware", "consumer electronics", "containers"),
        *("stationery", "personal care", "toys", "sports equipment", "hardware"),
        "small furniture",
    }
    assert {
        *("spoon", "screwdriver", "scissors", "pliers", "kettle", "flashlight", "bicycle_helmet"),
        *("power_drill", "glue_stick", "pencil", "air_pump", "ballpoint_pen", "razor"),
    } <= set(NAMES)
    least, most = zip(*(category.size_cm for category in CATALOGUE), strict=True)
    assert min(least) < 3.0
    assert max(most) == 60.0


ROW = "mug,kitchenware,mug,8,11,shell=porcelain"


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (ROW.replace("mug,8", "cup,8"), "table.csv:2, mug: unknown archetype 'cup'"),
        (ROW.replace("shell", "shaft"), r"mug: unknown roles \['shaft'\]; mug has \['shell'\]"),
        (ROW.replace("porcelain", "bone_chyna"), "role shell needs known materials, got 'bone_ch"),
        (ROW.replace("=porcelain", "="), "role shell needs known materials, got ''"),
        (ROW.replace("8,11", "11,8"), "must be positive and ascending, got 11 and 8 cm"),
        (ROW.replace("8,11", "8,tall"), "table.csv:2, mug: expected numbers and role=materials"),
        (ROW.replace("mug,k", "beer-mug,k"), "expected letters, digits and _, got category 'beer-"),
        (ROW.replace(",shell=porcelain", ""), "mug: expected numbers and role=materials"),
        (f"{ROW}\n{ROW}", "table.csv: category mug comes twice"),
    ],
)
def test_unsound_row_of_a_catalogue_is_named(row: str, message: str, tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    table.write_text(f"category,family,archetype,size_min_cm,size_max_cm,materials\n{row}\n")
    with pytest.raises(DataError, match=message):
        read_catalogue(table)


def test_catalogue_with_other_columns_is_refused(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("name\nmug\n")
    with pytest.raises(DataError, match="expected columns"):
        read_catalogue(tmp_path / "table.csv")


def test_seeds_and_numbers_give_different_objects() -> None:
    ids = [(0, "mug-0000"), (0, "mug-0001"), (1, "mug-0000")]
    masses = [make_phantom(Plan.of(*key)).mass_properties.mass_g for key in ids]
    assert len(set(masses)) == 3


def test_objects_do_not_depend_on_count_or_selection() -> None:
    few, many = plan_objects(5, seed=3), plan_objects(200, seed=3)
    assert many[:5] == few
    chosen = plan_objects(3, seed=3, categories=["mug", "hammer"])
    assert {plan.object_id for plan in chosen} == {"hammer-0000", "hammer-0001", "mug-0000"}
    assert set(chosen) <= set(many)


def test_every_split_has_an_object() -> None:
    for count in range(5, 60):
        assert {plan.split for plan in plan_objects(count, 0)} == {"train", "val", "test"}, count


def test_splits_are_70_10_20_and_train_knows_every_category() -> None:
    plans = plan_objects(10 * len(CATALOGUE), 0)
    shares = Counter(plan.split for plan in plans)
    assert [shares[s] / len(plans) for s in ("train", "val", "test")] == [0.7, 0.1, 0.2]
    three_each = plan_objects(3 * len(CATALOGUE), 0)
    assert {plan.category.name for plan in three_each if plan.split == "train"} == set(NAMES)


def test_plan_of_an_id_and_back() -> None:
    for plan in plan_objects(60, 5):
        assert Plan.of(5, plan.object_id) == plan


@pytest.mark.parametrize("name", ["hammer", "hammer-x", "anvil-0000", ""])
def test_unknown_id_is_refused(name: str) -> None:
    with pytest.raises(MissingObjectError, match="expected CATEGORY-NUMBER"):
        Plan.of(0, name)


def test_bad_requests_are_refused() -> None:
    with pytest.raises(DataError, match="must be positive, got 0"):
        plan_objects(0, 0)
    with pytest.raises(DataError, match="must not be negative, got -1"):
        plan_objects(1, -1)
    with pytest.raises(DataError, match=r"unknown categories \['anvil'\]; known are \['a"):
        plan_objects(1, 0, ["anvil"])


# --- what some objects must have inside ---


def part_box(phantom: Phantom, name: str) -> np.ndarray:
    return next(part.mesh.bounds for part in phantom.parts if part.name == name)


def flat_draw(name: str) -> dict[str, Manifold]:
    """An archetype's own solids, before the pose: lying along x or standing along z."""
    category = CATALOGUE[NAMES.index(name)]
    build = ARCHETYPES[category.archetype].build
    return {p.name: p.solid for p in build(np.random.default_rng(0), category.size_cm[1])}


def test_screwdriver_has_a_tang_inside_its_handle() -> None:
    parts = flat_draw("screwdriver")
    handle_end, tang_start = parts["handle"].bounding_box()[3], parts["shaft"].bounding_box()[0]
    assert 0.5 * handle_end < handle_end - tang_start < 0.9 * handle_end
    assert tang_start > 0.1 * handle_end


def test_hammer_handle_goes_through_the_head() -> None:
    parts = flat_draw("hammer")
    head, handle = parts["head"].bounding_box(), parts["handle"].bounding_box()
    assert handle[0] == 0.0
    assert handle[3] > head[3] - 0.05
    assert (parts["head"] - parts["handle"]).genus() == 1 + parts["head"].genus()


def test_bottle_is_about_half_full_and_its_air_is_enclosed() -> None:
    phantom = make_phantom(Plan.of(2, "water_bottle-0000"))
    meshes = [part.mesh for part in phantom.parts]
    shell, liquid = part_box(phantom, "shell"), part_box(phantom, "liquid")
    assert 0.25 < (liquid[1] - liquid[0])[2] / (shell[1] - shell[0])[2] < 0.6
    enclosed = outer_surface(meshes).volume - sum(mesh.volume for mesh in meshes)
    liquid_cm3 = next(part.mesh.volume for part in phantom.parts if part.name == "liquid")
    assert 0.4 * liquid_cm3 < enclosed < 2.5 * liquid_cm3


def test_mug_is_open() -> None:
    phantom = make_phantom(Plan.of(2, "mug-0000"))
    (body,) = phantom.parts
    assert float(outer_surface([body.mesh]).volume) == pytest.approx(float(body.mesh.volume))
    assert body.mesh.euler_number == 0  # one handle to put a finger through


def test_some_balls_are_hollow_and_some_are_not() -> None:
    kinds = set()
    for number in range(4):
        (body,) = make_phantom(Plan.of(0, f"rubber_ball-{number:04d}")).parts
        filled = float(outer_surface([body.mesh]).volume)
        kinds.add(float(body.mesh.volume) < 0.7 * filled)
    assert kinds == {True, False}


@pytest.mark.parametrize(
    "name", ["remote_control", pytest.param("flashlight", marks=pytest.mark.slow)]
)
def test_device_holds_board_and_cells_inside_its_shell(name: str) -> None:
    phantom = make_phantom(Plan.of(4, f"{name}-0000"))
    grids = object_grids([part.mesh for part in phantom.parts], range(len(phantom.parts)))
    assert grids.envelope.sum() > 1.1 * grids.occupancy.sum()  # there is air in it
    names = {part.name for part in phantom.parts}
    assert {"cell_1", "cell_2", "board"} < names
    everything = np.concatenate([part.mesh.bounds for part in phantom.parts])
    for inner in ("cell_1", "cell_2", "board"):
        box = part_box(phantom, inner)
        assert (box[0] > everything.min(axis=0) + 0.05).all()
        assert (box[1] < everything.max(axis=0) - 0.05).all()


@pytest.mark.parametrize(
    ("name", "seed"),
    [
        ("jar", 0),
        *(pytest.param("jar", seed, marks=pytest.mark.slow) for seed in (1, 2)),
        *(
            pytest.param(name, seed, marks=pytest.mark.slow)
            for name in ("teapot", "kettle")
            for seed in range(3)
        ),
    ],
)
def test_liquids_lie_level(name: str, seed: int) -> None:
    phantom = make_phantom(Plan.of(seed, f"{name}-0000"))
    (liquid,) = (part.mesh for part in phantom.parts if part.role == "liquid")
    level = float(liquid.bounds[1, 2])
    surface = liquid.triangles_center[:, 2] > level - 1e-6
    assert liquid.area_faces[surface].sum() > 0.1 * liquid.area
