"""Answers and how they were found."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import NoneType
from typing import Any, TypeVar

from nsdr.types.scenes import Event

__all__ = ["Answer", "ChoiceAnswer", "TraceStep", "with_lazy"]


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


class _Lazy:
    """Makes the fields that `with_lazy` was told about when they are first read."""

    def __getattr__(self, name: str) -> Any:
        make = self.__dict__.get("_makers", {}).get(name)
        if make is None:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        self.__dict__[name] = value = make()
        del self.__dict__["_makers"][name]
        return value

    def __getstate__(self) -> dict[str, Any]:
        """What pickled and copied answers keep: the steps and the probability, not the scene."""
        for name in tuple(self.__dict__.get("_makers", ())):
            getattr(self, name)
        return {k: v for k, v in self.__dict__.items() if k != "_makers"}


@dataclass(frozen=True)
class ChoiceAnswer(_Lazy):
    """The judgement of one choice of a multiple-choice question.

    Attributes:
        choice: text of the choice.
        answer: "correct" or "wrong"; None if it failed; with the official semantics also "error".
        program: postfix tokens of the choice's program followed by the question's; empty if the text has no program.
        trace: executed steps; empty if it failed.
        error: why it failed; "" if it did not.
        probability: that the choice is correct, in 0-1; None if it failed, or where the scene does not say
            what is uncertain (`Scene.uncertain`).
        meanings: of a choice of an explanatory question, whether it is correct by each meaning of "responsible"
            (`nsdr.symbolic.responsibility`), None where that is not known; else empty.
    """

    choice: str
    answer: str | None
    program: tuple[str, ...]
    trace: tuple[TraceStep, ...]
    error: str = ""
    probability: float | None = field(default_factory=NoneType)  # a plain default would be found in place of `_Lazy`'s
    meanings: Mapping[str, bool | None] = field(default_factory=dict)


@dataclass(frozen=True)
class Answer(_Lazy):
    """The answer to a question.

    Attributes:
        question: text of the question; "" when only a program was given.
        program: postfix tokens of the question's program.
        answer: the answer word, "frame 43" for a frame, or one line per event; None for a multiple-choice question.
        trace: executed steps; empty for a multiple-choice question, whose choices have traces of their own.
        choices: the judged choices; empty for a descriptive question.
        probability: that the answer is right as far as the scene's uncertain collisions go, in 0-1; None where the scene does
            not say what is uncertain (`Scene.uncertain`), and for a multiple-choice question, whose choices have their own.
    """

    question: str
    program: tuple[str, ...]
    answer: str | None
    trace: tuple[TraceStep, ...] = field(default_factory=tuple)
    choices: tuple[ChoiceAnswer, ...] = ()
    probability: float | None = field(default_factory=NoneType)  # a plain default would be found in place of `_Lazy`'s


T = TypeVar("T", Answer, ChoiceAnswer)


def with_lazy(answer: T, **makers: Callable[[], Any]) -> T:
    """The same answer, some of whose fields are made when they are first read.

    Args:
        answer: a new answer, which is changed.
        makers: by the field's name; each is called at most once, and must give the same value at any time.
    """
    answer.__dict__.setdefault("_makers", {}).update(makers)
    for name in makers:
        answer.__dict__.pop(name, None)
    return answer
