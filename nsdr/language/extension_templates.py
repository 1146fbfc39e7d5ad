"""Texts of questions beyond CLEVRER with their programs: speeds, directions, masses, what-ifs (see `grammar.extensions`).

Templates are functions of a `Grammar`, for `nsdr.language.templates.every`.
"""

from nsdr.language.templates import Grammar, Pair

__all__ = [
    "CHANGE_TEXTS",
    "changed",
    "direction",
    "extreme_speed",
    "faster",
    "heavier",
    "heaviest",
    "is_faster",
    "is_heavier",
    "speed",
]

CHANGE_TEXTS = {
    "twice_as_heavy": ("were twice as heavy", "weighed twice as much"),
    "half_as_heavy": ("were half as heavy", "weighed half as much"),
    "twice_as_fast": ("were twice as fast", "moved twice as fast"),
    "half_as_fast": ("were half as fast", "moved half as fast"),
    "standing_still": ("stood still", "did not move"),
}
"""Wordings of each change of an object (`nsdr.symbolic.quantities.CHANGES`)."""


def _at(grammar: Grammar) -> Pair:
    """ "when the video begins" or "when the OBJ enters the scene"."""
    if grammar.choose.pick(["video", "object"]) == "video":
        verb, token = grammar.choose.pick([("begins", "start"), ("ends", "end")])
        return f"when the video {verb}", [token, "get_frame"]
    text, tokens = grammar.one()
    verb, token = grammar.in_or_out()
    return f"when {text} {verb}s the scene", ["events", *tokens, token, "unique", "get_frame"]


def speed(grammar: Grammar) -> Pair:
    """ "How fast is the OBJ when the video ends?" and its other wordings."""
    (text, tokens), (when, frame) = grammar.one(), _at(grammar)
    wordings = [
        f"How fast is {text} {when}?",
        f"How fast does {text} move {when}?",
        f"What is the speed of {text} {when}?",
    ]
    return grammar.choose.vary(wordings), [*tokens, *frame, "query_speed"]


def direction(grammar: Grammar) -> Pair:
    """ "In which direction does the OBJ move when the video ends?" and its other wording."""
    (text, tokens), (when, frame) = grammar.one(), _at(grammar)
    wordings = [f"In which direction does {text} move {when}?", f"Which direction is {text} moving {when}?"]
    return grammar.choose.vary(wordings), [*tokens, *frame, "query_direction"]


def is_faster(grammar: Grammar) -> Pair:
    """ "Is the OBJ faster than the OBJ when the video ends?"."""
    (first, tokens), (second, others), (when, frame) = grammar.one(), grammar.one(), _at(grammar)
    return f"Is {first} faster than {second} {when}?", [*tokens, *others, *frame, "is_faster"]


def faster(grammar: Grammar) -> Pair:
    """ "Which is faster when the video ends, the OBJ or the OBJ?"."""
    (first, tokens), (second, others), (when, frame) = grammar.one(), grammar.one(), _at(grammar)
    word, token = grammar.choose.pick([("faster", "get_faster"), ("slower", "get_slower")])
    return f"Which is {word} {when}, {first} or {second}?", [*tokens, *others, *frame, token, "query_name"]


def extreme_speed(grammar: Grammar) -> Pair:
    """ "What color is the fastest object when the video ends?" and so on."""
    name = grammar.choose.pick(["color", "material", "shape"])
    when, frame = _at(grammar)
    word, token = grammar.choose.pick([("fastest", "filter_fastest"), ("slowest", "filter_slowest")])
    text = grammar.choose.vary([f"What {name} is", f"What is the {name} of"])
    return f"{text} the {word} object {when}?", ["objects", *frame, token, "unique", f"query_{name}"]


def is_heavier(grammar: Grammar) -> Pair:
    """ "Is the OBJ heavier than the OBJ?" and its other wording."""
    (first, tokens), (second, others) = grammar.one(), grammar.one()
    text = grammar.choose.vary([f"Is {first} heavier than {second}?", f"Does {first} weigh more than {second}?"])
    return text, [*tokens, *others, "is_heavier"]


def heavier(grammar: Grammar) -> Pair:
    """ "Which is heavier, the OBJ or the OBJ?"."""
    (first, tokens), (second, others) = grammar.one(), grammar.one()
    word, token = grammar.choose.pick([("heavier", "get_heavier"), ("lighter", "get_lighter")])
    return f"Which is {word}, {first} or {second}?", [*tokens, *others, token, "query_name"]


def heaviest(grammar: Grammar) -> Pair:
    """ "What is the color of the heaviest object?" and so on."""
    name = grammar.choose.pick(["color", "material", "shape"])
    word, token = grammar.choose.pick([("heaviest", "filter_heaviest"), ("lightest", "filter_lightest")])
    text = grammar.choose.vary([f"What {name} is", f"What is the {name} of"])
    return f"{text} the {word} object?", ["objects", token, "unique", f"query_{name}"]


def changed(grammar: Grammar) -> Pair:
    """ "What would [not] happen if the OBJ were twice as heavy?" and its other wordings."""
    text, tokens = grammar.one()
    change = grammar.choose.pick(list(CHANGE_TEXTS))
    negated = grammar.choose.pick([False, True])
    subject = grammar.choose.vary(["what", "which event", "which of the following"])
    would = f"{subject} would {'not ' if negated else ''}happen"
    condition = f"if {text} {grammar.choose.vary(CHANGE_TEXTS[change])}"
    sentence = grammar.choose.vary([f"{would} {condition}?", f"{condition}, {would}?"])
    program = ["all_events", *tokens, change, "get_changed", "belong_to", *(["negate"] if negated else [])]
    return sentence[0].upper() + sentence[1:], program
