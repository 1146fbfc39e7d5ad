"""What a part of a program stands for, as a noun phrase: "the brown sphere", "the first collision of the red cube"."""

from collections.abc import Sequence

from nsdr.symbolic.program import Step
from nsdr.world.vocabulary import indefinite

EVENT_NOUNS = {"filter_in": "entrance", "filter_out": "exit", "filter_collision": "collision"}
"""Noun of each filter of events."""
EVENT_VERBS = {"filter_in": "enters", "filter_out": "exits"}
"""Verb of the filters of events with one object."""
OBJECT_FILTERS = ("filter_color", "filter_material", "filter_shape")
MOTION_FILTERS = {"filter_moving": "moving", "filter_stationary": "stationary"}
"""Adjective of each filter of objects by motion."""
EXTREMES = {f"filter_{word}": word for word in ("fastest", "slowest", "heaviest", "lightest")}
"""Adjective of each filter that keeps one object."""
COMPARISONS = {f"get_{word}": word for word in ("faster", "slower", "heavier", "lighter")}
"""Adjective of each choice of one of two objects."""
PHRASES = {
    "unique": "the {0}",
    "filter_order": "the {1} {0}",
    "get_col_partner": "the other object of {0}",
    "get_object": "the object of {0}",
    "filter_ancestor": "event that led to {1}",
    "get_changed": "event with {1} {2}",
    "get_counterfact": "event without {1}",
    "counterfact_events": "event without {0}",
    "start": "the start of the video",
    "end": "the end of the video",
}
"""Phrase of each other module, of the phrases of its inputs."""


def attribute_words(steps: Sequence[Step], index: int) -> tuple[str, ...]:
    """Attribute words of the filters that gave a step's set of objects, in the order color, material, shape.

    Filters by the attribute of another object, which a program looks up, have no word.
    """
    return tuple(word for words in _filter_words(steps, index).values() for word in words)


def _filter_words(steps: Sequence[Step], index: int) -> dict[str, list[str]]:
    """The words of each of `OBJECT_FILTERS`, as in `attribute_words`."""
    words: dict[str, list[str]] = {name: [] for name in OBJECT_FILTERS}
    while steps[index].token in (*OBJECT_FILTERS, *MOTION_FILTERS, "unique"):
        if steps[index].token in OBJECT_FILTERS and (word := steps[steps[index].inputs[1]]).module is None:
            words[steps[index].token].append(word.token)
        index = steps[index].inputs[0]
    return words


def noun_phrase(steps: Sequence[Step], index: int) -> str:
    """What a step stands for; a set is named by its members' noun, without an article.

    Args:
        steps: of a program.
        index: of a step that gives objects, events, one of them, or a frame.
    """
    step = steps[index]
    if step.token in (*OBJECT_FILTERS, *MOTION_FILTERS, "objects"):
        return _objects(steps, index)
    if step.token in (*EVENT_NOUNS, "filter_before", "filter_after", "events", "all_events", "unseen_events"):
        return _events(steps, index)
    inputs = step.inputs
    if step.token in EXTREMES:
        when = _time_clause(steps, inputs[1]) if len(inputs) > 1 else ""
        return f"{EXTREMES[step.token]} {noun_phrase(steps, inputs[0])}{when}"
    if step.token in COMPARISONS:
        when = _time_clause(steps, inputs[2]) if len(inputs) > 2 else ""
        return f"the {COMPARISONS[step.token]} of {noun_phrase(steps, inputs[0])} and {noun_phrase(steps, inputs[1])}{when}"
    if step.token in PHRASES:
        return PHRASES[step.token].format(*(noun_phrase(steps, i) for i in inputs))
    return step.token if step.module else step.token.replace("_", " ")


def _objects(steps: Sequence[Step], index: int) -> str:
    words = attribute_words(steps, index)
    noun = " ".join(words if _filter_words(steps, index)["filter_shape"] else (*words, "object"))
    motion, clause = "", ""
    while steps[index].token != "objects" and steps[index].inputs:
        step = steps[index]
        if step.token in MOTION_FILTERS:
            motion += MOTION_FILTERS[step.token] + " "
            clause += _time_clause(steps, step.inputs[1])
        elif step.token in OBJECT_FILTERS and (of := steps[step.inputs[1]].inputs):
            clause += f" with the {step.token.removeprefix('filter_')} of {noun_phrase(steps, of[0])}"
        index = step.inputs[0]
    return motion + noun + clause


def _time_clause(steps: Sequence[Step], index: int) -> str:
    """ " when the video begins", " when the red cube enters", or "" for the whole video."""
    if steps[index].token != "get_frame":
        return ""
    event = steps[index].inputs[0]
    if steps[event].token in ("start", "end"):
        return f" when the video {'begins' if steps[event].token == 'start' else 'ends'}"
    filtered = steps[event].inputs[0] if steps[event].inputs else event
    if steps[event].token == "unique" and steps[filtered].token in EVENT_VERBS:
        return f" when {_participant(steps, steps[filtered].inputs[1])} {EVENT_VERBS[steps[filtered].token]}"
    return f" at {noun_phrase(steps, event)}"


def _events(steps: Sequence[Step], index: int) -> str:
    nouns: list[str] = []
    who: list[str] = []
    clause = ""
    while steps[index].inputs:
        step = steps[index]
        if step.token in EVENT_NOUNS:
            nouns.insert(0, EVENT_NOUNS[step.token])
            if steps[step.inputs[1]].token != "objects":
                who.insert(0, _participant(steps, step.inputs[1]))
        elif step.token in ("filter_before", "filter_after"):
            clause = f" {step.token.removeprefix('filter_')} {noun_phrase(steps, step.inputs[1])}{clause}"
        else:
            break
        index = step.inputs[0]
    noun = " and ".join(dict.fromkeys(nouns)) or "event"
    later = " after the video" if steps[index].token == "unseen_events" else ""
    return noun + (f" of {' and '.join(who)}" if who else "") + later + clause


def _participant(steps: Sequence[Step], index: int) -> str:
    phrase = noun_phrase(steps, index)
    return phrase if phrase.startswith("the ") else indefinite(phrase)
