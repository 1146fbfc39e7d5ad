"""Answers and how they were found."""

from dataclasses import dataclass
from typing import Any

from nsdr.types.events import Event


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


@dataclass(frozen=True)
class ChoiceAnswer:
    """The judgement of one choice of a multiple-choice question, or of one candidate for the answer of a descriptive question.

    Attributes:
        choice: text of the choice or candidate.
        answer: "correct" or "wrong"; None if it failed; "error" if it failed on an `OfficialExecutor`. A candidate is correct
            if it says the answer.
        program: postfix tokens of the choice's program followed by the question's; empty if the text has no program, and for
            a candidate.
        trace: executed steps; empty if it failed, and for a candidate.
        error: why it failed, such as a candidate that says no answer that can be read; "" if it did not.
        probability: that the choice or candidate is correct, in 0-1; None if it failed, if a candidate names no answer ("not
            sure"), or where the scene does not say which collisions are uncertain (`Scene.uncertain`).
    """

    choice: str
    answer: str | None
    program: tuple[str, ...]
    trace: tuple[TraceStep, ...]
    error: str = ""
    probability: float | None = None


@dataclass(frozen=True)
class Answer:
    """The answer to a question.

    Attributes:
        question: text of the question; "" when only a program was given.
        program: postfix tokens of the question's program.
        answer: the answer word, "frame 43" for a frame, or one line per event; None for a multiple-choice question.
        trace: executed steps; empty for a multiple-choice question, whose choices have traces of their own.
        choices: the judged choices of a multiple-choice question, or the judged candidates, if a descriptive one has any.
        probability: that the answer is right as far as the scene is known: its collisions, and in a perceived scene its
            objects, the frames of its events, and motion near its limit; None where the scene does not say which collisions are
            uncertain (`Scene.uncertain`), and for a multiple-choice question, whose choices have their own.
        notes: what a user should know about the answer, one sentence each: those of the scene, then how the question and
            its choices were read.
    """

    question: str
    program: tuple[str, ...]
    answer: str | None
    trace: tuple[TraceStep, ...] = ()
    choices: tuple[ChoiceAnswer, ...] = ()
    probability: float | None = None
    notes: tuple[str, ...] = ()
