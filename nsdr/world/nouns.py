"""Words for objects in English texts, and the attributes that they mean."""

from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["ADJECTIVES", "NOUNS"]

ADJECTIVES = {
    **{w: w for name in ("color", "material") for w in ATTRIBUTES[name]},
    **{"grey": "gray", "metallic": "metal", "shiny": "metal", "rubbery": "rubber", "matte": "rubber", "matt": "rubber"},
    **{"cubic": "cube", "cubical": "cube", "spherical": "sphere", "cylindrical": "cylinder"},
}
"""Attribute words before a noun, and what they mean."""

NOUNS = {
    **{form: (shape, "N") for shape in ATTRIBUTES["shape"] for form in (shape,)},
    **{f"{shape}s": (shape, "NS") for shape in ATTRIBUTES["shape"]},
    **{"ball": ("sphere", "N"), "balls": ("sphere", "NS"), "block": ("cube", "N"), "blocks": ("cube", "NS")},
    **{"box": ("cube", "N"), "boxes": ("cube", "NS")},
    **{"tube": ("cylinder", "N"), "tubes": ("cylinder", "NS"), "orb": ("sphere", "N"), "orbs": ("sphere", "NS")},
    **dict.fromkeys(("object", "thing", "item", "obj"), ("", "N")),
    **dict.fromkeys(("objects", "things", "items", "objs"), ("", "NS")),
}
"""Nouns for objects: their shape, or "" for any, and whether they are singular (N) or plural (NS)."""
