"""Programs in words: the text that a person would write for a program."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from nsdr.errors import ProgramError
from nsdr.symbolic.modules import WORDS
from nsdr.symbolic.program import Program, ProgramSource, Step

__all__ = ["in_words"]


def in_words(program: ProgramSource) -> str:
    """The question or choice that a program stands for, such as "How many red cubes are moving when the video ends?".

    The question parser reads it as that program again, for all programs of its own texts.

    Raises:
        ProgramError: the program is not well-formed, or none that a question or choice stands for.
    """
    parsed = Program.parse(program)
    try:
        text = _Words(parsed.steps).whole(len(parsed.steps) - 1)
    except (IndexError, KeyError):  # a part of it is no object, event or time of a question
        raise ProgramError("no question or choice stands for the program") from None
    return text[:1].upper() + text[1:]


@dataclass(frozen=True)
class _Objects:
    """A class of objects: attribute words, a motion, and a time such as " when the video ends"."""

    words: tuple[str, ...] = ()
    motion: str = ""
    time: str = ""
    single: int = -1
    """Step of the single object that the set was made of; -1 for a class."""

    def text(self, plural: bool) -> str:
        """ "moving red cubes when the video ends"."""
        noun = () if self.words and self.words[-1] in _SHAPES else ("object",)
        phrase = " ".join((*([self.motion] if self.motion else []), *self.words, *noun))
        return phrase + ("s" if plural else "") + self.time


@dataclass(frozen=True)
class _Events:
    """A set of events: their kind, the objects that take part, and " before the cube enters the scene" or the like."""

    base: str
    when: str = ""
    kind: str = ""
    who: tuple[int, ...] = ()
    causes_of: int = -1
    without: int = -1


_SHAPES = frozenset(word for word, kind in WORDS.items() if kind == "shape")
_INOUT = {"filter_in": ("enter", "entrance"), "filter_out": ("exit", "exit")}


class _Words:
    def __init__(self, steps: Sequence[Step]) -> None:
        self.steps = steps

    def whole(self, i: int) -> str:
        step = self.steps[i]
        if step.kind == "event":
            return self._event_choice(i)
        if step.kind == "object":
            return self.object(i)
        if step.kind == "frame":
            return f"when {self._asked(step.inputs[0])}?"
        if step.kind == "events":
            return self._future(self.events(i))
        if step.token in ("negate", "belong_to"):
            return self._multiple_choice(i) if self._judges(i) else self._exist(step.inputs[0], True)
        if step.token == "exist":
            return self._exist(i, False)
        if step.token == "count":
            return f"how many {self._subject(step.inputs[0], True)}?"
        if step.token.startswith("query_"):
            return f"what is the {step.token.removeprefix('query_')} of {self.object(step.inputs[0])}?"
        raise ProgramError(f"no question ends in {step.token!r}")

    def _step(self, i: int, *kinds: str) -> Step:
        if i < 0 or self.steps[i].kind not in kinds:
            raise ProgramError("no question or choice stands for the program")
        return self.steps[i]

    def _judges(self, i: int) -> bool:
        step = self.steps[i]
        return step.token == "belong_to" or self.steps[step.inputs[0]].token == "belong_to"

    def objects(self, i: int) -> _Objects:
        step = self._step(i, "objects", "object")
        if step.token == "objects":
            return _Objects()
        if step.kind == "object":
            return _Objects(single=i)
        below = self.objects(step.inputs[0])
        if step.token in ("filter_moving", "filter_stationary"):
            motion = step.token.removeprefix("filter_")
            return replace(below, motion=motion, time=self._time(step.inputs[1]))
        return replace(below, words=(*below.words, self.steps[step.inputs[1]].token))

    def object(self, i: int) -> str:
        """A single object: "the red cube", "the first object to collide with the sphere"."""
        step = self.steps[i]
        if step.token == "unique":
            return f"the {self.objects(step.inputs[0]).text(False)}"
        event = self.steps[step.inputs[0]]
        found = self.events(event.inputs[0])
        order = f"{self.steps[event.inputs[1]].token} " if event.token == "filter_order" else ""
        if step.token == "get_col_partner":
            return f"the {order}object to collide with {self.object(step.inputs[1])}{found.when}"
        noun = self.objects(found.who[0]).text(False)
        return f"the {order}{noun} that {_INOUT[found.kind][0]}s the scene{found.when}"

    def events(self, i: int) -> _Events:
        step = self._step(i, "events")
        if not step.inputs:
            return _Events(step.token)
        below = self.events(step.inputs[0])
        if step.token in ("filter_before", "filter_after"):
            return replace(below, when=f" {step.token.removeprefix('filter_')} {self.clause(step.inputs[1])}")
        if step.token == "filter_ancestor":
            return replace(below, causes_of=step.inputs[1])
        if step.token == "get_counterfact":
            return replace(below, without=step.inputs[1])
        return replace(below, kind=step.token, who=(*below.who, step.inputs[1]))

    def _time(self, i: int) -> str:
        step = self.steps[i]
        return "" if step.token == "null" else f" when {self.clause(step.inputs[0])}"

    def clause(self, i: int) -> str:
        """An event as a clause: "the video ends", "the cube enters the scene", "the first collision"."""
        step = self.steps[i]
        if step.token in ("start", "end"):
            return "the video begins" if step.token == "start" else "the video ends"
        found = self.events(step.inputs[0])
        if step.token == "filter_order":
            order = self.steps[step.inputs[1]].token
            if found.kind == "filter_collision":
                return f"the {order} collision"
            return f"the {order} {self.objects(found.who[0]).text(False)} {_INOUT[found.kind][0]}s the scene"
        if len(found.who) == 2:
            return f"{self.object(found.who[0])} collides with {self.object(found.who[1])}"
        return f"{self.object(found.who[0])} {_INOUT[found.kind][0]}s the scene"

    def _asked(self, i: int) -> str:
        """An event after "when": "does the cube enter the scene"."""
        clause = self.clause(i)
        for verb in ("enter", "exit", "collide"):
            clause = clause.replace(f" {verb}s", f" {verb}")
        return f"is {clause}" if clause.endswith(" collision") else f"does {clause}"

    def _event_choice(self, i: int) -> str:
        found = self.events(self.steps[i].inputs[0])
        if len(found.who) == 2:
            first, second = self.object(found.who[0]), self.object(found.who[1])
            is_possible = found.base == "all_events"
            return f"{first} collides with {second}" if is_possible else f"the collision between {first} and {second}"
        one = self.object(found.who[0])
        verb, noun = _INOUT[found.kind]
        return f"{one} {verb}s the scene" if found.base == "all_events" else f"{one}'s {noun}"

    def _subject(self, i: int, is_counted: bool) -> str:
        """What is counted, or exists, with its predicate: "red cubes enter the scene"."""
        step = self.steps[i]
        if step.kind == "objects":
            found = self.objects(i)
            tail = " are there" if is_counted else ""
            return f"{replace(found, time='').text(True)}{tail}{found.time}"
        events = self.events(i)
        if events.kind == "filter_collision":
            happen = " happen next" if events.base == "unseen_events" else " happen" if is_counted else ""
            return f"collisions{self._participants(events)}{happen}{events.when}"
        that = "" if is_counted else "that "
        return f"{self.objects(events.who[0]).text(True)} {that}{_INOUT[events.kind][0]} the scene{events.when}"

    def _participants(self, events: _Events) -> str:
        single = [self.object(who) for who in events.who if self.steps[who].kind == "object"]
        return {0: "", 1: f" involving {single[0] if single else ''}", 2: f" between {' and '.join(single)}"}[
            len(single)
        ]

    def _exist(self, i: int, is_negated: bool) -> str:
        inside = self.steps[i].inputs[0]
        step = self.steps[inside]
        if step.kind == "objects":
            single = self._single_of(inside)
            if single >= 0:
                found = self.objects(inside)
                return f"is {self.object(single)} {found.motion}{found.time}?"
        else:
            events = self.events(inside)
            if all(self.steps[who].kind == "object" for who in events.who):
                return self._does(events, is_negated)
            if events.base == "unseen_events":
                return f"will {'no' if is_negated else 'any'} collisions happen next?"
        return f"are there {'no' if is_negated else 'any'} {self._subject(inside, False)}?"

    def _single_of(self, i: int) -> int:
        return self.objects(i).single

    def _does(self, events: _Events, is_negated: bool) -> str:
        who = [self.object(one) for one in events.who]
        negation = "not " if is_negated else ""
        if events.kind != "filter_collision":
            return f"does {who[0]} {negation}{_INOUT[events.kind][0]} the scene{events.when}?"
        start = "will" if events.base == "unseen_events" else "does"
        end = " next" if events.base == "unseen_events" else events.when
        if len(who) == 2:
            return f"{start} {who[0]} {negation}collide with {who[1]}{end}?"
        return f"{start} {who[0]} {negation}collide with any object{end}?"

    def _future(self, events: _Events) -> str:
        if events.base != "unseen_events" or events.kind:
            raise ProgramError("no question asks for these events")
        return "what will happen next?"

    def _multiple_choice(self, i: int) -> str:
        is_negated = self.steps[i].token == "negate"
        judged = self.steps[self.steps[i].inputs[0] if is_negated else i]
        events = self.events(judged.inputs[1])
        negation = "not " if is_negated else ""
        if events.causes_of >= 0:
            return f"which of the following is {negation}responsible for {self._cause(events.causes_of)}?"
        if events.without >= 0:
            return f"what will {negation}happen without {self.object(events.without)}?"
        return f"what will {negation}happen next?"

    def _cause(self, i: int) -> str:
        step = self.steps[i]
        return self.clause(i) if step.token == "filter_order" else self._event_choice(i)
