"""All questions that can be asked about a scene: everything the grammar can express that has an answer in the scene."""

import random
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import combinations, product

from msgspec.structs import replace

from nsdr.baselines.recording import keep_recording
from nsdr.clevrer.files.questions import OPTION_TAGS, PLAIN, Choice, Question
from nsdr.errors import ExecutionError
from nsdr.language.rules import Chooser, Pair
from nsdr.language.texts import clevrer, in_words
from nsdr.symbolic import Executor
from nsdr.symbolic.quantities import Simulate
from nsdr.types import Scene
from nsdr.world.vocabulary import NAMES, Vocabulary

EXTENSION_KINDS = ("speed", "direction", "is_faster", "faster", "extreme_speed", "is_heavier", "heavier", "heaviest")
"""Subtypes of the descriptive questions beyond CLEVRER; in capitals their symbols in write_beyond.rules."""

DESCRIPTION_WEIGHTS = {
    ("color",): 1.0,
    ("material",): 1.0,
    ("shape",): 1.5,
    ("color", "material"): 0.25,
    ("color", "shape"): 1.7,
    ("material", "shape"): 1.0,
    ("color", "material", "shape"): 0.2,
}
"""Relative frequency of each set of attributes in descriptions of a single object, close to the released questions."""
ABSENT_CLASSES = 4
"""Number of classes without objects that each scene's questions mention ("Are there any green cubes that …?"), fewer where
there are objects of most classes."""
PLAIN_TRIES = 10
"""Questions drawn for each question that is wanted: many have no answer, or one that is too frequent."""
PLAIN_SAME_ANSWER = 0.25
"""Largest share of a scene's plain questions with the same last program token and the same answer."""
PLAIN_WITH_TIME = 0.3
"""Share of the plain questions that are about motion at the start or end of the video."""
_ATTRIBUTE_WORD = re.compile(r"\b[a-z]+ (?=filter_(?:color|material|shape)\b)")
_ATTRIBUTE_TOKENS = re.compile(r"\S+ filter_(color|material|shape) ?")


def form(asked: Question | Choice) -> str:
    """The program without its attribute words, but with their filters."""
    return _ATTRIBUTE_WORD.sub("", " ".join(asked.program or ()))


def family(asked: Question | Choice) -> str:
    """The program without its attribute words and without their filters."""
    return _ATTRIBUTE_TOKENS.sub("", " ".join(asked.program or ()))


def is_negated(question: Question) -> bool:
    """Whether it asks with "not"."""
    return (question.program or ())[-1:] == ("negate",)


def telling(vocabulary: Vocabulary) -> list[str]:
    """The kinds of words that say something about an object. Where all objects are of clay, "clay" says nothing."""
    return [kind for kind, words in vocabulary.words.items() if len(words) > 1]


class SceneWords:
    """Descriptions of a scene's objects and classes; implements `nsdr.language.rules.Phrases`."""

    def __init__(self, scene: Scene, rng: random.Random) -> None:
        self.rng, self.vocabulary = rng, scene.world.vocabulary
        kinds = telling(self.vocabulary)
        known = tuple(self.vocabulary.words[kind] for kind in kinds)
        triples = [tuple(getattr(o, kind) for kind in kinds) for o in scene.objects]
        matches: dict[tuple[str, ...], list[int]] = {}
        for i, triple in enumerate(triples):
            for size in (1, 2, 3):
                for words in combinations(triple, size):
                    matches.setdefault(words, []).append(i)
        self.unique: list[list[tuple[str, ...]]] = [
            [words for words, found in matches.items() if found == [i]] for i in range(len(triples))
        ]
        absent: set[tuple[str, ...]] = set()
        possible = {words for triple in product(*known) for words in _classes(triple)} - matches.keys()
        while len(absent) < min(ABSENT_CLASSES, len(possible)):
            words = rng.choice(_classes([rng.choice(words) for words in known]))
            if words not in matches:
                absent.add(words)
        small = {words: len(found) for words, found in matches.items() if len(words) < 3}
        self.counted = [(), *small, *sorted(absent)]
        # Classes with one object are excluded: a single frame would identify it.
        self.shared = [(), *(words for words, found in small.items() if found > 1)]
        self.named: list[int] = []

    def words(self, choose: Chooser, use: str, without: str) -> tuple[str, ...]:
        """See `Phrases.words`."""
        if use == "one":
            i = self.named.pop(0) if self.named else choose.pick(range(len(self.unique)))
            described = self.unique[i]
            return choose.vary(
                described, [DESCRIPTION_WEIGHTS[_attributes(words, self.vocabulary)] for words in described]
            )
        if use == "enters":
            return ()
        classes = self.counted if use == "counted" else self.shared
        return choose.pick([words for words in classes if without not in _attributes(words, self.vocabulary)])


def _classes(triple: Sequence[str]) -> list[tuple[str, ...]]:
    """The classes by one or two of an object's words."""
    return [words for size in (1, 2) for words in combinations(triple, size)]


@cache
def _attributes(words: tuple[str, ...], vocabulary: Vocabulary) -> tuple[str, ...]:
    return tuple(vocabulary.attributes[word] for word in words)


def descriptive_questions(scene: Scene, rng: random.Random, beyond: bool = False) -> Iterator[Question]:
    """All descriptive questions that have an answer in the scene, each in a random wording and with the id 0.

    Questions that have one possible answer, such as about the material in a world with one, are omitted, and so are questions
    about motion when the scene's `moving` is None.

    Args:
        scene: the scene.
        rng: draws the wordings.
        beyond: whether to ask questions beyond CLEVRER, about speeds, directions and masses, instead of CLEVRER's own.
    """
    words, executor = SceneWords(scene, rng), Executor(scene)
    of_clevrer = ["EVENTS", "QUERY"] if scene.moving is None else ["EVENTS", "MOTION", "QUERY"]
    known = {f"query_{kind}" for kind in NAMES if kind not in telling(words.vocabulary)}
    for symbol in map(str.upper, EXTENSION_KINDS) if beyond else of_clevrer:
        for text, program in clevrer(scene.world.vocabulary).every(symbol, words, rng):
            if program[-1] in known:
                continue
            try:
                answer = executor.answer(program).text
            except ExecutionError:  # not known, no such object or event, or more than one
                continue
            subtype = symbol.lower() if beyond else program[-1]
            yield Question(0, text, "descriptive", subtype, tuple(program), answer, ())


def multiple_choice_questions(scene: Scene, rng: random.Random) -> Iterator[Question]:
    """All multiple-choice questions with all their options, correct and wrong. All ids are 0.

    Predictive and counterfactual questions are omitted when the scene lacks that ground truth.
    """
    yield from _explanatory(scene, rng)
    if scene.predicted:
        yield from _predictive(scene, rng)
    if scene.counterfactual is not None:
        yield from _counterfactual(scene, rng)


class _Namer:
    """Makes texts and programs about given objects."""

    def __init__(self, scene: Scene, rng: random.Random, simulate: Simulate | None = None) -> None:
        self.words, self.rng, self.executor = SceneWords(scene, rng), rng, Executor(scene, simulate=simulate)
        self.rules = clevrer(scene.world.vocabulary)

    def __call__(self, symbol: str, objects: Sequence[int]) -> Pair:
        self.words.named = list(objects)
        return next(self.rules.every(symbol, self.words, self.rng))

    def option(self, question: Sequence[str], symbol: str, objects: Sequence[int]) -> Choice:
        """An option about given objects, correct or wrong for a question's program."""
        text, program = self(symbol, objects)
        return Choice(0, text, tuple(program), _judged(self.executor, question, program))

    def is_unique(self, symbol: str, objects: Sequence[int]) -> bool:
        """Whether the description of an event fits exactly one event."""
        try:
            self.executor.run(self(symbol, objects)[1])
        except ExecutionError:
            return False
        return True


def _judged(executor: Executor, question: Sequence[str], option: Sequence[str]) -> str:
    return "correct" if executor.run([*option, *question]) else "wrong"


def _explanatory(scene: Scene, rng: random.Random) -> Iterator[Question]:
    name = _Namer(scene, rng)
    about: list[tuple[str, tuple[int, ...]]] = []
    for event in scene.events:
        symbol = {"collision": "COLLISION", "out": "EXIT", "in": "ENTRANCE"}[event.kind]
        if name.is_unique(symbol, event.objects):
            about.append((symbol, event.objects))
    for target, participants in about:
        if target == "ENTRANCE":
            continue
        event_text, event_program = name(target, participants)
        question = ["events", *event_program, "filter_ancestor", "belong_to"]
        options = [name.option(question, "PRESENCE", [i]) for i in range(len(scene.objects)) if i not in participants]
        options += [
            name.option(question, symbol, objects)
            for symbol, objects in about
            if (symbol, objects) != (target, participants) and symbol != "EXIT"
        ]
        text = f"Which of the following is {{}}responsible for {event_text}?"
        yield from _both_ways(text, question, "explanatory", options)


def _both_ways(text: str, program: Sequence[str], kind: str, options: Sequence[Choice]) -> Iterator[Question]:
    """Yield the question in its affirmative and its negated form; "not" takes the place of "{}" in the text."""
    yield Question(0, text.format(""), kind, None, tuple(program), None, tuple(options))
    negated = tuple(replace(o, answer="wrong" if o.answer == "correct" else "correct") for o in options)
    yield Question(0, text.format("not "), kind, None, (*program, "negate"), None, negated)


def _predictive(scene: Scene, rng: random.Random) -> Iterator[Question]:
    name = _Namer(scene, rng)
    text, program = name("PREDICTIVE", [])
    pairs = combinations(range(len(scene.objects)), 2)
    options = tuple(name.option(program, "HAPPENS", _shuffled(pair, rng)) for pair in pairs)
    yield Question(0, text, "predictive", None, tuple(program), None, options)


def _counterfactual(scene: Scene, rng: random.Random) -> Iterator[Question]:
    name, recording = _Namer(scene, rng), Executor(keep_recording(scene))
    for removed in range(len(scene.objects)):
        pairs = combinations([i for i in range(len(scene.objects)) if i != removed], 2)
        text, program = name("COUNTERFACTUAL", [removed])
        options = []
        for pair in pairs:
            option = name.option(program, "HAPPENS", _shuffled(pair, rng))
            differs = _judged(recording, program, option.program or ()) != option.answer
            options.append(replace(option, tag=OPTION_TAGS[differs]))
        yield from _both_ways(text.replace(" will happen", " will {}happen"), program, "counterfactual", options)


def changed_questions(scene: Scene, simulate: Simulate, rng: random.Random, n: int) -> Iterator[Question]:
    """Up to `n` what-if questions about changed objects, drawn at random, each with all pairs of objects as options.

    Args:
        scene: the scene.
        simulate: gives the true collisions after a change.
        rng: draws objects, changes and wordings.
        n: largest number of questions; each takes two simulations.
    """
    name = _Namer(scene, rng, simulate)
    drawn = [(text, tuple(tokens)) for text, tokens in name.rules.every("CHANGED", name.words, rng)]
    rng.shuffle(drawn)
    asked: set[tuple[str, ...]] = set()
    for text, program in drawn:
        change = program[: program.index("get_changed")]
        if len(asked) >= n or change in asked:
            continue
        try:
            pairs = combinations(range(len(scene.objects)), 2)
            options = tuple(name.option(program, "HAPPENS", rng.sample(pair, 2)) for pair in pairs)
        except ExecutionError:  # impossible, or not known
            continue
        asked.add(change)
        yield Question(0, text, "counterfactual", None, program, None, options)


def _shuffled(pair: tuple[int, int], rng: random.Random) -> tuple[int, int]:
    return pair if rng.random() < 0.5 else (pair[1], pair[0])


def plain_questions(scene: Scene, rng: random.Random, count: int) -> list[Question]:
    """At most `count` different questions about a scene's objects, such as "How many cubes are there?".

    Networks learn faster from them. CLEVRER itself asks no such questions, except about motion.
    """
    executor, used = Executor(scene), Counter[tuple[str, str]]()
    found: dict[str, Question] = {}
    for _ in range(PLAIN_TRIES * count if scene.objects else 0):
        program = _plain_program(scene, rng)
        try:
            answer = executor.answer(program).text
        except ExecutionError:
            continue
        key = program[-1], str(answer)
        if used[key] < max(1, PLAIN_SAME_ANSWER * count):
            text = in_words(program, scene.world.vocabulary)
            used[key] += text not in found
            found[text] = Question(0, text, "descriptive", PLAIN, program, answer, ())
        if len(found) == count:
            break
    return list(found.values())


def _plain_program(scene: Scene, rng: random.Random) -> tuple[str, ...]:
    """A random program: it selects objects by one or two attributes, sometimes also by their motion, and asks about them."""
    kinds = telling(scene.world.vocabulary)
    ending = rng.choice(["count", "exist", *[f"query_{name}" for name in kinds]])
    names = [name for name in kinds if ending != f"query_{name}"]
    chosen = rng.choice(scene.objects)
    words = {name: getattr(chosen, name) for name in rng.sample(names, min(rng.randint(1, 2), len(names)))}
    if ending in ("count", "exist") and rng.random() < 0.5:
        name = rng.choice(names)
        words = {name: rng.choice(scene.world.vocabulary.words[name])}
    program = ["objects", *(token for name in sorted(words) for token in (words[name], f"filter_{name}"))]
    if rng.random() < PLAIN_WITH_TIME:
        program += [rng.choice(["start", "end"]), "get_frame", rng.choice(["filter_moving", "filter_stationary"])]
    return (*program, *([] if ending in ("count", "exist") else ["unique"]), ending)
