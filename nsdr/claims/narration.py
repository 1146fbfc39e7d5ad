"""Answers told in sentences that can be checked: what happens at which frame, and what follows from it.

Every sentence before the answer is a claim in the grammar of `docs/claims.md`, which `nsdr.claims.verification` reads back.
Each sentence is on a line of its own.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import combinations, pairwise
from string import ascii_uppercase
from typing import Any, Literal, get_args

from nsdr.claims.reading import written
from nsdr.claims.statements import PAST_KINDS, PLACES, EventPhrase, ObjectPhrase, Statement
from nsdr.clevrer.answers.prompts import answer_text
from nsdr.errors import ExecutionError
from nsdr.symbolic.causal import causal_path
from nsdr.symbolic.modules import Kind
from nsdr.symbolic.phrases import MOTION_FILTERS, OBJECT_FILTERS, attribute_words
from nsdr.symbolic.program import Program, Step
from nsdr.types import Answer, ChoiceAnswer, Event, Scene, TraceStep
from nsdr.world.vocabulary import NAMES

Length = Literal["short", "long"]
EVENT_FILTERS = {"filter_in": "in", "filter_out": "out", "filter_collision": "collision"}


def narrate(answer: Answer | ChoiceAnswer, scene: Scene, length: Length = "short") -> str:
    """Tell how an answer follows from what happens, in checkable sentences, each on a line, and last the tagged answer.

    Events are told first, with their frames ("Frame 43: the red cube and the blue sphere collide."). Then come what is counted
    or asked for, what led to what, and what happens after the video ("After the video, …") or without an object ("Without the
    red cube, …"). The options of a multiple-choice question are told in their order. Objects are named by as few attributes as
    single them out.

    Parts of a program that the sentences cannot express, such as sets within sets, are left out; their events are still told.

    Args:
        answer: a result of `nsdr.Executor`, or one of its choices. If the executor had to suppose another course of events
            (`Scene.uncertain`), the trace's facts differ from the scene's.
        scene: the scene that the answer is about.
        length: "short" tells what the answer is based on. "long" also tells all observed events and, if the question removes
            an object, all that happens without it.

    Raises:
        ExecutionError: an unknown length, or an answer without a trace.
    """
    if isinstance(answer, Answer) and answer.choices:
        letters = zip(ascii_uppercase, answer.choices, strict=False)
        final = answer_text({letter for letter, c in letters if c.answer == "correct"})
    else:
        said = answer.text if isinstance(answer, Answer) else answer.answer or "none"
        final = said.replace("\n", "; ")
    return "\n".join([*reasons(answer, scene, length), f"<answer>{final}</answer>"])


def reasons(answer: Answer | ChoiceAnswer, scene: Scene, length: Length = "short") -> list[str]:
    """The sentences of `narrate` before the answer. Arguments and errors are those of `narrate`."""
    if length not in get_args(Length):
        raise ExecutionError(f"length {length!r}: expected {' or '.join(get_args(Length))}")
    judged = (answer,) if answer.trace or isinstance(answer, ChoiceAnswer) else answer.choices or (answer,)
    told = _Narration(scene, length)
    for one in judged:
        if one.trace:
            told.conclude(Program.parse(one.program, scene.world.vocabulary).steps, one.trace)
        elif not (isinstance(one, ChoiceAnswer) and one.error):
            raise ExecutionError("the answer has no trace; expected a result of nsdr.Executor")
    return told.sentences()


class _Narration:
    """Collects the events and statements on which the answer to one question is based."""

    def __init__(self, scene: Scene, length: Length) -> None:
        self.scene, self.vocabulary, self.long = scene, scene.world.vocabulary, length == "long"
        self.events: set[Event] = set(scene.events) if self.long else set()
        self.states: list[Statement] = []
        self.conclusions: list[Statement] = []

    def sentences(self) -> list[str]:
        """All sentences, each once: events in order of time, then states, then conclusions."""
        events = [
            Statement(PAST_KINDS[e.kind], events=(self.event(e, e.frame),))
            for e in self.scene.events
            if e in self.events
        ]
        return list(dict.fromkeys(written(s, self.vocabulary) for s in (*events, *self.states, *self.conclusions)))

    def name(self, index: int, without: str = "") -> ObjectPhrase:
        """The object, named by as few attributes as single it out. Color and shape come first; `without` is not used."""
        names = [n for n in NAMES if n != without]
        subsets = [s for size in range(1, len(names) + 1) for s in combinations(names, size)]
        preferred = [s for s in subsets if {"color", "shape"} - {without} <= set(s)]
        for subset in (*preferred, *subsets):
            wanted = self._words(index, subset)
            if [self._words(i, subset) for i in range(len(self.scene.objects))].count(wanted) == 1:
                return ObjectPhrase(f"the {self.vocabulary.noun_phrase(wanted)}", wanted)
        return self.name(index)  # the words without one attribute are another object's, too

    def _words(self, index: int, names: Iterable[str]) -> tuple[str, ...]:
        return tuple(getattr(self.scene.objects[index], name) for name in names)

    def event(self, event: Event, frame: int | None = None) -> EventPhrase:
        return EventPhrase(event.kind, tuple(self.name(i) for i in event.objects), frame)

    def conclude(self, steps: Sequence[Step], trace: Sequence[TraceStep]) -> None:
        """Add what the answer of a trace is based on."""
        index = len(trace) - 1
        while trace[index].module == "negate":
            index = trace[index].inputs[0]
        step = trace[index]
        if step.module == "belong_to":
            self._membership(trace[step.inputs[0]], trace[step.inputs[1]], trace)
            return
        for i in sorted(_steps_below(trace, index)):
            below = trace[i]
            if below.kind == Kind.EVENT and below.module in ("unique", "filter_order"):
                self.events |= {below.value} & set(self.scene.events)
        if step.module in ("count", "exist"):
            self._counted(self._collected(steps, trace, step.inputs[0]), trace[step.inputs[0]])
        elif step.module.startswith("query_"):
            self._queried(step, steps, trace)
        elif step.module in ("unseen_events", "counterfact_events"):
            removed = trace[step.inputs[0]].value if step.inputs else None
            for event in step.value:
                self._predicted(event, removed)
        else:
            self.events |= set(step.events) & set(self.scene.events)

    # Multiple choice.

    def _membership(self, chosen: TraceStep, group: TraceStep, trace: Sequence[TraceStep]) -> None:
        if group.module == "filter_ancestor":
            self._responsible(chosen.value, trace[group.inputs[1]].value)
        elif isinstance(chosen.value, Event):
            event = chosen.value
            self.events |= {e for e in self.scene.events if e.objects == event.objects and e.kind == event.kind}
            if group.module == "unseen_events":
                self._elsewhere(event, self.scene.predicted or ())
            elif group.module == "get_counterfact":
                removed = trace[group.inputs[1]].value
                self._elsewhere(event, (self.scene.counterfactual or {}).get(removed, ()), removed)

    def _responsible(self, chosen: Any, target: Event) -> None:
        """What led to an event: the chosen event or object, with the chain of events in between."""
        if target not in self.scene.events:  # it was supposed
            return
        self.events.add(target)
        effect = self.event(target, target.frame)
        events = self.scene.events
        if not isinstance(chosen, Event):
            path = causal_path(events, lambda e: chosen in e.objects, target)
            self.events |= set(path or ())
            self.conclusions.append(Statement("cause", not path, (self.name(chosen),), (effect,)))
            return
        same = [e for e in events if (e.kind, e.objects) == (chosen.kind, chosen.objects)]
        path = causal_path(events, lambda e: e in same and e != target, target)
        if path:
            self.events |= set(path)
            links = [*pairwise(path), (path[0], target)] if self.long else [(path[0], target)]
            for pair in links:
                self.conclusions.append(Statement("cause", events=tuple(self.event(e, e.frame) for e in pair)))
        elif not same:
            self.conclusions.append(Statement(PAST_KINDS[chosen.kind], True, events=(self.event(chosen),)))
        for event in same if not path else []:
            self.events.add(event)
            self.conclusions.append(Statement("cause", True, events=(self.event(event, event.frame), effect)))

    def _elsewhere(self, event: Event, events: Sequence[Event], removed: int | None = None) -> None:
        """Add whether an event happens after the video or without an object, and on what that is based.

        After the video, it is based on the last event of each of its objects, if it happens, and on what else happens then.
        Without an object, it is based on all events of its kind that do not happen in the video. A long text also tells the
        others.
        """
        observed = [e for e in self.scene.events if e.kind == event.kind]
        happening, seen = {(e.kind, e.objects) for e in events}, {(e.kind, e.objects) for e in observed}
        last, moving = self.scene.n_frames - 1, self.scene.moving
        if removed is not None:
            self.events |= {e for e in observed if (e.kind, e.objects) not in happening}
        elif (event.kind, event.objects) in happening:
            for i in event.objects:
                self.events.update([e for e in self.scene.events if i in e.objects][-1:])
        if self.long and removed is None and moving is not None:
            shown = [i for i in event.objects if self.scene.visible[i, last]]
            self.states += [self._motion(i, "moving" if moving[i, last] else "stationary", last) for i in shown]
        told = [e for e in events if self.long or e.kind == event.kind]
        told = [e for e in told if self.long or removed is None or (e.kind, e.objects) not in seen]
        for one in told:
            self._predicted(one, removed)
        self._predicted(event, removed, (event.kind, event.objects) not in happening)

    def _predicted(self, event: Event, removed: int | None, negated: bool = False) -> None:
        """Add that an event happens, or does not happen, after the video or without an object."""
        kind, gone = ("future", None) if removed is None else ("counterfactual", self.name(removed))
        self.conclusions.append(Statement(kind, negated, events=(self.event(event),), removed=gone))

    def _motion(self, index: int, state: str, frame: int | None) -> Statement:
        return Statement("motion", objects=(self.name(index),), words=(state,), frame=frame)

    # Open questions.

    def _counted(self, said: Statement | None, found: TraceStep) -> None:
        self.events |= set(found.events) & set(self.scene.events) if found.kind == Kind.EVENTS else set()
        if said is None:
            return
        if said.words:
            self.states += [self._motion(i, said.words[0], said.frame) for i in found.value]
        pair = said.events and len(said.events[0].objects) == 2
        self.conclusions.append(
            replace(said, negated=not found.value) if pair else replace(said, number=len(found.value))
        )

    def _queried(self, step: TraceStep, steps: Sequence[Step], trace: Sequence[TraceStep]) -> None:
        attribute = step.module.removeprefix("query_")
        source = trace[step.inputs[0]]
        index = source.value
        below = trace[source.inputs[0]] if source.inputs else source
        if source.module in ("get_object", "get_col_partner") and below.module == "filter_order":
            self._placed(index, below, steps, trace)
        elif source.module == "unique":
            said = self._collected(steps, trace, source.inputs[0])
            if said and said.words:
                self.states.append(self._motion(index, said.words[0], said.frame))
        if attribute in NAMES:  # claims know no speeds, directions and names
            told = (self.name(index, without=attribute),)
            self.conclusions.append(Statement("attribute", objects=told, words=(step.value,), attribute=attribute))

    def _placed(self, index: int, order: TraceStep, steps: Sequence[Step], trace: Sequence[TraceStep]) -> None:
        """Add "the second cube to enter is the red cube", if that says all that the program does."""
        said = self._collected(steps, trace, order.inputs[0])
        if said is None or said.kind != "count" or said.relation or not (said.objects or said.events[0].objects):
            return
        members = said.objects[0] if said.objects else ObjectPhrase("object", ())
        place = PLACES[trace[order.inputs[1]].value]
        told = (replace(members, text=self.vocabulary.noun_phrase(members.words), definite=True), self.name(index))
        self.conclusions.append(Statement("order", objects=told, events=said.events, number=place))

    def _collected(self, steps: Sequence[Step], trace: Sequence[TraceStep], index: int) -> Statement | None:
        """What a step collects, without its number.

        None for a set that combines several classes of objects, kinds of events or boundaries in time.
        """
        if trace[index].kind == Kind.OBJECTS:
            return _class_of(steps, trace, index)
        kinds: set[str] = set()
        classes: list[int] = []
        single: list[int] = []
        relation, frame = "", None
        while steps[index].inputs:
            step = steps[index]
            argument = step.inputs[-1]
            if step.token in EVENT_FILTERS:
                kinds.add(EVENT_FILTERS[step.token])
                if trace[argument].kind == Kind.OBJECT:
                    single.append(trace[argument].value)
                elif steps[argument].token != "objects":
                    classes.append(argument)
            elif step.token in ("filter_before", "filter_after") and not relation:
                relation, frame = step.token.removeprefix("filter_"), trace[argument].value.frame
            else:
                return None
            index = step.inputs[0]
        later = steps[index].token == "unseen_events"
        if len(kinds) != 1 or not (later or steps[index].token == "events") or (later and relation):
            return None
        (kind,) = kinds
        if kind == "collision":
            if classes or len(single) > 2 or len(set(single)) < len(single):
                return None
            event = EventPhrase(kind, tuple(self.name(i) for i in sorted(single)))
            past = kind if len(single) == 2 else "count"
            return Statement("future" if later else past, events=(event,), frame=frame, relation=relation)
        if later or single or len(classes) > 1:
            return None
        members = (
            _class_of(steps, trace, classes[0]) if classes else Statement("presence", objects=(ObjectPhrase("", ()),))
        )
        if members is None or members.words:
            return None
        return replace(members, kind="count", events=(EventPhrase(kind, ()),), frame=frame, relation=relation)


def _class_of(steps: Sequence[Step], trace: Sequence[TraceStep], index: int) -> Statement | None:
    """The class of objects that a step collects, or those of it that are in one state of motion."""
    words = attribute_words(steps, index)
    motion, frame = "", None
    while steps[index].inputs:
        step = steps[index]
        if step.token in MOTION_FILTERS:
            if motion or trace[step.inputs[0]].kind != Kind.OBJECTS:
                return None
            motion, frame = MOTION_FILTERS[step.token], trace[step.inputs[1]].value
            motion = motion if frame is not None else "ever moving" if motion == "moving" else "never moving"
        elif step.token not in OBJECT_FILTERS or steps[step.inputs[1]].inputs:
            return None
        index = step.inputs[0]
    if steps[index].token != "objects":
        return None
    states = (motion,) if motion else ()
    return Statement(
        "count" if motion else "presence", objects=(ObjectPhrase("", words, False),), words=states, frame=frame
    )


def _steps_below(trace: Sequence[TraceStep], index: int) -> set[int]:
    return {index}.union(*(_steps_below(trace, i) for i in trace[index].inputs))
