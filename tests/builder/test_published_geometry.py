"""Published files onto each other: filling, labels, orientation, nets, on shapes that are known."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh

from xden1k.errors import DataError
from xden1k.values.closed import edge_faults
from xden_builder.published import kernels
from xden_builder.published.convention import Convention, vote
from xden_builder.published.fill import fill_mesh
from xden_builder.published.given import PublishedObject
from xden_builder.published.labels import LabelVolume, label_volume
from xden_builder.published.nets import part_nets
from xden_builder.published.orientation import ORIENTATIONS, Orientation
from xden_builder.published.register import UPRIGHT, cm_per_unit, register
from xden_builder.published.shares import BoxShares, volume_shares
from xden_builder.published.sides import six_side_agreement
from xden_builder.published.solids import part_solids, thickness_voxels
from xden_builder.published.survey import Survey, survey_object

SIDE = 64
UNIT = 1 / 20
"""Of the mesh, for one voxel."""
TABLE = {"head": 2.0, "handle": 0.2}


LOW = np.array([(-1.0, -0.25, -0.2), (0.6, -0.1, -0.2), (-0.75, -0.15, -0.1)])
HIGH = np.array([(1.0, 0.25, 0.2), (1.0, 0.9, 0.2), (-0.45, 0.15, 0.7)])
"""Corners of three boxes that overlap: a body of no symmetry, 2 long."""
HEAD_FROM = 0.3
SHIFT = np.array([0.013, -0.021, 0.017])
"""Of the volume's middle in the mesh."""


def body_mesh() -> trimesh.Trimesh:
    """The body, each box with a surface of its own."""
    boxes = [trimesh.creation.box(bounds=pair) for pair in zip(LOW, HIGH, strict=True)]
    return trimesh.util.concatenate(boxes)


def affine_of(way: Orientation) -> np.ndarray:
    """From voxels, i being i to i + 1, to the mesh."""
    affine = np.eye(4)
    affine[:3, :3] = way.matrix * UNIT
    affine[:3, 3] = SHIFT - affine[:3, :3] @ np.full(3, SIDE / 2)
    return affine


def covered(place: int, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Exact share of each voxel in the union of boxes, but where two of them end in one voxel."""
    inverse = np.linalg.inv(affine_of(ORIENTATIONS[place]))
    share = np.zeros((SIDE,) * 3)
    for corners in zip(low, high, strict=True):
        ends = np.sort(np.array(corners) @ inverse[:3, :3].T + inverse[:3, 3], axis=0)
        cells = np.arange(SIDE)[:, None]
        along = (np.minimum(cells + 1, ends[1]) - np.maximum(cells, ends[0])).clip(0)
        share = np.maximum(share, np.einsum("i,j,k->ijk", *along.T))
    return share


@cache
def body_volume(place: int) -> np.ndarray:
    """The body's attenuation: a head beyond a plane, a handle before it."""
    plane = np.array([HEAD_FROM, -9.0, -9.0])
    head = covered(place, np.maximum(LOW, plane)[:2], HIGH[:2])
    handle = covered(place, LOW[[0, 2]], np.minimum(HIGH, [HEAD_FROM, 9.0, 9.0])[[0, 2]])
    return (TABLE["head"] * head + TABLE["handle"] * handle).astype(np.float32)


@cache
def filled_body() -> BoxShares:
    """The body's mesh, filled."""
    return fill_mesh(body_mesh())


def given(place: int, **changes: object) -> PublishedObject:
    """The body as a release has it; 10 cm long."""
    values = {
        "object_id": "xden1k-0000",
        "category": "hammer",
        "mesh": body_mesh(),
        "colors_rgb": None,
        "lac_per_cm": body_volume(place),
        "table_lac_per_cm": TABLE,
        "size_cm": 5 * body_mesh().extents[[2, 0, 1]],
    }
    return PublishedObject(**(values | changes))  # type: ignore[arg-type]


@cache
def survey(place: int) -> Survey:
    return survey_object(given(place))


def random_labels(parts: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    labels = np.pad(rng.integers(0, parts + 1, (7, 7, 7)), 2).astype(np.uint8)
    return labels, ((labels > 0) * rng.uniform(0.5, 1.0, labels.shape)).astype(np.float32)


def test_a_mesh_without_a_face_and_with_turned_ones_is_filled_all_the_same():
    whole = trimesh.creation.icosphere(3)
    faces = np.delete(whole.faces, [5, 300], axis=0)
    faces[100:140] = faces[100:140, ::-1]
    found = fill_mesh(trimesh.Trimesh(whole.vertices, faces, process=False))
    volume = float(found.raw.mean() * found.extent.prod())
    assert volume == pytest.approx(float(whole.volume), rel=0.005)


def test_overlapping_solids_of_one_mesh_are_solid():
    found = filled_body()
    true = 2 * 0.5 * 0.4 + 0.4 * 0.65 * 0.4 + 0.3 * 0.3 * 0.5
    assert float(found.raw.mean() * found.extent.prod()) == pytest.approx(true, rel=0.02)


def test_a_cavity_stays_one_in_the_raw_shares_and_is_filled_in_the_solid_ones():
    outer, inner = trimesh.creation.box((2, 2, 2)), trimesh.creation.box((1, 1, 1))
    inner.invert()
    found = fill_mesh(trimesh.util.concatenate([outer, inner]))
    assert found.raw.mean() == pytest.approx(7 / 8, abs=0.02)
    assert found.solid.mean() == 1.0


def test_a_flat_mesh_is_refused():
    with pytest.raises(DataError, match="expected a body, got sides of"):
        fill_mesh(trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))


def test_labels_hold_the_volume_of_each_part_whatever_the_edges():
    volume = label_volume(body_volume(0), TABLE)
    head = 0.7 * 0.5 * 0.4 + 0.4 * 0.65 * 0.4
    assert volume.names == ("head", "handle")
    assert volume.filled_voxels[0] * UNIT**3 == pytest.approx(head, rel=0.03)


def thin_shell(level: float, weaker: float) -> np.ndarray:
    """A shell of 0.8 voxels on a ball, and a solid of a weaker part beside it."""
    size = 48
    away = np.linalg.norm(np.indices((size,) * 3) - [[[[15.6]]], [[[24.3]]], [[[23.8]]]], axis=0)
    share = (0.9 - np.abs(away - 12)).clip(0, 0.8)
    volume = (level * share).astype(np.float32)
    volume[34:44, 14:34, 14:34] = weaker
    return volume


@pytest.mark.parametrize("table", [{"strap": 0.11, "shell": 0.19}, {}])
def test_a_sheet_that_fills_no_voxel_is_not_taken_for_a_weaker_part(table):
    volume = thin_shell(level=0.19, weaker=0.11)
    found = label_volume(volume, table)
    true = float(volume[:32].sum()) / 0.19
    assert found.filled_voxels[1] == pytest.approx(true * 0.19 / found.lac_per_cm[1], rel=0.02)
    assert found.filled_voxels[0] == pytest.approx(10 * 20 * 20, rel=0.02)
    assert found.guessed_voxels[0] < 0.02 * found.filled_voxels[0]


def test_without_a_table_the_levels_come_from_the_volume():
    volume = label_volume(body_volume(0), {})
    assert volume.flags == ("parts_from_volume",)
    assert volume.lac_per_cm == pytest.approx([0.2, 2.0], rel=1e-3)


def test_a_thing_so_thin_that_no_level_shows_is_one_part_of_its_largest_value():
    volume = np.zeros((20, 20, 20), dtype=np.float32)
    volume[4:16, 9, 9] = np.linspace(3.0, 5.0, 12)
    found = label_volume(volume, {})
    assert found.lac_per_cm.tolist() == [5.0]
    assert found.filled_voxels[0] == pytest.approx(float(volume.sum()) / 5.0)
    volume[4] = 0
    with pytest.raises(DataError, match=r"expected 12 voxels above 0.001 1/cm, got 11"):
        label_volume(volume, {})


def test_parts_that_the_volume_cannot_show_are_merged_or_lost():
    volume = label_volume(body_volume(0), {**TABLE, "cap": 2.0, "string": 0.0})
    assert volume.names == ("head+cap", "handle")
    assert volume.lost == ("string",)
    assert volume.flags == ("equal_levels",)


def test_a_table_of_other_figures_gives_its_names_where_it_has_as_many_parts():
    volume = label_volume(body_volume(0), {"head": 1.5, "handle": 0.1})
    assert volume.names == ("handle", "head")
    assert volume.lac_per_cm == pytest.approx([0.2, 2.0], rel=1e-3)
    assert volume.flags == ("levels_not_in_table",)
    fewer = label_volume(body_volume(0), {"head": 1.5})
    assert fewer.names == ("region_01", "region_02")
    assert (fewer.flags, fewer.lost) == (("levels_not_in_table", "parts_from_volume"), ("head",))


def test_a_level_that_the_table_lacks_is_told():
    volume = label_volume(body_volume(0), {"head": 2.0})
    assert volume.names == ("head",)
    assert volume.flags == ("levels_not_in_table",)


def test_air_alone_is_refused():
    with pytest.raises(DataError, match=r"expected values above .* got air alone"):
        label_volume(np.zeros((8, 8, 8), dtype=np.float32), TABLE)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2))])
def test_nets_of_any_labels_are_closed(seed):
    labels, share = random_labels(3, seed)
    filled = np.bincount(labels.ravel(), share.ravel(), 4)[1:]
    for faces in part_nets(labels, share, filled).faces:
        assert edge_faults(faces) == (0, 0)


def test_neighbours_share_their_interface_so_that_volumes_add_up():
    labels, share = random_labels(3, seed=5)
    filled = np.bincount(labels.ravel(), share.ravel(), 4)[1:]
    net = part_nets(labels, share, filled)
    volumes = [trimesh.Trimesh(net.points, faces, process=False).volume for faces in net.faces]
    outer = np.concatenate(net.faces)
    edges = np.sort(outer, axis=1)
    _, index, count = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
    hull = trimesh.Trimesh(net.points, outer[count[index] == 1], process=False)
    assert hull.volume == pytest.approx(sum(volumes), rel=1e-9)


def test_blocks_of_an_odd_grid_keep_all_volume_and_go_to_the_part_that_fills_most():
    labels, share = random_labels(3, seed=7)
    shape = tuple((side + 1) // 2 for side in labels.shape)
    owner, total = np.zeros(shape, dtype=np.uint8), np.zeros(shape, dtype=np.float32)
    kernels.pool_parts(labels, share, np.zeros(4, dtype=np.float32), owner, total)
    assert 8 * total.sum() == pytest.approx(float(share.sum()), rel=1e-5)
    for block in np.ndindex(shape):
        cut = tuple(slice(2 * place, 2 * place + 2) for place in block)
        filled = np.bincount(labels[cut].ravel(), share[cut].ravel(), 4)
        assert owner[block] == (filled[1:].argmax() + 1 if filled[1:].any() else 0)


def test_a_sheet_thinner_than_a_voxel_keeps_its_volume():
    labels = np.zeros((24, 24, 8), dtype=np.uint8)
    labels[3:21, 3:21, 4] = 1
    share = np.where(labels > 0, 0.35, 0).astype(np.float32)
    net = part_nets(labels, share, np.array([float(share.sum())]))
    mesh = trimesh.Trimesh(net.points, net.faces[0], process=False)
    assert mesh.volume == pytest.approx(float(share.sum()), rel=1e-3)
    volume = LabelVolume(labels, share, ("sheet",), np.ones(1), np.zeros(1), (), (), (0, 0, 0), 24)
    assert thickness_voxels(volume)[0] == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("place", [29, pytest.param(0, marks=pytest.mark.slow)])
def test_registration_finds_a_known_pose(place):
    told = vote([survey(place)] * 3)
    assert (told.place, told.sure, told.size_order) == (place, True, (1, 2, 0))
    told = replace(told, mode="isotropic")
    volume = label_volume(body_volume(place), TABLE)
    found = register(filled_body(), volume_shares(volume), given(place).size_cm, told, SIDE)
    corners = np.stack(np.meshgrid(*([12, 52],) * 3), axis=-1).reshape(-1, 3)
    truth = affine_of(ORIENTATIONS[place])
    expected = 5 * (corners @ truth[:3, :3].T + truth[:3, 3]) @ UPRIGHT.T
    got = corners @ found.affine[:3, :3].T + found.affine[:3, 3]
    assert np.abs(got - expected).max() < 0.3 * 5 * UNIT
    assert found.six_side > 0.9
    assert found.flags == ()
    other = register(filled_body(), volume_shares(volume), np.array([5.0, 9.0, 4.0]), told, SIDE)
    assert other.flags == ("size_unlike_mesh",)


@pytest.mark.slow
def test_where_all_meshes_lie_alike_a_damaged_one_is_placed_as_the_others():
    place = 29
    told = vote([survey(place)] * 10)
    assert told.mode == "isotropic"
    assert told.scale == pytest.approx((1 / UNIT / SIDE,) * 3, rel=0.003)
    cut = body_volume(place).copy()
    cut[:, :, 50:] = 0  # of 12 to 52
    bodies = filled_body(), volume_shares(label_volume(cut, TABLE))
    truth = affine_of(ORIENTATIONS[place])
    errors = [
        np.abs(
            register(*bodies, given(place).size_cm, each, SIDE).affine[:3, :3] / 5
            - UPRIGHT @ truth[:3, :3]
        ).max()
        for each in (told, replace(told, scale=None, middle=None))
    ]
    assert errors[0] < 0.005 * UNIT < errors[1]


@pytest.mark.slow
def test_a_can_of_thin_sheet_is_placed_by_its_ends_and_not_on_what_is_in_it():
    told = Convention(
        "stretched", 0, (0, 1, 2), 1.0, 3, 3, sure=True, scale=(1.0,) * 3, middle=(0.5,) * 3
    )
    solid = np.ones((64,) * 3, dtype=np.float32)
    half_full = solid.copy()
    half_full[:, :, 52:63], half_full[:, :, 63] = 0.0, 0.1
    mesh = BoxShares(np.full(3, -1.0), np.ones(3), solid, solid)
    can, block = (
        BoxShares(np.zeros(3), np.full(3, 64.0), shares, shares) for shares in (half_full, solid)
    )
    size_cm = np.full(3, 10.0)
    placed = register(mesh, can, size_cm, told, 64)
    assert np.abs(placed.affine[:3, :3]).max(axis=0) == pytest.approx(10 / 64)
    assert placed.flags == ()
    elsewhere = register(mesh, block, size_cm, replace(told, scale=(1.3,) * 3), 64)
    assert elsewhere.flags == ("placed_alone",)


def test_meshes_that_wander_in_their_volumes_have_a_scale_in_common_but_no_middle():
    one = survey(29)
    away = [replace(one, box_middle=(0.45 + 0.02 * step, 0.5, 0.5)) for step in range(10)]
    told = vote(away)
    assert told.scale is not None
    assert told.middle is None


def test_a_mirrored_volume_gives_meshes_that_are_wound_outwards():
    place = next(k for k, way in enumerate(ORIENTATIONS) if way.mirrored)
    affine = np.eye(4)
    affine[:3, :3] = ORIENTATIONS[place].matrix
    for solid in part_solids(label_volume(body_volume(0), TABLE), affine).parts:
        assert solid is not None
        assert solid.volume > 0


def test_an_object_without_a_preferred_orientation_has_no_vote():
    one, half = (1.0, 1.0, 1.0), (0.5, 0.5, 0.5)
    flat = Survey("ball", [[0.9] * 48] * 2, one, one, one, one, half, ())
    told = vote([flat, flat, flat])
    assert (told.unambiguous, told.sure, told.margin) == (0, False, 0)
    assert vote([flat, survey(29), flat]).place == 29


def test_a_release_turned_by_another_angle_than_quarter_turns_is_refused():
    turned = body_mesh()
    turned.apply_transform(trimesh.transformations.rotation_matrix(np.radians(30), (1, 1, 1)))
    asked = survey_object(given(0, mesh=turned))
    with pytest.raises(DataError, match=r"quarter turns .* got 0\.[1-5].* turned by another"):
        vote([asked] * 5)


def test_a_convention_and_a_survey_survive_json():
    told = vote([survey(29)] * 2)
    assert Convention.from_json(told.to_json()) == told
    assert Survey.from_json(survey(29).to_json()) == survey(29)


def test_bodies_of_other_proportions_are_refused():
    long = trimesh.creation.box((2.0, 0.2, 0.2))
    told = replace(vote([survey(29)] * 3), mode="isotropic")
    with pytest.raises(DataError, match="boxes of mesh and volume must agree within 8%"):
        register(
            fill_mesh(long),
            volume_shares(label_volume(body_volume(0), TABLE)),
            np.ones(3),
            told,
            SIDE,
        )


def test_a_flat_body_whose_mesh_lacks_a_sliver_at_its_bottom_is_placed():
    told = replace(vote([survey(29)] * 3), mode="isotropic", scale=None)
    box = np.array([60, 20, 8])[list(ORIENTATIONS[29].axes)]
    first = (SIDE - box) // 2
    lac_per_cm = np.zeros((SIDE,) * 3, dtype=np.float32)
    lac_per_cm[tuple(slice(a, a + n) for a, n in zip(first, box, strict=True))] = TABLE["head"]
    open_below = trimesh.creation.box(np.array([60, 20, 6.2]) * UNIT)
    volume = volume_shares(label_volume(lac_per_cm, {"head": TABLE["head"]}))
    placed = register(fill_mesh(open_below), volume, np.ones(3), told, SIDE)
    assert placed.meta["iou"] > 0.7


def test_a_cavity_that_nothing_opens_is_not_seen_from_outside():
    body = np.zeros((12, 12, 12), dtype=np.float32)
    body[2:10, 2:10, 2:10] = 1
    hollow = body.copy()
    hollow[4:8, 4:8, 4:8] = 0
    assert six_side_agreement(body, hollow) == 1.0
    assert six_side_agreement(body, np.roll(body, 3, axis=0)) < 0.7


def test_scale_is_the_geometric_mean_of_the_sides():
    assert cm_per_unit(
        np.array([1.0, 1.0, 1.0]), np.array([1.0, 2.0, 4.0]), (2, 0, 1)
    ) == pytest.approx(2)


def test_the_outer_surface_holds_a_cavity_that_the_parts_do_not():
    labels = np.zeros((20, 20, 20), dtype=np.uint8)
    labels[4:16, 4:16, 4:16] = 1
    labels[7:13, 7:13, 7:13] = 0
    share, each = labels.astype(np.float32), (np.ones(1), np.zeros(1))
    volume = LabelVolume(labels, share, ("shell",), *each, (), (), (0, 0, 0), 20)
    solids = part_solids(volume, np.eye(4))
    (shell,) = solids.parts
    assert shell is not None
    assert shell.volume == pytest.approx(12**3 - 6**3, rel=1e-3)
    assert solids.outer.volume == pytest.approx(12**3, rel=1e-3)
