"""Features kept on disk: by what they are made of, whatever becomes of the disk."""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from xden1k.format.cache import PieceCache
from xden_baselines.features.encoder import PatchEncoder
from xden_baselines.features.kept import Identified, KeptFeatures, feature_cache

PICTURE = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
MASK = np.ones((64, 64), dtype=bool)
PIXELS = np.array([[10, 20], [30, 40], [50, 9]])


@dataclass
class Colors:
    """The colour of each patch's centre; counts how often it is asked."""

    identity: str = "colours"
    asked: list[int] = field(default_factory=list)

    source, width, stride_px = "test", 3, 4

    def patches(self, picture: np.ndarray, mask: np.ndarray, pixels: np.ndarray) -> np.ndarray:
        self.asked.append(len(pixels))
        return picture[pixels[:, 0], pixels[:, 1]].astype(np.float32) / 7

    def texts(self, names: Sequence[str]) -> np.ndarray:
        return np.zeros((len(names), 3), dtype=np.float32)


def cache(folder: Path, limit_bytes: int = 10**6) -> PieceCache:
    return PieceCache(folder / "features", limit_bytes)


def test_what_was_computed_once_is_read_to_the_bit(tmp_path: Path) -> None:
    encoder = Colors()
    assert isinstance(encoder, Identified)
    computed = KeptFeatures(encoder, cache(tmp_path)).patches(PICTURE, MASK, PIXELS)
    other = KeptFeatures(encoder, cache(tmp_path))
    assert isinstance(other, PatchEncoder)
    read = other.patches(PICTURE, MASK, PIXELS)
    assert encoder.asked == [3]
    assert read.dtype == np.float32
    assert read.tobytes() == computed.tobytes()
    assert read.tobytes() == Colors().patches(PICTURE, MASK, PIXELS).tobytes()
    assert read.flags.writeable


def test_whatever_features_are_made_of_is_in_the_key(tmp_path: Path) -> None:
    other = PICTURE.copy()
    other[0, 0, 0] ^= 1
    hidden = MASK.copy()
    hidden[0, 0] = False
    KeptFeatures(Colors(), cache(tmp_path)).patches(PICTURE, MASK, PIXELS)
    changed = [
        (Colors(), (other, MASK, PIXELS)),
        (Colors(), (PICTURE, hidden, PIXELS)),
        (Colors(), (PICTURE, MASK, PIXELS[::-1])),
        (Colors(), (PICTURE, MASK, PIXELS[:2])),
        (Colors(), (PICTURE.reshape(32, 128, 3), MASK.reshape(32, 128), PIXELS[:1])),
        (Colors("another device"), (PICTURE, MASK, PIXELS)),
    ]
    for encoder, given in changed:
        KeptFeatures(encoder, cache(tmp_path)).patches(*given)
        assert encoder.asked


def test_a_damaged_file_is_computed_again(tmp_path: Path) -> None:
    expected = KeptFeatures(Colors(), cache(tmp_path)).patches(PICTURE, MASK, PIXELS)
    (path,) = (one for one in tmp_path.rglob("*") if one.is_file())
    for damaged in (path.read_bytes()[:-1], b"", path.read_bytes()[:-1] + b"x"):
        path.write_bytes(damaged)
        encoder = Colors()
        found = KeptFeatures(encoder, cache(tmp_path)).patches(PICTURE, MASK, PIXELS)
        assert encoder.asked
        np.testing.assert_array_equal(found, expected)


def test_where_nothing_may_be_kept_it_is_computed_each_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("XDEN1K_CACHE_GB", "0")
    encoder = Colors()
    for _ in range(2):
        KeptFeatures(encoder, feature_cache()).patches(PICTURE, MASK, PIXELS)
    assert encoder.asked == [3, 3]
    assert not list(tmp_path.iterdir())


def fill(folder: Path, together: object) -> None:
    """Compute and keep the same features as another process, at the same time."""
    together.wait()
    for shift in range(50):
        kept = KeptFeatures(Colors(), cache(folder))
        found = kept.patches(PICTURE, MASK, PIXELS + shift % 10)
        np.testing.assert_array_equal(found, Colors().patches(PICTURE, MASK, PIXELS + shift % 10))


@pytest.mark.slow
def test_two_processes_share_a_cache(tmp_path: Path) -> None:
    spawn = multiprocessing.get_context("spawn")
    together = spawn.Barrier(2)
    both = [spawn.Process(target=fill, args=(tmp_path, together)) for _ in range(2)]
    for one in both:
        one.start()
    for one in both:
        one.join()
        assert one.exitcode == 0
    files = [one for one in tmp_path.rglob("*") if one.is_file()]
    assert len(files) == 10
    assert not [one for one in files if one.suffix == ".new"]
