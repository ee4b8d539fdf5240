"""init and check: what a lab is given, and what it is told before anything is fitted."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner
from PIL import Image

from tests.builder.folders import contents
from tests.builder.poly_scenes import geometries
from xden1k.errors import DataError
from xden1k.rays import path_lengths
from xden1k.values.views import XRayView
from xden_builder.audit.air import corner_ratio
from xden_builder.capture import CaptureFolder, ScannerFile, ViewFile, read_scanner, write_scanner
from xden_builder.capture.parts import CapturePart
from xden_builder.cli import cli
from xden_builder.physics.source import Tube
from xden_builder.pipeline.check import run as check_run
from xden_builder.pipeline.check.object import Finding, ObjectCheck
from xden_builder.pipeline.check.outlines import (
    Lengths,
    Outline,
    air_level,
    contradictions,
    outline,
    shadow_lengths,
)
from xden_builder.pipeline.check.run import FolderCheck, check_folder
from xden_builder.pipeline.check.weight import weight_contradiction
from xden_builder.pipeline.remarks import calibration_remark, filtration_remark, is_calibrated
from xden_builder.reconstruct.plausible import SHADOW_DEPTH, check_exposure

SIZE = 64
VIEWS = geometries(SIZE)
LAC = np.array([1.5, 0.3])
HEADER = "object_id,category,mesh_units,mass_g"


def solid(size, at):
    return trimesh.creation.box(size, trimesh.transformations.translation_matrix(at))


def key(grow=1.0):
    """A wing of metal and a grip of plastic: other from each side, and turned over."""
    return {
        "grip": solid((3.0 * grow, 2.0, 2.0), (1.5, 0.5, 2.5)),
        "wing": solid((1.0, 4.0, 5.0 * grow), (0.5, 1.0, -1.0)),
    }


def write_object(
    root: Path, object_id: str, parts: dict[str, trimesh.Trimesh], views=VIEWS
) -> Path:
    folder = root / object_id
    (folder / "parts").mkdir(parents=True)
    for name, mesh in parts.items():
        mesh.export(folder / "parts" / f"{name}.ply")
    (folder / "parts.csv").write_text("name,material\ngrip,abs\nwing,aluminium\n")
    for name, geometry in views.items():
        lengths = path_lengths(list(parts.values()), range(len(parts)), geometry, 2)
        noise = np.random.default_rng(len(object_id)).normal(0, 1e-4, geometry.shape)
        image = lengths.image(np.resize(LAC, len(parts))) + noise
        np.save(folder / f"{name}.npy", image.astype(np.float32))
    return folder


@pytest.fixture
def captures(tmp_path: Path) -> Path:
    views = {
        name: ViewFile(f"{name}.npy", "transmission", geometry) for name, geometry in VIEWS.items()
    }
    write_scanner(ScannerFile(views, Tube(kv=100.0)), tmp_path / "scanner.toml")
    write_object(tmp_path, "key-1", key())
    write_object(tmp_path, "key-02", key(1.2))
    (tmp_path / "objects.csv").write_text(f"{HEADER}\nkey-1,key,,80\nkey-02,key,,\n")
    return tmp_path


def checked(captures: Path) -> FolderCheck:
    return check_folder(captures, workers=1)


def told(captures: Path) -> list[tuple[str, str, str]]:
    return [
        (each.object_id, finding.kind, finding.message)
        for each in checked(captures).objects
        for finding in each.findings
    ]


def test_sound_captures_are_clean_and_left_as_they_are(captures: Path) -> None:
    before = contents(captures)
    assert told(captures) == []
    assert contents(captures) == before


def test_what_is_wrong_with_all_alike_is_told_once(captures: Path) -> None:
    for name in ("key-1", "key-02"):
        np.save(captures / name / "pa.npy", np.ones((10, 10), dtype=np.float32))
    ((finding, object_ids),) = checked(captures).by_finding.items()
    assert sorted(object_ids) == ["key-02", "key-1"]
    assert f"{captures / object_ids[0] / 'pa.npy'}: expected" in finding.message


def test_figures_in_which_an_id_occurs_are_told_apart() -> None:
    said = [("1", "expected 100, got 11"), ("2", "expected 200, got 22"), ("3", "3/pa.png: dark")]
    said += [("4", "4/pa.png: dark")]
    objects = tuple(ObjectCheck(name, (Finding("refused", words),)) for name, words in said)
    found = {each.message: names for each, names in FolderCheck(objects).by_finding.items()}
    assert found == {
        "expected 100, got 11": ("1",),
        "expected 200, got 22": ("2",),
        "3/pa.png: dark": ("3", "4"),
    }


def test_a_sheet_that_stands_edge_on_between_two_rows_of_pixels_is_not_accused(
    captures: Path,
) -> None:
    sheets = {"grip": solid((3, 2, 0.1), (1.5, 0.5, 0)), "wing": solid((1, 4, 0.1), (-0.5, 1, 0))}
    write_object(captures, "sheet", sheets)
    (captures / "objects.csv").write_text(f"{HEADER}\nsheet,key,,\n")
    assert told(captures) == []


def test_a_pin_in_the_midst_of_dead_pixels_is_refused_no_more_than_by_a_rebuild(
    tmp_path: Path,
) -> None:
    """Its pixels are seen, most of the large pixels it is drawn in are not."""
    fine = geometries(512)
    views = {
        name: ViewFile(f"{name}.npy", "transmission", geometry) for name, geometry in fine.items()
    }
    write_scanner(ScannerFile(views, Tube(kv=100.0)), tmp_path / "scanner.toml")
    pin = {
        "grip": solid((0.03, 0.03, 3.0), (0.0, 0.0, 2.0)),
        "wing": solid((0.03, 0.03, 3), (0, 0, -2)),
    }
    folder = write_object(tmp_path, "pin", pin, fine)
    (tmp_path / "objects.csv").write_text(f"{HEADER}\npin,key,,\n")
    for name, geometry in fine.items():
        dead = np.full(geometry.shape, 255, dtype=np.uint8)
        dead.flat[path_lengths(list(pin.values()), range(2), geometry, 3).pixels] = 0
        Image.fromarray(dead).save(folder / f"ignore_{name}.png")
    assert [each for each in told(tmp_path) if each[1] == "refused"] == []


def test_a_share_of_dead_pixels_that_is_refused_is_not_told_as_the_limit() -> None:
    geometry = VIEWS["pa"]
    lengths = path_lengths([solid((3, 3, 3), (0, 0, 0))], [0], geometry)
    few = len(lengths.pixels) // 2
    for dead, refused in ((few, False), (few + 1, True)):
        valid = np.ones(geometry.shape, dtype=np.bool_)
        valid.flat[lengths.pixels[:dead]] = False
        view = XRayView("pa", np.ones(geometry.shape, dtype=np.float32), valid, geometry)
        with (
            pytest.raises(DataError, match=r"view pa: 50\.[1-9]% of") if refused else nullcontext()
        ):
            check_exposure([(view, lengths)])


def exchange(folder: Path) -> None:
    pa, lat = (folder / f"{name}.npy" for name in VIEWS)
    one, other = pa.read_bytes(), lat.read_bytes()
    pa.write_bytes(other)
    lat.write_bytes(one)


def mirror(folder: Path) -> None:
    np.save(folder / "pa.npy", np.load(folder / "pa.npy")[:, ::-1])


def turn_over(folder: Path) -> None:
    np.save(folder / "pa.npy", np.load(folder / "pa.npy")[::-1, ::-1])


def take_another(folder: Path) -> None:
    (folder / "lat.npy").write_bytes((folder.parent / "key-02" / "lat.npy").read_bytes())


def hand_over_twice(folder: Path) -> None:
    """One picture as both views, each before a flat of its own."""
    scanner = read_scanner(folder.parent / "scanner.toml")
    counts = {"quantity": "counts", "polarity": "linear", "dark": 0.0}
    views = {
        name: replace(view, image="both.npy" if name == "pa" else "again.npy", flat=flat, **counts)
        for (name, view), flat in zip(scanner.views.items(), (1000.0, 1001.0), strict=True)
    }
    write_scanner(replace(scanner, views=views), folder / "scanner.toml")
    picture = 1000 * np.load(folder / "pa.npy")
    np.save(folder / "both.npy", picture)
    np.save(folder / "again.npy", picture)


def annotate_twice(folder: Path) -> None:
    trimesh.load(folder / "parts" / "grip.ply").export(folder / "parts" / "handle.ply")


def misspell(folder: Path) -> None:
    (folder / "parts.csv").write_text("name,material\ngrip,abs\nwing,aluminum_alloy\n")


def told_of_objects(row: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        (folder.parent / "objects.csv").write_text(f"{HEADER}\n{row}\nkey-02,key,,\n")

    return change


def lose_a_mesh(folder: Path) -> None:
    (folder / "parts" / "wing.ply").unlink()
    (folder / "parts.csv").unlink()


def put_behind_the_source(folder: Path) -> None:
    solid((1, 1, 1), (0, -400, 0)).export(folder / "parts" / "grip.ply")


def damage_the_ct(folder: Path) -> None:
    (folder / "ct.npz").write_text("zz")


def lose_a_picture_and_misspell(folder: Path) -> None:
    misspell(folder)
    (folder / "pa.npy").unlink()


@pytest.mark.parametrize(
    ("spoil", "kind", "message"),
    [
        (exchange, "contradicts", "the pictures of pa and lat seem exchanged"),
        (mirror, "contradicts", "the picture of pa seems mirrored left to right"),
        (take_another, "contradicts", "the picture of lat is that of lat of key-02 too"),
        (hand_over_twice, "contradicts", "the picture of lat is that of pa of key-1 too"),
        (annotate_twice, "refused", "parts grip and handle are the same mesh in the same place"),
        (misspell, "refused", "unknown material 'aluminum_alloy'.*near: aluminum"),
        (told_of_objects("key-1,key,mm,"), "refused", r"1/10 of|10 times the"),
        (told_of_objects("key-1,key,,375"), "contradicts", "mass_g is 375 g, but .* weigh again"),
        (told_of_objects("key-1,key,,136"), "contradicts", "mass_g is 136 g, but .* weigh again"),
        (turn_over, "contradicts", "the picture of pa seems turned upside down: "),
        (lose_a_mesh, "contradicts", r"% of the shadow in \w+ lies beside the parts"),
        (put_behind_the_source, "refused", "part grip reaches behind the source"),
        (lose_a_picture_and_misspell, "refused", r"pa\.npy: no such image"),
        (lose_a_picture_and_misspell, "refused", "unknown material"),
        (damage_the_ct, "contradicts", r"ct\.npz: not an npz archive \(`xden-build audit` reads"),
    ],
)
def test_what_is_wrong_is_told_of_that_object(
    captures: Path, spoil: Callable[[Path], None], kind: str, message: str
) -> None:
    spoil(captures / "key-1")
    found = [each for each in told(captures) if each[0] == "key-1"]
    assert any(each[1] == kind and re.search(message, each[2]) for each in found), found
    assert all("\n" not in each[2] for each in found)


def seen(name: str, drawn: np.ndarray, shadow: np.ndarray) -> Outline:
    return Outline(name, drawn, shadow, drawn)


def flag() -> np.ndarray:
    """A pole with a flag at its top: other in each of the four ways to turn it over."""
    mask = np.zeros((24, 24), dtype=np.bool_)
    mask[2:22, 8:10] = mask[2:10, 8:18] = True
    return mask


def test_a_picture_upside_down_is_not_called_exchanged_where_both_views_look_alike() -> None:
    other = np.roll(flag(), 1, axis=1)
    pa, lat = seen("pa", flag(), flag()[::-1, ::-1]), seen("lat", other, other)
    (said,) = contradictions(pa, lat)
    assert said.startswith("the picture of pa seems turned upside down: ")


def test_two_pictures_exchanged_are_not_called_turned_over_where_both_views_look_alike() -> None:
    other = np.roll(flag()[:, ::-1], 2, axis=1)
    (said,) = contradictions(seen("pa", flag(), other), seen("lat", other, flag()))
    assert said.startswith("the pictures of pa and lat seem exchanged: ")


@pytest.mark.parametrize("row", [10, 11, 13])
def test_a_thin_thing_that_lies_a_little_off_is_not_called_mirrored(row: int) -> None:
    line, there = np.zeros((2, 24, 24), dtype=np.bool_)
    line[11, 4:18] = there[row, 4:18] = True
    near = replace(seen("pa", line, there), near=np.ones_like(line))
    assert [*contradictions(near, seen("lat", flag(), flag()))] == []


@pytest.mark.parametrize(
    ("turned", "words"),
    [
        (np.rot90(flag(), -1), "turned by a quarter clockwise: "),
        (np.rot90(flag()), "turned by a quarter counter-clockwise: "),
        (flag().T, "of exchanged rows and columns: "),
        (flag()[::-1, ::-1].T, "of exchanged rows and columns, upside down: "),
    ],
)
def test_a_picture_turned_by_a_quarter_is_told(turned: np.ndarray, words: str) -> None:
    (said,) = contradictions(seen("pa", flag(), turned), seen("lat", flag(), flag()))
    assert said.startswith(f"the picture of pa seems {words}")


def test_a_picture_of_another_shape_is_not_turned_by_a_quarter() -> None:
    wide = np.concatenate([flag(), np.zeros_like(flag())], axis=1)
    assert [*contradictions(seen("pa", wide, wide), seen("lat", wide, wide))] == []


def test_a_thin_end_that_casts_no_shadow_hardly_makes_a_shadow_shorter() -> None:
    drawn, shadow = np.zeros((2, 40, 40), dtype=np.bool_)
    drawn[14:26, 14:26] = shadow[14:26, 14:26] = True
    drawn[5:14, 20] = True  # an antenna: the outline's longest side is 1.75 times as long
    lengths = shadow_lengths(seen("pa", drawn, shadow))
    assert lengths is not None
    assert lengths.ratio == pytest.approx(0.91, abs=0.02)
    assert shadow_lengths(seen("pa", drawn, drawn)) == Lengths(1.0, 1.0)
    cut = shadow.copy()
    cut[14:26, 26:] = True  # goes on beyond the border
    assert shadow_lengths(seen("pa", drawn, cut)) is None


def test_rows_that_are_wider_apart_than_was_told_are_seen_beside_columns_alone() -> None:
    drawn, shadow = np.zeros((2, 60, 60), dtype=np.bool_)
    drawn[10:40, 10:40] = shadow[10:37, 10:40] = True
    lengths = shadow_lengths(seen("pa", drawn, shadow))
    assert lengths is not None
    assert lengths.aspect == pytest.approx(0.9, abs=0.01)
    narrow = np.zeros_like(drawn)
    narrow[10:40, 30:33] = True
    lengths = shadow_lengths(seen("pa", narrow, narrow))
    assert lengths == Lengths(1.0, None)


@pytest.mark.parametrize(
    ("depth", "tells"),
    [(0.16, (False, False)), (0.25, (True, False)), (0.4, (True, True))],
)
def test_the_rim_of_a_faint_round_body_does_not_make_it_shorter_or_of_another_form(
    depth: float, tells: tuple[bool, bool]
) -> None:
    """A cylinder that stands upright: its sides are fainter than its ends."""
    drawn = np.zeros((100, 100), dtype=np.bool_)
    drawn[20:80, 30:70] = True
    across = (np.arange(100) - 49.5) / 20
    profile = np.sqrt(np.clip(1 - across**2, 0, 1))
    image = np.where(drawn, 1 - depth * profile, 1.0)
    shadow = image < 1 - SHADOW_DEPTH
    view = replace(seen("pa", drawn, shadow), depth=1 - float(np.median(image[shadow])))
    lengths = shadow_lengths(view)
    assert (lengths is not None, lengths is not None and lengths.aspect is not None) == tells
    if lengths is not None:
        assert lengths.ratio == pytest.approx(1, abs=0.02)
    if lengths is not None and lengths.aspect is not None:
        assert lengths.aspect == pytest.approx(1, abs=0.02)


def test_objects_that_were_turned_by_hand_tell_no_pitch(captures: Path) -> None:
    assert {view for view, _ in checked(captures).objects[0].lengths} == {"pa", "lat"}
    scanner = captures / "scanner.toml"
    text = scanner.read_text().replace("[views.lat]", "[views.lat]\nturned = true")
    scanner.write_text(text)
    assert {view for view, _ in checked(captures).objects[0].lengths} == {"pa"}


def test_a_pitch_or_a_source_that_is_wrong_for_the_whole_folder_is_told_of_its_view(
    captures: Path,
) -> None:
    names = [f"key-{number}" for number in range(5)]
    for number, name in enumerate(names):
        shutil.rmtree(captures / name, ignore_errors=True)
        write_object(captures, name, key(1.0 + 0.05 * number))
    rows = "".join(f"{name},key,,\n" for name in names)
    (captures / "objects.csv").write_text(f"{HEADER}\n{rows}")
    assert checked(captures).remarks == ()
    told_views = {
        name: ViewFile(f"{name}.npy", "transmission", geometry) for name, geometry in VIEWS.items()
    }
    finer = replace(
        VIEWS["lat"],
        pixel00_cm=VIEWS["lat"].pixel00_cm * [1.0, 0.87, 0.87],
        column_step_cm=0.87 * VIEWS["lat"].column_step_cm,
        row_step_cm=0.87 * VIEWS["lat"].row_step_cm,
    )
    told_views["lat"] = replace(told_views["lat"], geometry=finer)
    write_scanner(ScannerFile(told_views, Tube(kv=100.0)), captures / "scanner.toml")
    report = checked(captures)
    (said,) = report.remarks
    assert re.match(r"shadows in lat are 0\.8\d times as long as the meshes are there", said), said
    assert not report.clean
    assert report.to_dict()["remarks"] == (said,)
    result = CliRunner().invoke(cli, ["check", str(captures), "--workers", "1"])
    assert result.exit_code == 1
    assert f"contradicts: {captures}: shadows in lat are" in result.stdout


def test_a_pitch_that_is_wrong_in_rows_alone_is_told() -> None:
    report = FolderCheck(
        tuple(
            ObjectCheck(f"key-{number}", (), (), (("pa", Lengths(1.02, 1.05 + 0.002 * number)),))
            for number in range(6)
        )
    )
    (said,) = report.remarks
    assert said.startswith("shadows in pa are 1.055 times as tall for their width as the meshes")
    assert "row_step_cm" in said


def seen_alike(name: str, **told: float | None) -> Outline:
    """A view whose shadow lies where the parts are drawn."""
    mask = np.zeros((20, 20), dtype=np.bool_)
    mask[5:15, 5:12] = True
    return replace(seen(name, mask, mask), **told)


@pytest.mark.parametrize(
    ("level", "words"),
    [
        (0.25, ["air in pa has a transmission of 0.25, expected 0.8 to 1.25: the picture was"]),
        (0.004, ["air in pa has a transmission of 0.004, expected 0.8 to 1.25: the picture was"]),
        (0.7999, ["air in pa has a transmission of 0.7999, expected 0.8 to 1.25: the picture was"]),
        (1.2404, []),
        (1.2501, ["air in pa has a transmission of 1.3, expected 0.8 to 1.25: the picture was"]),
        (1.4, ["air in pa has a transmission of 1.4, expected 0.8 to 1.25: the picture was"]),
        (1.03, []),
        (None, []),
    ],
)
def test_another_exposure_than_that_of_the_flat_is_told_before_all_that_comes_of_it(
    level: float | None, words: list[str]
) -> None:
    found = [*contradictions(seen_alike("pa", brightest=level), seen_alike("lat"))]
    assert [said[: len(start)] for said, start in zip(found, words, strict=True)] == words


@pytest.mark.parametrize(("rim", "brightest"), [(0.3, 1.0), (0.01, 1.0), (1.0, 1.0), (1.4, 1.4)])
def test_a_holder_around_the_picture_is_not_taken_for_another_exposure(
    rim: float, brightest: float
) -> None:
    """Borders tell what air is like where they are lit, else what is brightest within."""
    image = np.full(VIEWS["pa"].shape, rim, dtype=np.float32)
    image[6:-6, 6:-6] = 1.0
    view = XRayView("pa", image, np.ones(image.shape, dtype=np.bool_), VIEWS["pa"])
    found, _ = outline(view, None, list(key().values()))
    assert found.brightest == pytest.approx(brightest)


@pytest.mark.parametrize(
    ("depth", "words"), [(0.02, []), (0.0, ["view pa shows no shadow at all"])]
)
def test_a_block_of_foam_is_not_called_air(depth: float, words: list[str]) -> None:
    noise = np.random.default_rng(1).normal(0, 0.005, VIEWS["pa"].shape)
    there = path_lengths(list(key().values()), range(len(key())), VIEWS["pa"], 1).image(
        np.full(len(key()), 1.0), 1.0
    )
    image = (1 + noise - depth * (there < 1)).astype(np.float32)
    view = XRayView("pa", image, np.ones(image.shape, dtype=np.bool_), VIEWS["pa"])
    pa, _ = outline(view, None, list(key().values()))
    found = list(contradictions(pa, replace(pa, name="lat")))
    assert [said[: len(start)] for said, start in zip(found, words, strict=True)] == words


@pytest.mark.parametrize(
    "there",
    [
        (slice(-12, None), slice(48, 80)),
        (slice(-12, None), slice(None)),
        (slice(None, 12), slice(None, 12)),
        (slice(None), slice(None, 40)),
    ],
)
def test_what_stands_at_a_border_is_no_open_field_that_falls_off(
    there: tuple[slice, slice],
) -> None:
    image = np.ones((128, 128), dtype=np.float32)
    image[there] = 0.93
    nothing = np.zeros(image.shape, dtype=np.bool_)
    assert corner_ratio(image, nothing, ~nothing) == 1
    assert corner_ratio(2 - image, nothing, ~nothing) == 1


def test_air_that_is_masked_says_nothing_of_the_airs_level() -> None:
    image = np.full((10, 10), 0.93, dtype=np.float32)
    image[4:] = 1.0  # of what is not known
    other = np.zeros(image.shape, dtype=np.bool_)
    other[4:], other[:2, :2] = True, True
    assert air_level(image, other) == pytest.approx(0.93)
    valid = np.ones(VIEWS["pa"].shape, dtype=np.bool_)
    valid[:, : int(0.3 * valid.shape[1])] = valid[:, int(0.7 * valid.shape[1]) :] = False
    view = XRayView("pa", np.where(valid, np.float32(0.93), np.nan), valid, VIEWS["pa"])
    _, level = outline(view, None, list(key().values()))
    assert level == pytest.approx(0.93)


def test_what_goes_wrong_with_one_object_ends_no_check_of_the_others(
    captures: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = check_run.check_object

    def failing(folder: CaptureFolder, object_id: str) -> object:
        if object_id == "key-1":
            raise ValueError("odd")
        return usual(folder, object_id)

    monkeypatch.setattr(check_run, "check_object", failing)
    found = {each.object_id: each.findings for each in checked(captures).objects}
    assert "odd" in found["key-1"][0].message
    assert not found["key-02"]


@pytest.mark.parametrize(
    ("filtration", "words"),
    [
        ("{ Al = 2.5 }", "told as 25 mm Al, which lets 15.3% of 60 keV through"),
        ("{ Cu = 0.1 }", "told as 1 mm Cu, which lets 24.0%"),
        ("{ Al = 0.25, Cu = 0.03 }", ""),
        ("{ Al = -2500 }", ""),
        ("{ Al = nan }", ""),
        ("{ Sn = 0.06 }\n[calibration]\nkv = 100.0", ""),
        ("{ Sn = 0.06 }\n[calibration]\ndate = 2026-01-01", "told as 0.6 mm Sn, which lets"),
        ("{ Unobtainium = 2.5 }", ""),
        ("2.5", ""),
    ],
)
def test_filters_told_in_another_unit_are_asked_about(
    tmp_path: Path, filtration: str, words: str
) -> None:
    (tmp_path / "scanner.toml").write_text(f"[tube]\nkv = 100.0\nfiltration = {filtration}\n")
    said = filtration_remark(tmp_path)
    assert (words in said) if words else said == ""


@pytest.mark.parametrize(
    ("calibration", "words"),
    [
        ("", "the scanner was not calibrated: tube and geometry are as told"),
        ("[calibration]\ndate = 2026-01-01\n", "the tube was not calibrated, by wedges"),
        ("[calibration]\nkv = 100.0\n", ""),
        ('[calibration]\nkv = 100.0\nfound = { transmission_sd = { "10 mm Fe" = 0.015 } }', ""),
        (
            '[calibration]\nkv = 100.0\nfound = { transmission_sd = { "10 mm Fe" = 1.028 } }',
            "light through 10 mm Fe is known to 102.8%, expected 10% or better",
        ),
    ],
)
def test_a_calibration_that_measured_no_spectrum_does_not_hide_a_filter_nobody_told(
    tmp_path: Path, calibration: str, words: str
) -> None:
    """Of balls alone, or of so few steps that next to nothing is known of the tube."""
    (tmp_path / "scanner.toml").write_text(f"[tube]\nkv = 100.0\n{calibration}")
    assert is_calibrated(tmp_path) == (words == "")
    said = calibration_remark(tmp_path)
    assert (words in said) if words else said == ""


def test_a_calibration_that_is_no_table_is_none(tmp_path: Path) -> None:
    tube = "[tube]\nkv = 100.0\nfiltration = { Al = 2.5 }\n"
    (tmp_path / "scanner.toml").write_text(f"calibration = 1\n{tube}")
    assert "told as 25 mm Al" in filtration_remark(tmp_path)
    assert "was not calibrated" in calibration_remark(tmp_path)


def test_balls_before_a_beam_of_one_energy_leave_nothing_to_be_told(tmp_path: Path) -> None:
    tube = "[tube]\nenergy_kev = 60.0\n[calibration]\ndate = 2026-01-01\n"
    (tmp_path / "scanner.toml").write_text(tube)
    assert calibration_remark(tmp_path) == ""


def test_heavy_filters_of_an_industrial_tube_are_not_asked_about(tmp_path: Path) -> None:
    (tmp_path / "scanner.toml").write_text("[tube]\nkv = 225.0\nfiltration = { Cu = 0.15 }\n")
    assert filtration_remark(tmp_path) == ""


def test_every_way_that_explains_a_picture_is_told_where_the_object_is_symmetric() -> None:
    arrow = flag() | flag()[:, ::-1]
    (said,) = contradictions(seen("pa", arrow, arrow[::-1]), seen("lat", flag(), flag()))
    assert said.startswith("the picture of pa seems mirrored top to bottom or turned upside down: ")


def test_air_that_is_brighter_at_one_border_tells_of_the_open_field_and_of_nothing_else() -> None:
    sound = seen("pa", flag(), flag())
    spoilt = replace(seen("lat", flag(), ~flag()), air={"top": 0.7, "bottom": 1.4, "left": 1.0})
    (said,) = contradictions(sound, spoilt)
    assert said.startswith("air in lat has a transmission of 0.70 at its top and of 1.40 at its bo")
    assert "turned over or mirrored" in said
    even = replace(sound, air={"top": 1.02, "bottom": 0.98, "left": 0.7})
    assert [*contradictions(even, sound)] == []


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        (0.96, ["air in pa is 4.0% darker in the corners than"]),
        (0.71, ["air in pa is 29.0% darker in the corners than"]),
        (0.99, []),
        (0.3, []),
        (None, []),
    ],
)
def test_air_that_is_darker_in_the_corners_tells_of_no_open_field(
    corners: float | None, words: list[str]
) -> None:
    found = [*contradictions(seen_alike("pa", corners=corners), seen_alike("lat"))]
    assert [said[: len(start)] for said, start in zip(found, words, strict=True)] == words


@pytest.mark.parametrize(
    ("reached", "ratio"), [((slice(0, 0), slice(0, 0)), 0.95), ((0, 64), 0.95), ((0, 0), None)]
)
def test_corners_are_compared_with_borders_that_no_part_reaches(
    reached: tuple[Any, Any], ratio: float | None
) -> None:
    away = np.square(np.linspace(-1, 1, 128))
    image = (1 - 0.06 * (away[:, None] + away)).astype(np.float32)
    drawn = np.zeros(image.shape, dtype=np.bool_)
    drawn[reached] = True
    found = corner_ratio(image, drawn, ~drawn)
    assert found == (ratio if ratio is None else pytest.approx(ratio, abs=0.01))


def test_a_collimator_is_not_called_a_flat_that_is_turned_over_and_hides_nothing() -> None:
    dark = {"left": 0.0, "right": 0.0, "top": 1.0}
    lat = replace(seen("lat", flag(), flag()[::-1, ::-1]), air=dark)
    collimated, turned = contradictions(seen("pa", flag(), flag()), lat)
    assert collimated == (
        "no light comes through at the left and right of lat: if a collimator or a holder is in "
        "the picture, mark it in ignore_lat.png"
    )
    assert turned.startswith("the picture of lat seems turned upside down: ")


def test_a_mass_is_impossible_only_beyond_half_and_one_and_a_half_of_what_labels_allow() -> None:
    part = CapturePart("block", trimesh.creation.box(), "aluminium")  # 2.64 to 2.77 g/cm³
    for mass_g in (1.4, 2.7, 4.1):
        assert weight_contradiction(mass_g, [part], [1.0]) is None
    for mass_g in (1.3, 4.2):
        said = weight_contradiction(mass_g, [part], [1.0])
        assert said is not None
        assert "allow 1.32 to 4.15 g" in said
    unknown = CapturePart("block", part.mesh)
    assert weight_contradiction(19.3, [unknown], [1.0]) is None


def test_the_command_tells_all_and_exits_with_1(captures: Path) -> None:
    clean = CliRunner().invoke(cli, ["check", str(captures), "--workers", "1"])
    assert "scanner.toml: the scanner was not calibrated" in clean.stderr
    assert (clean.exit_code, clean.stdout.split(": ", 1)[1]) == (
        0,
        "2 objects, 2 sound, 0 refused, 0 contradicting themselves\n",
    )
    misspell(captures / "key-1")
    exchange(captures / "key-02")
    result = CliRunner().invoke(cli, ["check", str(captures), "--workers", "1"])
    assert result.exit_code == 1
    assert [line.split(": ")[:2] for line in result.stdout.splitlines()[:2]] == [
        ["contradicts", "key-02"],
        ["refused", "key-1"],
    ]
    assert "2 objects, 0 sound, 1 refused, 1 contradicting" in result.stdout
    as_json = CliRunner().invoke(cli, ["check", str(captures), "--workers", "1", "--json"])
    report = json.loads(as_json.stdout)
    assert (report["clean"], report["refused"], report["contradicting"]) == (False, 1, 1)


def test_a_folder_that_is_none_is_one_line(tmp_path: Path) -> None:
    result = CliRunner().invoke(cli, ["check", str(tmp_path)])
    assert result.exit_code == 1
    assert result.output == f"Error: {tmp_path / 'objects.csv'}: no such file\n"


# init


def test_init_writes_files_that_are_read_but_whose_object_is_refused(tmp_path: Path) -> None:
    result = CliRunner().invoke(cli, ["init", str(tmp_path / "new")])
    assert result.exit_code == 0
    assert sorted(contents(tmp_path / "new")) == [
        "example-0001/parts.csv",
        "objects.csv",
        "scanner.toml",
    ]
    folder = CaptureFolder(tmp_path / "new")
    with pytest.raises(DataError, match=r"example-0001/pa\.tif: no such image"):
        folder.read("example-0001")
    assert {kind for _, kind, _ in told(tmp_path / "new")} == {"refused"}


@pytest.mark.parametrize("name", ["scanner.toml", "objects.csv", "example-0001/parts.csv"])
def test_init_overwrites_nothing_and_then_writes_nothing(tmp_path: Path, name: str) -> None:
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("mine")
    result = CliRunner().invoke(cli, ["init", str(tmp_path)])
    assert result.exit_code == 1
    assert result.output == f"Error: {tmp_path / name}: is there already; nothing is written\n"
    assert contents(tmp_path) == {name: b"mine"}


def test_init_writes_nothing_where_a_file_stands_in_place_of_a_folder(tmp_path: Path) -> None:
    (tmp_path / "example-0001").touch()
    result = CliRunner().invoke(cli, ["init", str(tmp_path)])
    assert result.exit_code == 1
    said = f"{tmp_path / 'example-0001'}: expected a folder, got a file; nothing is written\n"
    assert result.output == f"Error: {said}"
    assert [path.name for path in tmp_path.iterdir()] == ["example-0001"]
