"""What the three command lines share: errors as one line, JSON output, exit codes.

Exit codes: 0 done, 1 error (one line, no traceback), 2 usage, 3 done in part.
"""

from __future__ import annotations

import json
from typing import Any

import click

from xden1k.errors import XDenError
from xden1k.plain import plain

__all__ = ["DONE_IN_PART", "Group", "json_option", "print_json"]

DONE_IN_PART = 3
"""Exit code of a command that finished although some objects failed."""


class Group(click.Group):
    """A group of commands that turns every deliberate error into one line and exit code 1."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command."""
        try:
            return super().invoke(ctx)
        except (XDenError, OSError) as err:
            raise click.ClickException(str(err)) from err


json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON, for machines.")
"""Decorator: adds ``--json``, which arrives as ``as_json``."""


def print_json(values: Any) -> None:
    """Write values as indented JSON to stdout; nan and infinities are null."""
    click.echo(json.dumps(plain(values), indent=2, ensure_ascii=False, allow_nan=False))
