"""The datasheet of a dataset folder: how it was made, and what it is not good for.

Its questions are those of Gebru et al., Datasheets for Datasets (doi:10.1145/3458723).
"""

from __future__ import annotations

from xden1k.documents.answers import answer, unanswered
from xden1k.documents.facts import Facts
from xden1k.documents.maintainer import ANSWERS_NAME
from xden1k.documents.questions import QUESTIONS, SECTIONS, number

__all__ = ["datasheet_text"]


def datasheet_text(facts: Facts) -> str:
    """Text of ``DATASHEET.md``: every question, then those that nobody has answered."""
    manifest = facts.manifest
    settings = f"`{manifest.config_sha256[:12]}`" if manifest.config_sha256 else "not recorded"
    head = f"""# Datasheet

Made by {manifest.builder}, data version {manifest.version}, settings {settings}. The questions are
those of Gebru et al., [Datasheets for Datasets](https://doi.org/10.1145/3458723), in short. What
the data can tell is answered from them, the rest by the maintainer, in `{ANSWERS_NAME}`.
"""
    return "\n".join([head, *(_section(facts, name) for name in SECTIONS), _open_questions(facts)])


def _section(facts: Facts, section: str) -> str:
    heading, questions = SECTIONS[section]
    blocks = [_block(facts, f"{section}.{name}") for name in questions]
    return "\n".join([f"## {heading}\n", *blocks])


def _block(facts: Facts, key: str) -> str:
    return f"### {number(key)} {QUESTIONS[key]}\n\n{answer(facts, key) or '*Unanswered.*'}\n"


def _open_questions(facts: Facts) -> str:
    lines = [f"- {number(key)} `{key}`: {QUESTIONS[key]}" for key in unanswered(facts)]
    return "\n".join(["## Unanswered questions\n", *(lines or ["None."]), ""])
