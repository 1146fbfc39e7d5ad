"""CLEVRER's question grammar: texts with their programs, at random or exhaustively.

The wordings are those of the released questions; every text has exactly one program. Templates make two kinds of choices:
of content (`pick`: another program) and of wording (`vary`: the same program). `sample` makes both at random and describes
objects by random words; the question parser is trained on its texts. `every` enumerates the content and draws the wording;
`nsdr.generate.questions` uses it to make the questions of a scene.
"""

import random
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, TypeVar

from nsdr.world.vocabulary import ATTRIBUTES, COLORS, MATERIALS

__all__ = ["TEXT_KINDS", "Chooser", "Grammar", "Pair", "Phrases", "described", "every", "random_words", "sample"]

T = TypeVar("T")
Pair = tuple[str, list[str]]
"""A text or a part of one, and its postfix tokens."""

BEFORE_AFTER_WEIGHTS = (0.65, 0.35)
"""Weights of no clause and of a "before" or "after" clause, in `sample`."""
COLLISION_WEIGHTS = (0.75, 0.25)
"""Weights of questions about entrances or exits and about collisions, in `sample`."""
COUNT_EXIST_WEIGHTS = (0.67, 0.33)
"""Weights of counting and of existence among the questions about motion, in `sample`."""
DESCRIPTIVE_WEIGHTS = (3, 3, 5)
"""Weights of questions about events, about motion and about attributes, in `sample`."""
EXPLANATORY_WEIGHTS = (2, 1)
"""Weights of collisions and of exits as the event to explain, in `sample`."""
MULTIPLE_CHOICE_WEIGHTS = (8, 8, 1)
"""Weights of explanatory, counterfactual and predictive questions, in `sample`."""
CHOICE_WEIGHTS = (4, 2, 1, 1, 4)
"""Weights of presence, collision, entrance and exit as nouns, and of a collision as a sentence, in `sample`."""
WORD_PROBABILITIES = {"color": 0.5, "material": 0.5, "shape": 0.6}
"""Probability that a single object is described by each attribute, in `sample` (0-1). Without any, the colour is used."""
BARE_PROBABILITIES = {"counted": 0.4, "moves": 0.3, "enters": 0.8}
"""Probability that a class of objects has no attribute words, in `sample` (0-1)."""


class Chooser(Protocol):
    """Makes the choices of the templates."""

    def pick(self, options: Sequence[T], weights: Sequence[float] | None = None) -> T:
        """One of several contents; `weights` are their relative frequencies."""
        ...

    def vary(self, options: Sequence[T], weights: Sequence[float] | None = None) -> T:
        """One of several wordings; `weights` are their relative frequencies."""
        ...


class Phrases(Protocol):
    """Describes objects by attribute words, in the order color, material, shape."""

    def one(self, choose: Chooser) -> tuple[str, ...]:
        """Words of a single object."""
        ...

    def some(self, choose: Chooser, use: str, without: str) -> tuple[str, ...]:
        """Words of a class of objects, possibly none.

        Args:
            choose: makes the choices.
            use: how the text uses the class: "counted", "moves" (the one object of it that moves or rests) or "enters" (the one
                that enters or exits).
            without: attribute that must not be among the words.
        """
        ...


def described(words: Sequence[str], plural: bool = False) -> Pair:
    """A noun phrase such as "red metal cube" and its filters; without a shape word the noun is "object"."""
    names = [("color" if w in COLORS else "material" if w in MATERIALS else "shape") for w in words]
    tokens = [token for word, name in zip(words, names, strict=True) for token in (word, f"filter_{name}")]
    noun = [] if "shape" in names else ["object"]
    return " ".join([*words, *noun]) + ("s" if plural else ""), tokens


class Grammar:
    """The templates; each method makes one text.

    Args:
        choose: makes the choices.
        phrases: describes objects.
    """

    def __init__(self, choose: Chooser, phrases: Phrases) -> None:
        self.choose, self.phrases = choose, phrases

    def one(self) -> Pair:
        """ "the red cube" as a single object."""
        text, tokens = described(self.phrases.one(self.choose))
        return f"the {text}", ["objects", *tokens, "unique"]

    def some(self, use: str, without: str = "") -> Pair:
        """ "red cubes" or "red cube" as a class."""
        return described(self.phrases.some(self.choose, use, without), plural=use == "counted")

    def in_or_out(self) -> tuple[str, str]:
        """ "enter" or "exit" with its module."""
        return self.choose.pick([("enter", "filter_in"), ("exit", "filter_out")])

    def time(self) -> Pair:
        """TIME: "when the video begins", "when the OBJ enters the scene", or nothing."""
        kind = self.choose.pick(["none", "video", "object"])
        if kind == "none":
            return "", ["null"]
        if kind == "video":
            verb, token = self.choose.pick([("begins", "start"), ("ends", "end")])
            return f" when the video {verb}", [token, "get_frame"]
        text, tokens = self.one()
        verb, token = self.in_or_out()
        return f" when {text} {verb}s the scene", ["events", *tokens, token, "unique", "get_frame"]

    def before_after(self) -> Pair:
        """ "before|after the OBJ enters|exits the scene", or nothing."""
        if self.choose.pick([False, True], BEFORE_AFTER_WEIGHTS):
            return "", ["events"]
        text, tokens = self.one()
        verb, token = self.in_or_out()
        side = self.choose.pick(["before", "after"])
        return f" {side} {text} {verb}s the scene", ["events", "events", *tokens, token, "unique", f"filter_{side}"]

    def motion(self) -> tuple[str, str]:
        """ "moving" or "stationary" with its module."""
        return self.choose.pick([("moving", "filter_moving"), ("stationary", "filter_stationary")])

    def count_or_exist_events(self) -> Pair:
        """ "How many OBJs enter the scene …?", "Are there any collisions …?" and so on."""
        when, events = self.before_after()
        last = self.choose.pick(["count", "exist"])
        if self.choose.pick([False, True], COLLISION_WEIGHTS):
            start = "How many collisions happen" if last == "count" else "Are there collisions"
            return f"{start}{when}?", [*events, "objects", "filter_collision", last]
        text, tokens = self.some("counted")
        verb, token = self.in_or_out()
        program = [*events, "objects", *tokens, token, last]
        if last == "count":
            return f"How many {text} {verb} the scene{when}?", program
        return f"Are there any {text} that {verb} the scene{when}?", program

    def count_or_exist_motion(self) -> Pair:
        """ "How many OBJs are moving …?", "Are there any stationary OBJs …?" and so on."""
        when, frame = self.time()
        text, tokens = self.some("counted")
        word, token = self.motion()
        last = self.choose.pick(["count", "exist"], COUNT_EXIST_WEIGHTS)
        program = ["objects", *tokens, *frame, token, last]
        if last == "exist":
            return f"Are there any {word} {text}{when}?", program
        wordings = [f"How many {text} are {word}{when}?", f"How many {word} {text} are there{when}?"]
        return self.choose.vary(wordings), program

    def query(self) -> Pair:
        """ "What is the color of REF?" and so on."""
        name = self.choose.pick(["color", "material", "shape"])
        text, tokens = self.choose.pick([self.collision_partner, self.enters_or_exits, self.moves_or_rests])(name)
        start = self.choose.vary([f"What is the {name} of", f"What {name} is"])
        return f"{start} the {text}?", [*tokens, f"query_{name}"]

    def ordered(self) -> Pair:
        """ "first", "second" or "last" with its module, or `unique`."""
        order = self.choose.pick(["", "first", "second", "last"])
        return (f"{order} ", [order, "filter_order"]) if order else ("", ["unique"])

    def collision_partner(self, _: str) -> Pair:
        """REF: "the [first] object to collide with the OBJ"."""
        order, pick = self.ordered()
        text, tokens = self.one()
        program = ["events", *tokens, "filter_collision", *pick, *tokens, "get_col_partner"]
        return f"{order}object to collide with {text}", program

    def enters_or_exits(self, asked: str) -> Pair:
        """REF: "the [first] OBJ that enters|exits the scene", where OBJ does not name the attribute `asked`."""
        order, pick = self.ordered()
        verb, token = self.in_or_out()
        text, tokens = self.some("enters", asked)
        return f"{order}{text} that {verb}s the scene", ["events", "objects", *tokens, token, *pick, "get_object"]

    def moves_or_rests(self, asked: str) -> Pair:
        """REF: "the moving OBJ TIME", "the OBJ that is stationary TIME", where OBJ does not name the attribute `asked`."""
        text, tokens = self.some("moves", asked)
        when, frame = self.time()
        word, token = self.motion()
        phrase = self.choose.vary([f"{word} {text}{when}", f"{text} that is {word}{when}"])
        return phrase, ["objects", *tokens, *frame, token, "unique"]

    def collision(self) -> Pair:
        """ "the collision between the OBJ and the OBJ" and its other wordings."""
        text, tokens = self.one()
        other, other_tokens = self.one()
        phrase = self.choose.vary([f"the collision between {text} and {other}", f"{text}'s colliding with {other}"])
        return phrase, ["events", *tokens, "filter_collision", *other_tokens, "filter_collision", "unique"]

    def entrance(self) -> Pair:
        """ "the OBJ's entrance" and its other wordings."""
        text, tokens = self.one()
        phrase = self.choose.vary([f"{text}'s entrance", f"{text}'s entering the scene"])
        return phrase, ["events", *tokens, "filter_in", "unique"]

    def exit(self) -> Pair:
        """ "the OBJ's exit" and its other wordings."""
        text, tokens = self.one()
        phrase = self.choose.vary([f"{text}'s exit", f"{text}'s exiting the scene"])
        return phrase, ["events", *tokens, "filter_out", "unique"]

    def presence(self) -> Pair:
        """ "the presence of the OBJ"."""
        text, tokens = self.one()
        return f"the presence of {text}", tokens

    def happens(self) -> Pair:
        """ "the OBJ and the OBJ collide" and its other wordings."""
        (first, tokens), (second, other_tokens) = self.one(), self.one()
        sentence = self.choose.vary([f"{first} collides with {second}", f"{first} and {second} collide"])
        program = ["all_events", *tokens, "filter_collision", *other_tokens, "filter_collision", "unique"]
        return sentence[0].upper() + sentence[1:], program

    def explanatory(self) -> Pair:
        '''"Which of the following is [not] responsible for EVENT?"'''
        text, tokens = self.choose.pick([self.collision, self.exit], EXPLANATORY_WEIGHTS)()
        negated = self.choose.pick([False, True])
        program = ["events", *tokens, "filter_ancestor", "belong_to", *(["negate"] if negated else [])]
        return f"Which of the following is {'not ' if negated else ''}responsible for {text}?", program

    def predictive(self) -> Pair:
        """ "What will happen next?" and its other wording."""
        text = self.choose.vary(["What will happen next?", "Which event will happen next?"])
        return text, ["unseen_events", "belong_to"]

    def counterfactual(self) -> Pair:
        """ "What will [not] happen without the OBJ?" and its other wordings."""
        text, tokens = self.one()
        negated = self.choose.pick([False, True])
        subject = self.choose.vary(["what", "which event", "which of the following"])
        condition = self.choose.vary([f"if {text} is removed", f"without {text}"])
        will = f"{subject} will {'not ' if negated else ''}happen"
        sentence = self.choose.vary([f"{will} {condition}?", f"{condition}, {will}?"])
        program = ["all_events", *tokens, "get_counterfact", "belong_to", *(["negate"] if negated else [])]
        return sentence[0].upper() + sentence[1:], program

    def descriptive(self) -> Pair:
        """Any descriptive question."""
        families = [self.count_or_exist_events, self.count_or_exist_motion, self.query]
        return self.choose.pick(families, DESCRIPTIVE_WEIGHTS)()

    def multiple_choice(self) -> Pair:
        """Any multiple-choice question."""
        families = [self.explanatory, self.counterfactual, self.predictive]
        return self.choose.pick(families, MULTIPLE_CHOICE_WEIGHTS)()

    def choice(self) -> Pair:
        """Any option of a multiple-choice question."""
        families = [self.presence, self.collision, self.entrance, self.exit, self.happens]
        return self.choose.pick(families, CHOICE_WEIGHTS)()


TEXT_KINDS = ("descriptive", "multiple_choice", "choice")
"""The three kinds of text, each with its own network (paper, section 4.3); also the names of the start symbols in `Grammar`."""


class _AtRandom:
    def __init__(self, rng: random.Random) -> None:
        self.rng = rng

    def pick(self, options: Sequence[T], weights: Sequence[float] | None = None) -> T:
        return self.rng.choices(options, weights)[0]

    vary = pick


def random_words(rng: random.Random) -> tuple[str, ...]:
    """Random attribute words of a single object, at least one."""
    used = [name for name, probability in WORD_PROBABILITIES.items() if rng.random() < probability]
    return tuple(rng.choice(ATTRIBUTES[name]) for name in used or ["color"])


class _RandomWords:
    def __init__(self, rng: random.Random) -> None:
        self.rng = rng

    def one(self, choose: Chooser) -> tuple[str, ...]:
        return random_words(self.rng)

    def some(self, choose: Chooser, use: str, without: str) -> tuple[str, ...]:
        return () if self.rng.random() < BARE_PROBABILITIES[use] else self.one(choose)


def sample(kind: str, rng: random.Random) -> Pair:
    """A random text of a kind ("descriptive", "multiple_choice" or "choice") and its program's tokens.

    Objects are described by random attribute words, so that a text need not fit any scene.
    """
    text: Pair = getattr(Grammar(_AtRandom(rng), _RandomWords(rng)), kind)()
    return text


class _Replay:
    """Repeats a recorded path of picks, then takes the first option of every further one; wordings are drawn at random."""

    def __init__(self, path: list[tuple[int, int]], rng: random.Random) -> None:
        self.path, self.depth, self.rng = path, 0, rng

    def pick(self, options: Sequence[T], weights: Sequence[float] | None = None) -> T:
        if self.depth == len(self.path):
            self.path.append((0, len(options)))
        index = self.path[self.depth][0]
        self.depth += 1
        return options[index]

    def vary(self, options: Sequence[T], weights: Sequence[float] | None = None) -> T:
        return self.rng.choices(options, weights)[0]


def every(symbol: Callable[[Grammar], Pair], phrases: Phrases, rng: random.Random) -> Iterator[Pair]:
    """All contents of a symbol such as `Grammar.query`, each in one random wording.

    Args:
        symbol: a method of `Grammar`.
        phrases: describes objects; it has to choose among descriptions by `pick`.
        rng: draws the wordings.
    """
    path: list[tuple[int, int]] = []
    while True:
        yield symbol(Grammar(_Replay(path, rng), phrases))
        while path and path[-1][0] + 1 == path[-1][1]:
            path.pop()
        if not path:
            return
        path[-1] = (path[-1][0] + 1, path[-1][1])
