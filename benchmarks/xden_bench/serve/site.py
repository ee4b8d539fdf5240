"""The web app from its folders: what the command and a Hugging Face Space start."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

from xden1k.errors import require
from xden1k.values.settings import load_settings
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.serve.desk import Desk
from xden_bench.serve.limits import Limits

__all__ = ["Site", "run"]


@dataclass(frozen=True, eq=False)
class Site:
    """Where everything is.

    Parameters
    ----------
    reference
        What submissions are compared with.
    results
        Folder of the entries.
    state
        Folder of the desk.
    settings
        TOML with the desk's :class:`~xden_bench.serve.limits.Limits`; None = as they are.
    login
        Whether whoever sends a file must log in with Hugging Face.
    """

    reference: Reference
    results: Path
    state: Path
    settings: Path | None = None
    login: bool = False

    @property
    def limits(self) -> Limits:
        """How much the desk takes on."""
        return load_settings(Limits, self.settings) if self.settings else Limits()


def run(site: Site, *, host: str, port: int) -> None:
    """Serve until interrupted.

    Raises
    ------
    MissingExtraError
        If the extras ``view`` and ``build`` are not installed.
    DataError
        If the settings, or the desk's folder, are not right.
    OSError
        If the port is taken.
    """
    for module, extra in (("gradio", "view"), ("matplotlib", "view"), ("manifold3d", "build")):
        require(module, extra)
    from xden_bench.serve.app import build_app, launch

    with (
        tempfile.TemporaryDirectory() as scratch,
        Desk(
            site.reference,
            load_protocol(),
            results=site.results,
            state=site.state,
            limits=site.limits,
        ) as desk,
    ):
        launch(build_app(desk, Path(scratch), login=site.login), desk, host=host, port=port)
