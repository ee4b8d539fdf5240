"""Shaded pictures: exact geometry, the optics of each surface, and what must not be told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from tests.baselines.painted import GREY, painted
from tests.phantoms import BAR, FILLED
from xden1k.errors import DataError
from xden1k.values.materials import load_materials
from xden1k.values.types import DensityObject
from xden_baselines.views.cameras import Camera, Rig
from xden_baselines.views.rendering import Rendered, render
from xden_baselines.views.shaded.body import Body
from xden_baselines.views.shaded.clear import light_from_clear
from xden_baselines.views.shaded.finishes import Finish, Look, draw_looks, finishes_of
from xden_baselines.views.shaded.opaque import light_from_opaque
from xden_baselines.views.shaded.reflection import refracted, unit
from xden_baselines.views.shaded.rendering import render_shaded
from xden_baselines.views.shaded.scene import Scene
from xden_baselines.views.shaded.studio import Studio
from xden_baselines.views.shaded.textures import TEXTURES, noise

RIG = Rig(elevations_deg=(30.0,), per_ring=1, size_px=40)
BLUE = (0.16, 0.40, 0.70)
BALL = trimesh.creation.icosphere(subdivisions=4, radius=1.0)
AIRY = Finish("airy", "even", 1.0, 0.0, 0.01, 0.01, 0.0, 0.0, 1.0, 1.0)
"""Clear, and refracting no more than air."""
MATT = Finish("matt", "even", 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0)
MIRROR = Finish("mirror", "even", 1.0, 1.0, 0.01, 0.01, 0.0, 0.0, 0.0, 0.0)
EVEN = Studio(panels=(), floor=(0.5,) * 3, wall=(0.5,) * 3, ceiling=(0.5,) * 3)


def look(finish: Finish, color: Sequence[float] = (1.0, 1.0, 1.0)) -> Look:
    return Look(finish, np.array(color), finish.roughness_low, np.zeros(3))


def made(obj: DensityObject, *materials: str) -> DensityObject:
    """Give parts, in their order, other materials, and leave all else."""
    pairs = zip(obj.parts, materials, strict=True)
    parts = tuple(replace(part, material=material) for part, material in pairs)
    return replace(obj, parts=parts)


def shaded(obj: DensityObject, studio: Studio | None = None) -> Rendered:
    meshes = [part.mesh for part in obj.parts]
    vertices = np.concatenate([np.asarray(mesh.vertices) for mesh in meshes])
    looks = draw_looks(obj.object_id, obj.parts)
    return render_shaded(meshes, looks, RIG.cameras(vertices), studio or Studio())


def towards_ball(count: int = 400) -> np.ndarray:
    """Rays from (0, -5, 0) that meet a ball of radius 1 off its rim."""
    rng = np.random.default_rng(1)
    aim = np.stack([rng.uniform(-0.6, 0.6, count), np.zeros(count), rng.uniform(-0.6, 0.6, count)])
    return unit(aim.T - [0.0, -5.0, 0.0])


def light_of_ball(finish_look: Look, studio: Studio) -> tuple[np.ndarray, np.ndarray]:
    """Rays to a ball, and the light they find."""
    scene, rays = Scene(Body([BALL]), [finish_look], studio), towards_ball()
    hit, hits = scene.body.cast(np.array([0.0, -5.0, 0.0]), rays)
    assert hit.all()
    light = light_from_clear if finish_look.clear else lambda *of: light_from_opaque(*of, 0)
    return rays, light(scene, hits)


def test_masks_distances_and_parts_are_those_of_the_flat_renderer_to_the_bit() -> None:
    obj = made(painted("bar-0001", BAR, {"plastic": GREY, "steel": GREY}), "pet", "steel")
    meshes = [part.mesh for part in obj.parts]
    cameras: tuple[Camera, ...] = RIG.cameras(np.concatenate([mesh.vertices for mesh in meshes]))
    flat, found = render(meshes, [GREY, GREY], cameras), shaded(obj)
    np.testing.assert_array_equal(found.pictures.masks, flat.pictures.masks)
    np.testing.assert_array_equal(found.pictures.distance_cm, flat.pictures.distance_cm)
    np.testing.assert_array_equal(found.parts, flat.parts)
    off = ~flat.pictures.masks
    np.testing.assert_array_equal(found.pictures.colors[off], flat.pictures.colors[off])


@pytest.mark.parametrize(
    ("color", "one", "other"),
    [
        (GREY, "steel", "aluminium"),
        (BLUE, "steel", "wood_beech"),
        (BLUE, "glass_soda_lime", "cast_iron"),
    ],
    ids=["alloys", "painted", "painted glass"],
)
def test_what_an_eye_cannot_tell_the_pictures_do_not_tell(
    color: tuple[float, float, float], one: str, other: str
) -> None:
    bar = painted("bar-0001", BAR, {"plastic": color, "steel": color})
    first = shaded(made(bar, one, one)).pictures.colors
    second = shaded(made(bar, other, other)).pictures.colors
    np.testing.assert_array_equal(first, second)
    assert np.ptp(first[first < 255]) > 20


def test_what_is_hidden_in_an_opaque_part_leaves_no_trace() -> None:
    paint = {"shell": BLUE, "core": GREY}
    whole = shaded(made(painted("filled-0001", FILLED, paint), "steel", "lead"))
    shell = shaded(made(painted("filled-0001", FILLED[:1], paint), "steel"))
    np.testing.assert_array_equal(whole.pictures.colors, shell.pictures.colors)


def test_a_mirror_shows_the_room_and_matt_stone_hardly() -> None:
    def change(finish: Finish) -> float:
        rooms = (Studio(), Studio(turn_rad=1.0))
        one, other = (light_of_ball(look(finish), room)[1] for room in rooms)
        return float(np.abs(one - other).mean() / one.mean())

    assert change(MIRROR) > 0.3
    assert change(MATT) < 0.7 * change(MIRROR)


def test_a_perfect_mirror_shows_the_room_in_the_mirrored_direction() -> None:
    rays, light = light_of_ball(look(MIRROR), Studio())
    _, hits = Body([BALL]).cast(np.array([0.0, -5.0, 0.0]), rays)
    exact = unit(hits.points_cm)
    np.testing.assert_allclose(hits.normals, exact, atol=0.01)
    away = rays - 2 * (rays * hits.normals).sum(axis=1, keepdims=True) * hits.normals
    room = Studio().radiance(away, np.full(len(away), 1e-4))
    np.testing.assert_allclose(np.median(light / room), 1, atol=0.01)


def test_in_an_even_room_a_white_ball_is_as_bright_as_the_room() -> None:
    _, light = light_of_ball(look(MATT), EVEN)
    np.testing.assert_allclose(light, 0.5, rtol=0.05)


def test_a_clear_ball_that_does_not_refract_cannot_be_seen() -> None:
    rays, light = light_of_ball(look(AIRY), Studio())
    room = Studio().radiance(rays, np.full(len(rays), 1e-4))
    np.testing.assert_allclose(light, room, rtol=1e-3)


def test_light_through_tinted_matter_fades_by_beers_law() -> None:
    color = np.array([0.5, 0.8, 0.9])
    rays, light = light_of_ball(look(AIRY, color), EVEN)
    nearest = np.linalg.norm(np.cross(rays, [0.0, -5.0, 0.0]), axis=1)
    chord_cm = 2 * np.sqrt(1 - nearest**2)
    np.testing.assert_allclose(light, 0.5 * color ** chord_cm[:, None], rtol=0.01)


def test_refraction_is_snells_law_and_reflectance_fresnels() -> None:
    angles = np.radians([0.0, 30.0, 60.0])
    rays = np.stack([np.sin(angles), np.zeros(3), -np.cos(angles)], axis=1)
    up = np.tile([0.0, 0.0, 1.0], (3, 1))
    bent, reflectance = refracted(rays, up, np.full(3, 1 / 1.5))
    np.testing.assert_allclose(bent[:, 0], np.sin(angles) / 1.5)
    assert reflectance[0] == pytest.approx(0.04)
    brewster = np.arctan(1.5)
    ray = np.array([[np.sin(brewster), 0.0, -np.cos(brewster)]])
    _, at_brewster = refracted(ray, up[:1], np.array([1 / 1.5]))
    assert at_brewster[0] == pytest.approx(np.cos(2 * brewster) ** 2 / 2)
    outward, total = refracted(rays, up, np.full(3, 1.5))
    assert total[2] == 1
    np.testing.assert_allclose(outward[2], [rays[2, 0], 0, -rays[2, 2]])


def test_blur_moves_light_of_the_room_and_makes_none() -> None:
    high = np.linspace(-1, 1, 61)[1:-1]
    around = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    level = np.sqrt(1 - high**2)[:, None]
    grid = np.stack(
        [level * np.cos(around), level * np.sin(around), np.tile(high[:, None], 90)], axis=-1
    ).reshape(-1, 3)
    means = [Studio().radiance(grid, np.full(len(grid), blur)).mean() for blur in (0.02, 0.2, 0.75)]
    np.testing.assert_allclose(means, means[0], rtol=0.12)


def test_edges_of_a_box_stay_sharp_and_a_ball_is_round() -> None:
    box = Body([trimesh.creation.box(extents=[2, 2, 2])])
    rays = towards_ball()
    _, hits = box.cast(np.array([0.0, -5.0, 0.0]), rays)
    np.testing.assert_allclose(hits.normals, hits.flat)


def test_every_material_has_a_look_and_every_look_its_texture() -> None:
    for name in load_materials():
        for finish in finishes_of(name):
            assert finish.texture in TEXTURES
            assert 0 <= finish.roughness_low <= finish.roughness_high <= 1
            assert (finish.refractive_index > 0) == (finish.tint_cm > 0)
            assert not (finish.refractive_index and finish.metalness)


def test_textures_stay_within_their_scale() -> None:
    rng = np.random.default_rng(0)
    places, normals = rng.uniform(0, 500, (4000, 3)), unit(rng.normal(size=(4000, 3)))
    assert noise(places).std() == pytest.approx(1, abs=0.05)
    for name, texture in TEXTURES.items():
        grain = texture(places, normals)
        assert np.abs(grain.tone).max() <= 2.2, name
        assert abs(grain.tone.mean()) < 0.35, name


def test_a_part_without_a_material_is_refused_by_name() -> None:
    bar = painted("bar-0001", BAR, {"plastic": GREY, "steel": GREY})
    with pytest.raises(DataError, match=r"bar-0001: the part steel has no material.*flat pictures"):
        shaded(made(bar, "pp", ""))
    with pytest.raises(DataError, match="no look is known of the material 'unobtainium'"):
        finishes_of("unobtainium")
