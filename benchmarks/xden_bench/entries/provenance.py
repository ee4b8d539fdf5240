"""Where a number comes from: the code's version and commit."""

from __future__ import annotations

import shutil
import subprocess
from importlib.metadata import version
from pathlib import Path

__all__ = ["code_commit", "package_version"]

CODE = ("xden1k", "benchmarks/xden_bench", "baselines/xden_baselines", "builder/xden_builder")
"""What a score and the builder's row depend on: a change elsewhere makes no commit dirty."""


def package_version() -> str:
    """Version of this package."""
    return version("xden1k")


def code_commit(checkout: Path = Path(__file__).parents[3]) -> str | None:
    """Commit of the code that runs, ``-dirty`` if it was changed since.

    Parameters
    ----------
    checkout
        The folder that would be the repository.

    Returns
    -------
    str or None
        None where the code is not a git checkout (installed from a wheel: the version says all).
    """
    git = shutil.which("git")
    if git is None or not (checkout / ".git").exists():
        return None

    def run(*arguments: str) -> str:
        done = subprocess.run(  # noqa: S603 - git by its full path, and fixed arguments
            [git, "-C", str(checkout), *arguments], capture_output=True, text=True, check=False
        )
        return done.stdout.strip() if done.returncode == 0 else ""

    commit = run("rev-parse", "HEAD")
    if not commit:
        return None
    return f"{commit}-dirty" if run("status", "--porcelain", "--", *CODE) else commit
