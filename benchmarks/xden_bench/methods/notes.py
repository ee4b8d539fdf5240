"""What a row must say of the answers it is made of, and when they make no row."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from xden1k.errors import DataError
from xden1k.predictions import MAX_TEXT
from xden_bench.methods.partial import Facts

__all__ = ["counted", "counts", "refuse_silence", "short"]

MOST_FALLBACKS: Final = 0.05
"""Of a model's answers: of more a row would not be the model's it names."""
MOST_MISSING: Final = 0.5
"""Of the answers asked of a model that nobody stands in for: of more a row would say nothing."""


def counts(facts: Sequence[Facts]) -> Iterator[str]:
    """Tell how many answers are not the model's, and where it was computed."""
    if fallbacks := sum(one.fallbacks for one in facts):
        objects = sum(one.fallbacks > 0 for one in facts)
        yield f"{fallbacks} of {_answers(facts)} answers by the fallback, on {objects} objects"
    if unanswered := sum(one.unanswered for one in facts):
        objects = sum(one.unanswered > 0 for one in facts)
        yield f"{unanswered} of {_answers(facts)} answers missing, on {objects} objects"
    if devices := sorted({one.device for one in facts} - {"cpu"}):
        yield f"computed on {', '.join(devices)}"


def _answers(facts: Sequence[Facts]) -> int:
    return sum(max(one.answers, one.fallbacks) for one in facts)


def refuse_silence(method: str, facts: Sequence[Facts]) -> None:
    """Refuse a row that would be of a substitute, or of guesses, rather than of its model.

    Raises
    ------
    DataError
        If over a twentieth of the answers are a substitute's, or over half are missing.
    """
    fallbacks, answers = sum(one.fallbacks for one in facts), _answers(facts)
    missing = sum(one.unanswered for one in facts)
    if missing > MOST_MISSING * answers:
        raise DataError(
            f"{method}: {missing} of {answers} answers are missing, over {MOST_MISSING:.0%}: such "
            "a row would say nothing of the model it names"
        )
    if fallbacks > MOST_FALLBACKS * answers:
        raise DataError(
            f"{method}: {fallbacks} of {answers} answers are the fallback's, over "
            f"{MOST_FALLBACKS:.0%}: such a row would not be the model's it names"
        )


def short(notes: Sequence[str], counts: Iterable[str]) -> str:
    """Join notes; where they are longer than a submission may have them, counts are not cut off."""
    text, end = "; ".join(filter(None, notes)), "; ".join(counts)[: MAX_TEXT // 2]
    room = MAX_TEXT - len(end) - 2 * bool(end)
    return "; ".join(filter(None, [text if len(text) <= room else f"{text[: room - 1]}…", end]))


def counted(texts: Sequence[str]) -> Iterator[str]:
    """Each text once, and of how many objects it is unless it is of all."""
    for text, count in sorted(Counter(filter(None, texts)).items()):
        yield text if count == len(texts) else f"{text} ({count} of {len(texts)} objects)"
