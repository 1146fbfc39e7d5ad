"""`semantics="official"`: the answers of the released executor on its own prediction files, including its quirks.

Besides what it knows of a file (`nsdr.symbolic.official_world`), it differs from the paper's semantics in this:

- Types are checked when a program runs. Objects and frames are both plain numbers.
- `events` holds the start and the end of the video as well; `all_events` holds collisions only, without frames.
- Entrances and exits after the video never match a filter.
- Taking part in an event does not make an object responsible for it.
- Unknown tokens are values. The answer is the top of the stack; values left below it are ignored. An object or a frame as the
  answer is its number. Any failure gives the answer "error".
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import combinations
from typing import Any

from nsdr.clevrer.files.predictions import PredictionFile
from nsdr.errors import ExecutionError, NsdrError, ProgramError
from nsdr.symbolic.modules import MODULES, WORDS, Kind
from nsdr.symbolic.official_world import OfficialEvent, OfficialWorld
from nsdr.symbolic.postfix import NotQuick, PhraseTable, PostfixRunner
from nsdr.symbolic.program import ProgramSource, program_tokens
from nsdr.types import Answer, ChoiceAnswer, TraceStep
from nsdr.types.answers import with_lazy
from nsdr.world.timeline import VIDEO_FRAMES

__all__ = ["OfficialExecutor"]

ERROR = "error"
"""The answer of a program that fails."""
ORDERS = {"first": 0, "second": 1, "last": -1}
"""Index of an event in a list, by order word."""


class OfficialExecutor:
    """The released executor on one prediction file. A program that fails is an "error", never an exception.

    Args:
        content: of `sim_N.json` (see `nsdr.clevrer.files.predictions`).
        collisions: "predicted", or "velocity" for the variant NE ("no events"), which detects them from the motion.

    Raises:
        DataError: another value of `collisions`.
    """

    def __init__(self, content: PredictionFile, collisions: str = "predicted") -> None:
        self.world = OfficialWorld(content, collisions)
        self._runner = PostfixRunner(PHRASES, self.world)

    def run(self, program: ProgramSource) -> Any:
        """Run a program.

        Returns:
            Its value: a word, number or truth value, an object id or frame, an `OfficialEvent`, a list of object ids or
            events, or None for `null`; "error" for a program that fails.
        """
        try:
            value = self._runner.run(program)[0]
            return value.copy() if isinstance(value, list) else value
        except ExecutionError:
            return ERROR
        except NotQuick:
            pass
        try:
            return self._values(_tokens(program))[-1][2]
        except (ProgramError, ExecutionError):
            return ERROR

    def run_batch(self, programs: Iterable[ProgramSource]) -> list[Any]:
        """Run many programs; returns the value of each as from `run`."""
        return [self.run(program) for program in programs]

    def answer(self, program: ProgramSource, question: str = "") -> Answer:
        """Answer a question; a program that fails gives "error" without a trace."""
        tokens = _tokens(program)
        value = self.run(tokens)
        if isinstance(value, str) and value == ERROR:
            return Answer(question, tokens, ERROR)
        answer = Answer(
            question, tokens, str(value) if type(value) is int else self._text(_kind(tokens[-1], value), value)
        )
        return with_lazy(answer, trace=partial(self._trace, tokens))

    def _trace(self, tokens: tuple[str, ...]) -> tuple[TraceStep, ...]:
        values = self._values(tokens)
        return tuple(TraceStep(t, inputs, _kind(t, v), v, self._text(_kind(t, v), v)) for t, inputs, v in values)

    def judge(
        self,
        question_program: ProgramSource,
        choices: Sequence[tuple[str, ProgramSource | NsdrError]],
        question: str = "",
    ) -> Answer:
        """Each choice joined with the question into one program: "yes" is correct, "no" wrong, anything else an "error"."""
        tokens = _tokens(question_program)
        judged = []
        for text, choice in choices:
            if isinstance(choice, NsdrError):
                judged.append(ChoiceAnswer(text, ERROR, (), (), str(choice)))
                continue
            whole = self.answer((*_tokens(choice), *tokens))
            judgement = {"yes": "correct", "no": "wrong"}.get(str(whole.answer), ERROR)
            judged.append(ChoiceAnswer(text, judgement, whole.program, whole.trace))
        return Answer(question, tokens, None, (), tuple(judged))

    def _values(self, tokens: Sequence[str]) -> list[tuple[str, tuple[int, ...], Any]]:
        """Token, indices of the inputs and value of every step."""
        values: list[tuple[str, tuple[int, ...], Any]] = []
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
                arguments = [values[i][2] for i in inputs]
                for allowed, argument in zip(kinds, arguments, strict=True):
                    if not any(_fits(kind, argument) for kind in allowed):
                        raise ProgramError(f"{token}: does not take {argument}; expected {' or '.join(allowed)}")
                value = _FUNCTIONS[token](self.world, *arguments)
            stack.append(len(values))
            values.append((token, inputs, value))
        if not values:
            raise ProgramError("the program is empty")
        return values

    def _text(self, kind: Kind, value: Any) -> str:
        """A value in words."""
        if isinstance(value, list):
            return "; ".join(self._text(kind, v) for v in value) or "none"
        if isinstance(value, OfficialEvent):
            names = " and ".join(self._text(Kind.OBJECT, i) for i in value.objects)
            when = "" if value.frame is None else f"(frame {value.frame})"
            return " ".join(part for part in (names, value.kind, when) if part)
        if kind in (Kind.OBJECT, Kind.OBJECTS):
            return self.world.objects[value].name if value >= 0 else "unknown object"
        if isinstance(value, bool):
            return "yes" if value else "no"
        return "the whole video" if value is None else str(value)


def _tokens(source: ProgramSource) -> tuple[str, ...]:
    """Tokens of a program; none, which is an error when it runs, of an unreadable tree."""
    try:
        return program_tokens(source)
    except ProgramError:
        return ()


def _fits(kind: Kind, value: Any) -> bool:
    if kind == Kind.OBJECTS:
        return isinstance(value, list) and all(type(v) is int for v in value)
    if kind == Kind.EVENTS:
        return isinstance(value, list) and all(isinstance(v, OfficialEvent) for v in value)
    if kind == Kind.EVENT:
        return isinstance(value, OfficialEvent)
    if kind in (Kind.OBJECT, Kind.FRAME):
        return type(value) is int or (value is None and kind == Kind.FRAME)
    return isinstance(value, bool) if kind == Kind.BOOLEAN else isinstance(value, str) and WORDS.get(value) == kind


def _kind(token: str, value: Any) -> Kind:
    """Kind of a step's value, for the trace."""
    if isinstance(value, OfficialEvent):
        return Kind.EVENT
    module = MODULES.get(token)
    return WORDS.get(token, Kind.UNKNOWN) if module is None else module.result or Kind.OBJECT


def _unique(_: OfficialWorld, values: list[Any]) -> Any:
    if len(values) != 1:
        raise ExecutionError(f"expected exactly one, found {len(values)}")
    return values[0]


def _get_object(_: OfficialWorld, event: OfficialEvent) -> int:
    if len(event.objects) != 1:
        raise ExecutionError(f"a {event.kind} has {len(event.objects)} objects; expected one")
    return event.objects[0]


def _partner(_: OfficialWorld, event: OfficialEvent, one: int) -> int:
    if event.kind != "collision" or one not in event.objects:
        raise ExecutionError(f"the {event.kind} is no collision of object {one}")
    return event.objects[event.objects[0] == one]


def _with(attribute: str) -> Callable[..., list[int]]:
    return lambda w, objects, word: [i for i in objects if getattr(w.object(i), attribute) == word]


def _of_kind(kind: str) -> Callable[..., list[OfficialEvent]]:
    def matches(event: OfficialEvent) -> bool:
        return event.kind == kind and (kind == "collision" or event.time < VIDEO_FRAMES)

    def run(_: OfficialWorld, events: list[OfficialEvent], who: list[int] | int) -> list[OfficialEvent]:
        objects = set(who if isinstance(who, list) else [who])
        return [e for e in events if matches(e) and not objects.isdisjoint(e.objects)]

    return run


def _only(kind: str) -> Callable[..., OfficialEvent]:
    return lambda w, events: _order(w, [e for e in events if e.kind == kind], "first")


def _order(_: OfficialWorld, events: list[OfficialEvent], order: str) -> OfficialEvent:
    index = ORDERS[order]
    if len(events) <= max(index, 0):
        raise ExecutionError(f"no {order} event among {len(events)}")
    return events[index]


def _ancestor(world: OfficialWorld, events: list[OfficialEvent], event: OfficialEvent) -> list[OfficialEvent]:
    causes = world.causes(event)
    return [e for e in events if e in causes]


def _counterfact(world: OfficialWorld, events: list[OfficialEvent], removed: int) -> list[OfficialEvent]:
    pairs = {e.objects for e in world.collisions_without(removed)}
    if any(not e.objects for e in events):
        raise ExecutionError("the start and the end of the video have no objects")
    return [e for e in events if e.objects in pairs]


def _belong(_: OfficialWorld, one: OfficialEvent | int, events: list[OfficialEvent]) -> bool:
    for event in events:
        if not isinstance(one, OfficialEvent):
            if one in event.objects:
                return True
        elif one.kind == event.kind:
            if one.kind != "collision" and event.time >= VIDEO_FRAMES:
                raise ExecutionError("entrances and exits after the video cannot be compared")
            if one.objects == event.objects:
                return True
    return False


_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "objects": lambda w: [o.id for o in w.objects],
    "events": lambda w: w.events,
    "all_events": lambda w: [OfficialEvent("collision", None, p) for p in combinations(range(len(w.objects)), 2)],
    "unseen_events": lambda w: w.unseen_events,
    "start": lambda w: _only("start")(w, w.events),
    "end": lambda w: _only("end")(w, w.events),
    "null": lambda w: None,
    "unique": _unique,
    "count": lambda w, values: len(values),
    "exist": lambda w, values: bool(values),
    "negate": lambda w, value: not value,
    "query_color": lambda w, one: w.object(one).color,
    "query_material": lambda w, one: w.object(one).material,
    "query_shape": lambda w, one: w.object(one).shape,
    "query_direction": lambda w, one, frame: w.direction(one, frame),
    "get_frame": lambda w, event: event.time,
    "get_object": _get_object,
    "get_col_partner": _partner,
    "counterfact_events": lambda w, removed: w.collisions_without(removed),
    "filter_color": _with("color"),
    "filter_material": _with("material"),
    "filter_shape": _with("shape"),
    "filter_moving": lambda w, objects, frame: w.in_motion(objects, frame, True),
    "filter_stationary": lambda w, objects, frame: w.in_motion(objects, frame, False),
    "filter_start": _only("start"),
    "filter_end": _only("end"),
    "filter_in": _of_kind("in"),
    "filter_out": _of_kind("out"),
    "filter_collision": _of_kind("collision"),
    "filter_order": _order,
    "filter_before": lambda w, events, event: [e for e in events if e.time < event.time],
    "filter_after": lambda w, events, event: [e for e in events if e.time > event.time],
    "filter_ancestor": _ancestor,
    "get_counterfact": _counterfact,
    "belong_to": _belong,
}
"""Function of each module, called as `run(world, *arguments)`; the signature table gives its arguments."""

PHRASES = PhraseTable(lambda module: _FUNCTIONS[module.name])
