"""Answers and how they were found."""

from collections.abc import Sequence
from dataclasses import dataclass, field
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
    trace: tuple[TraceStep, ...] = field(repr=False)
    error: str = ""
    probability: float | None = None

    def __str__(self) -> str:
        """The judgement and the choice, such as "correct (98 %) The cube exits the scene"; why it failed, if it did."""
        return _line(self)


@dataclass(frozen=True)
class Answer:
    """The answer to a question. Printed, it is the answer with its probability, and a line for each choice.

    Attributes:
        question: text of the question; "" when only a program was given.
        program: postfix tokens of the question's program.
        answer: a number for a count; else a word, "frame 43" for a frame, or one line per event. For a multiple-choice
            question, the text of the correct choice, or a tuple of their texts if not exactly one is correct.
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
    answer: int | str | tuple[str, ...]
    trace: tuple[TraceStep, ...] = field(default=(), repr=False)
    choices: tuple[ChoiceAnswer, ...] = ()
    probability: float | None = None
    notes: tuple[str, ...] = ()

    @classmethod
    def of_choices(
        cls, question: str, program: tuple[str, ...], choices: Sequence[ChoiceAnswer], notes: Sequence[str] = ()
    ) -> "Answer":
        """The answer to a multiple-choice question: the choices that are correct.

        Args:
            question: text of the question.
            program: postfix tokens of the question's program.
            choices: the judged choices.
            notes: what a user should know about the answer.
        """
        chosen = tuple(c.choice for c in choices if c.answer == "correct")
        return cls(question, program, chosen[0] if len(chosen) == 1 else chosen, (), tuple(choices), None, tuple(notes))

    @property
    def is_multiple_choice(self) -> bool:
        """Whether the choices are those of a multiple-choice question, and not candidates for the answer."""
        return bool(self.choices) and not self.trace

    @property
    def text(self) -> str:
        """The answer in words, as CLEVRER's files write it: "3" for a count. For a multiple-choice question, the texts of the
        correct choices, separated by semicolons, or "none".
        """
        return ("; ".join(self.answer) or "none") if isinstance(self.answer, tuple) else str(self.answer)

    def __str__(self) -> str:
        width = max((len(_judgement(c)) for c in self.choices), default=0)
        probability = format_probability(self)
        if self.probability is not None and "\n" in self.text:
            probability = f"\nall of this: {percent(self.probability)}"
        return "\n".join([self.text + probability, *(_line(c, width) for c in self.choices)])


def _judgement(choice: ChoiceAnswer) -> str:
    return (choice.answer or "error") + format_probability(choice)


def _line(choice: ChoiceAnswer, width: int = 0) -> str:
    return f"{_judgement(choice):<{width}} {choice.choice}{': ' + choice.error if choice.error else ''}"


def answer_from_word(word: str) -> int | str:
    """The answer that a word stands for: a number for a count such as "3", else the word."""
    return int(word) if word.isdecimal() else word


def format_probability(answer: Answer | ChoiceAnswer) -> str:
    """How probable it is that an answer or judgement is right, as " (98 %)"; "" where that is not known."""
    if answer.probability is None or answer.answer is None:
        return ""
    right = 1 - answer.probability if answer.answer == "wrong" else answer.probability
    return f" ({percent(right)})"


def percent(probability: float) -> str:
    """A probability (0-1) as "77 %", never as certainty."""
    rounded = round(100 * probability)
    return f"{'>99' if rounded == 100 else '<1' if rounded == 0 else rounded} %"
