"""The command that serves the web app."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import click

from xden1k.commands import tell_notes
from xden_bench.commands.entering import refuse_disturbed
from xden_bench.commands.shared import FILE, FOLDER, RESULTS, open_reference, root_option

__all__ = ["serve"]


@click.command(epilog="Example: xden-bench serve --state build/desk --port 7860")
@root_option
@click.option(
    "--results",
    type=FOLDER,
    help=f"The entries. [default: {RESULTS} in a checkout, else results in the state]",
)
@click.option(
    "--state",
    type=FOLDER,
    help="What the desk keeps: uploads, tickets, audit log. [default: desk in the user's cache]",
)
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen at.")
@click.option(
    "--port",
    type=click.IntRange(1, 65535),
    default=7860,
    show_default=True,
    help="Port to listen at.",
)
@click.option("--settings", type=FILE, help="TOML with the limits of the desk.")
@click.option(
    "--trusted-proxy",
    "trusted_proxies",
    metavar="ADDRESS",
    multiple=True,
    help="Address or network of a proxy whose X-Forwarded-For is believed. Repeatable.",
)
def serve(
    root: Path | str | None,
    results: Path | None,
    state: Path | None,
    host: str,
    port: int,
    settings: Path | None,
    trusted_proxies: tuple[str, ...],
) -> None:
    """Serve the web app: leaderboard, object explorer, and a desk that takes submissions.

    Needs the extras view and build.
    """
    from xden1k.access.hub import cache_folder
    from xden_bench.serve.site import Site, run, take_address

    state = state or cache_folder() / "desk"
    if results is None:
        results = RESULTS if (RESULTS / "README.md").is_file() else state / "results"
    reference = open_reference(root, "test")
    refuse_disturbed(reference.folder)
    site = Site(reference, results, state, settings, trusted_proxies=trusted_proxies)
    with take_address(host, port) as listener:
        tell_notes()
        run(site, listener, partial(click.echo, err=True))
