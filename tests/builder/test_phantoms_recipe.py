"""A recipe of phantoms: the same bytes whatever is in the way of them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from xden1k.errors import DataError
from xden1k.folder import open_folder
from xden_builder.pipeline.phantoms import make_phantoms, same_instructions

SETTINGS: dict[str, Any] = {"count": 3, "seed": 2026, "size_px": 48, "unseen": ["water_bottle"]}
MAKE = """
import os, sys
from pathlib import Path
from xden_builder.pipeline.phantoms import make_phantoms

if __name__ == "__main__":
    stop = (lambda _: os.kill(os.getpid(), 9)) if sys.argv[3] == "killed" else (lambda _: None)
    make_phantoms({settings}, Path(sys.argv[1]), workers=int(sys.argv[2]), on_done=stop)
"""


def make(root: Path, workers: int, end: str = "", **environment: str) -> int:
    script = root.with_suffix(".py")
    script.write_text(MAKE.format(settings=SETTINGS))
    words = [sys.executable, str(script), str(root), str(workers), end]
    return subprocess.run(words, env={**os.environ, **environment}, check=False).returncode  # noqa: S603


@pytest.mark.slow
def test_processor_threads_workers_and_kills_change_no_byte(tmp_path: Path) -> None:
    other = {
        "OPENBLAS_CORETYPE": "Nehalem",
        "OPENBLAS_NUM_THREADS": "2",
    }
    longer = same_instructions()["NPY_DISABLE_CPU_FEATURES"]
    assert make(tmp_path / "plain", 1) == 0
    assert make(tmp_path / "other", 2, **other, NPY_DISABLE_CPU_FEATURES=f"X86_V3 {longer}") == 0
    assert make(tmp_path / "killed", 1, "killed") == -9
    assert not (tmp_path / "killed").exists()
    assert len(list((tmp_path / "killed.work").glob("*.seal"))) >= 1
    assert make(tmp_path / "killed", 1) == 0
    one, *others = (open_folder(tmp_path / name) for name in ("plain", "other", "killed"))
    assert one.manifest.splits["unseen"] == 1
    assert {each.manifest_sha256 for each in others} == {one.manifest_sha256}


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"size": 48}, r"expected the settings \['count', 'seed', 'size_px', 'unseen'\]"),
        ({"unseen": ["mugg"]}, r"unknown categories \['mugg'\]"),
    ],
)
def test_a_wrong_setting_makes_nothing(
    tmp_path: Path, changed: dict[str, Any], message: str
) -> None:
    with pytest.raises(DataError, match=message):
        make_phantoms({**SETTINGS, **changed}, tmp_path / "out", workers=1)
    assert list(tmp_path.iterdir()) == []


def test_no_object_chosen_is_told(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="none of the 3 objects was chosen"):
        make_phantoms(SETTINGS, tmp_path / "out", workers=1, objects=slice(3, 4))
