"""The packaged sample: the same rows from every folder, with and without ``import xden1k``."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from xden1k.access import hub

REPOSITORY = hub.SAMPLE.parents[1]

SCRIPT = """
import hashlib, json, os, sys, warnings

{imports}
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    splits = datasets.load_dataset("xden1k")
    datasets.load_dataset("xden1k", streaming=True)
    os.chdir(sys.argv[1])
    again = datasets.load_dataset("xden1k")

from xden1k.format.records import decode_array
from xden1k.format.schema import ARRAY_COLUMNS

def light(row):
    names = [name for name in row if name not in ARRAY_COLUMNS and not name.startswith("preview")]
    return repr([(name, row[name]) for name in names])

def array(row, name):
    value = row[name]
    if isinstance(value, bytes):
        value = decode_array(row, name)
    return value is not None and hashlib.sha256(value.tobytes()).hexdigest()

print(json.dumps({{
    "warnings": sum("simulated sample" in str(each.message) for each in caught),
    "same elsewhere": all(again[name].cache_files == splits[name].cache_files for name in splits),
    "decoded": not isinstance(next(iter(splits.values()))[0]["labels"], bytes),
    "light": [light(row) for rows in splits.values() for row in rows],
    "arrays": [
        array(row, name)
        for rows in splits.values()
        for row in rows
        for name in sorted(ARRAY_COLUMNS)
    ],
}}))
"""


def answer(imports: str, folder: Path, home: Path) -> dict:
    """Rows as a fresh process with its own caches sees them in a folder, then in the root."""
    environment = {name: value for name, value in os.environ.items() if name != hub.ROOT_VARIABLE}
    environment |= {
        "HF_HOME": str(home / "hf"),
        "XDG_CACHE_HOME": str(home / "cache"),
        "HF_HUB_OFFLINE": "1",
        "PYTHONPATH": str(REPOSITORY),
    }
    ran = subprocess.run(  # noqa: S603
        [sys.executable, "-c", SCRIPT.format(imports=imports), REPOSITORY],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    return json.loads(ran.stdout)


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {name: tmp_path_factory.mktemp(name) for name in ("empty", "home")}


@pytest.fixture(scope="module")
def from_empty(folders: dict[str, Path]) -> dict:
    return answer("import xden1k, datasets", folders["empty"], folders["home"])


@pytest.mark.slow
def test_sample_loads_from_an_empty_folder_and_then_from_the_root(from_empty: dict) -> None:
    assert from_empty["light"]
    assert from_empty["decoded"]
    assert from_empty["warnings"] == 1
    assert from_empty["same elsewhere"]


@pytest.mark.slow
def test_sample_loads_from_the_root_without_our_import(
    folders: dict[str, Path], from_empty: dict
) -> None:
    without_import = answer("import datasets", REPOSITORY, folders["home"])
    assert not without_import["decoded"]
    for part in ("light", "arrays"):
        assert without_import[part] == from_empty[part]


@pytest.mark.slow
def test_sample_loads_from_the_root_at_once(folders: dict[str, Path], from_empty: dict) -> None:
    assert answer("import xden1k, datasets", REPOSITORY, folders["home"]) == from_empty
