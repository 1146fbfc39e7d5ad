"""The well-formed questions that are nearest to a text which was refused."""

import math
import random
import re
from collections.abc import Sequence
from difflib import SequenceMatcher
from itertools import combinations

from nsdr.errors import ExecutionError
from nsdr.language.normal import FUNCTION_WORDS, MEANINGS, normal_form
from nsdr.language.rules import Chooser, Pair
from nsdr.language.slots import Slot
from nsdr.language.texts import clevrer
from nsdr.symbolic import Executor
from nsdr.types import Scene
from nsdr.world.vocabulary import Vocabulary

SYMBOLS = {
    "descriptive": ("EVENTS", "MOTION", "QUERY"),
    "multiple_choice": ("EXPLANATORY", "PREDICTIVE", "COUNTERFACTUAL"),
    "choice": ("PRESENCE", "COLLISION", "ENTRANCE", "EXIT", "HAPPENS"),
}
"""Symbols of write_clevrer.rules whose contents are compared with a text, by kind of text."""
OPEN: tuple[Pair, ...] = (
    ("What happens in this video?", ["events"]),
    ("Describe the scene", ["objects", "events", "describe"]),
)
"""Descriptive questions that are known as a whole, with their programs."""
TOLD_MEANINGS = {"narrate": ["what", "happen"]}
"""What words of normal forms that stand for a whole question are compared by."""
QUESTION_KINDS = ("descriptive", "multiple_choice")
"""The kinds that a question may be of."""
REMOVALS = frozenset(
    [
        "without",
        "suppose",
        "supposing",
        "imagine",
        "assume",
        "assuming",
        "absent",
        "taken",
        "remove",
        "removed",
        "removing",
    ]
).union(["delete", "deleted", "erased", "eliminated", "excluded", "omitted"])
"""Words of normal forms that speak of another world, as "if" does beside "will"; the nearest questions to a text with one are
about removals."""
_SIDE_ASKED = re.compile(r"\b(?:after|before) (?:how|what|which)\b")
"""A text that asks what is before an event may mean to ask for what is before it, or the reverse."""
FUNCTION_WEIGHT = 0.2
"""Weight of function words beside that of others (1) in the similarity of two texts."""
ORDER_WEIGHT = 0.3
"""Weight of the similar order of words beside that of the words themselves (1)."""
_CONDITION = re.compile(r"\b(?:if|suppose|supposing|imagine|assume|assuming)\b")
_RESULT = re.compile(r"\b(?:will|would|happens?|what if)\b")
"""A text with a condition and a result asks for another world."""
CHANGES = {
    r"heavy|heavier|heaviest|lighter|mass|weigh\w*": '--mass "OBJECT=2"',
    r"fast|faster|slow|slower|speed|velocity|quicker": '--velocity "OBJECT=x2"',
    r"frozen|fixed|held|glued": '--freeze "OBJECT"',
    r"moved|shifted|elsewhere": '--shift "OBJECT=0,0.4"',
    r"added|add|another": '--add "EXAMPLE=1,0"',
}
"""Options of `nsdr simulate` for what no question expresses, by words that ask for it."""
SUGGESTED = 3
"""Number of texts that are suggested."""
COMPARED = 60
"""Number of texts with the most similar words whose order is compared, too."""


class _Names:
    """Descriptions of objects; implements `nsdr.language.rules.Phrases`."""

    def __init__(
        self, names: Sequence[tuple[str, ...]], classes: Sequence[tuple[str, ...]], vocabulary: Vocabulary
    ) -> None:
        self.names, self.classes, self.vocabulary = list(names), classes, vocabulary

    def words(self, choose: Chooser, use: str, without: str) -> tuple[str, ...]:
        if use == "one":
            return choose.pick(self.names)
        named = self.vocabulary.words.get(without, ())
        kept = [words for words in self.classes if not set(words).intersection(named)]
        return () if use == "enters" else choose.pick(kept)


def any_names(vocabulary: Vocabulary) -> list[tuple[str, ...]]:
    """Two objects for suggestions where neither a scene nor the text names any: red cube and blue sphere in CLEVRER's words."""
    colors, shapes = vocabulary.words["color"], vocabulary.words["shape"]
    names = [(colors[i % len(colors)], shapes[(i - 1) % len(shapes)]) for i in (1, 2)]
    return list(dict.fromkeys(names))


def intervention_hint(text: str, vocabulary: Vocabulary) -> str:
    """What to do for a question about a changed world that no program expresses; "" for other texts."""
    lower, options = text.lower(), []
    if _CONDITION.search(lower) and _RESULT.search(lower):
        options = [option for words, option in CHANGES.items() if re.search(rf"\b(?:{words})\b", lower)]
    words = normal_form(text, vocabulary=vocabulary).words
    named = [word.text(vocabulary) for word in words if isinstance(word, Slot) and word.words]
    if not options and "without" in _meanings(text, vocabulary) and "and" in words and len(named) == 2:
        options = [f'--remove "{name}"' for name in named]
    said = " ".join(options).replace("EXAMPLE", vocabulary.example)
    return f"; nsdr simulate VIDEO {said} says what would happen" if options else ""


def nearest_questions(text: str, scene: Scene | None, *kinds: str, vocabulary: Vocabulary) -> list[str]:
    """Well-formed texts that are most similar to a text.

    Args:
        text: a text that was refused.
        scene: the texts name its objects and can be executed on it; None for objects that the text names, if any.
        kinds: of the texts: "descriptive", "multiple_choice" or "choice".
        vocabulary: of the words of objects.

    Returns:
        The most similar first, always the same for the same arguments.
    """
    said, others = _meanings(text, vocabulary), any_names(vocabulary)
    words = normal_form(text, vocabulary=vocabulary).words
    named = dict.fromkeys(word.words for word in words if isinstance(word, Slot) and word.words)
    names = (list(named) or others) if scene is None else _names_in_scene(said, scene)
    if not names:
        return []
    shapes = [
        (shape,) for shape in vocabulary.words["shape"] if scene is None or any(o.shape == shape for o in scene.objects)
    ]
    phrases = _Names(names, list(dict.fromkeys([(), *names, *shapes])), vocabulary)
    if scene is None and len(names) < 2:  # a collision takes two
        phrases.names = [*names, *(other for other in others if other not in names)]
    symbols = [symbol for kind in kinds for symbol in SYMBOLS[kind]]
    if "COUNTERFACTUAL" in symbols and "without" in said and (scene is None or scene.counterfactual):
        symbols = ["COUNTERFACTUAL"]
    pairs = [pair for symbol in symbols for pair in clevrer(vocabulary).every(symbol, phrases, random.Random(0))]
    pairs += OPEN if "QUERY" in symbols else ()
    said_names = [f"the {vocabulary.noun_phrase(words)}" for words in phrases.names]
    pairs = [pair for pair in pairs if all(pair[0].count(name) < 2 for name in said_names)]
    pairs = [pair for pair in pairs if _words(pair[0]) != _words(text)]  # which a parser just refused
    pairs.sort(key=lambda pair: (-_common(said, _meanings(pair[0], vocabulary)), len(pair[0])))
    nearest = sorted(
        pairs[:COMPARED], key=lambda pair: (-_similarity(said, _meanings(pair[0], vocabulary)), len(pair[0]))
    )
    found: list[str] = []
    if _SIDE_ASKED.search(text.lower()):
        nearest = [both for pair in nearest for both in (pair, *(p for p in nearest if _is_other_side(pair[0], p[0])))]
    for candidate, program in [*nearest, *pairs[COMPARED:]]:
        if candidate not in found and (scene is None or _fits(program, scene)):
            found.append(candidate)
        if len(found) == SUGGESTED:
            break
    return found


def _meanings(text: str, vocabulary: Vocabulary) -> list[str]:
    """Attribute words and the meanings of the other words of a text."""
    words = normal_form(text, vocabulary=vocabulary).words
    if {"if", "will"}.issubset(words):
        words = tuple("without" if word == "if" else word for word in words)
    parts = ((word.words or ("object",)) if isinstance(word, Slot) else (_meaning(word),) for word in words)
    return [meaning for part in parts for one in part for meaning in TOLD_MEANINGS.get(one, [one])]


def _words(text: str) -> list[str]:
    return re.findall(r"\w+", text.lower())


def _meaning(word: str) -> str:
    return "without" if word in REMOVALS else MEANINGS.get(word, word)


def _is_other_side(first: str, second: str) -> bool:
    """Whether two texts differ only in that one says "before" where the other says "after"."""
    return " after " in first and first.replace(" after ", " before ") == second


def _names_in_scene(said: Sequence[str], scene: Scene) -> list[tuple[str, ...]]:
    """For each object the shortest unique description that is nearest to what was said."""
    triples = [(o.color, o.material, o.shape) for o in scene.objects]
    names = []
    for triple in triples:
        options = [
            words
            for size in (1, 2, 3)
            for words in combinations(triple, size)
            if sum(set(words) <= set(other) for other in triples) == 1
        ]
        names.append(max(options, key=lambda words: (sum(w in said for w in words), -len(words), words)))
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


def _common(first: Sequence[str], second: Sequence[str]) -> float:
    """Weighted Dice coefficient of the words of two texts (0-1)."""
    a, b = set(first), set(second)
    total = _weight(a) + _weight(b)
    return 2 * _weight(a & b) / total if total else 0.0


def _weight(words: set[str]) -> float:
    return math.fsum(FUNCTION_WEIGHT if word in FUNCTION_WORDS else 1.0 for word in words)


def _similarity(first: Sequence[str], second: Sequence[str]) -> float:
    order = SequenceMatcher(None, first, second, autojunk=False).ratio()
    return _common(first, second) + ORDER_WEIGHT * order
