"""CLEVRER's attribute words and their fixed order (the order of every attribute index and logit in this package)."""

from collections.abc import Sequence
from typing import Literal, get_args

Color = Literal["gray", "red", "blue", "green", "brown", "cyan", "purple", "yellow"]
Material = Literal["metal", "rubber"]
Shape = Literal["cube", "sphere", "cylinder"]
COLORS: tuple[str, ...] = get_args(Color)
MATERIALS: tuple[str, ...] = get_args(Material)
SHAPES: tuple[str, ...] = get_args(Shape)
ATTRIBUTES = {"color": COLORS, "material": MATERIALS, "shape": SHAPES}
"""Words of each attribute."""
N_ATTRIBUTE_TRIPLES = len(COLORS) * len(MATERIALS) * len(SHAPES)
"""Number of attribute triples (48)."""
DIRECTIONS = ("towards the camera", "right", "away from the camera", "left")
"""Answers beyond CLEVRER: directions of motion at 0, 90, 180 and 270 degrees from the x axis to the y axis."""
IMAGE_DIRECTIONS = ("up and to the left", "up and to the right", "down and to the left", "down and to the right")
"""Answers beyond CLEVRER: where an object moves in the image, over the whole video."""
STATIONARY = "stationary"
"""The answer beyond CLEVRER for an object that does not move."""
SPEED_UNIT = "world units per second"
"""What stands after the number in an answer beyond CLEVRER; seconds are of simulated time."""

COLORS_RGB = {
    "gray": (87, 87, 87),
    "red": (173, 35, 35),
    "blue": (42, 75, 215),
    "green": (29, 105, 20),
    "brown": (129, 74, 25),
    "cyan": (41, 208, 208),
    "purple": (129, 38, 192),
    "yellow": (255, 238, 51),
}
"""sRGB (0-255) of each colour word, CLEVR's `properties.json`."""


def attribute_index(color: str, material: str, shape: str) -> int:
    """Index 0-47 of an attribute triple: `color * 6 + material * 3 + shape`."""
    return (COLORS.index(color) * len(MATERIALS) + MATERIALS.index(material)) * len(SHAPES) + SHAPES.index(shape)


def attributes_of(index: int) -> tuple[str, str, str]:
    """(color, material, shape) of an attribute index; inverse of `attribute_index`."""
    rest, shape = divmod(index, len(SHAPES))
    color, material = divmod(rest, len(MATERIALS))
    return COLORS[color], MATERIALS[material], SHAPES[shape]


def differing_words(words: Sequence[str], other: Sequence[str]) -> int:
    """In how many words two triples (color, material, shape) differ, such as those of a `SceneObject.name`."""
    return sum(a != b for a, b in zip(words, other, strict=True))


ADJECTIVES = {
    **{word: word for word in COLORS + MATERIALS},
    **{"grey": "gray", "metallic": "metal", "shiny": "metal", "rubbery": "rubber", "matte": "rubber", "matt": "rubber"},
    **dict.fromkeys(("steel", "chrome", "glossy", "reflective"), "metal"),
    **{"cubic": "cube", "cubical": "cube", "spherical": "sphere", "cylindrical": "cylinder"},
}
"""Attribute words before a noun, and what they mean."""

NOUNS = {
    **{shape: (shape, "N") for shape in SHAPES},
    **{f"{shape}s": (shape, "NS") for shape in SHAPES},
    **{"ball": ("sphere", "N"), "balls": ("sphere", "NS"), "block": ("cube", "N"), "blocks": ("cube", "NS")},
    **{"box": ("cube", "N"), "boxes": ("cube", "NS"), "globe": ("sphere", "N"), "globes": ("sphere", "NS")},
    **{"tube": ("cylinder", "N"), "tubes": ("cylinder", "NS"), "orb": ("sphere", "N"), "orbs": ("sphere", "NS")},
    **dict.fromkeys(("object", "thing", "item", "obj", "entity", "thingy"), ("", "N")),
    **dict.fromkeys(("objects", "things", "items", "objs", "entities", "bodies"), ("", "NS")),
}
"""Nouns for objects: their shape, or "" for any, and whether they are singular (N) or plural (NS)."""
