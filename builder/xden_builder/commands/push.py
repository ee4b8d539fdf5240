"""``xden-build push``: a dataset folder onto the Hub."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from xden1k.commands import LOCAL_ROOT, json_option, print_json
from xden_builder.commands.shared import progress_bar

if TYPE_CHECKING:
    from xden_builder.pipeline.publish import Pushed

__all__ = ["push"]


@click.command(epilog="Example: xden-build push dataset --repo-id OWNER/NAME --dry-run")
@click.argument("root", type=LOCAL_ROOT)
@click.option("--repo-id", metavar="ID", required=True, help="Dataset repository on the Hub.")
@click.option("--revision", metavar="TAG", help="Tag to set.", show_default="v and the version")
@click.option("--private", is_flag=True, help="Make the repository private, if it is made.")
@click.option("--create-pr", is_flag=True, help="Open a pull request; sets no tag.")
@click.option("--dry-run", is_flag=True, help="Say what would be pushed and deleted; no token.")
@click.option(
    "--i-know-these-are-simulated",
    "simulated_too",
    is_flag=True,
    help="Push simulated objects to the repository of the paper.",
)
@json_option
def push(
    root: Path,
    repo_id: str,
    revision: str | None,
    private: bool,
    create_pr: bool,
    dry_run: bool,
    simulated_too: bool,
    as_json: bool,
) -> None:
    """Publish a dataset folder on the Hugging Face Hub, under a tag.

    Verifies the folder, uploads it in one commit, then sets the tag, which never moves. Can be
    stopped and started again; the same folder twice is no new commit.
    """
    from huggingface_hub.utils import disable_progress_bars  # type: ignore[attr-defined]

    from xden1k.format.manifest import Manifest
    from xden_builder.pipeline.publish import push as push_folder

    if not sys.stderr.isatty():
        disable_progress_bars()
    total = Manifest.read(root).objects if (root / "manifest.json").is_file() else 0
    with progress_bar(total) as bar:
        pushed = push_folder(
            root,
            repo_id,
            tag=revision,
            private=private,
            create_pr=create_pr,
            dry_run=dry_run,
            simulated_too=simulated_too,
            on_row=bar.update,
        )
    if as_json:
        print_json(pushed.to_dict() | {"dry_run": dry_run})
    else:
        _echo(pushed, root, dry_run)


def _echo(pushed: Pushed, root: Path, dry_run: bool) -> None:
    if dry_run:
        _echo_files(pushed, root)
    size = sum(pushed.uploaded.values()) / 1e6
    click.echo(
        f"{pushed.url}: {len(pushed.uploaded)} files, {size:.1f} MB, {pushed.unchanged} unchanged, "
        f"{len(pushed.deleted)} deleted{'; nothing was pushed, this is a dry run' * dry_run}"
    )
    if pushed.note:
        click.echo(f"note: {pushed.note}", err=True)


def _echo_files(pushed: Pushed, root: Path) -> None:
    card = (root / "README.md").read_text(encoding="utf-8")
    click.echo(f"---{card.split('---')[1]}---")
    for name, size in pushed.uploaded.items():
        click.echo(f"push    {size:>14,} B  {name}")
    for name in pushed.deleted:
        click.echo(f"delete  {'':>14}    {name}")
