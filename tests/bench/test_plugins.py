"""Methods of other packages that do not keep to the interface."""

from __future__ import annotations

import re
import subprocess
import sysconfig
import venv
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.values.modality import Modality
from xden_bench.methods import baseline
from xden_bench.methods.baseline import find_predictor, run_predictor

GRID = (64, 64, 64)


class Gives:
    """A method that predicts one and the same thing."""

    name, version, reads = "gives", "1", Modality.PARTS
    trainable = external_data = False
    notes = ""

    def __init__(self, values: Any) -> None:
        self._values = values

    def fit(self, train: Any, *, seed: int) -> None:
        """Learn nothing."""

    def predict(self, sample: Any) -> Any:
        return self._values


class Broken(Gives):
    def __init__(self) -> None:
        raise ValueError("no weights at ~/weights")


@pytest.mark.parametrize(
    ("values", "found"),
    [
        (None, "got NoneType"),
        ([0.0, 1.0], "got list"),
        (torch.zeros(GRID), "got torch.Tensor"),
        (np.full(GRID, "1"), "got numpy.ndarray of <U1"),
        (np.zeros(GRID, complex), "got numpy.ndarray of complex128"),
        (np.zeros(GRID, object), "got numpy.ndarray of object"),
        (np.zeros(GRID, bool), "got numpy.ndarray of bool"),
        (np.array([1.0, 1.0, 1.0]), "entry 0 is air and must be 0, got 1.0"),
        (np.zeros(4), r"shape must be (3,), air and 2 parts, got (4,)"),
        (np.zeros((64, 64)), "shape must be (64, 64, 64) or (parts + 1,), got (64, 64)"),
    ],
)
def test_what_is_no_prediction_is_refused_with_the_object(
    folder: DatasetFolder, tmp_path: Path, values: Any, found: str
) -> None:
    named = rf"^({re.escape(str(folder.root))}: )?bar-0002: "
    with pytest.raises(DataError, match=named) as caught:
        run_predictor(Gives(values), folder, "test", tmp_path / "preds.npz")
    assert found in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_part_densities_need_parts_to_be_declared(folder: DatasetFolder, tmp_path: Path) -> None:
    blind = Gives(np.zeros(3))
    blind.reads = Modality.GEOMETRY
    with pytest.raises(DataError, match="bar-0002: part densities need the modality PARTS"):
        run_predictor(blind, folder, "test", tmp_path / "preds.npz")


def test_whole_numbers_are_a_prediction(folder: DatasetFolder, tmp_path: Path) -> None:
    whole = Gives(np.ones(GRID, np.int64))
    run_predictor(whole, folder, "test", tmp_path / "preds.npz")
    assert (tmp_path / "preds.npz").is_file()


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("no_such_package:Method", "does not load: No module named"),
        ("numpy:no_such_name", "does not load: module 'numpy' has no attribute"),
        ("numpy:pi", "does not load: 'float' object is not callable"),
        ("numpy:ndarray", "does not load: "),
        ("builtins:dict", "is no xden1k Predictor"),
    ],
)
def test_a_method_that_does_not_load_is_named(
    monkeypatch: pytest.MonkeyPatch, value: str, message: str
) -> None:
    entry = EntryPoint("theirs", value, "xden1k.predictors")
    monkeypatch.setattr(baseline, "_entries", lambda group: {"theirs": entry})
    with pytest.raises(DataError, match=f"the method theirs .*{message}"):
        find_predictor("theirs")


def test_a_constructor_that_fails_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    class Entry:
        value = "theirs:Broken"
        load = staticmethod(lambda: Broken)

    monkeypatch.setattr(baseline, "_entries", lambda group: {"theirs": Entry})
    with pytest.raises(DataError, match="does not load: no weights at ~/weights"):
        find_predictor("theirs")


class Album:
    """Pictures that are words."""

    def __init__(self, root: Path = Path("drawn")) -> None:
        self.description = f"pictures of {root}"

    def __call__(self, folder: DatasetFolder, object_id: str) -> str:
        return object_id


class Looks(Gives):
    name, reads = "looks", Modality.RGB


class Illustrates(Looks):
    pictures_of = Album(Path("mine"))


@pytest.mark.parametrize(
    ("kind", "views", "description"),
    [
        (Looks, None, "pictures of drawn"),
        (Looks, Path("there"), "pictures of there"),
        (Illustrates, None, "pictures of mine"),
        (Illustrates, Path("there"), "pictures of there"),
    ],
)
def test_pictures_are_drawn_or_read_or_the_methods_own(
    monkeypatch: pytest.MonkeyPatch, kind: type, views: Path | None, description: str
) -> None:
    class Entry:
        load = staticmethod(lambda: Album)

    monkeypatch.setattr(baseline, "_entries", lambda group: {"shaded": Entry, "scenes": Entry})
    source = baseline.find_pictures(kind(None), views)
    assert source is not None
    assert source.description == description


def test_who_reads_no_pictures_gets_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(baseline, "_entries", lambda group: {})
    assert baseline.find_pictures(Gives(None), None) is None
    with pytest.raises(
        DataError, match="the method gives reads no pictures: no views, no pictures"
    ):
        baseline.find_pictures(Gives(None), Path("there"))
    with pytest.raises(DataError, match="no source of pictures 'shaded' is installed"):
        baseline.find_pictures(Looks(None), None)
    with pytest.raises(DataError, match="the method gives reads no pictures"):
        baseline.find_pictures(Gives(None), None, "shaded")


def test_pictures_are_drawn_as_asked_even_where_the_method_has_its_own() -> None:
    source = baseline.find_pictures(Illustrates(None), None, "shaded")
    assert source is not None
    assert "shaded by material" in source.description
    for views, pictures in [(Path("there"), "flat"), (None, "scenes")]:
        with pytest.raises(DataError, match=r"either those of a folder of scenes .*or drawn"):
            baseline.find_pictures(Looks(None), views, pictures)
    with pytest.raises(DataError, match="no source of pictures 'oils' is installed; there are"):
        baseline.find_pictures(Looks(None), None, "oils")


PROJECT = """[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "their-method"
version = "1.0"

[project.entry-points."xden1k.predictors"]
my-method = "their_method:MyMethod"

[tool.hatch.build.targets.wheel]
only-include = ["their_method.py"]
"""


@pytest.mark.slow
def test_the_manuals_method_in_a_package_of_its_own_makes_a_row(
    dataset: Path, tmp_path: Path
) -> None:
    manual = Path(__file__).parents[2] / "docs" / "manual" / "predictor.md"
    code = re.search(r"```python\n(.*?)```", manual.read_text(), re.DOTALL)
    assert code is not None
    package, environment = tmp_path / "package", tmp_path / "environment"
    package.mkdir()
    (package / "pyproject.toml").write_text(PROJECT)
    (package / "their_method.py").write_text(code[1])
    venv.create(environment, with_pip=True)
    # the packages that are installed here, and nothing of a checkout's paths
    base = {"base": str(environment), "platbase": str(environment)}
    site = Path(sysconfig.get_path("purelib", "venv", base))
    here = sysconfig.get_path("purelib")
    (site / "here.pth").write_text(f"import site; site.addsitedir({here!r})\n")

    def run(*words: str) -> str:
        python = environment / "bin" / "python"
        ran = subprocess.run([python, *words], capture_output=True, text=True, cwd=tmp_path)  # noqa: S603
        assert ran.returncode == 0, ran.stderr
        return ran.stdout

    def bench(*words: str) -> str:
        return run("-c", "from xden_bench.cli import cli; cli()", *words)

    run(
        "-m",
        "pip",
        "install",
        "-q",
        "--no-deps",
        "--no-build-isolation",
        "--no-index",
        str(package),
    )
    assert re.search(
        r"^my-method +geometry +densities\b", bench("baseline", "--list"), re.MULTILINE
    )
    told = bench("baseline", "my-method", "--root", str(dataset), "--out", "preds.npz")
    assert "my-method, track geometry, split test" in told
    assert "density MAE" in bench("score", "preds.npz", "--root", str(dataset))
