"""What the three command lines share: errors as one line, JSON output, exit codes.

Exit codes: 0 done, 1 error (one line, no traceback), 2 usage, 3 done in part.
"""

from __future__ import annotations

import errno
import json
import shlex
import warnings
from collections.abc import Sequence
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click
from click.core import ParameterSource

from xden1k.errors import (
    DataError,
    MissingExtraError,
    SubmissionError,
    XDenError,
    install_command,
)
from xden1k.values.plain import plain

if TYPE_CHECKING:
    from xden1k.folder import DatasetFolder

__all__ = [
    "DONE_IN_PART",
    "LOCAL_ROOT",
    "ROOT",
    "Group",
    "OpenGroup",
    "command_line",
    "json_option",
    "key_values",
    "open_root",
    "print_json",
    "tell_notes",
]

COMMANDS: Final = "xden1k.commands"
"""Entry points of this group are commands of ``xden``. What one needs beyond this package is the
extra of its own name."""
NOTES: Final = "xden1k.notes"
"""Key of a command's notes in its context."""
DONE_IN_PART = 3
"""Exit code of a command that finished although some objects failed."""


class Group(click.Group):
    """A group of commands that turns every deliberate error into one line and exit code 1."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; what it noted is told at its end, and after an error not at all."""
        try:
            result = super().invoke(ctx)
            tell_notes()
            return result
        except SystemExit:
            tell_notes()
            raise
        except SubmissionError as err:
            tell_notes()  # whether it is the right dataset may be what is wrong
            raise click.ClickException(str(err)) from err
        except XDenError as err:
            raise click.ClickException(str(err)) from err
        except OSError as err:
            if err.errno == errno.EPIPE:  # the reader has seen enough; click ends quietly
                raise
            known = err.filename is not None and err.strerror is not None
            said = f"{err.filename}: {err.strerror}" if known else str(err)
            raise click.ClickException(said) from err


class OpenGroup(Group):
    """A group to which packages add commands, by entry points of the group ``xden1k.commands``.

    Its own commands come first. None of the others is imported until it is run, or asked for its
    help: the list of all imports nothing.
    """

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of its own commands and of those that were added."""
        return sorted({*super().list_commands(ctx), *_added()})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command; one that was added is not loaded yet."""
        own = super().get_command(ctx, cmd_name)
        if own is not None or cmd_name not in (added := _added()):
            return own
        return _Later(added[cmd_name])


def _added() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=COMMANDS)}


class _Later(click.Command):
    """Stands for a command that was added until it is run."""

    def __init__(self, entry: EntryPoint) -> None:
        package = entry.module.partition(".")[0]
        super().__init__(entry.name, short_help=f"Of {package}: ask it for its --help.")
        self._entry = entry

    def make_context(
        self,
        info_name: str | None,
        args: list[str],
        parent: click.Context | None = None,
        **extra: Any,
    ) -> click.Context:
        """Load the command, and let it read its arguments."""
        return self._loaded().make_context(info_name, args, parent, **extra)

    def _loaded(self) -> click.Command:
        try:
            command = self._entry.load()
        except ImportError as err:
            raise MissingExtraError(
                f"the command {self.name} needs more than is installed ({err}): "
                f"{install_command(self._entry.name)}"
            ) from err
        except AttributeError as err:
            raise DataError(f"the command {self.name} does not load: {err}") from err
        if not isinstance(command, click.Command):
            raise DataError(f"the command {self.name} is no click command: {self._entry.value}")
        return command


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


def key_values(texts: Sequence[str]) -> dict[str, Any]:
    """Read what ``--set KEY=VALUE`` gave: values of JSON's types, else text.

    Raises
    ------
    DataError
        If a text is none.
    """
    found: dict[str, Any] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not key.isidentifier() or not equals or key in found:
            raise DataError(f"--set takes KEY=VALUE, each key once, got {text!r}")
        try:
            found[key] = json.loads(value)
        except ValueError:
            found[key] = value
    return found


def open_root(root: Path | str | None) -> DatasetFolder:
    """Open the dataset folder that ``--root`` names, or the one there is without it.

    What its finder warns of becomes a note, for :func:`tell_notes`.

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
    _notes().extend(str(note.message) for note in notes)
    return folder


def tell_notes() -> None:
    """Write what was noted to stderr, each a line, once."""
    for note in _notes():
        click.echo(f"note: {note}", err=True)
    _notes().clear()


def _notes() -> list[str]:
    """Return the notes of the command that is running."""
    notes: list[str] = click.get_current_context().meta.setdefault(NOTES, [])
    return notes
