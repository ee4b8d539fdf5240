"""The training split's proposals as a table that can be kept in a file."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from xden1k.errors import DataError
from xden_baselines.chat.candidates import Candidate, MaterialProposer, Picture

__all__ = ["Proposals", "tabulate"]

UNSEEN = ""
"""No category is called so: its candidates are those of all objects."""


@dataclass(frozen=True, slots=True)
class Proposals:
    """What was proposed for each category.

    Parameters
    ----------
    source
        Who proposed it.
    by_category
        The candidates; those of an unseen category under the empty name.
    """

    source: str
    by_category: Mapping[str, tuple[Candidate, ...]]

    @property
    def fallbacks(self) -> int:
        """None: a table always answers."""
        return 0

    def propose(
        self, object_id: str, category: str, picture: Picture | None = None
    ) -> tuple[Candidate, ...]:
        """Look a category up."""
        return self.by_category.get(category, self.by_category[UNSEEN])

    def save(self, path: Path) -> None:
        """Write the table."""
        path.write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> Proposals:
        """Read what :meth:`save` wrote.

        Raises
        ------
        DataError
            If the file holds something else.
        """
        try:
            values = json.loads(path.read_text(encoding="utf-8"))
            by_category = {
                category: tuple(_candidate(one) for one in found)
                for category, found in values["by_category"].items()
            }
            if not all(by_category.values()) or UNSEEN not in by_category:
                raise DataError("every category, and the unseen one, needs candidates")
            return cls(str(values["source"]), by_category)
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as err:
            raise DataError(f"{path}: no table of proposals: {err}") from err


def tabulate(proposer: MaterialProposer, categories: Iterable[str]) -> Proposals:
    """Ask for the candidates of each category, and of one that nobody has seen."""
    names = sorted({*categories, UNSEEN})
    return Proposals(proposer.source, {name: proposer.propose("", name) for name in names})


def _candidate(values: Mapping[str, object]) -> Candidate:
    name, density, thickness = (values[key] for key in ("name", "density_g_cm3", "thickness_cm"))
    return Candidate(str(name), _range(density), _range(thickness))


def _range(value: object) -> tuple[float, float]:
    if not isinstance(value, list):
        raise TypeError(f"a range must be a list, got {value!r}")
    low, high = map(float, value)
    return low, high
