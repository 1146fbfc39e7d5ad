"""CLEVRER's question grammar: draws questions and choices with their programs.

The wordings are those of the released questions; every text has exactly one program. Objects are described by random
attribute words, so texts need not fit any scene: this trains the parser, not the executor.
"""

import random
from collections.abc import Callable

from nsdr.clevrer.vocab import COLORS, MATERIALS, SHAPES

__all__ = ["TEXT_KINDS", "sample"]

Pair = tuple[str, list[str]]
"""A text (or a part of one) and its postfix tokens."""


def _object(rng: random.Random, plural: bool = False, bare: float = 0.0) -> Pair:
    """Such as "red metal cube" and its filters; "object" alone with chance `bare`."""
    words: list[str] = []
    tokens: list[str] = []
    color, material, shape = rng.random() < 0.5, rng.random() < 0.5, rng.random() < 0.6
    if rng.random() < bare:
        color = material = shape = False
    elif not (color or material or shape):
        color = True
    for used, name, choices in ((color, "color", COLORS), (material, "material", MATERIALS), (shape, "shape", SHAPES)):
        if used:
            word = rng.choice(choices)
            words.append(word)
            tokens += [word, f"filter_{name}"]
    if not shape:
        words.append("object")
    return " ".join(words) + ("s" if plural else ""), tokens


def _one(rng: random.Random) -> Pair:
    """ "the red cube" as a single object."""
    text, tokens = _object(rng)
    return f"the {text}", ["objects", *tokens, "unique"]


def _in_or_out(rng: random.Random) -> tuple[str, str]:
    return rng.choice([("enter", "filter_in"), ("exit", "filter_out")])


def _time(rng: random.Random) -> Pair:
    kind = rng.choice(["none", "video", "object"])
    if kind == "none":
        return "", ["null"]
    if kind == "video":
        verb, token = rng.choice([("begins", "start"), ("ends", "end")])
        return f" when the video {verb}", [token, "get_frame"]
    text, tokens = _one(rng)
    verb, token = _in_or_out(rng)
    return f" when {text} {verb}s the scene", ["events", *tokens, token, "unique", "get_frame"]


def _before_after(rng: random.Random) -> Pair:
    if rng.random() < 0.35:
        return "", ["events"]
    text, tokens = _one(rng)
    verb, token = _in_or_out(rng)
    side = rng.choice(["before", "after"])
    return f" {side} {text} {verb}s the scene", ["events", "events", *tokens, token, "unique", f"filter_{side}"]


def _motion(rng: random.Random) -> tuple[str, str]:
    return rng.choice([("moving", "filter_moving"), ("stationary", "filter_stationary")])


def _count_or_exist_events(rng: random.Random) -> Pair:
    when, events = _before_after(rng)
    if rng.random() < 0.25:
        if rng.random() < 0.7:
            return f"How many collisions happen{when}?", [*events, "objects", "filter_collision", "count"]
        return f"Are there collisions{when}?", [*events, "objects", "filter_collision", "exist"]
    text, tokens = _object(rng, plural=True, bare=0.4)
    verb, token = _in_or_out(rng)
    program = [*events, "objects", *tokens, token]
    if rng.random() < 0.5:
        return f"How many {text} {verb} the scene{when}?", [*program, "count"]
    return f"Are there any {text} that {verb} the scene{when}?", [*program, "exist"]


def _count_or_exist_motion(rng: random.Random) -> Pair:
    when, frame = _time(rng)
    text, tokens = _object(rng, plural=True, bare=0.4)
    word, token = _motion(rng)
    program = ["objects", *tokens, *frame, token]
    form = rng.randrange(3)
    if form == 0:
        return f"How many {text} are {word}{when}?", [*program, "count"]
    if form == 1:
        return f"How many {word} {text} are there{when}?", [*program, "count"]
    return f"Are there any {word} {text}{when}?", [*program, "exist"]


def _query(rng: random.Random) -> Pair:
    name = rng.choice(["color", "material", "shape"])
    text, tokens = rng.choice([_collision_partner, _enters_or_exits, _moves_or_rests])(rng)
    start = rng.choice([f"What is the {name} of", f"What {name} is"])
    return f"{start} the {text}?", [*tokens, f"query_{name}"]


def _ordered(rng: random.Random) -> Pair:
    order = rng.choice(["", "first", "second", "last"])
    return (f"{order} ", [order, "filter_order"]) if order else ("", ["unique"])


def _collision_partner(rng: random.Random) -> Pair:
    order, pick = _ordered(rng)
    text, tokens = _one(rng)
    program = ["events", *tokens, "filter_collision", *pick, *tokens, "get_col_partner"]
    return f"{order}object to collide with {text}", program


def _enters_or_exits(rng: random.Random) -> Pair:
    order, pick = _ordered(rng)
    verb, token = _in_or_out(rng)
    text, tokens = _object(rng, bare=0.8)
    return f"{order}{text} that {verb}s the scene", ["events", "objects", *tokens, token, *pick, "get_object"]


def _moves_or_rests(rng: random.Random) -> Pair:
    text, tokens = _object(rng, bare=0.3)
    when, frame = _time(rng)
    word, token = _motion(rng)
    phrase = f"{word} {text}{when}" if rng.random() < 0.5 else f"{text} that is {word}{when}"
    return phrase, ["objects", *tokens, *frame, token, "unique"]


def _event(rng: random.Random, kinds: str) -> Pair:
    """An event as a noun phrase; `kinds` holds c (collision), i (in), o (out)."""
    kind = rng.choice(kinds)
    text, tokens = _one(rng)
    if kind == "c":
        other, other_tokens = _one(rng)
        phrase = rng.choice([f"the collision between {text} and {other}", f"{text}'s colliding with {other}"])
        return phrase, ["events", *tokens, "filter_collision", *other_tokens, "filter_collision", "unique"]
    if kind == "i":
        phrase = rng.choice([f"{text}'s entrance", f"{text}'s entering the scene"])
        return phrase, ["events", *tokens, "filter_in", "unique"]
    phrase = rng.choice([f"{text}'s exit", f"{text}'s exiting the scene"])
    return phrase, ["events", *tokens, "filter_out", "unique"]


def _explanatory(rng: random.Random) -> Pair:
    text, tokens = _event(rng, "cco")
    negated = rng.random() < 0.5
    program = ["events", *tokens, "filter_ancestor", "belong_to", *(["negate"] if negated else [])]
    return f"Which of the following is {'not ' if negated else ''}responsible for {text}?", program


def _predictive(rng: random.Random) -> Pair:
    text = rng.choice(["What will happen next?", "Which event will happen next?"])
    return text, ["unseen_events", "belong_to"]


def _counterfactual(rng: random.Random) -> Pair:
    text, tokens = _one(rng)
    negated = rng.random() < 0.5
    subject = rng.choice(["what", "which event", "which of the following"])
    condition = rng.choice([f"if {text} is removed", f"without {text}"])
    will = f"{subject} will {'not ' if negated else ''}happen"
    sentence = rng.choice([f"{will} {condition}?", f"{condition}, {will}?"])
    program = ["all_events", *tokens, "get_counterfact", "belong_to", *(["negate"] if negated else [])]
    return sentence[0].upper() + sentence[1:], program


def _choice(rng: random.Random) -> Pair:
    kind = rng.choice(["presence", "event", "happens"])
    if kind == "presence":
        text, tokens = _one(rng)
        return f"the presence of {text}", tokens
    if kind == "event":
        return _event(rng, "ccio")
    (first, tokens), (second, other_tokens) = _one(rng), _one(rng)
    sentence = rng.choice([f"{first} collides with {second}", f"{first} and {second} collide"])
    program = ["all_events", *tokens, "filter_collision", *other_tokens, "filter_collision", "unique"]
    return sentence[0].upper() + sentence[1:], program


_FAMILIES: dict[str, tuple[list[Callable[[random.Random], Pair]], list[int]]] = {
    "descriptive": ([_count_or_exist_events, _count_or_exist_motion, _query], [3, 3, 5]),
    "multiple_choice": ([_explanatory, _counterfactual, _predictive], [8, 8, 1]),
    "choice": ([_choice], [1]),
}
TEXT_KINDS = tuple(_FAMILIES)
"""The three kinds of text, each with a network of its own (paper, section 4.3)."""


def sample(kind: str, rng: random.Random) -> Pair:
    """A random text of a kind ("descriptive", "multiple_choice" or "choice") and its program's tokens."""
    families, weights = _FAMILIES[kind]
    return rng.choices(families, weights)[0](rng)
