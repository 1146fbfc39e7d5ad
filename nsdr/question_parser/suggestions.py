"""The well-formed questions that are nearest to a text which was refused."""

import random
import re
from collections.abc import Sequence
from difflib import SequenceMatcher
from itertools import combinations

from nsdr.errors import ExecutionError
from nsdr.language.choosing import Chooser
from nsdr.language.texts import clevrer, described
from nsdr.question_parser.tokenizer import split_words
from nsdr.symbolic import Executor
from nsdr.types import Scene
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["nearest_questions", "suggestion"]

SYMBOLS = {
    "descriptive": ("EVENTS", "MOTION", "QUERY"),
    "multiple_choice": ("EXPLANATORY", "PREDICTIVE", "COUNTERFACTUAL"),
    "choice": ("PRESENCE", "COLLISION", "ENTRANCE", "EXIT", "HAPPENS"),
}
"""Symbols of clevrer.rules whose contents are compared with a text, by kind of text."""
ANY_NAMES = (("red", "cube"), ("blue", "sphere"))
"""Objects of the suggestions where neither a scene nor the text names any."""
FUNCTION_TEXT = "a an and any are at do does 's in is it of on that the there this to was were will"
FUNCTION_WORDS = frozenset(FUNCTION_TEXT.split())
FUNCTION_WEIGHT = 0.2
"""Weight of these words beside that of others (1) in the similarity of two texts."""
ORDER_WEIGHT = 0.3
"""Weight of the similar order of words beside that of the words themselves (1)."""
COMPARED = 60
"""Number of texts with the most similar words whose order is compared, too."""
_SUFFIX = re.compile(r"(?:ing|es|ed|s|e)$")
STEM_LETTERS = 5
STEMS = {
    **dict.fromkeys(("hit", "hitt", "bump", "touch", "crash", "strik", "meet", "bang"), "colli"),
    **dict.fromkeys(("leav", "left", "disap", "vanis", "go", "gon"), "exit"),
    **dict.fromkeys(("appea", "arriv", "com"), "enter"),
    **dict.fromkeys(("rest", "still", "motio", "parke", "stand"), "stati"),
    **{"ball": "spher", "block": "cub", "box": "cub", "grey": "gray", "colou": "color", "thing": "objec"},
    **{"shiny": "metal", "matt": "rubbe", "caus": "respo", "why": "respo", "happe": "happe", "remov": "witho"},
}
"""Stems that count as those of the grammar's words."""


class _Names:
    """Descriptions of objects; implements `nsdr.language.choosing.Phrases`."""

    def __init__(self, names: Sequence[tuple[str, ...]], classes: Sequence[tuple[str, ...]]) -> None:
        self.names, self.classes = list(names), classes

    def words(self, choose: Chooser, use: str, without: str) -> tuple[str, ...]:
        if use == "one":
            return choose.pick(self.names)
        kept = [words for words in self.classes if not set(words).intersection(ATTRIBUTES.get(without, ()))]
        return () if use == "enters" else choose.pick(kept)


def suggestion(text: str, scene: Scene | None, kind: str) -> str:
    """The nearest questions as the end of an error message."""
    near = nearest_questions(text, scene, kind)
    return f"; the nearest {'options' if kind == 'choice' else 'questions'}: {' | '.join(near)}" if near else ""


def nearest_questions(text: str, scene: Scene | None, kind: str = "descriptive", n: int = 3) -> list[str]:
    """Well-formed texts that are most similar to a text.

    Args:
        text: a text that was refused.
        scene: the texts name its objects and can be executed on it; None for objects that the text names, if any.
        kind: "descriptive", "multiple_choice" or "choice".
        n: number of texts.

    Returns:
        The most similar first, always the same for the same arguments.
    """
    said = _stems(text)
    names = _names_in_text(text) if scene is None else _names_in_scene(text, scene)
    if not names:
        return []
    shapes = [
        (shape,) for shape in ATTRIBUTES["shape"] if scene is None or any(o.shape == shape for o in scene.objects)
    ]
    phrases = _Names(names, list(dict.fromkeys([(), *names, *shapes])))
    if scene is None and len(names) < 2:  # a collision takes two
        phrases.names = [*names, *(other for other in ANY_NAMES if other not in names)]
    pairs = [pair for symbol in SYMBOLS[kind] for pair in clevrer().every(symbol, phrases, random.Random(0))]
    described_names = [described(words)[0] for words in phrases.names]
    pairs = [pair for pair in pairs if all(pair[0].count(f"the {name}") < 2 for name in described_names)]
    pairs.sort(key=lambda pair: (-_common(said, _stems(pair[0])), len(pair[0])))
    nearest = sorted(pairs[:COMPARED], key=lambda pair: (-_similarity(said, _stems(pair[0])), len(pair[0])))
    found: list[str] = []
    for candidate, program in [*nearest, *pairs[COMPARED:]]:
        if candidate not in found and (scene is None or _fits(program, scene)):
            found.append(candidate)
        if len(found) == n:
            break
    return found


def _names_in_text(text: str) -> list[tuple[str, ...]]:
    """Noun phrases of the text as attribute words, each with a word of every attribute at most."""
    names: list[tuple[str, ...]] = []
    current: dict[str, str] = {}
    for word in [*split_words(text), ""]:
        stem = _stem(word)
        attribute = next(((n, w) for n, words in ATTRIBUTES.items() for w in words if word and _stem(w) == stem), None)
        if attribute is not None and attribute[0] not in current:
            current[attribute[0]] = attribute[1]
            continue
        if current:
            names.append(tuple(current[n] for n in ATTRIBUTES if n in current))
        current = dict([attribute]) if attribute is not None else {}
    return list(dict.fromkeys(names)) or list(ANY_NAMES)


def _names_in_scene(text: str, scene: Scene) -> list[tuple[str, ...]]:
    """For each object the shortest unique description that is nearest to the text's words."""
    said = _stems(text)
    triples = [(o.color, o.material, o.shape) for o in scene.objects]
    names = []
    for triple in triples:
        options = [
            words
            for size in (1, 2, 3)
            for words in combinations(triple, size)
            if sum(set(words) <= set(other) for other in triples) == 1
        ]
        names.append(max(options, key=lambda words: (sum(_stem(w) in said for w in words), -len(words), words)))
    return names


def _fits(program: Sequence[str], scene: Scene) -> bool:
    """Whether the program, up to where it takes a choice, can be executed on the scene."""
    tokens = list(program)
    if "belong_to" in tokens:
        tokens = tokens[: tokens.index("belong_to")]
    try:
        Executor(scene).run(tokens)
    except ExecutionError:
        return False
    return True


def _stem(word: str) -> str:
    stem = _SUFFIX.sub("", word)[:STEM_LETTERS] if len(word) > 3 else word
    return STEMS.get(stem, stem)


def _stems(text: str) -> list[str]:
    return [_stem(word) for word in split_words(text)]


def _common(first: Sequence[str], second: Sequence[str]) -> float:
    """Weighted Dice coefficient of the words of two texts (0-1)."""
    a, b = set(first), set(second)
    total = _weight(a) + _weight(b)
    return 2 * _weight(a & b) / total if total else 0.0


def _weight(stems: set[str]) -> float:
    return sum(FUNCTION_WEIGHT if stem in FUNCTION_WORDS else 1.0 for stem in stems)


def _similarity(first: Sequence[str], second: Sequence[str]) -> float:
    order = SequenceMatcher(None, first, second, autojunk=False).ratio()
    return _common(first, second) + ORDER_WEIGHT * order
