"""Answers and how they were found."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

from nsdr.types.scenes import Event

__all__ = ["Answer", "ChoiceAnswer", "TraceStep", "with_trace_of"]


@dataclass(frozen=True)
class TraceStep:
    """One executed module.

    Attributes:
        module: the module's token.
        inputs: indices of the steps that gave its arguments.
        kind: type of the result (`nsdr.symbolic.Kind`).
        value: the result: a word, number or truth value, object ids, or `Event`s.
        text: the result in words.
        objects: ids of the objects in the result, or for a word or number those of its inputs.
        events: the events in the result, or for a word or number those of its inputs.
    """

    module: str
    inputs: tuple[int, ...]
    kind: str
    value: Any
    text: str
    objects: tuple[int, ...] = ()
    events: tuple[Event, ...] = ()


class _LazyTrace:
    """Makes `trace` when it is first read, if `with_trace_of` was told how."""

    def __getattr__(self, name: str) -> Any:
        if name != "trace" or "_make_trace" not in self.__dict__:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        self.__dict__["trace"] = trace = self.__dict__["_make_trace"]()
        del self.__dict__["_make_trace"]
        return trace

    def __getstate__(self) -> dict[str, Any]:
        """What pickled and copied answers keep: the steps, not the scene."""
        getattr(self, "trace", ())
        return self.__dict__


@dataclass(frozen=True)
class ChoiceAnswer(_LazyTrace):
    """The judgement of one choice of a multiple-choice question.

    Attributes:
        choice: text of the choice.
        answer: "correct" or "wrong"; None if it failed; with the official semantics also "error".
        program: postfix tokens of the choice's program followed by the question's; empty if the text has no program.
        trace: executed steps; empty if it failed.
        error: why it failed; "" if it did not.
    """

    choice: str
    answer: str | None
    program: tuple[str, ...]
    trace: tuple[TraceStep, ...]
    error: str = ""


@dataclass(frozen=True)
class Answer(_LazyTrace):
    """The answer to a question.

    Attributes:
        question: text of the question; "" when only a program was given.
        program: postfix tokens of the question's program.
        answer: the answer word, "frame 43" for a frame, or one line per event; None for a multiple-choice question.
        trace: executed steps; empty for a multiple-choice question, whose choices have traces of their own.
        choices: the judged choices; empty for a descriptive question.
    """

    question: str
    program: tuple[str, ...]
    answer: str | None
    trace: tuple[TraceStep, ...] = field(default_factory=tuple)
    choices: tuple[ChoiceAnswer, ...] = ()


T = TypeVar("T", Answer, ChoiceAnswer)


def with_trace_of(answer: T, make: Callable[[], tuple[TraceStep, ...]]) -> T:
    """The same answer, whose trace is made when it is first read.

    Args:
        answer: a new answer, which is changed.
        make: called at most once; it must give the same trace at any time.
    """
    answer.__dict__["_make_trace"] = make
    del answer.__dict__["trace"]
    return answer
