"""What the three command lines share: errors as one line, JSON output, exit codes.

Exit codes: 0 done, 1 error (one line, no traceback), 2 usage, 3 done in part.
"""

from __future__ import annotations

import errno
import json
import shlex
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from xden1k.errors import DataError, XDenError
from xden1k.values.plain import plain

if TYPE_CHECKING:
    from xden1k.folder import DatasetFolder

__all__ = [
    "DONE_IN_PART",
    "LOCAL_ROOT",
    "ROOT",
    "Group",
    "command_line",
    "json_option",
    "open_root",
    "print_json",
]

DONE_IN_PART = 3
"""Exit code of a command that finished although some objects failed."""


class Group(click.Group):
    """A group of commands that turns every deliberate error into one line and exit code 1."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command."""
        try:
            return super().invoke(ctx)
        except XDenError as err:
            raise click.ClickException(str(err)) from err
        except OSError as err:
            if err.errno == errno.EPIPE:  # the reader has seen enough; click ends quietly
                raise
            known = err.filename is not None and err.strerror is not None
            said = f"{err.filename}: {err.strerror}" if known else str(err)
            raise click.ClickException(said) from err


class _Root(click.Path):
    """A folder, or a URL, which is left as it is."""

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        """Return a path or a URL."""
        return value if "://" in str(value) else super().convert(value, param, ctx)


class _LocalRoot(click.Path):
    """A folder of this machine, and no URL."""

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        """Return a path; a URL would become one, too."""
        if "://" in str(value):
            raise DataError(
                f"{value} is a URL: this needs a folder here; get it by `xden download`"
            )
        return super().convert(value, param, ctx)


ROOT = _Root(path_type=Path, file_okay=False)
"""Type of an option that names a dataset folder, here or at a URL."""
LOCAL_ROOT = _LocalRoot(path_type=Path, file_okay=False)
"""Type of an option that names a dataset folder here, for what reads all of it."""

json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON, for machines.")
"""Decorator: adds ``--json``, which arrives as ``as_json``."""


def print_json(values: Any) -> None:
    """Write values as indented JSON to stdout; nan and infinities are null."""
    click.echo(json.dumps(plain(values), indent=2, ensure_ascii=False, allow_nan=False))


def command_line(context: click.Context, program: str) -> str:
    """Return the command line as it was given, without what only changes the output.

    Parameters
    ----------
    context
        Of the command.
    program
        What it is a command of.
    """
    words = [*program.split(), context.info_name or ""]
    for parameter in context.command.params:
        name = parameter.name or ""
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE and name != "as_json":
            given = context.params[name]
            for value in given if isinstance(given, tuple) else (given,):
                if isinstance(parameter, click.Option):
                    words.append(parameter.opts[0])
                if not (isinstance(parameter, click.Option) and parameter.is_flag):
                    words.append(str(value))
    return shlex.join(words)


def open_root(root: Path | str | None) -> DatasetFolder:
    """Open the dataset folder that ``--root`` names, or the one there is without it.

    What its finder warns of becomes a line on stderr.

    Raises
    ------
    DataError
        If it is not a dataset folder.
    """
    from xden1k.access.hub import data_root
    from xden1k.folder import open_folder

    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always")
        folder = open_folder(data_root(root))
    for note in notes:
        click.echo(f"note: {note.message}", err=True)
    return folder
