"""``xden-build datasheet``: what a maintainer answers, into a dataset folder."""

from __future__ import annotations

from pathlib import Path

import click

from xden1k.commands import json_option, print_json
from xden_builder.commands.shared import FOLDER

__all__ = ["datasheet"]

FILE = click.Path(path_type=Path, dir_okay=False)


@click.command(epilog="Example: xden-build datasheet dataset --answers datasheet.toml")
@click.argument("root", type=FOLDER, required=False)
@click.option(
    "--answers", type=FILE, help="What you answer.", show_default="datasheet.toml in the folder"
)
@click.option("--template", type=FILE, help="Write a file with every question instead.")
@json_option
def datasheet(
    root: Path | None, answers: Path | None, template: Path | None, as_json: bool
) -> None:
    """Write the datasheet of a dataset folder anew, with your answers.

    Whatever the data cannot tell is for you to answer: who made and paid for it, consent, contact.
    The answers stay in the folder. A --template has every question; with ROOT it says which of
    them the data of this folder answer. Beside captures, the file goes into what is built of them.
    """
    if template is not None and answers is None:
        _write_template(template, root, as_json)
    elif root is None or template is not None:
        raise click.UsageError("ROOT is needed, or --template alone or with ROOT")
    else:
        _renew(root, answers, as_json)


def _write_template(template: Path, root: Path | None, as_json: bool) -> None:
    from xden1k.documents.answers import answered_by_data
    from xden1k.documents.maintainer import Answers, template_text
    from xden1k.errors import DataError
    from xden1k.folder.documents import folder_facts

    if template.exists():
        raise DataError(f"{template} exists: remove it yourself, or choose another")
    answered = [] if root is None else answered_by_data(folder_facts(root, Answers()))
    template.write_text(template_text(answered), encoding="utf-8")
    if as_json:
        print_json({"template": str(template), "answered_by_data": answered})
    else:
        click.echo(template)


def _renew(root: Path, answers: Path | None, as_json: bool) -> None:
    from xden1k.documents.answers import unanswered
    from xden1k.documents.maintainer import Answers
    from xden1k.documents.questions import QUESTIONS
    from xden1k.folder.documents import renew_datasheet

    said = Answers.of_folder(root) if answers is None else Answers.read(answers)
    left = unanswered(renew_datasheet(root, said))
    if as_json:
        print_json({"root": str(root), "questions": len(QUESTIONS), "unanswered": left})
    else:
        told = f"{len(QUESTIONS) - len(left)} of {len(QUESTIONS)} questions answered"
        click.echo(f"{root / 'DATASHEET.md'}: {told}")
        for key in left:
            click.echo(f"unanswered: {key}")
