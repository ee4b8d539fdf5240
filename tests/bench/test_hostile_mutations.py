"""Damaged submissions: whatever is changed, the answer is a score or a list of coded errors."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.bench.crafting import npy, two_bars, zipped
from tests.bench.mutations import mutated
from tests.bench.watched import fuzz_apart
from xden1k.folder import open_folder
from xden1k.predictions import CODES
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.submission import validate

FAST = 60
ALL = 10_000


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return two_bars(tmp_path_factory.mktemp("mutations") / "dataset")


@pytest.fixture(scope="module")
def sounds(dataset: Path) -> tuple[bytes, bytes]:
    """Two grids; a grid and part densities. Each has its standard deviation."""
    truth = Reference(open_folder(dataset), "test").truth("bar-1")
    grid = npy((np.float32(1.1) * truth.density_g_cm3).astype(np.float16))
    parts = npy(np.array([0, *(2.0 for _ in range(truth.parts))], np.float32))
    meta = {
        "schema": "xden-submission/1",
        "method": "damaged",
        "dataset_revision": "0.1.0",
        "config": "default",
        "split": "test",
        "inputs": ["mesh", "parts"],
        "training_data": [],
        "external_data": False,
    }
    first = [
        ("__meta__.npy", npy(np.array(json.dumps(meta)))),
        ("density/bar-1.npy", grid),
        ("density_sd/bar-1.npy", grid),
    ]
    grids = [("density/bar-2.npy", grid), ("density_sd/bar-2.npy", grid)]
    both = [("part_density/bar-2.npy", parts), ("part_density_sd/bar-2.npy", parts)]
    return zipped([*first, *grids]), zipped([*first, *both])


def try_mutations(
    seeds: range, sounds: tuple[bytes, bytes], dataset: Path, folder: Path
) -> Counter[str]:
    """Score each, check what must hold of all, and count the codes told; none is a score."""
    for index, sound in enumerate(sounds):
        (folder / f"sound-{index}.npz").write_bytes(sound)
    verdicts = list(fuzz_apart(seeds, dataset, folder))
    assert [one for one in verdicts if one["crash"]] == []
    assert [one["seed"] for one in verdicts] == list(seeds)
    for one in verdicts:
        check(one)
    return Counter(line[:4] for one in verdicts for line in one["told"] or ["none"])


def check(verdict: dict[str, Any]) -> None:
    assert verdict["seconds"] < 5
    assert verdict["peak_mib"] < 500
    assert verdict["touched"] == []
    for line in verdict["told"]:
        code = re.match(r"(E\d{3})[ :]", line)
        assert code, line
        assert code[1] in CODES
        assert len(line) < 500
        assert line.isprintable()


@pytest.mark.parametrize("index", [0, 1])
def test_the_files_that_are_damaged_are_sound(
    sounds: tuple[bytes, bytes], dataset: Path, tmp_path: Path, index: int
) -> None:
    (tmp_path / "sound.npz").write_bytes(sounds[index])
    reference = Reference(open_folder(dataset), "test")
    problems = validate(tmp_path / "sound.npz", reference, load_protocol())
    assert [one for one in problems if one.is_error] == []


def test_a_seed_gives_the_same_damage(sounds: tuple[bytes, bytes]) -> None:
    assert mutated(sounds[0], 7) == mutated(sounds[0], 7) != mutated(sounds[0], 8)


@pytest.mark.slow
def test_dozens_of_mutations_are_scored_or_told_what_is_wrong(
    sounds: tuple[bytes, bytes], dataset: Path, tmp_path: Path
) -> None:
    told = try_mutations(range(FAST), sounds, dataset, tmp_path)
    # the mutations go deeper than the archive
    assert len([code for code in told if "E2" < code < "F"]) > 3, told


@pytest.mark.slow
def test_ten_thousand_mutations_are_scored_or_told_what_is_wrong(
    sounds: tuple[bytes, bytes], dataset: Path, tmp_path: Path
) -> None:
    told = try_mutations(range(ALL), sounds, dataset, tmp_path)
    # no chance writes a lump beside the object, the mark of a comment, or the template's name
    assert {code for code in CODES if code[0] == "E"} - told.keys() <= {"E405", "E206", "E207"}
