"""Responsible-AI fields of a Croissant document, from the answers of the datasheet.

The words are those of the Croissant RAI vocabulary, version 1.0
(https://docs.mlcommons.org/croissant/docs/croissant-rai-spec.html).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from xden1k.documents.answers import answer
from xden1k.documents.facts import Facts
from xden1k.documents.statements import label_voxels_text, materials_text

__all__ = ["RAI_VERSION", "responsible_fields"]

RAI_VERSION: Final = "http://mlcommons.org/croissant/RAI/1.0"
"""What such a document says to conform to."""
_COLLECTION_TYPES: Final = {
    "scan": "Direct measurement",
    "ct": "Secondary Data analysis",
    "phantom": "Software Collection",
    "published": "Secondary Data analysis",
}
"""Of each source, in the words of the vocabulary."""
_ONE_TEXT: Final = {
    "dataCollection": ("collection.acquired", "collection.mechanisms"),
    "dataCollectionMissingData": ("composition.missing",),
    "dataReleaseMaintenancePlan": ("maintenance.updates", "maintenance.older_versions"),
}
_TEXTS: Final = {
    "dataPreprocessingProtocol": ("preprocessing.done",),
    "dataBiases": ("composition.sample", "uses.consequences"),
    "dataUseCases": ("motivation.purpose", "uses.other_tasks"),
    "personalSensitiveInformation": (
        *("composition.individuals", "composition.sensitive", "composition.confidential"),
    ),
}
"""Questions whose answers a field gives: fields of one text, fields of several."""


def responsible_fields(facts: Facts) -> dict[str, Any]:
    """Give every field that there is something to say in, ``rai:`` before its name."""
    manifest = facts.manifest
    fields: dict[str, Any] = {
        "dataCollectionType": list(
            dict.fromkeys(_COLLECTION_TYPES[source] for source in manifest.sources)
        ),
        "dataAnnotationProtocol": [materials_text(manifest)],
        "annotationsPerItem": "One mesh, and one material or none, for each part.",
        "machineAnnotationTools": [manifest.builder],
        "dataLimitations": [label_voxels_text(manifest), *_answers(facts, ["uses.not_for"])],
        **{name: "\n\n".join(_answers(facts, keys)) for name, keys in _ONE_TEXT.items()},
        **{name: _answers(facts, keys) for name, keys in _TEXTS.items()},
    }
    return {f"rai:{name}": value for name, value in fields.items() if value}


def _answers(facts: Facts, keys: Sequence[str]) -> list[str]:
    return [text for key in keys if (text := answer(facts, key))]
