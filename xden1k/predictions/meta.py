"""What a submission says about itself: the JSON in ``__meta__``."""

from __future__ import annotations

import json
import re
import reprlib
from collections.abc import Callable, Iterator, Mapping, Set
from dataclasses import asdict, dataclass, fields
from typing import Any, Literal, TypeVar, get_args

from xden1k.predictions.problems import Problem
from xden1k.values.modality import INPUTS, Modality, Track, track_of

__all__ = [
    "COMMENT_MARKS",
    "MAX_TEXT",
    "SCHEMA",
    "SEGMENTS_SCHEMA",
    "MethodMeta",
    "SegmentsMeta",
    "SubmissionMeta",
    "Target",
    "Units",
    "parse_meta",
]

SCHEMA = "xden-submission/1"
"""Of densities, ``preds.npz``."""
SEGMENTS_SCHEMA = "xden-segments/1"
"""Of segments, ``segments.npz``."""
Units = Literal["g/cm3", "kg/m3"]
Target = Literal["density", "apparent_density"]
MAX_TEXT = 500
"""Characters in any one text; a method's name has at most :data:`MAX_NAME`."""
MAX_NAME = 80
COMMENT_MARKS = ("<!--", "-->")
"""Of HTML, and so of Markdown."""
_BRIEF = reprlib.Repr()
_BRIEF.maxlevel, _BRIEF.maxstring = 3, 100


@dataclass(frozen=True, slots=True)
class MethodMeta:
    """What every submission says about its method, and what was predicted.

    Parameters
    ----------
    method
        Display name, at most 80 characters of ASCII, a letter or digit among them.
    dataset_revision, config, split
        What was predicted: the manifest's version, ``default``, and one of its splits.
    inputs
        Any of ``mesh``, ``rgb``, ``parts``, ``text``, ``xray``, ``materials``, ``truth``:
        everything the method looked at. They decide the track, and whether the row has a rank.
    training_data
        Every data set trained on; may be empty.
    external_data
        True if anything beyond this data set was used, pretrained weights included.
    code, paper, command, notes
        Where the code and the paper are, the command that made the file, and what a reader of
        the row must know; empty if nothing.
    seconds_per_object, processor_seconds_per_object
        Run time, and processor time of the method's process: all its threads; if measured.
    peak_memory_gb
        The most main memory that process held, 1e9 bytes; if measured.
    hardware
        What time and memory were measured on; empty if not told.
    seed
        Of the method, if it draws random numbers.
    manifest_sha256
        Checksum of the dataset's ``manifest.json``, 64 hexadecimal digits; empty if not told.
        Unlike the revision it tells any two datasets apart.
    """

    method: str
    dataset_revision: str
    config: str
    split: str
    inputs: tuple[str, ...]
    training_data: tuple[str, ...]
    external_data: bool
    code: str = ""
    paper: str = ""
    command: str = ""
    notes: str = ""
    seconds_per_object: float | None = None
    processor_seconds_per_object: float | None = None
    peak_memory_gb: float | None = None
    seed: int | None = None
    manifest_sha256: str = ""
    hardware: str = ""

    @property
    def reads(self) -> Modality:
        """The inputs as flags."""
        return Modality.of_inputs(self.inputs)

    @property
    def track(self) -> Track:
        """The track its inputs put it in."""
        return track_of(self.reads)

    def to_json(self) -> str:
        """Return the text of ``__meta__``: keys sorted, nothing that is not set."""
        values = {key: value for key, value in asdict(self).items() if value not in ("", None)}
        return json.dumps(values, sort_keys=True, ensure_ascii=False)


@dataclass(frozen=True, slots=True)
class SubmissionMeta(MethodMeta):
    """What a submission of densities says about itself, beside :class:`MethodMeta`.

    Parameters
    ----------
    units
        Of the arrays as stored; readers get g/cm³ in either case.
    target
        ``density``, or ``apparent_density`` (LAC / 0.17, the paper's).
    """

    units: Units = "g/cm3"
    target: Target = "density"
    schema: str = SCHEMA


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentsMeta(MethodMeta):
    """What a submission of segments says about itself, beside :class:`MethodMeta`.

    Parameters
    ----------
    points_seed
        Of the protocol: which points of each object are labelled.
    points_sha256
        Checksum of the points of all objects: :func:`xden1k.segmentation.points_sha256`.
    """

    points_seed: int
    points_sha256: str
    schema: str = SEGMENTS_SCHEMA

    @property
    def target(self) -> str:
        """What is predicted."""
        return "segments"


Form = TypeVar("Form", bound=MethodMeta)


def parse_meta(text: str, form: type[Form]) -> tuple[Form | None, list[Problem]]:
    """Read the text of ``__meta__``.

    Parameters
    ----------
    text
        Of the array.
    form
        What the file must say: :class:`SubmissionMeta` or :class:`SegmentsMeta`.

    Returns
    -------
    meta, problems
        None if there is any problem, and every problem found: E201 to E204, E206.
    """
    try:
        values = json.loads(text, object_pairs_hook=_without_repeats)
    except (ValueError, RecursionError) as err:
        return None, [Problem("E201", None, f"__meta__ is not JSON: {err}")]
    if not isinstance(values, dict):
        return None, [Problem("E201", None, "__meta__ must be a JSON object")]
    known = {field.name: field.default for field in fields(form)}
    if values.get("schema") != known["schema"]:
        found = _shown(values.get("schema"))
        return None, [Problem("E202", None, f"schema must be {known['schema']!r}, got {found}")]
    if problems := _field_problems(values, known.keys()):
        return None, problems
    lists = {key: tuple(values[key]) for key in ("inputs", "training_data")}
    return form(**{**values, **lists}), []


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Refuse a key that comes twice: which value counts would be up to the reader."""
    values = dict(pairs)
    if len(values) < len(pairs):
        raise ValueError("a key comes twice in one object")
    return values


def _shown(value: object) -> str:
    """Show what a stranger wrote, in 60 printable characters; nesting of any depth is harmless."""
    text = _BRIEF.repr(value).encode("ascii", "backslashreplace").decode()
    return text if len(text) <= 60 else text[:60] + "..."


def _field_problems(values: Mapping[str, Any], known: Set[str]) -> list[Problem]:
    """Every field that is missing, unknown or wrong."""
    problems = [
        Problem("E203", None, f"unknown field {_shown(key)}; known are {sorted(known)}")
        for key in sorted(values.keys() - known)
    ]
    for key, (code, expected, is_valid) in _RULES.items():
        if key not in values:
            if key in _REQUIRED & known:
                problems.append(Problem(code, None, f"{key} is missing: it must be {expected}"))
        elif not is_valid(values[key]):
            message = f"{key} must be {expected}, got {_shown(values[key])}"
            problems.append(Problem(code, None, message))
    return [*problems, *_comment_problems(values)]


def _is_text(value: object, most: int = MAX_TEXT) -> bool:
    """One printable line. Lone surrogates and line breaks are not printable."""
    return isinstance(value, str) and len(value) <= most and value.isprintable()


def _comment_problems(values: Mapping[str, Any]) -> Iterator[Problem]:
    """Refuse marks of an HTML comment, which would hide what follows wherever a text is shown."""
    for key, value in values.items():
        for text in value if isinstance(value, list) else [value]:
            if isinstance(text, str) and any(mark in text for mark in COMMENT_MARKS):
                expected = " nor ".join(COMMENT_MARKS)
                yield Problem("E206", None, f"{key} must hold neither {expected}: {_shown(text)}")


def _is_name(value: object) -> bool:
    """ASCII: beyond it lie letters that look like others, and invisible characters."""
    text = str(value)
    return _is_text(value, MAX_NAME) and text.isascii() and any(map(str.isalnum, text))


def _is_texts(value: object, most: int = 20) -> bool:
    return isinstance(value, list) and len(value) <= most and all(map(_is_text, value))


def _is_inputs(value: object) -> bool:
    return _is_texts(value) and isinstance(value, list) and set(value) <= set(INPUTS)


def _is_amount(value: object) -> bool:
    # false for nan as well, which JSON's reader lets through
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < 1e9


def _is_seed(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**63


def _is_sha256(value: object) -> bool:
    return isinstance(value, str) and bool(re.fullmatch("[0-9a-f]{64}", value))


_NAME = (
    "E203",
    f"one printable line of 1 to {MAX_NAME} characters of ASCII with a letter or digit",
    _is_name,
)
_TEXT = ("E203", f"one printable line of at most {MAX_TEXT} characters", _is_text)
_AMOUNT = ("E203", "a number >= 0", _is_amount)
_RULES: Mapping[str, tuple[str, str, Callable[[object], bool]]] = {
    "method": _NAME,
    "dataset_revision": _NAME,
    "config": _NAME,
    "split": _NAME,
    "inputs": ("E203", f"a list of any of {INPUTS}", _is_inputs),
    "training_data": ("E203", "a list of at most 20 lines of text", _is_texts),
    "external_data": ("E203", "true or false", lambda value: isinstance(value, bool)),
    "units": ("E204", f"one of {get_args(Units)}", lambda value: value in get_args(Units)),
    "target": ("E203", f"one of {get_args(Target)}", lambda value: value in get_args(Target)),
    "code": _TEXT,
    "paper": _TEXT,
    "command": _TEXT,
    "notes": _TEXT,
    "hardware": _TEXT,
    "seconds_per_object": _AMOUNT,
    "processor_seconds_per_object": _AMOUNT,
    "peak_memory_gb": _AMOUNT,
    "seed": ("E203", "an integer from 0 to 2**63 - 1", _is_seed),
    "manifest_sha256": ("E203", "64 hexadecimal digits", _is_sha256),
    "points_seed": ("E203", "an integer from 0 to 2**63 - 1", _is_seed),
    "points_sha256": ("E203", "64 hexadecimal digits", _is_sha256),
}
_REQUIRED = frozenset(
    {
        "method",
        "dataset_revision",
        "config",
        "split",
        "inputs",
        "training_data",
        "external_data",
        "points_seed",
        "points_sha256",
    }
)
