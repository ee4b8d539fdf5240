"""Pictures of objects."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests import phantoms
from xden1k.errors import DataError
from xden1k.pictures import figures, page
from xden1k.pictures.figures import contact_sheet, object_sheet
from xden1k.rays.reprojection import reprojected
from xden1k.values.types import DensityObject


@pytest.fixture(scope="module")
def bar() -> DensityObject:
    return phantoms.box_object("bar", phantoms.BAR, shape=(60, 50))


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw with few dots: what is on a page does not depend on them."""
    monkeypatch.setattr(page, "DPI", 40)


def test_reprojection_of_an_exact_object_is_its_radiograph(bar: DensityObject) -> None:
    for view in bar.views:
        model = reprojected(bar, view).transmission
        # the radiograph has one ray a pixel, the model nine: they differ at edges
        difference = np.abs(model - view.transmission)[view.valid]
        assert np.median(difference) < 1e-6
        assert np.quantile(difference, 0.8) < 1e-3


def test_reprojection_takes_the_gain_of_the_fit(bar: DensityObject) -> None:
    brighter = replace(bar, meta={"fit": {"gain": {"pa": 1.5, "lat": 0.5}}})
    for view, gain in zip(bar.views, (1.5, 0.5), strict=True):
        model = reprojected(brighter, view).transmission
        np.testing.assert_allclose(model, gain * reprojected(bar, view).transmission, rtol=1e-6)


def test_reprojection_through_unknown_attenuation_is_not_a_number(bar: DensityObject) -> None:
    steel = replace(bar.parts[1], lac_per_cm=phantoms.NAN, apparent_density_g_cm3=phantoms.NAN)
    part_known = replace(bar, parts=(bar.parts[0], steel))
    model = reprojected(part_known, "pa").transmission
    assert 0.01 < np.isnan(model).mean() < 0.5
    assert np.nanmin(model) > 0.5


def test_a_reprojection_is_a_view_of_the_same_geometry(bar: DensityObject) -> None:
    view = bar.views[1]
    model = reprojected(bar, "lat", subrays=1)
    assert (model.name, model.geometry) == ("lat", view.geometry)
    assert model.valid.all()
    np.testing.assert_allclose(model.transmission[view.valid], view.transmission[view.valid], 1e-6)
    with pytest.raises(DataError, match=r"bar: no view 'ap'; there are \['pa', 'lat'\]"):
        reprojected(bar, "ap")


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize(
    "change",
    [
        pytest.param(
            {"density": None, "category": "a_category_with_a_very_long_name " * 4},
            marks=pytest.mark.slow,
        ),
        {"flags": ("a remark",), "weighed_mass_g": 70.0, "source": "scan"},
    ],
)
def test_any_object_can_be_drawn(bar: DensityObject, tmp_path: Path, change: dict) -> None:
    object_sheet(replace(bar, **change), tmp_path / "bar.png")
    with Image.open(tmp_path / "bar.png") as image:
        picture = np.asarray(image.convert("RGB"))
    assert picture.shape[1] > 10 * page.DPI
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 100


@pytest.mark.usefixtures("coarse")
def test_an_object_of_many_parts_can_be_drawn(tmp_path: Path) -> None:
    boxes = [phantoms.Box(f"part {i}", (i, 0, 0), (i + 1, 1, 1), 1.0 + i) for i in range(20)]
    object_sheet(phantoms.box_object("many", boxes), tmp_path / "many.png")
    assert (tmp_path / "many.png").is_file()


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
def test_drawing_twice_gives_the_same_bytes_and_leaves_pyplot_alone(
    bar: DensityObject, tmp_path: Path
) -> None:
    import sys

    before = "matplotlib.pyplot" in sys.modules
    for name in ("one.png", "two.png"):
        object_sheet(bar, tmp_path / name)
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
    assert ("matplotlib.pyplot" in sys.modules) == before


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
def test_a_contact_sheet_grows_with_its_objects(tmp_path: Path) -> None:
    objects = phantoms.objects()
    sizes = []
    for count in (1, 4, 6):
        contact_sheet(iter(objects[:count]), tmp_path / "sheet.png")
        with Image.open(tmp_path / "sheet.png") as picture:
            sizes.append(picture.size)
    assert sizes[0][0] < sizes[1][0] == sizes[2][0]
    assert sizes[0][1] == sizes[1][1] < sizes[2][1]


@pytest.fixture
def texts(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What is written on a page."""
    written: list[str] = []

    def note(page: object, left: float, top: float, text: str, **style: object) -> None:
        written.append(text)

    monkeypatch.setattr(page.Page, "text", note)
    monkeypatch.setattr(page.Page, "save", lambda page, path: None)
    return written


@pytest.mark.parametrize(
    ("source", "made"),
    [
        ("scan", "measured"),
        ("phantom", "simulated"),
        pytest.param("ct", "computed", marks=pytest.mark.slow),
    ],
)
def test_nothing_is_called_measured_but_a_scan(
    tmp_path: Path, texts: list[str], source: str, made: str
) -> None:
    obj = phantoms.box_object("bar-0001", phantoms.BAR, source=source)
    object_sheet(obj, tmp_path / "bar.png")
    assert {f"PA {made}", f"LAT {made}"} <= set(texts)
    assert ("PA measured" in texts) == (source == "scan")


def test_a_contact_sheet_says_which_plane_and_which_density_is_shown(
    tmp_path: Path, texts: list[str]
) -> None:
    low, high = (0, 1, 0), (8, 2.5, 4)
    flat = [phantoms.Box("flat", low, high)]
    unknown = phantoms.box_object("flat-0002", flat, density_known=False)
    contact_sheet([phantoms.box_object("flat-0001", flat), unknown], tmp_path / "sheet.png")
    assert [text for text in texts if " = " in text] == [
        "y = 1.75 cm",
        "LAC, y = 1.75 cm",
    ]
    assert "attenuation only" in texts
    assert texts.count("PA") == texts.count("LAT") == 2


def shades(monkeypatch: pytest.MonkeyPatch) -> list[tuple[np.ndarray, float]]:
    """What is drawn in grey, 0 to 1, and the height over width of a pixel."""
    drawn: list[tuple[np.ndarray, float]] = []
    picture = figures.draw_image

    def note(axes: object, image: np.ndarray, scale: object, **how: object) -> None:
        if scale.cmap.name == "gray":
            drawn.append((np.asarray(scale.norm(image)), how["aspect"]))
        picture(axes, image, scale, **how)

    monkeypatch.setattr(figures, "draw_image", note)
    return drawn


def test_light_matter_beside_metal_can_be_seen(
    bar: DensityObject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = shades(monkeypatch)
    object_sheet(bar, tmp_path / "bar.png")
    contact_sheet([bar], tmp_path / "sheet.png")
    assert len(drawn) == 6
    for image, _ in (drawn[0], drawn[4]):  # along y, in which they lie side by side
        levels = np.unique(np.asarray(image).round(1))
        assert levels[[0, -1]].tolist() == pytest.approx([0, 1], abs=0.11)
        # 1 cm of steel and of plastic side by side: an eighth of the attenuation, a third of grey
        assert 0.25 < np.median(image[(image > 0.05) & (image < 0.8)]) < 0.5


def test_a_radiograph_of_few_rows_is_no_hairline_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, texts: list[str]
) -> None:
    drawn, labels = shades(monkeypatch), []
    bars = page.Page.colour_bar
    monkeypatch.setattr(
        page.Page, "colour_bar", lambda *args: labels.append(args[3]) or bars(*args)
    )
    flat = phantoms.box_object("flat", phantoms.BAR, shape=(60, 50))
    views = tuple(
        replace(
            view,
            transmission=view.transmission[29:31],
            valid=view.valid[29:31],
            geometry=replace(view.geometry, shape=(2, 50)),
        )
        for view in flat.views
    )
    few = replace(flat, views=views)
    object_sheet(few, tmp_path / "few.png")
    contact_sheet([few], tmp_path / "sheet.png")
    for image, aspect in drawn:
        assert image.shape[0] * aspect / image.shape[1] == pytest.approx(0.25)
    assert any("rows drawn" in label and "times as high" in label for label in labels)


def test_attenuation_is_never_on_the_scale_of_densities(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    labels = []
    monkeypatch.setattr(
        page.Page,
        "colour_bar",
        lambda page, box, scale, label, ticks=None: labels.append((label, scale.norm.vmax)),
    )
    known, unknown = phantoms.objects()[2:4]
    object_sheet(unknown, tmp_path / "unknown.png")
    assert labels[-1][0] == "LAC, 1/cm"
    assert labels[-1][1] == pytest.approx(2.5 * 0.17, rel=1e-3)
    labels.clear()
    contact_sheet([known, unknown], tmp_path / "sheet.png")
    assert [label for label, _ in labels] == ["density, g/cm³", "LAC, 1/cm"]
    np.testing.assert_allclose([highest for _, highest in labels], [2, 0.425], rtol=1e-3)


def test_an_empty_contact_sheet_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="at least one object"):
        contact_sheet([], tmp_path / "sheet.png")
