"""The answers of the released research code on its own prediction files, including its quirks.

Besides what it knows of a file (`nsdr.symbolic.official_facts`), it differs from `nsdr.Executor` in this:

- Types are checked when a program runs. Objects and frames are both plain numbers.
- `events` holds the start and the end of the video as well; `all_events` holds collisions only, without frames.
- Entrances and exits after the video never match a filter.
- Taking part in an event does not make an object responsible for it.
- Unknown tokens are values. The answer is the top of the stack; values left below it are ignored. An object or a frame as the
  answer is its number. Any failure gives the answer "error".
"""

from collections.abc import Callable, Sequence
from typing import Any

from nsdr.clevrer.files.predictions import PredictionFile
from nsdr.errors import ExecutionError, NsdrError, ProgramError
from nsdr.symbolic.modules import MODULES, WORDS, Kind, as_set
from nsdr.symbolic.official_facts import VIDEO_FRAMES, OfficialEvent, OfficialFacts
from nsdr.symbolic.program import ProgramSource, program_tokens
from nsdr.types import Answer, ChoiceAnswer, TraceStep

ERROR = "error"
"""The answer of a program that fails."""
Events = tuple[OfficialEvent, ...]


class OfficialExecutor:
    """The released executor on one prediction file. A program that fails is an "error", never an exception.

    Args:
        content: of `sim_N.json` (see `nsdr.clevrer.files.predictions`).
        collisions: "predicted", or "velocity" for the variant NE ("no events"), which detects them from the motion.

    Raises:
        DataError: another value of `collisions`.
    """

    def __init__(self, content: PredictionFile, collisions: str = "predicted") -> None:
        self.facts = OfficialFacts(content, collisions)

    def __repr__(self) -> str:
        return f"OfficialExecutor({len(self.facts.objects)} objects)"

    def run(self, program: ProgramSource) -> Any:
        """Run a program.

        Returns:
            Its value: a word, number or truth value, an object id or frame, an `OfficialEvent`, a tuple of object ids or
            events, or None for `null`; "error" for a program that fails.
        """
        try:
            return self._steps(program_tokens(program))[-1].value
        except (ProgramError, ExecutionError):
            return ERROR

    def answer(self, program: ProgramSource, question: str = "") -> Answer:
        """Answer a question; a program that fails gives "error" without a trace."""
        tokens = program_tokens(program)
        try:
            trace = self._steps(tokens)
        except (ProgramError, ExecutionError):
            return Answer(question, tokens, ERROR)
        value = trace[-1].value
        return Answer(question, tokens, value if type(value) is int else trace[-1].text, trace)

    def answer_choices(
        self,
        question_program: ProgramSource,
        choices: Sequence[tuple[str, ProgramSource | NsdrError]],
        question: str = "",
    ) -> Answer:
        """Each choice joined with the question into one program: "yes" is correct, "no" wrong, anything else an "error"."""
        tokens = program_tokens(question_program)
        judged = []
        for text, choice in choices:
            if isinstance(choice, NsdrError):
                judged.append(ChoiceAnswer(text, ERROR, (), (), str(choice)))
                continue
            whole = self.answer((*program_tokens(choice), *tokens))
            judgement = {"yes": "correct", "no": "wrong"}.get(whole.text, ERROR)
            judged.append(ChoiceAnswer(text, judgement, whole.program, whole.trace))
        return Answer.of_choices(question, tokens, judged)

    def _steps(self, tokens: Sequence[str]) -> tuple[TraceStep, ...]:
        """Every step, with its types checked as it runs."""
        steps: list[TraceStep] = []
        stack: list[int] = []
        for token in tokens:
            value: Any = token
            inputs: tuple[int, ...] = ()
            if token in _FUNCTIONS:
                kinds = ((Kind.EVENTS,),) if token in ("filter_start", "filter_end") else MODULES[token].arguments
                first = len(stack) - len(kinds)
                if first < 0:
                    raise ProgramError(f"{token}: takes {len(kinds)} arguments, found {len(stack)}")
                inputs = tuple(stack[first:])
                del stack[first:]
                arguments = [steps[i].value for i in inputs]
                for allowed, argument in zip(kinds, arguments, strict=True):
                    if not any(_fits(kind, argument) for kind in allowed):
                        raise ProgramError(f"{token}: does not take {argument}; expected {' or '.join(allowed)}")
                value = _FUNCTIONS[token](self.facts, *arguments)
            stack.append(len(steps))
            kind = _kind(token, value)
            steps.append(TraceStep(token, inputs, kind, value, self._text(kind, value)))
        if not steps:
            raise ProgramError("the program is empty")
        return tuple(steps)

    def _text(self, kind: Kind, value: Any) -> str:
        """A value in words."""
        if kind in (Kind.EVENTS, Kind.EVENT):
            return self.facts.event_text(value if isinstance(value, tuple) else (value,))
        if kind in (Kind.OBJECTS, Kind.OBJECT):
            return self.facts.object_text(as_set(value))
        if isinstance(value, bool):
            return "yes" if value else "no"
        return "the whole video" if value is None else str(value)


def _fits(kind: Kind, value: Any) -> bool:
    if kind == Kind.OBJECTS:
        return isinstance(value, tuple) and all(type(v) is int for v in value)
    if kind == Kind.EVENTS:
        return isinstance(value, tuple) and all(isinstance(v, OfficialEvent) for v in value)
    if kind == Kind.EVENT:
        return isinstance(value, OfficialEvent)
    if kind in (Kind.OBJECT, Kind.FRAME):
        return type(value) is int or (value is None and kind == Kind.FRAME)
    return isinstance(value, bool) if kind == Kind.BOOLEAN else isinstance(value, str) and WORDS.get(value) == kind


def _kind(token: str, value: Any) -> Kind:
    """Kind of a step's value, for the trace."""
    if isinstance(value, OfficialEvent):
        return Kind.EVENT
    if token not in _FUNCTIONS:
        return WORDS.get(token, Kind.UNKNOWN)
    return MODULES[token].result or Kind.OBJECT if token in MODULES else Kind.EVENT


def _border_events(kind: str) -> Callable[..., Events]:
    def run(_: OfficialFacts, events: Events, who: tuple[int, ...] | int) -> Events:
        objects = set(as_set(who))
        return tuple(
            e for e in events if e.kind == kind and e.frame < VIDEO_FRAMES and not objects.isdisjoint(e.objects)
        )

    return run


def _only(kind: str) -> Callable[..., OfficialEvent]:
    def run(_: OfficialFacts, events: Events) -> OfficialEvent:
        found = [e for e in events if e.kind == kind]
        if not found:
            raise ExecutionError(f"no {kind} among the events")
        return found[0]

    return run


def _before(facts: OfficialFacts, events: Events, event: OfficialEvent) -> Events:
    return tuple(e for e in events if facts.frame_of(e) < facts.frame_of(event))


def _after(facts: OfficialFacts, events: Events, event: OfficialEvent) -> Events:
    return tuple(e for e in events if facts.frame_of(e) > facts.frame_of(event))


def _ancestor(facts: OfficialFacts, events: Events, event: OfficialEvent) -> Events:
    causes = facts.causes(event)
    return tuple(e for e in events if e in causes)


def _counterfact(facts: OfficialFacts, events: Events, removed: int) -> Events:
    pairs = {e.objects for e in facts.collisions_without(removed)}
    if any(not e.objects for e in events):
        raise ExecutionError("the start and the end of the video have no objects")
    return tuple(e for e in events if e.objects in pairs)


def _belong(_: OfficialFacts, one: OfficialEvent | int, events: Events) -> bool:
    for event in events:
        if not isinstance(one, OfficialEvent):
            if one in event.objects:
                return True
        elif one.kind == event.kind:
            if one.kind != "collision" and event.frame >= VIDEO_FRAMES:
                raise ExecutionError("entrances and exits after the video cannot be compared")
            if one.objects == event.objects:
                return True
    return False


_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{module.name: module.run for module in MODULES.values() if not module.extension},
    "query_direction": lambda w, one, frame: w.direction(one, frame),
    "counterfact_events": lambda w, removed: w.collisions_without(removed),
    "filter_start": _only("start"),
    "filter_end": _only("end"),
    "filter_in": _border_events("in"),
    "filter_out": _border_events("out"),
    "filter_before": _before,
    "filter_after": _after,
    "filter_ancestor": _ancestor,
    "get_counterfact": _counterfact,
    "belong_to": _belong,
}
"""Function of each module, called as `run(facts, *arguments)`; where the two semantics agree, that of the signature table. The
table also gives the arguments."""
