"""Answers told in sentences that can be checked: what happens at which frame, and what follows from it.

Every sentence before the answer is a claim in the grammar of `docs/rewards.md`; `nsdr.claims.verification` reads it back. Each
stands on a line of its own.
"""

from collections.abc import Iterable, Sequence
from itertools import combinations, pairwise
from string import ascii_uppercase
from typing import Any, Literal, get_args

from nsdr.claims.counted_sets import CountedSet, counted_set
from nsdr.clevrer.answers.prompts import answer_text
from nsdr.errors import ExecutionError
from nsdr.symbolic.causal import causal_path
from nsdr.symbolic.modules import Kind
from nsdr.symbolic.program import Program, Step
from nsdr.types import Answer, ChoiceAnswer, Event, Scene, TraceStep
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["Length", "Namer", "narrate"]

Length = Literal["short", "long"]
VERBS = {"in": ("enters", "enter"), "out": ("exits", "exit")}
NOUNS = {"in": "entrance", "out": "exit"}


def narrate(answer: Answer | ChoiceAnswer, scene: Scene, length: Length = "short") -> str:
    """Tell how an answer follows from what happens, in checkable sentences, one a line; the last line is the tagged answer.

    Events are told with their frames ("Frame 43: the red cube and the blue sphere collide."), then what is counted or asked
    for, what led to what, what happens after the video ("After the video, …") or without an object ("Without the red cube, …").
    Options of a multiple-choice question follow each other in their order. Objects are named by as many attributes as they
    need.

    What a program does that the sentences cannot say (such as sets within sets) is left out; its events are told all the same.

    Args:
        answer: of `Executor.answer` or `Executor.judge` with the paper's semantics, or one of the latter's choices. Where the
            executor had to suppose another course of events (`Scene.uncertain`), the trace's facts differ from the scene's.
        scene: the scene that it is about.
        length: "short" tells what the answer rests on; "long" all observed events first, and all that is known of the time
            after the video or of the video without the removed object where the question asks for that.

    Raises:
        ExecutionError: an unknown length, or an answer without a trace.
    """
    if length not in get_args(Length):
        raise ExecutionError(f"length {length!r}: expected {' or '.join(get_args(Length))}")
    judged = answer.choices if isinstance(answer, Answer) and answer.choices else (answer,)
    told = _Narration(scene, length)
    for one in judged:
        if one.trace:
            told.conclude(Program.parse(one.program).steps, one.trace)
        elif not (isinstance(one, ChoiceAnswer) and one.error):
            raise ExecutionError("the answer has no trace; expected one of an executor with semantics 'paper'")
    return "\n".join([*told.sentences(), f"<answer>{_answer(answer)}</answer>"])


def _answer(answer: Answer | ChoiceAnswer) -> str:
    if isinstance(answer, Answer) and answer.choices:
        letters = zip(ascii_uppercase, answer.choices, strict=False)
        return answer_text({letter for letter, c in letters if c.answer == "correct"})
    return (answer.answer or "none").replace("\n", "; ")


class Namer:
    """Names the objects of a scene by as few attributes as single each out, colour and shape first.

    Args:
        scene: the scene; its attribute triples are unique.
    """

    def __init__(self, scene: Scene) -> None:
        self._objects = scene.objects

    def __call__(self, index: int, without: str = "") -> str:
        """A name such as "the red cube".

        Args:
            index: id of the object.
            without: an attribute that the name leaves out, if it can.
        """
        names = [n for n in ATTRIBUTES if n != without]
        subsets = [s for size in range(1, len(names) + 1) for s in combinations(names, size)]
        preferred = [s for s in subsets if {"color", "shape"} - {without} <= set(s)]
        for subset in (*preferred, *subsets):
            wanted = self._words(index, subset)
            if [self._words(i, subset) for i in range(len(self._objects))].count(wanted) == 1:
                return f"the {class_name(wanted)}"
        if without:
            return self(index)
        raise ExecutionError(f"more than one {self._objects[index].name}; attribute triples must be unique")

    def _words(self, index: int, names: Iterable[str]) -> tuple[str, ...]:
        return tuple(getattr(self._objects[index], name) for name in names)


def class_name(words: Sequence[str], plural: bool = False) -> str:
    """ "red cube" or "metal objects"."""
    noun = () if words and words[-1] in ATTRIBUTES["shape"] else ("object",)
    return " ".join((*words, *noun)) + ("s" if plural else "")


class _Narration:
    """Collects evidence, conclusions and the answer's facts of one question."""

    def __init__(self, scene: Scene, length: Length) -> None:
        self.scene, self.long, self.name = scene, length == "long", Namer(scene)
        self.events: set[Event] = set(scene.events) if self.long else set()
        self.states: list[str] = []
        self.conclusions: list[str] = []

    def sentences(self) -> list[str]:
        """All sentences, each once: events in order of time, then states, then conclusions."""
        events = [self.event(e) for e in self.scene.events if e in self.events]
        return list(dict.fromkeys(f"{s[0].upper()}{s[1:]}." for s in (*events, *self.states, *self.conclusions)))

    def event(self, event: Event) -> str:
        return f"frame {event.frame}: {self.clause(event)}"

    def clause(self, event: Event, negated: bool = False, modal: str = "") -> str:
        """ "the red cube and the blue sphere collide"."""
        names = [self.name(i) for i in event.objects]
        singular, plural = VERBS.get(event.kind, ("", "collide"))
        if not negated and not modal:
            return f"{' and '.join(names)} {plural if len(names) > 1 else singular}"
        auxiliary = modal or ("do" if len(names) > 1 else "does")
        return f"{' and '.join(names)} {auxiliary} {'not ' if negated else ''}{plural}"

    def noun(self, event: Event) -> str:
        """ "the collision of the red cube and the blue sphere at frame 43"."""
        who = " and ".join(self.name(i) for i in event.objects)
        return f"the {NOUNS.get(event.kind, 'collision')} of {who} at frame {event.frame}"

    def conclude(self, steps: Sequence[Step], trace: Sequence[TraceStep]) -> None:
        """Add what a trace's answer rests on."""
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
            self._counted(counted_set(steps, trace, step.inputs[0]), trace[step.inputs[0]])
        elif step.module.startswith("query_"):
            self._queried(step, steps, trace)
        else:
            self.events |= set(step.events) & set(self.scene.events)

    # Multiple choice.

    def _membership(self, chosen: TraceStep, group: TraceStep, trace: Sequence[TraceStep]) -> None:
        if group.module == "filter_ancestor":
            self._responsible(chosen.value, trace[group.inputs[1]].value)
        elif isinstance(chosen.value, Event) and chosen.value.kind == "collision":
            event = chosen.value
            self.events |= {e for e in self.scene.events if e.objects == event.objects and e.kind == event.kind}
            if group.module == "unseen_events":
                self._unseen(event)
            elif group.module == "get_counterfact":
                self._without(event, trace[group.inputs[1]].value)

    def _responsible(self, chosen: Any, target: Event) -> None:
        """What led to an event: the chosen event or object, with the chain of events in between."""
        self.events.add(target)
        events = self.scene.events
        if not isinstance(chosen, Event):
            path = causal_path(events, lambda e: chosen in e.objects, target)
            self.events |= set(path or ())
            denied = "" if path else "not "
            self.conclusions.append(f"{self.name(chosen)} is {denied}responsible for {self.noun(target)}")
            return
        same = [e for e in events if (e.kind, e.objects) == (chosen.kind, chosen.objects)]
        path = causal_path(events, lambda e: e in same and e != target, target)
        if path:
            self.events |= set(path)
            links = list(pairwise(path)) if self.long else []
            for cause, effect in [*links, (path[0], target)]:
                self.conclusions.append(f"{self.noun(cause)} led to {self.noun(effect)}")
        elif not same:
            self.conclusions.append(self.clause(chosen, negated=True))
        for event in same if not path else []:
            self.events.add(event)
            self.conclusions.append(f"{self.noun(event)} did not lead to {self.noun(target)}")

    def _unseen(self, event: Event) -> None:
        unseen = self.scene.unseen or ()
        if self.long:
            self.states += [self._motion(i, self.scene.n_frames - 1) for i in event.objects if self._knows_motion(i)]
            self.conclusions += [f"after the video, {self.clause(e)}" for e in unseen]
        happens = any(e.objects == event.objects for e in unseen)
        self.conclusions.append(f"after the video, {self.clause(event, not happens)}")

    def _without(self, event: Event, removed: int) -> None:
        events = (self.scene.counterfactual or {}).get(removed, ())
        if self.long:
            self.conclusions += [f"without {self.name(removed)}, {self.clause(e, modal='would')}" for e in events]
        happens = any(e.objects == event.objects for e in events)
        self.conclusions.append(f"without {self.name(removed)}, {self.clause(event, not happens, 'would')}")

    def _knows_motion(self, index: int) -> bool:
        return self.scene.moving is not None and bool(self.scene.visible[index, -1])

    def _motion(self, index: int, frame: int) -> str:
        assert self.scene.moving is not None
        state = "moving" if self.scene.moving[index, frame] else "stationary"
        return f"frame {frame}: {self.name(index)} is {state}"

    # Open questions.

    def _counted(self, counted: CountedSet | None, found: TraceStep) -> None:
        if counted and counted.motion:
            for i in found.value:
                self.states.append(_moving_clause(self.name(i), False, counted))
        self.events |= set(found.events) & set(self.scene.events) if found.kind == Kind.EVENTS else set()
        if counted is None:
            return
        if counted.pair is None:
            self.conclusions.append(_count_clause(counted, len(found.value), self.name))
            return
        event = Event("collision", 0, counted.pair)
        when = f" {counted.relation} frame {counted.frame}" if counted.relation else ""
        later = "after the video, " if counted.later else ""
        self.conclusions.append(f"{later}{self.clause(event, not found.value)}{when}")

    def _queried(self, step: TraceStep, steps: Sequence[Step], trace: Sequence[TraceStep]) -> None:
        attribute = step.module.removeprefix("query_")
        source = trace[step.inputs[0]]
        index = source.value
        below = trace[source.inputs[0]] if source.inputs else source
        if source.module in ("get_object", "get_col_partner") and below.module == "filter_order":
            self._placed(index, below, steps, trace)
        elif source.module == "unique":
            counted = counted_set(steps, trace, source.inputs[0])
            if counted and counted.motion:
                self.states.append(_moving_clause(self.name(index), False, counted))
        if attribute in ATTRIBUTES:  # claims know no speeds, directions and names
            self.conclusions.append(f"the {attribute} of {self.name(index, without=attribute)} is {step.value}")

    def _placed(self, index: int, order: TraceStep, steps: Sequence[Step], trace: Sequence[TraceStep]) -> None:
        """ "the second cube to enter is the red cube", where that says all that the program does."""
        counted = counted_set(steps, trace, order.inputs[0])
        if counted is None or counted.relation or counted.later or counted.pair:
            return
        place = trace[order.inputs[1]].value
        if counted.event == "collision" and counted.who is not None:
            self.conclusions.append(
                f"the {place} object to collide with {self.name(counted.who)} is {self.name(index)}"
            )
        elif counted.event in VERBS and counted.who is None:
            verb = VERBS[counted.event][1]
            self.conclusions.append(f"the {place} {class_name(counted.words)} to {verb} is {self.name(index)}")


def _steps_below(trace: Sequence[TraceStep], index: int) -> set[int]:
    found = {index}
    for i in trace[index].inputs:
        found |= _steps_below(trace, i)
    return found


def _moving_clause(who: str, plural: bool, counted: CountedSet) -> str:
    """ "frame 12: the red cube is moving", "2 cubes never move in the video"."""
    if counted.frame is None:
        if counted.motion == "moving":
            return f"{who} move{'' if plural else 's'} in the video"
        return f"{who} never move{'' if plural else 's'} in the video"
    return f"frame {counted.frame}: {who} {'are' if plural else 'is'} {counted.motion}"


def _count_clause(counted: CountedSet, number: int, name: Namer) -> str:
    words = "no" if number == 0 else str(number)
    plural = number > 1
    when = f"{counted.relation} frame {counted.frame}" if counted.relation else "in the video"
    if counted.event == "collision":
        who = f" of {name(counted.who)}" if counted.who is not None else ""
        clause = f"{words} collision{'s' if plural else ''}{who} {'happen' if plural else 'happens'}"
        return f"after the video, {clause}" if counted.later else f"{clause} {when}"
    what = f"{words} {class_name(counted.words, plural)}"
    if counted.event:
        return f"{what} {VERBS[counted.event][1 if plural else 0]} {when}"
    if counted.motion:
        return _moving_clause(what, plural, counted)
    return f"there {'are' if plural else 'is'} {what}"
