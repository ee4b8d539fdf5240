"""The web app from its folders: what the command and a Hugging Face Space start."""

from __future__ import annotations

import socket
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from xden1k.errors import require
from xden1k.values.settings import load_settings
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.serve.desk import Desk
from xden_bench.serve.limits import Limits
from xden_bench.serve.standings import Standings

__all__ = ["Site", "run", "take_address"]


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
    trusted_proxies
        As :func:`xden_bench.serve.app.serve` has them.
    """

    reference: Reference
    results: Path
    state: Path
    settings: Path | None = None
    login: bool = False
    trusted_proxies: tuple[str, ...] = ()

    @property
    def limits(self) -> Limits:
        """How much the desk takes on."""
        return load_settings(Limits, self.settings) if self.settings else Limits()


def take_address(host: str, port: int) -> socket.socket:
    """Take an address, before anything else is begun or said; close it in the end.

    Raises
    ------
    MissingExtraError
        If the extras ``view`` and ``build`` are not installed.
    DataError
        If the address cannot be had.
    """
    for module, extra in (("gradio", "view"), ("matplotlib", "view"), ("manifold3d", "build")):
        require(module, extra)
    from xden_bench.serve.app import bind

    return bind(host, port)


def run(site: Site, listener: socket.socket, say: Callable[[str], object]) -> None:
    """Serve until interrupted.

    Parameters
    ----------
    site
        What.
    listener
        From :func:`take_address`.
    say
        Is told the address as soon as the first page can be had, and what takes time before.

    Raises
    ------
    DataError
        If the settings, or the desk's folder, are not right.
    """
    from xden_bench.serve.app import build_app, serve
    from xden_bench.serve.explorer import Explorer
    from xden_bench.serve.page_explore import mount_explorer

    with (
        tempfile.TemporaryDirectory() as models,
        Desk(
            site.reference,
            load_protocol(),
            results=site.results,
            state=site.state,
            limits=site.limits,
        ) as desk,
    ):
        standings = Standings(site.results, site.state / "kept")
        say("reading the results; entries that are new are verified, once")
        standings.refresh()
        app = build_app(desk, standings, site.state, login=site.login)
        explorer = Explorer(site.reference.folder, desk.upload_of, Path(models))
        mount_explorer(app, explorer, standings)
        listener.listen()
        host, port = listener.getsockname()[:2]
        say(f"http://{host}:{port} (stop with Ctrl-C)")
        with standings:
            serve(app, listener, site.trusted_proxies)
