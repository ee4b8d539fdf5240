"""What the commands share: options, the dataset they speak of, a bar, the command line as given."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xden1k import commands
from xden1k.commands import ROOT, open_root
from xden1k.errors import DataError
from xden1k.values.modality import TRACKS

if TYPE_CHECKING:
    from xden_bench.scoring.bootstrap import Estimate
    from xden_bench.scoring.reference import Reference

__all__ = [
    "FILE",
    "FOLDER",
    "RESULTS",
    "command_line",
    "echo_lines",
    "interval_text",
    "key_option",
    "open_reference",
    "parse_command",
    "progress_bar",
    "protocol_option",
    "root_option",
    "sealed_option",
    "signing_key_option",
    "split_option",
    "track_option",
]

FILE = click.Path(path_type=Path, dir_okay=False)
FOLDER = click.Path(path_type=Path, file_okay=False)
RESULTS = Path("benchmarks/results")
"""Where entries lie in a checkout."""

root_option = click.option(
    "--root",
    type=ROOT,
    help="Dataset folder or URL. [default: XDEN1K_ROOT, the cache, the sample]",
)
split_option = click.option("--split", default="test", show_default=True, help="Split to score.")
protocol_option = click.option(
    "--protocol",
    type=click.Choice(["v2", "v1", "paper"]),  # PROTOCOLS, whose import takes NumPy's time
    default="v2",
    show_default=True,
    help="The rules.",
)
track_option = click.option(
    "--track",
    type=click.Choice(TRACKS),
    help="Refuse a submission whose inputs do not put it in this track.",
)
sealed_option = click.option(
    "--sealed", type=FILE, help="The sealed truth of the split private. Needs --key."
)
key_option = click.option(
    "--key", type=FILE, help="The organiser's key, which opens the sealed truth."
)

signing_key_option = click.option(
    "--signing-key", type=FILE, help="Sign with this key, from keygen --team."
)


def open_reference(
    root: Path | str | None,
    split: str,
    sealed: Path | None = None,
    key: Path | None = None,
    *,
    scoring: bool = True,
) -> Reference:
    """Open a split of the dataset that ``--root`` names as the truth.

    Where nothing is scored, the split private opens without its answers.

    Raises
    ------
    UsageError
        If of ``--sealed``, ``--key`` and the split private one lacks another.
    DataError
        If there is no such split, or its answers are sealed or do not open.
    """
    from xden1k.values.types import PRIVATE
    from xden_bench.scoring.reference import Reference
    from xden_bench.sealed import InputsReference, SealedReference, SealedTruth, read_key

    if sealed is None and key is None:
        kind = InputsReference if split == PRIVATE and not scoring else Reference
        return kind(open_root(root), split)
    if sealed is None or key is None or split != PRIVATE:
        raise click.UsageError(f"--sealed, --key and the split {PRIVATE} go together.")
    folder = open_root(root)
    return SealedReference(folder, split, SealedTruth(sealed, folder, read_key(key)))


def command_line(context: click.Context) -> str:
    """Return the command line as it was given, without what only changes the output."""
    return commands.command_line(context, "xden-bench")


def interval_text(one: Estimate, form: str) -> str:
    """Both ends of an interval in a format, a dash where there is none."""
    if one.interval is None:
        return "-"
    return " to ".join(format(end, form) for end in one.interval)


def parse_command(
    text: str,
    command: click.Command,
    defaults: Mapping[str, Any] | None = None,
    group: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the arguments of a printed command, as the command itself reads them.

    Nothing runs, and no shell sees the text.

    Parameters
    ----------
    text
        As it was printed.
    command
        That it is one of.
    defaults
        Of options that had another default when it was printed.
    group
        Names of the groups that the command is in.

    Raises
    ------
    DataError
        If it is another command, or one that would be a usage error.
    """
    try:
        words = shlex.split(text)
    except ValueError as err:
        raise DataError(f"no command can be read from {text!r}: {err}") from err
    path = ["xden-bench", *group, command.name or ""]
    if words[: len(path)] != path or "--help" in words:
        raise DataError(f"the command must be `{' '.join(path)} ...`, got {text!r}")
    try:
        rest = words[len(path) :]
        return command.make_context(path[-1], rest, default_map=defaults).params
    except click.ClickException as err:
        raise DataError(f"{text!r}: {err.format_message()}") from err


def progress_bar(object_ids: Sequence[str]) -> Iterable[str]:
    """Go through ids with a bar on stderr, if that is a terminal."""
    from tqdm import tqdm

    bar: Iterable[str] = tqdm(object_ids, unit="object", disable=None, leave=False)
    return bar


def echo_lines(first: str | None, rest: Iterable[object]) -> None:
    """Print lines."""
    for line in ([first] if first else []) + [str(one) for one in rest]:
        click.echo(line)
