"""The public names: sorted, importable, documented, the same for people and type checkers."""

from __future__ import annotations

import ast
import inspect
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

import pytest
from mypy import api

import xden1k
from xden1k.errors import MissingExtraError


def test_all_is_sorted_and_listed() -> None:
    assert xden1k.__all__ == sorted(xden1k.__all__)
    assert set(xden1k.__all__) <= set(dir(xden1k))


@pytest.mark.parametrize("name", [name for name in xden1k.__all__ if name != "__version__"])
def test_each_public_name_is_importable_and_documented(name: str) -> None:
    value = getattr(xden1k, name)
    assert inspect.getdoc(value)
    assert name in inspect.getmodule(value).__all__


def test_what_type_checkers_see_is_what_is_loaded() -> None:
    tree = ast.parse(Path(xden1k.__file__).read_text(encoding="utf-8"))
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    seen = {
        alias.name: node.module.removeprefix("xden1k.")
        for node in imports
        for alias in node.names
        if node.module.startswith("xden1k.")
    }
    assert seen == xden1k._MODULE_OF
    assert sorted([*seen, "__version__"]) == xden1k.__all__


def test_the_version_is_the_packages() -> None:
    assert xden1k.__version__ == version("xden1k")


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'xden1k' has no attribute 'nothing'"):
        xden1k.nothing  # noqa: B018


@pytest.mark.parametrize(
    ("name", "library", "command"),
    [("XDen1K", "torch", r"pip install torch$"), ("reprojected", "numba", r"pip .*\[build\]'$")],
)
def test_a_library_that_is_missing_is_named_with_its_command(
    monkeypatch: pytest.MonkeyPatch, name: str, library: str, command: str
) -> None:
    def lacking(module: str) -> ModuleType:
        if module == "xden1k.errors":
            return import_module(module)
        raise ModuleNotFoundError(f"No module named {library!r}", name=library)

    monkeypatch.setattr(xden1k, "import_module", lacking)
    with pytest.raises(MissingExtraError, match=f"^xden1k.{name} needs {library}: {command}"):
        xden1k.__getattr__(name)


@pytest.mark.slow
def test_type_checkers_tell_of_a_misspelt_name(tmp_path: Path) -> None:
    probe = tmp_path / "probe.py"
    probe.write_text("import xden1k\n\nxden1k.XDen1K, xden1k.__version__.upper()\nxden1k.XDen2K\n")
    alone = ["--config-file=", "--follow-imports=skip", f"--cache-dir={tmp_path / 'cache'}"]
    said, problem, status = api.run([*alone, str(probe), xden1k.__file__])
    assert (problem, status) == ("", 1)
    (error,) = [line for line in said.splitlines() if ": error: " in line]
    assert error.startswith(f'{probe}:4: error: Module has no attribute "XDen2K"')
