"""Publish the checksums of a dataset that was made: ``python -m xden_bench.datasets NAME ROOT``.

For maintainers, in a checkout, once: it writes the fingerprints and the recipe's
``manifest_sha256``, and refuses a dataset that is not whole or whose checksum is published.
"""

from __future__ import annotations

import sys
from pathlib import Path

from xden1k.errors import DataError
from xden1k.folder import open_folder
from xden1k.folder.verify import refuse_unsound
from xden_bench.datasets.fingerprints import write_fingerprints
from xden_bench.datasets.recipe import load_recipe

UNKNOWN = 'manifest_sha256 = ""'


def publish(name: str, root: Path, out: Path = Path(__file__).parent) -> None:
    """Write what is published of a dataset.

    Parameters
    ----------
    name, root
        The dataset, and the folder with all of it.
    out
        The folder of the recipes.

    Raises
    ------
    DataError
        If the folder is unsound, its splits are not those of the recipe, or a checksum is there.
    """
    recipe, folder, file = load_recipe(name), open_folder(root), out / f"{name}.toml"
    if folder.manifest.splits != dict(recipe.splits):
        raise DataError(f"{root}: expected {dict(recipe.splits)}, got {folder.manifest.splits}")
    text = file.read_text(encoding="utf-8")
    if UNKNOWN not in text:
        raise DataError(f"{file}: its manifest_sha256 is published already")
    refuse_unsound(root)
    write_fingerprints(folder, out / f"{name}.parquet")
    known = f'manifest_sha256 = "{folder.manifest_sha256}"'
    file.write_text(text.replace(UNKNOWN, known), encoding="utf-8")


if __name__ == "__main__":
    publish(sys.argv[1], Path(sys.argv[2]))
