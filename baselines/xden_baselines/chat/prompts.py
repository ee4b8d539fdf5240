"""What a chat model is asked of materials, after NeRF2Physics' prompts, in words of our own.

A wording that changes gets a new version in its request: recorded answers belong to one wording.
"""

from __future__ import annotations

__all__ = [
    "CAPTION",
    "JSON",
    "MATERIALS",
    "SUBJECT",
    "THICKNESS",
    "THICKNESS_EXAMPLES",
    "of_object",
]

CAPTION = """Describe the object in the picture in one sentence of at most 30 words: what it is, \
which parts it has, and what they look like. Answer with nothing but that sentence."""

MATERIALS = """You are told, in quotes, what an object is; a picture of it may be attached. Which \
materials may it consist of? Think of all of its parts, inside as well as outside; leave out \
coatings and paint. Name exactly 5 different ones, likeliest first, and the range of each one's \
mass density in kg/m^3.
A program reads your answer: give nothing but a list in this form, items divided by semicolons:
(material 1: low-high kg/m^3);(material 2: low-high kg/m^3);(material 3: low-high kg/m^3);\
(material 4: low-high kg/m^3);(material 5: low-high kg/m^3)"""

THICKNESS = """You are told, in quotes, what an object is, and which materials it may consist of; \
a picture of it may be attached. How thick, in cm, is each of these in it: the wall of a hollow \
part, the full depth of a solid one? Give a range for each.
A program reads your answer: give nothing but a list in this form, with exactly the names you are \
given, items divided by semicolons:
(material 1: low-high cm);(material 2: low-high cm);(material 3: low-high cm)"""

_EXAMPLES = {
    "a desk lamp with a cloth shade on a turned foot": {
        "cotton": "0.05-0.1",
        "brass": "0.1-0.2",
        "beech wood": "2.0-4.0",
        "abs plastic": "0.2-0.3",
        "glass": "0.1-0.3",
    },
    "a low upholstered stool": {
        "plywood": "1.0-2.0",
        "polyurethane foam": "4.0-12.0",
        "wool fabric": "0.2-0.4",
        "steel": "0.1-0.3",
        "polypropylene": "0.3-0.6",
    },
    "a picture in a narrow black frame": {
        "pine wood": "1.0-2.0",
        "glass": "0.2-0.3",
        "cardboard": "0.1-0.3",
        "aluminium": "0.1-0.2",
        "polystyrene": "0.5-1.5",
    },
    "a shelf of bent wire with three tiers": {
        "steel": "0.2-0.6",
        "stainless steel": "0.2-0.5",
        "aluminium": "0.3-0.8",
        "rubber": "0.3-1.0",
        "abs plastic": "0.2-0.5",
    },
}
"""A lamp, an upholstered seat, a frame and a rack, as in the original; the figures are estimates
of household things, taken from no dataset."""

JSON = """{subject}
Which materials may it consist of? Think of all of its parts, inside as well as outside; leave out \
coatings and paint. Name exactly 5 different ones, likeliest first, with the range of the mass \
density in kg/m^3 and the range of the thickness in cm: the wall of a hollow part, the full depth \
of a solid one.
Answer with nothing but JSON in this form:
{{"materials": [{{"name": "...", "density_kg_m3": [low, high], "thickness_cm": [low, high]}}]}}"""

SUBJECT = "The object is described as: {description}.{picture}"


def of_object(description: str, names: tuple[str, ...] = ()) -> str:
    """Return the question about an object, and about these of its materials if there are any.

    Examples
    --------
    >>> of_object("a pot", ("steel", "oak"))
    'Object: "a pot" Materials: steel, oak'
    """
    question = f'Object: "{description}"'
    return f"{question} Materials: {', '.join(names)}" if names else question


def _example(description: str, thicknesses: dict[str, str]) -> tuple[str, str]:
    """Return a question about thicknesses, and its answer."""
    answer = ";".join(f"({name}: {values} cm)" for name, values in thicknesses.items())
    return of_object(description, tuple(thicknesses)), answer


THICKNESS_EXAMPLES = tuple(_example(*each) for each in _EXAMPLES.items())
"""Four questions about thicknesses, each with its answer."""
