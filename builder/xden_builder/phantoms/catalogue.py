"""What there is to simulate: categories, and the materials that their parts are made of.

A new category goes to the end: which split an object falls into depends on the place of its
category.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

__all__ = ["CATALOGUE", "Category"]


@dataclass(frozen=True, slots=True)
class Category:
    """One kind of object.

    Parameters
    ----------
    name, family
        Its class, and the group of classes it belongs to.
    archetype
        A key of :data:`xden_builder.phantoms.archetypes.ARCHETYPES`.
    size_cm
        Least and largest length (of what lies) or height (of what stands).
    materials
        By role of a part: names of the material library, separated by spaces, all as likely.
    """

    name: str
    family: str
    archetype: str
    size_cm: tuple[float, float]
    materials: Mapping[str, str]


_STEEL = "steel stainless_steel_304"
_SHELL = "pp abs pc"
_RUBBER = "silicone rubber_natural rubber_filled"
_DEVICE = {
    "cell": "alkaline_cell",
    "spring": "steel",
    "contact": "nickel_silver brass",
    "board": "pcb_fr4",
    "button": _RUBBER,
    "keypad": "silicone",
    "chip": "epoxy",
    "lamp": "epoxy",
}

CATALOGUE: Final = (
    Category(
        "screwdriver",
        "hand tools",
        "screwdriver",
        (14.0, 27.0),
        {"shaft": _STEEL, "sleeve": _RUBBER, "handle": "pp abs nylon_6 wood_beech"},
    ),
    Category(
        "water_bottle",
        "containers",
        "bottle",
        (18.0, 26.0),
        {"shell": "pet hdpe pp", "liquid": "water", "cap": "pp hdpe"},
    ),
    Category(
        "remote_control",
        "consumer electronics",
        "remote_control",
        (14.0, 20.0),
        {**_DEVICE, "shell": "abs ps pc"},
    ),
    Category(
        "hammer",
        "hand tools",
        "hammer",
        (24.0, 30.0),
        {"wedge": "steel wood_beech", "handle": "wood_beech wood_oak", "head": "steel cast_iron"},
    ),
    Category("rubber_ball", "toys", "ball", (3.0, 14.0), {"body": "rubber_natural rubber_filled"}),
    Category(
        "mug", "kitchenware", "mug", (8.0, 11.0), {"shell": "porcelain earthenware glass_soda_lime"}
    ),
    Category(
        "flashlight",
        "consumer electronics",
        "flashlight",
        (13.0, 24.0),
        {
            **_DEVICE,
            "reflector": "abs aluminium",
            "lens": "pmma pc glass_soda_lime",
            "shell": "abs aluminium_6061",
        },
    ),
    Category(
        "scissors",
        "stationery",
        "scissors",
        (13.0, 22.0),
        {"rivet": _STEEL, "blade": "stainless_steel_304", "handle": "pp abs"},
    ),
    Category(
        "jar",
        "containers",
        "jar",
        (8.0, 16.0),
        {"shell": "glass_soda_lime pet", "liquid": "water_like oil_vegetable", "lid": "steel pp"},
    ),
    Category(
        "bolt",
        "hardware",
        "bolt",
        (4.0, 12.0),
        {"bolt": "steel brass nylon_66", "washer": "steel brass", "nut": "steel brass"},
    ),
    Category(
        "baseball",
        "sports equipment",
        "cored_ball",
        (7.2, 7.6),
        {"core": "cork rubber_natural", "winding": "cotton_fabric", "cover": "leather"},
    ),
    Category(
        "frying_pan",
        "cookware",
        "frying_pan",
        (22.0, 29.0),
        {
            "rivet": "aluminium stainless_steel_304",
            "pan": "aluminium_cast steel",
            "bracket": "stainless_steel_304",
            "handle": "phenolic wood_beech",
        },
    ),
    Category(
        "ballpoint_pen",
        "stationery",
        "pen",
        (13.0, 15.0),
        {
            "point": "brass",
            "ink": "glycerol",
            "refill": "pp",
            "spring": "steel",
            "button": "abs pom",
            "clip": "steel pc",
            "barrel": "ps abs",
        },
    ),
    Category(
        "padlock",
        "hardware",
        "padlock",
        (4.5, 9.0),
        {
            "shackle": "steel",
            "pin": "brass nickel_silver",
            "plug": "brass",
            "shell": "brass zamak_3 aluminium_6061",
        },
    ),
    Category(
        "kettle",
        "kitchenware",
        "kettle",
        (18.0, 23.0),
        {
            "plate": "stainless_steel_304",
            "shell": "pp stainless_steel_304 glass_borosilicate",
            "liquid": "water",
            "base": "pp",
            "lid": "pp",
            "handle": "pp",
        },
    ),
    Category(
        "dumbbell",
        "sports equipment",
        "dumbbell",
        (14.0, 24.0),
        {"bar": "steel", "weight": "cast_iron concrete", "coat": "neoprene pvc_soft"},
    ),
    Category(
        "pencil",
        "stationery",
        "pencil",
        (9.0, 19.0),
        {
            "ferrule": "aluminium brass",
            "lead": "graphite",
            "eraser": "rubber_filled pvc_soft",
            "wood": "wood_pine wood_generic",
        },
    ),
    Category(
        "glue_stick",
        "stationery",
        "glue_stick",
        (8.0, 12.0),
        {
            "screw": "pp",
            "holder": "pp",
            "glue": "water_like",
            "knob": "pp",
            "shell": "pp",
            "cap": "pp",
        },
    ),
    Category(
        "glass_bottle",
        "containers",
        "bottle",
        (18.0, 28.0),
        {
            "shell": "glass_soda_lime",
            "liquid": "water oil_vegetable ethanol",
            "cap": "pp aluminium",
        },
    ),
)
"""Every category; an object takes the next one, over and over."""
