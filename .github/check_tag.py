"""Says what keeps a tag from being released: ``python .github/check_tag.py v0.1.0``.

The release workflow runs it before anything is installed, so it needs Python alone.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]


def problems(tag: str, root: Path = ROOT) -> Iterator[str]:
    """Compare a tag with what the checkout says of its version, one line for each difference."""
    version = tomllib.loads((root / "pyproject.toml").read_text())["project"]["version"]
    if tag != f"v{version}":
        yield f"pyproject.toml: version {version} is released by the tag v{version}, got {tag}"
    cited = re.search(r"^version: (.*)$", (root / "CITATION.cff").read_text(), re.MULTILINE)
    if cited is None or cited[1] != version:
        found = cited[1] if cited else "none"
        yield f"CITATION.cff: version must be {version}, got {found}"
    dated = rf"^## {re.escape(version)} \(\d{{4}}-\d\d-\d\d\)$"
    if not re.search(dated, (root / "CHANGELOG.md").read_text(), re.MULTILINE):
        yield f"CHANGELOG.md: no heading '## {version} (YYYY-MM-DD)' with the day of the release"


if __name__ == "__main__":
    sys.exit("\n".join(problems(sys.argv[1])) or None)
