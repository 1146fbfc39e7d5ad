"""Words of objects, in the fixed order of every attribute index and logit in this package."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Annotated, Any, Literal

from msgspec import Meta

from nsdr.errors import DataError
from nsdr.validation import Checked, Share
from nsdr.world.physics import DECIMALS

NAMES = ("color", "material", "shape")
"""What the words say of an object."""
MAX_WORDS = 20
"""Most words of each kind."""
Word = Annotated[str, Meta(pattern="^[a-z]{2,20}$")]
Words = Annotated[tuple[Word, ...], Meta(min_length=1, max_length=MAX_WORDS)]
Level = Annotated[int, Meta(ge=0, le=255)]
Length = Annotated[float, Meta(ge=0.02, le=5)]
"""World units: CLEVRER's objects are 0.4 wide."""
MIN_COLOR_DISTANCE = 20
"""Two colours with a smaller distance of their sRGB (0-255) look the same."""
ES_ENDINGS = ("s", "x", "z", "ch", "sh")
"""Endings of nouns whose plural ends in -es."""
OBJECT_NOUNS = ("object", "thing", "item", "obj", "entity", "thingy")
OBJECTS_NOUNS = ("objects", "things", "items", "objs", "entities", "bodies")
"""Nouns for any object."""
DIRECTIONS = ("towards the camera", "right", "away from the camera", "left")
"""Answers beyond CLEVRER: directions of motion at 0, 90, 180 and 270 degrees from the direction of the camera, which is that of
the x axis in CLEVRER, towards the y axis."""
IMAGE_DIRECTIONS = ("up and to the left", "up and to the right", "down and to the left", "down and to the right")
"""Answers beyond CLEVRER: where an object moves in the image, over the whole video."""
STATIONARY = "stationary"
"""The answer beyond CLEVRER for an object that does not move."""
SPEED_UNIT = "world units per second"
"""What stands after the number in an answer beyond CLEVRER; seconds are of simulated time."""


@dataclass(frozen=True)
class Color(Checked):
    """A colour of objects.

    Attributes:
        word: in questions and answers.
        srgb: red, green and blue (0-255).
        synonyms: other words that are read.
    """

    word: Word
    srgb: tuple[Level, Level, Level]
    synonyms: tuple[Word, ...] = ()


@dataclass(frozen=True)
class Material(Checked):
    """A material of objects.

    Attributes:
        word: in questions and answers.
        synonyms: other words that are read.
        restitution: coefficient of restitution; those of two colliding objects are multiplied, as in Bullet (0-1).
        friction: factor of the shape's coefficient of friction (0-100).
        metallic: whether it mirrors what is around it, tinted by its colour; other materials are matt with a gloss.
        roughness: of the gloss: 0.02 makes small highlights, 1 none. CLEVR's rubber has 0.59; its metal has 0.1.
    """

    word: Word
    synonyms: tuple[Word, ...] = ()
    restitution: Share = 0.8
    friction: Annotated[float, Meta(ge=0, le=100)] = 1.0
    metallic: bool = False
    roughness: Annotated[float, Meta(ge=0.02, le=1)] = 0.59


@dataclass(frozen=True)
class Shape(Checked):
    """A shape of objects, with its size.

    Attributes:
        word: in questions and answers.
        solid: what it is in space; several shapes may be of one solid.
        size_world: extent along x and y, and height (world units). Cylinders stand upright.
        friction: coefficient of friction on the table. Spheres slide and never roll: theirs is 0.
        plural: of the word; "" for the regular one.
        synonyms: other nouns that are read, with regular plurals.
        adjectives: that are read.
    """

    word: Word
    solid: Literal["box", "sphere", "cylinder"]
    size_world: tuple[Length, Length, Length] = (0.4, 0.4, 0.4)
    friction: Share = 0.0
    plural: str = ""
    synonyms: tuple[Word, ...] = ()
    adjectives: tuple[Word, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        x, _, z = self.size_world
        form = {"cylinder": (x, x, z), "sphere": (x, x, x)}.get(self.solid, self.size_world)
        if self.size_world != form:
            raise DataError(
                f"shape {self.word}: size_world {list(self.size_world)}: expected a {self.solid}'s, {list(form)}"
            )
        if self.solid == "sphere" and self.friction:
            reason = "expected 0, because spheres slide and never roll"
            raise DataError(f"shape {self.word}: friction {self.friction:g}: {reason}")

    @property
    def half_width_world(self) -> float:
        """Half of the larger extent along x and y (world units)."""
        return max(self.size_world[:2]) / 2

    @property
    def is_square(self) -> bool:
        """Whether it is as long along x as along y: boxes that are not look the same only after half a turn."""
        return self.size_world[0] == self.size_world[1]

    @property
    def radius_world(self) -> float:
        """The radius of a sphere or cylinder, and the mean of a box's halves along x and y (world units)."""
        x, y, _ = self.size_world
        return (x + y) / 4

    @property
    def height_world(self) -> float:
        """Height of the centre of an object that stands on the table (world units)."""
        return self.size_world[2] / 2

    @property
    def plurals(self) -> dict[str, str]:
        """The plural of the word and of its synonyms."""
        regular = {
            noun: f"{noun}es" if noun.endswith(ES_ENDINGS) else f"{noun}s" for noun in (self.word, *self.synonyms)
        }
        return regular | ({self.word: self.plural} if self.plural else {})


_COLORS = (
    Color("gray", (87, 87, 87), ("grey",)),
    Color("red", (173, 35, 35)),
    Color("blue", (42, 75, 215)),
    Color("green", (29, 105, 20)),
    Color("brown", (129, 74, 25)),
    Color("cyan", (41, 208, 208)),
    Color("purple", (129, 38, 192)),
    Color("yellow", (255, 238, 51)),
)
"""CLEVRER's, with the sRGB of CLEVR's `properties.json`."""
_MATERIALS = (
    Material("metal", ("metallic", "shiny", "steel", "chrome", "glossy", "reflective"), metallic=True, roughness=0.1),
    Material("rubber", ("rubbery", "matte", "matt")),
)
_SHAPES = (
    Shape("cube", "box", friction=0.03, synonyms=("block", "box"), adjectives=("cubic", "cubical")),
    Shape("sphere", "sphere", synonyms=("ball", "globe", "orb"), adjectives=("spherical",)),
    Shape("cylinder", "cylinder", friction=0.03, synonyms=("tube",), adjectives=("cylindrical",)),
)


@dataclass(frozen=True)
class Vocabulary(Checked):
    """The words of objects, each of which has a colour, a material and a shape.

    The order of the words is that of every attribute index and logit.
    """

    colors: Annotated[tuple[Color, ...], Meta(min_length=1, max_length=MAX_WORDS)] = _COLORS
    materials: Annotated[tuple[Material, ...], Meta(min_length=1, max_length=MAX_WORDS)] = _MATERIALS
    shapes: Annotated[tuple[Shape, ...], Meta(min_length=1, max_length=MAX_WORDS)] = _SHAPES

    def __post_init__(self) -> None:
        super().__post_init__()
        words = [word for entry in self._entries for word in (entry.word, *entry.synonyms)]
        words += [word for shape in self.shapes for word in (*shape.adjectives, *shape.plurals.values())]
        if repeated := [word for word, times in Counter(words).items() if times > 1]:
            raise DataError(
                f"vocabulary: {', '.join(repeated)}: there more than once; expected one meaning for each word"
            )
        for one, other in combinations(self.colors, 2):
            if math.dist(one.srgb, other.srgb) < MIN_COLOR_DISTANCE:
                raise DataError(
                    f"vocabulary: colors {one.word} and {other.word}: srgb {list(one.srgb)} and {list(other.srgb)} look "
                    f"the same; expected a distance of {MIN_COLOR_DISTANCE} or more"
                )
        for first, second in combinations(self.shapes, 2):
            if (first.solid, first.size_world) == (second.solid, second.size_world):
                raise DataError(
                    f"vocabulary: shapes {first.word} and {second.word}: both are a {first.solid} of the size "
                    f"{list(first.size_world)}; expected another solid or size, which tells them apart"
                )

    def color(self, word: str) -> Color:
        """The colour of a word."""
        return self.colors[self.words["color"].index(word)]

    def material(self, word: str) -> Material:
        """The material of a word."""
        return self.materials[self.words["material"].index(word)]

    def shape(self, word: str) -> Shape:
        """The shape of a word."""
        return self.shapes[self.words["shape"].index(word)]

    def pair_restitution(self, one: str, other: str) -> float:
        """Coefficient of restitution of a collision of two objects of these materials: 0.64 in CLEVRER."""
        return round(self.material(one).restitution * self.material(other).restitution, DECIMALS)

    def __hash__(self) -> int:
        return self._hash

    def __reduce__(self) -> tuple[Any, ...]:
        return Vocabulary, (
            self.colors,
            self.materials,
            self.shapes,
        )  # without the hash, which is another in each process

    @cached_property
    def _hash(self) -> int:
        return hash((self.colors, self.materials, self.shapes))

    @property
    def _entries(self) -> "tuple[Color | Material | Shape, ...]":
        return (*self.colors, *self.materials, *self.shapes)

    @cached_property
    def words(self) -> dict[str, tuple[str, ...]]:
        """The words of each attribute, without synonyms."""
        kinds: tuple[tuple[Color | Material | Shape, ...], ...] = (self.colors, self.materials, self.shapes)
        return {name: tuple(entry.word for entry in kind) for name, kind in zip(NAMES, kinds, strict=True)}

    @cached_property
    def adjectives(self) -> dict[str, str]:
        """Attribute words before a noun, and what they mean."""
        named: tuple[Color | Material, ...] = (*self.colors, *self.materials)
        meanings = {entry.word: entry.word for entry in named}
        meanings |= {synonym: entry.word for entry in named for synonym in entry.synonyms}
        return meanings | {adjective: shape.word for shape in self.shapes for adjective in shape.adjectives}

    @cached_property
    def nouns(self) -> dict[str, tuple[str, str]]:
        """Nouns for objects: their shape, or "" for any, and whether they are singular (N) or plural (NS)."""
        named = {
            noun: (shape.word, number)
            for shape in self.shapes
            for one, many in shape.plurals.items()
            for noun, number in ((one, "N"), (many, "NS"))
        }
        return named | dict.fromkeys(OBJECT_NOUNS, ("", "N")) | dict.fromkeys(OBJECTS_NOUNS, ("", "NS"))

    @cached_property
    def triples(self) -> tuple[tuple[str, str, str], ...]:
        """The words of each attribute index."""
        return tuple(self.triple(i) for i in range(self.n_triples))

    @cached_property
    def attributes(self) -> dict[str, str]:
        """The attribute of each of its words."""
        return {word: name for name, words in self.words.items() for word in words}

    def in_order(self, words: Sequence[str]) -> tuple[str, ...]:
        """Attribute words in the order color, material, shape."""
        return tuple(sorted(words, key=lambda word: NAMES.index(self.attributes[word])))

    def noun_phrase(self, words: Sequence[str], is_plural: bool = False) -> str:
        """A noun phrase of attribute words in order, such as "red metal cube" or "red objects"."""
        *before, noun = words if self.attributes.get(words[-1] if words else "") == "shape" else (*words, "object")
        return " ".join((*before, self._plurals[noun] if is_plural else noun))

    @cached_property
    def _plurals(self) -> dict[str, str]:
        return {"object": "objects"} | {shape.word: shape.plurals[shape.word] for shape in self.shapes}

    @property
    def example(self) -> str:
        """Some object's words: "red metal cube" in CLEVRER."""
        return f"{self.colors[1 % len(self.colors)].word} {self.materials[0].word} {self.shapes[0].word}"

    @property
    def n_triples(self) -> int:
        """Number of attribute triples; CLEVRER has 48."""
        return len(self.colors) * len(self.materials) * len(self.shapes)

    def index(self, color: str, material: str, shape: str) -> int:
        """Index of an attribute triple. In CLEVRER it is `color * 6 + material * 3 + shape`."""
        color_index, material_index, shape_index = (
            words.index(word) for words, word in zip(self.words.values(), (color, material, shape), strict=True)
        )
        return (color_index * len(self.materials) + material_index) * len(self.shapes) + shape_index

    def triple(self, index: int) -> tuple[str, str, str]:
        """(color, material, shape) of an attribute index; inverse of `index`."""
        rest, shape = divmod(index, len(self.shapes))
        color, material = divmod(rest, len(self.materials))
        return self.colors[color].word, self.materials[material].word, self.shapes[shape].word


CLEVRER = Vocabulary()


def differing_words(words: Sequence[str], other: Sequence[str]) -> int:
    """In how many words two triples (color, material, shape) differ, such as those of a `SceneObject.name`."""
    return sum(a != b for a, b in zip(words, other, strict=True))


def indefinite(noun: str) -> str:
    """The noun with "a" or "an"."""
    return f"{'an' if noun[:1].lower() in tuple('aeiou') else 'a'} {noun}"
