"""The questions of a datasheet, after Gebru et al., Datasheets for Datasets, in short.

All 57 of them, in their order (doi:10.1145/3458723, section 3). Their numbers are ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

__all__ = ["COMMENTS", "QUESTIONS", "SECTIONS", "number"]

COMMENTS: Final = "comments"
"""The last question of every section, which nobody has to answer."""
_COMMENTS: Final = {COMMENTS: "Any other comments?"}

SECTIONS: Final[Mapping[str, tuple[str, Mapping[str, str]]]] = {
    "motivation": (
        "Motivation",
        {
            "purpose": "For what purpose was the dataset created: which task, which gap?",
            "creators": "Who created it, and on behalf of which entity?",
            "funding": "Who funded the creation, by which grant?",
            **_COMMENTS,
        },
    ),
    "composition": (
        "Composition",
        {
            "instances": "What do the instances represent? Are there several types?",
            "count": "How many instances are there, of each type?",
            "sample": "Are these all possible instances, or a sample of a larger set? "
            "Is it representative?",
            "content": "What data does each instance consist of: raw data or features?",
            "targets": "Is there a label or target for each instance?",
            "missing": "Is any information missing from individual instances, and why?",
            "relations": "Are relationships between instances made explicit?",
            "splits": "Are there recommended data splits, and why these?",
            "errors": "Are there errors, sources of noise, or redundancies?",
            "self_contained": "Is the dataset self-contained, or does it rely on external "
            "resources?",
            "confidential": "Does it contain data that might be considered confidential?",
            "offensive": "Does it contain data that might be offensive, insulting or threatening, "
            "or cause anxiety?",
            "subpopulations": "Does it identify any subpopulations, as by age or gender?",
            "individuals": "Is it possible to identify individuals, directly or indirectly?",
            "sensitive": "Does it contain data that might be considered sensitive in any way?",
            **_COMMENTS,
        },
    ),
    "collection": (
        "Collection process",
        {
            "acquired": "How was the data of each instance acquired: observed, reported, or "
            "derived, and was it verified?",
            "mechanisms": "What mechanisms or procedures collected the data, and how were they "
            "validated?",
            "sampling": "If it is a sample of a larger set, what was the sampling strategy?",
            "people": "Who was involved in the collection, and how were they compensated?",
            "timeframe": "Over what timeframe was the data collected?",
            "ethical_review": "Were any ethical review processes conducted?",
            "directly": "Was the data collected from the individuals themselves, or by way of "
            "third parties?",
            "notified": "Were the individuals notified about the collection?",
            "consent": "Did the individuals consent to the collection and use of their data?",
            "revocation": "If they consented, can they revoke it?",
            "impact": "Has the potential impact on data subjects been analysed?",
            **_COMMENTS,
        },
    ),
    "preprocessing": (
        "Preprocessing, cleaning, labeling",
        {
            "done": "Was any preprocessing, cleaning or labeling done?",
            "raw": "Was the raw data saved in addition?",
            "software": "Is the software that did it available?",
            **_COMMENTS,
        },
    ),
    "uses": (
        "Uses",
        {
            "so_far": "Has the dataset been used for any tasks already?",
            "repository": "Is there a repository that links to papers or systems that use it?",
            "other_tasks": "What other tasks could it be used for?",
            "consequences": "Is there anything in its composition, collection or preprocessing "
            "that might impact future uses?",
            "not_for": "Are there tasks for which it should not be used?",
            **_COMMENTS,
        },
    ),
    "distribution": (
        "Distribution",
        {
            "third_parties": "Will it be distributed to third parties outside of the entity it was "
            "created for?",
            "how": "How will it be distributed? Does it have a DOI?",
            "when": "When will it be distributed?",
            "license": "Under which copyright, licence or terms of use?",
            "restrictions": "Have third parties imposed restrictions on the data?",
            "regulations": "Do export controls or other regulatory restrictions apply?",
            **_COMMENTS,
        },
    ),
    "maintenance": (
        "Maintenance",
        {
            "maintainer": "Who will be supporting, hosting and maintaining the dataset?",
            "contact": "How can the owner, curator or manager be contacted?",
            "erratum": "Is there an erratum?",
            "updates": "Will it be updated: how often, by whom, and how is that told?",
            "retention": "If it relates to people, are there limits on the retention of their "
            "data?",
            "older_versions": "Will older versions continue to be supported?",
            "contributions": "If others want to extend or contribute to it, how can they?",
            **_COMMENTS,
        },
    ),
}
"""Heading and questions of each section, by the keys of ``datasheet.toml``."""

QUESTIONS: Final[Mapping[str, str]] = {
    f"{section}.{name}": question
    for section, (_, questions) in SECTIONS.items()
    for name, question in questions.items()
}
"""Every question by its key, ``SECTION.NAME``."""


def number(key: str) -> str:
    """Return the number of a question: of its section, and in it.

    Examples
    --------
    >>> number("motivation.funding"), number("maintenance.comments"), len(QUESTIONS)
    ('1.3', '7.8', 57)
    """
    section, _, name = key.partition(".")
    return f"{list(SECTIONS).index(section) + 1}.{list(SECTIONS[section][1]).index(name) + 1}"
