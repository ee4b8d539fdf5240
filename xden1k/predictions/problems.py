"""What can be wrong with a submission: stable codes, one line for each finding."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from xden1k.errors import SubmissionError

__all__ = [
    "CODES",
    "SUSPICIONS",
    "Problem",
    "listed",
    "raise_errors",
    "raise_suspicions",
    "shortened",
]

CODES = {
    "E101": "not a readable .npz",
    "E102": "declared size or compression ratio beyond what the grid allows",
    "E103": "object array (a pickle, never loaded)",
    "E104": "unknown key, or a member that is no .npy",
    "E105": "duplicate member",
    "E201": "__meta__ missing, not a 0-d string, or not JSON",
    "E202": "schema not supported",
    "E203": "field of __meta__ missing, unknown or of the wrong type",
    "E204": "unknown units",
    "E205": "revision, manifest, config, split, track or target is not what is being scored",
    "E206": "a text of __meta__ holds the mark of an HTML comment",
    "E207": "the template's name, not filled in",
    "E301": "objects missing",
    "E302": "objects not in the split",
    "E303": "density_sd of some objects only, or without its density",
    "E401": "dtype is not little-endian float32 or float16",
    "E402": "shape is not (64, 64, 64), or (parts + 1,)",
    "E403": "NaN, infinity or above 1e9",
    "E404": "negative density or density_sd",
    "E405": "mass, but none of it inside the object",
    "E406": "air, entry 0 of part_density or part_density_sd, is not 0",
    "E407": "above the protocol's physical limit",
    "W501": "units look wrong",
    "W502": "one constant for all objects",
    "W503": "mass outside the object",
    "W504": "the values of the reference",
    "W505": "the values of a trivial method",
    "W506": "axes look exchanged or turned over",
}
"""Every code and its meaning. E: the file is refused. W: a footnote to the row."""
SUSPICIONS = ("W501", "W506")
"""Footnotes that are nearly always a slip: commands refuse the file unless told it is meant."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One finding about a submission.

    Parameters
    ----------
    code
        A key of :data:`CODES`.
    object_id
        The object concerned; None if it is the file as a whole.
    message
        What was expected and what came, on one line.

    Examples
    --------
    >>> str(Problem("E403", "mug-0001", "3 values are not finite, first at (0, 1, 2)"))
    'E403 mug-0001: 3 values are not finite, first at (0, 1, 2)'
    """

    code: str
    object_id: str | None
    message: str

    def __str__(self) -> str:
        where = f" {self.object_id}" if self.object_id is not None else ""
        return f"{self.code}{where}: {self.message}"

    @property
    def is_error(self) -> bool:
        """True if the file is refused because of it."""
        return self.code.startswith("E")


def raise_errors(problems: Iterable[Problem], path: Path | None = None) -> None:
    """Raise what is an error, all at once.

    Parameters
    ----------
    problems
        Of one file.
    path
        The file, to be named on each line; None where it is the only one.

    Raises
    ------
    SubmissionError
        If there is an error among the problems.
    """
    where = f"{path}: " if path else ""
    if errors := [f"{where}{problem}" for problem in problems if problem.is_error]:
        raise SubmissionError(errors)


def raise_suspicions(problems: Iterable[Problem]) -> None:
    """Raise what is nearly always a slip, all at once.

    Raises
    ------
    SubmissionError
        If there is one of :data:`SUSPICIONS` among the problems.
    """
    found = [problem for problem in problems if problem.code in SUSPICIONS]
    if found:
        raise SubmissionError([f"{one} (if it is meant: --accept-warnings)" for one in found])


def shortened(problems: Iterable[Problem], most: int = 200) -> Iterator[Problem]:
    """Give the problems of ``most`` objects for each code, then one for all others.

    Examples
    --------
    >>> many = [Problem("E104", name, "not an .npy array") for name in "abcd"]
    >>> [str(one) for one in shortened(many, most=2)]
    ['E104 a: not an .npy array', 'E104 b: not an .npy array', "E104: and so on, 2: 'c', 'd'"]
    """
    objects: dict[str, list[str]] = {}
    for problem in problems:
        if problem.object_id is None:
            yield problem
            continue
        told = objects.setdefault(problem.code, [])
        told.append(problem.object_id)
        if len(told) <= most:
            yield problem
    for code, told in objects.items():
        if len(told) > most:
            yield Problem(code, None, f"and so on, {listed(told[most:])}")


def listed(names: Iterable[str], most: int = 5) -> str:
    """Count and first few names, safe to print whatever they hold.

    Examples
    --------
    >>> listed(["a", "b", "c"], most=2)
    "3: 'a', 'b', ..."
    """
    every = sorted(names)
    shown = [ascii(name if len(name) <= 60 else name[:60] + "...") for name in every[:most]]
    return f"{len(every)}: " + ", ".join(shown + ["..."] * (len(every) > most))
