"""The alias in fresh processes: both orders of import, workers, no network, an empty folder."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.phantoms import objects
from xden1k.access.hub import ROOT_VARIABLE
from xden1k.folder import write_folder

XDEN1K_FIRST = """
import socket, sys, warnings

warnings.simplefilter("error", UserWarning)
import xden1k

heavy = {"datasets", "torch", "trimesh", "numpy", "pyarrow"} & set(sys.modules)
assert not heavy, heavy
import datasets
from torch.utils.data import DataLoader

def no_network(*_):
    raise AssertionError("the network was used")

socket.getaddrinfo = no_network
rows = datasets.load_dataset("xden1k", split="test", num_proc=2)
ids = ["bar-0002", "filled-0001", "hollow-0001"]
assert rows["object_id"][:] == ids
assert datasets.get_dataset_config_names("xden1k") == ["default", "metadata"]
assert xden1k.load_dataset(split="test").cache_files == rows.cache_files
mapped = rows.map(lambda row: {"mean": float(row["density"].mean())}, num_proc=2)
assert mapped.features["density"] == rows.features["density"]
stream = datasets.load_dataset("xden1k", split="test", streaming=True)
for source in (stream, rows):
    source = source.select_columns(["object_id", "labels"])
    for row in DataLoader(source, batch_size=None, num_workers=2):
        assert row["labels"].shape == (128, 128, 128)
        ids.append(row["object_id"])
assert sorted(ids) == sorted(3 * ids[:3])
print("done")
"""

DATASETS_FIRST_AND_SPAWN = """
import datasets
import xden1k
from torch.utils.data import DataLoader

if __name__ == "__main__":
    assert datasets.get_dataset_config_info("xden1k").splits["test"].num_examples == 3
    stream = datasets.load_dataset("xden1k", split="test", streaming=True).select_columns("labels")
    loader = DataLoader(stream, batch_size=None, num_workers=1, multiprocessing_context="spawn")
    assert [row["labels"].shape for row in loader] == 3 * [(128, 128, 128)]
    print("done")
"""


@pytest.mark.slow
@pytest.mark.parametrize("script", [XDEN1K_FIRST, DATASETS_FIRST_AND_SPAWN])
def test_whichever_import_comes_first_it_works_with_workers_and_without_a_network(
    script: str, tmp_path: Path
) -> None:
    write_folder(objects(), tmp_path / "root", version="1.2.0", builder="test", shard_bytes=1)
    (tmp_path / "script.py").write_text(script)
    (tmp_path / "empty").mkdir()
    environment = os.environ | {
        ROOT_VARIABLE: str(tmp_path / "root"),
        "HF_HOME": str(tmp_path / "hf"),
        "PYTHONPATH": str(Path(__file__).parents[2]),
    }
    ran = subprocess.run(
        [sys.executable, "../script.py"],
        cwd=tmp_path / "empty",
        env=environment,
        capture_output=True,
        text=True,
    )
    assert (ran.returncode, ran.stdout) == (0, "done\n"), ran.stderr
    assert list((tmp_path / "empty").iterdir()) == []
