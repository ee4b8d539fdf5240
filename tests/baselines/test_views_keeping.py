"""Pictures that are kept: the same as fresh ones, found by content, and shaded ones on demand."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.baselines.painted import BROWN, GREY, RED, painted
from tests.phantoms import BAR
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden1k.format.cache import LIMIT_VARIABLE
from xden1k.predictor import PictureSource
from xden1k.values.types import DensityObject
from xden_baselines.views import source as sources
from xden_baselines.views.cameras import Rig
from xden_baselines.views.keeping import name_of
from xden_baselines.views.pictures import Pictures
from xden_baselines.views.source import RenderedPhantoms, ShadedPhantoms

RIG = Rig(elevations_deg=(30.0,), per_ring=2, size_px=40)
NAMES = ["plastic", "steel"]


def bar(color: tuple[float, float, float] = RED, source: str = "phantom") -> DensityObject:
    obj = painted("bar-0001", BAR, dict(zip(NAMES, (color, GREY), strict=True)), source=source)
    parts = zip(obj.parts, ("pp", "steel"), strict=True)
    return replace(obj, parts=tuple(replace(part, material=name) for part, name in parts))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    root = tmp_path_factory.mktemp("kept") / "dataset"
    scan = replace(bar(source="scan"), object_id="bar-0002")
    write_folder([bar(), scan], root, version="0.1.0", builder="tests")
    return open_folder(root)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv(LIMIT_VARIABLE, "1")
    return tmp_path


def assert_same(one: Pictures, other: Pictures) -> None:
    np.testing.assert_array_equal(one.colors, other.colors)
    np.testing.assert_array_equal(one.masks, other.masks)
    np.testing.assert_array_equal(one.distance_cm, other.distance_cm)
    for first, second in zip(one.cameras, other.cameras, strict=True):
        np.testing.assert_array_equal(first.camera_to_world, second.camera_to_world)


@pytest.mark.parametrize("kind", [RenderedPhantoms, ShadedPhantoms])
def test_kept_pictures_are_those_that_were_drawn(
    kind: type[RenderedPhantoms],
    folder: DatasetFolder,
    cache: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drawn = kind(RIG)(folder, "bar-0001")
    with monkeypatch.context() as patch:
        patch.delattr(sources, "render")
        patch.delattr(sources, "render_shaded")
        assert_same(kind(RIG)(folder, "bar-0001"), drawn)
    (piece,) = cache.rglob("*.npz")
    piece.write_bytes(piece.read_bytes()[:-40])
    assert_same(kind(RIG)(folder, "bar-0001"), drawn)


def test_what_changes_pictures_changes_their_name() -> None:
    moved = bar()
    moved.parts[0].mesh.vertices[0] += 1e-9
    objects = [bar(), bar(BROWN), moved, replace(bar(), object_id="bar-0003")]
    names = {name_of(obj, "flat 1") for obj in objects} | {name_of(bar(), "flat 2")}
    assert len(names) == 5
    assert name_of(bar(), "flat 1") == name_of(bar(), "flat 1")


def test_a_full_cache_or_none_gives_the_same_pictures(
    folder: DatasetFolder, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = RenderedPhantoms(RIG)(folder, "bar-0001")
    monkeypatch.setenv(LIMIT_VARIABLE, "0")
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache / "other"))
    assert_same(RenderedPhantoms(RIG)(folder, "bar-0001"), drawn)
    assert not (cache / "other").exists()


def test_shaded_pictures_differ_from_flat_ones_in_colour_alone(folder: DatasetFolder) -> None:
    flat, shaded = (
        RenderedPhantoms(RIG)(folder, "bar-0001"),
        ShadedPhantoms(RIG)(folder, "bar-0001"),
    )
    assert (flat.colors != shaded.colors).any()
    assert_same(replace(shaded, colors=flat.colors), flat)


def test_a_row_says_which_pictures_it_saw(folder: DatasetFolder) -> None:
    source = ShadedPhantoms(RIG)
    assert isinstance(source, PictureSource)
    assert source.description == "2 views of 40 x 40 px shaded by material (look 1)"
    assert source.fingerprint != ShadedPhantoms(Rig()).fingerprint
    with pytest.raises(DataError, match="bar-0002: its parts have no true colours"):
        source(folder, "bar-0002")


DIGEST = """
import hashlib, sys
from pathlib import Path
from xden1k.folder import open_folder
from xden_baselines.views.cameras import Rig
from xden_baselines.views.source import ShadedPhantoms
rig = Rig(elevations_deg=(30.0,), per_ring=2, size_px=40)
drawn = ShadedPhantoms(rig)(open_folder(Path(sys.argv[1])), "bar-0001")
print(hashlib.sha256(drawn.colors.tobytes()).hexdigest())
"""


@pytest.mark.slow
def test_every_process_draws_the_same(folder: DatasetFolder, cache: Path) -> None:
    def digest(threads: int) -> str:
        env = {"XDEN1K_CACHE_GB": "0", "OMP_NUM_THREADS": str(threads), "HOME": str(cache)}
        command = [sys.executable, "-c", DIGEST, str(folder.path)]
        done = subprocess.run(  # noqa: S603 our own words
            command, env=env, capture_output=True, check=True, text=True
        )
        return done.stdout

    assert digest(1) == digest(2) == digest(1)
