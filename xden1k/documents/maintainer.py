"""``datasheet.toml``: what a maintainer answers where the data cannot tell."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from xden1k.documents.questions import QUESTIONS, SECTIONS, number
from xden1k.errors import DataError, did_you_mean
from xden1k.format.remote import RemotePath

__all__ = ["ANSWERS_NAME", "Answers", "template_text"]

ANSWERS_NAME: Final = "datasheet.toml"
"""Its name, beside captures and in a dataset folder."""


@dataclass(frozen=True)
class Answers:
    """What a maintainer answers.

    Parameters
    ----------
    text
        The file as it is; empty where there is none.
    by_key
        Answers by the keys of the questions, none of them empty.
    """

    text: str = ""
    by_key: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def parse(cls, content: bytes, where: object) -> Answers:
        """Read the content of a file.

        Parameters
        ----------
        content
            UTF-8, with a table for each section: ``[motivation]``, ``funding = "..."``.
        where
            Name of the file, for messages.

        Raises
        ------
        DataError
            If it is not TOML, has an unknown key, or an answer that is no text.
        """
        try:
            text = content.decode()
            tables = tomllib.loads(text)
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as err:
            raise DataError(f"{where}: not valid TOML: {err}") from err
        return cls(text, dict(_answers(tables, where)))

    @classmethod
    def read(cls, path: Path | RemotePath) -> Answers:
        """Read a file.

        Raises
        ------
        DataError
            As :meth:`parse`, or if there is no such file.
        """
        try:
            return cls.parse(path.read_bytes(), path)
        except OSError as err:
            raise DataError(f"{path}: cannot be read: {err.strerror or err}") from err

    @classmethod
    def of_folder(cls, root: Path | RemotePath) -> Answers:
        """Read those in a folder; none where it has no such file.

        Raises
        ------
        DataError
            As :meth:`parse`.
        """
        path = root / ANSWERS_NAME
        try:
            return cls.parse(path.read_bytes(), path)
        except (FileNotFoundError, NotADirectoryError):
            return cls()


def _answers(tables: Mapping[str, Any], where: object) -> Iterator[tuple[str, str]]:
    for section, answers in tables.items():
        if not isinstance(answers, dict) or section not in SECTIONS:
            known = f"sections are {', '.join(f'[{name}]' for name in SECTIONS)}"
            raise DataError(
                f"{where}: unknown key {section}{did_you_mean(section, SECTIONS)}; {known}"
            )
        for name, answer in answers.items():
            _check(f"{section}.{name}", answer, where)
            if answer.strip():
                yield f"{section}.{name}", answer.strip()


def _check(key: str, answer: object, where: object) -> None:
    if key not in QUESTIONS:
        names = list(SECTIONS[key.partition(".")[0]][1])
        near = did_you_mean(key, QUESTIONS)
        raise DataError(f"{where}: unknown key {key}{near}; in its section are {', '.join(names)}")
    if not isinstance(answer, str):
        raise DataError(f"{where}: {key} must be a text in quotes, got {answer!r}")


def template_text(answered: Collection[str]) -> str:
    """Text of a ``datasheet.toml`` that answers nothing yet: every key, commented out.

    Parameters
    ----------
    answered
        Keys of questions that the data answer.
    """
    head = "# Answers for DATASHEET.md: take away the # before a key, and write between the quotes."
    tables = (_table(section, answered) for section in SECTIONS)
    return "\n".join([head, *tables])


def _table(section: str, answered: Collection[str]) -> str:
    heading, questions = SECTIONS[section]
    lines = [f"\n# {heading}", f"[{section}]"]
    for name, question in questions.items():
        key = f"{section}.{name}"
        told = " (answered from the data; yours follows)" * (key in answered)
        lines += [f"\n# {number(key)} {question}{told}", f'# {name} = ""']
    return "\n".join(lines) + "\n"
