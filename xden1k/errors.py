"""Every error this project raises on purpose.

::

    XDenError(Exception)
    ├── DataError(ValueError)             a file or an array breaks the format
    │   ├── ObjectError                   the same, of one object of a dataset
    │   └── SubmissionError               the same, in a file sent for scoring
    ├── MissingObjectError(LookupError)   no object of that id
    ├── ModalityError                     a method touched what it did not declare (modality.py)
    └── MissingExtraError(ImportError)    an optional dependency is not installed

The commands turn each of them into one line on stderr and exit code 1.
"""

import difflib
import importlib
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Final

__all__ = [
    "DataError",
    "MissingExtraError",
    "MissingObjectError",
    "ObjectError",
    "SubmissionError",
    "XDenError",
    "about",
    "did_you_mean",
    "install_command",
    "of_dataset",
    "require",
]

_PROJECT: Final = Path(__file__).parents[1]


class XDenError(Exception):
    """Base of every deliberate error."""


class DataError(XDenError, ValueError):
    """A file or an array breaks the format: what was expected, what came, and where."""


class ObjectError(DataError):
    """One object of a dataset cannot be used; the message names it."""


class SubmissionError(DataError):
    """A file sent for scoring is not valid.

    Parameters
    ----------
    problems
        Every problem found, one line each, at least one.
    """

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("\n".join(problems))
        self.problems = tuple(problems)


class MissingObjectError(XDenError, LookupError):
    """The dataset has no object of that id."""


class MissingExtraError(XDenError, ImportError):
    """An optional dependency is not installed; the message gives the pip command."""


@contextmanager
def about(object_id: str) -> Iterator[None]:
    """Name the object in whatever is found wrong in this block, unless it is named.

    Parameters
    ----------
    object_id
        As in the dataset.

    Raises
    ------
    ObjectError
        In place of a DataError.

    Examples
    --------
    >>> with about("mug-0001"):
    ...     raise DataError("part 0 is not a closed mesh")
    Traceback (most recent call last):
    xden1k.errors.ObjectError: mug-0001: part 0 is not a closed mesh
    """
    try:
        yield
    except ObjectError:
        raise
    except DataError as err:
        named = re.search(rf"(?<![\w/-]){re.escape(object_id)}(?![\w/-])", str(err))
        raise ObjectError(f"{err}" if named else f"{object_id}: {err}") from err


@contextmanager
def of_dataset(root: object) -> Iterator[None]:
    """Name the dataset beside an object that is found wrong in this block, unless it is named.

    Parameters
    ----------
    root
        Its folder or URL.

    Raises
    ------
    ObjectError
        In place of one that names the object alone.

    Examples
    --------
    >>> with of_dataset("data"), about("mug-0001"):
    ...     raise DataError("part 0 is not a closed mesh")
    Traceback (most recent call last):
    xden1k.errors.ObjectError: data: mug-0001: part 0 is not a closed mesh
    """
    try:
        yield
    except ObjectError as err:
        named = re.match(rf"{re.escape(str(root))}[:/]", str(err))
        raise ObjectError(f"{err}" if named else f"{root}: {err}") from err


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean ...?"`` where a known name is close to one, else nothing.

    Examples
    --------
    >>> did_you_mean("mugg", ["mug", "bottle"])
    '; did you mean mug?'
    >>> did_you_mean("xyz", ["mug", "bottle"])
    ''
    """
    near = difflib.get_close_matches(name, list(known), n=3)
    return f"; did you mean {' or '.join(near)}?" if near else ""


def install_command(extra: str) -> str:
    """Return the pip command that installs an extra: of this checkout, where it is one."""
    if (_PROJECT / "pyproject.toml").is_file():
        return f"pip install -e '{_PROJECT}[{extra}]'"
    return f"pip install 'xden1k[{extra}]'"


def require(module: str, extra: str) -> ModuleType:
    """Import an optional dependency.

    Parameters
    ----------
    module
        Name of the module to import.
    extra
        The extra of this package that installs it.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as err:
        raise MissingExtraError(
            f"{module} is needed here: {install_command(extra)} ({err})"
        ) from err
