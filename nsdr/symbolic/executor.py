"""Runs programs on a scene (paper, section 4.4), step by step. The values of all steps are the trace."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from string import ascii_uppercase
from typing import Any, TypeVar

from nsdr.clevrer.answers.answer_forms import UnreadableError, read_candidate
from nsdr.errors import ExecutionError, NsdrError, ProgramError
from nsdr.io.notes import distinct
from nsdr.symbolic.facts import Boundary, SceneFacts
from nsdr.symbolic.failures import failure
from nsdr.symbolic.modules import EXTENSIONS, Kind, as_set
from nsdr.symbolic.probabilities import PossibleScenes, first_of_two, simulated
from nsdr.symbolic.program import SAID_KINDS, Program, ProgramSource, Step
from nsdr.symbolic.quantities import Simulate
from nsdr.symbolic.telling import event_lines, lines_without
from nsdr.types import Answer, ChoiceAnswer, Event, Scene, TraceStep
from nsdr.world.vocabulary import SPEED_UNIT, indefinite

PREDICTIVE = ("unseen_events", "belong_to")
"""Program of every predictive question."""
OF_OBJECTS, OF_EVENTS = (Kind.OBJECTS, Kind.OBJECT), (Kind.EVENTS, Kind.EVENT)
"""Types of values that hold objects, and of those that hold events."""
SIMULATED = frozenset({"unseen_events", "get_counterfact", "counterfact_events"})
"""Modules whose events are simulated."""
EXPECTED = {
    Kind.NUMBER: "a number, such as 3",
    Kind.BOOLEAN: "yes or no",
    Kind.FRAME: "a frame, such as frame 43",
    Kind.SPEED: f"a speed, such as 1.8 {SPEED_UNIT}",
}
"""What a candidate has to say, by the result of the question's program, where that is more than its name or a word."""
Found = TypeVar("Found")


class Executor:
    """Executes programs on one scene, by the rules of the paper and of CLEVRER's own answers.

    `nsdr.symbolic.OfficialExecutor` has the rules of the released research code instead.

    Args:
        scene: the scene.
        simulate: gives the events with an object changed, for questions beyond CLEVRER such as "what if the cube were twice
            as heavy" (`nsdr.symbolic.quantities`). With None, such questions are refused.
        data_set_rules: whether to use what is known about CLEVRER's questions and not from the video, as evaluations of the
            data set do. There is one such rule: exactly one of the two choices of a predictive question is correct. If both
            are judged alike and the scene has scores of predicted collisions, the choice with the higher score is the
            correct one.

    Raises:
        ExecutionError: the scene is no `Scene`.
    """

    def __init__(self, scene: Scene, simulate: Simulate | None = None, data_set_rules: bool = False) -> None:
        if not isinstance(scene, Scene):
            raise ExecutionError(f"programs run on a Scene, got {indefinite(type(scene).__name__)}")
        self.scene, self.data_set_rules = scene, data_set_rules
        self.facts = SceneFacts(scene, simulate)
        self._possible_scenes = PossibleScenes(scene, Executor)

    def __repr__(self) -> str:
        return f"Executor({self.scene.n_frames} frames, {len(self.scene.objects)} objects)"

    def _parsed(self, program: ProgramSource) -> Program:
        """A program in the words of the scene's world."""
        return Program.parse(program, self.scene.world.vocabulary)

    def run(self, program: ProgramSource) -> Any:
        """Run a program.

        Returns:
            Its value: a word, number or truth value, an object's id, an `Event`, or a tuple of ids or events.

        Raises:
            ProgramError: the program is not well-formed.
            ExecutionError: it does not fit the scene; says what was asked for and what the scene has.
        """
        return self._values(_complete(self._parsed(program)).steps)[-1]

    def answer(self, program: ProgramSource, question: str = "", candidates: Sequence[str] = ()) -> Answer:
        """Answer a descriptive question.

        A question supposes that what it names happened. If its program fails for the scene as it was found, it is answered for
        the most probable scene in which it does not fail, unless such scenes are too improbable
        (`nsdr.symbolic.probabilities.MIN_SUPPOSED`).

        Args:
            program: the question's program.
            question: its text.
            candidates: texts, one of which may say the answer, such as "3" or "B. The object is stationary.". Each becomes a
                choice, which is "correct" if it says the answer. A candidate that cannot be read as an answer has an `error`
                instead. If none says the answer, a note says so.

        Returns:
            The answer (yes, no, a number, an attribute word, a frame, a list of events or a description) with its trace.

        Raises:
            ProgramError: the program is not well-formed, or does not give an answer.
            ExecutionError: it does not fit the scene; says what was asked for and what the scene has.
        """
        parsed = _complete(self._parsed(program))
        if parsed.result not in SAID_KINDS:
            raise ProgramError(
                f"the program gives {parsed.result}; the program of a question ends in a count, exist, query or frame"
            )
        values = self._supposing(lambda e: e._values(parsed.steps))
        trace = self._trace(parsed.steps, values)
        said: int | str = self._told(parsed.steps, values) if parsed.result == Kind.EVENTS else trace[-1].text
        said = values[-1] if parsed.result == Kind.NUMBER else said
        probability = self._probability(parsed, self._said(parsed.result, values[-1]))
        answer = Answer(question, parsed.tokens, said, trace, (), probability)
        choices = tuple(self._candidate(parsed, answer, candidate) for candidate in candidates)
        notes = [*self.scene.notes, *parsed.notes]
        if candidates and not any(c.answer == "correct" for c in choices):
            notes.append(f"none of the candidates says the answer, {answer.text!r}")
        return replace(answer, choices=choices, notes=distinct(notes))

    def answer_choices(
        self,
        question_program: ProgramSource,
        choices: Sequence[tuple[str, ProgramSource | NsdrError] | str | list[str] | Program],
        question: str = "",
    ) -> Answer:
        """Answer a multiple-choice question: each choice is joined with the question into one program, and "yes" is correct.

        A choice that fails has an `error` in place of an answer, and the others are judged. For what the question and the
        choices suppose, see `answer`.

        Args:
            question_program: ends in `belong_to`, which takes the choice (`Program.needs_choice`).
            choices: programs, alone or as (text, program) pairs; for a text without a program, the reason.
            question: text of the question.

        Raises:
            ProgramError: a program is not well-formed, or is not that of a question or choice.
            ExecutionError: the question's program does not fit the scene; says what was asked for and what the scene has.
        """
        parsed = self._parsed(question_program)
        named = [c if isinstance(c, tuple) else (str(self._parsed(c)), c) for c in choices]
        answers = self._supposing(lambda e: e._judged(parsed, named))
        scores = self._prediction_scores(parsed, answers)
        answers = self._with_probabilities(answers) if scores is None else self._exactly_one(answers, *scores)
        of_choices = (choice.notes for _, choice in named if isinstance(choice, Program))
        notes = distinct(self.scene.notes, parsed.notes, *of_choices)
        return Answer.of_choices(question, parsed.tokens, answers, notes)

    def _candidate(self, program: Program, answer: Answer, candidate: str) -> ChoiceAnswer:
        """Whether a candidate says the answer, and how probable it is that it says the right one."""
        try:
            said = read_candidate(candidate, program.result, answer.text, self.scene.world.vocabulary)
        except UnreadableError:
            words = self.scene.world.vocabulary.words.get(program.result)
            expected = EXPECTED.get(program.result, indefinite(program.result))
            expected = f"one {program.result}: {', '.join(words)}" if words else expected
            return ChoiceAnswer(candidate, None, (), (), f"says no answer that can be read; expected {expected}")
        if said == answer.text:
            return ChoiceAnswer(candidate, "correct", (), (), probability=answer.probability)
        probability = None if said is None else self._probability(program, said)
        return ChoiceAnswer(candidate, "wrong", (), (), probability=probability)

    def _judged(
        self, question: Program, choices: Sequence[tuple[str, ProgramSource | NsdrError]]
    ) -> list[ChoiceAnswer]:
        """The choices, one by one, without probabilities."""
        answers = []
        for number, (text, choice) in enumerate(choices):
            if isinstance(choice, NsdrError):
                answers.append(ChoiceAnswer(text, None, (), (), str(choice)))
                continue
            name = f"choice {ascii_uppercase[number]}" if 1 < len(choices) <= len(ascii_uppercase) else "the choice"
            answers.append(self._judged_one(question, self._parsed(choice), text, name))
        return answers

    def _judged_one(self, question: Program, choice: Program, text: str, choice_name: str) -> ChoiceAnswer:
        whole = choice.then(question)
        try:
            values = self._values(whole.steps, choice_name, len(choice.steps))
        except ExecutionError as e:
            takes_choice = next(i for i, step in enumerate(question.steps) if -1 in step.inputs)
            self._values(question.steps[:takes_choice])  # fails if it is not the choice's fault
            found = self._possible_scenes.supposed(lambda e: e._values(whole.steps))
            if found is None:
                return ChoiceAnswer(text, None, whole.tokens, (), str(e))
            values = found
        trace = self._trace(whole.steps, values)
        return ChoiceAnswer(text, "correct" if values[-1] else "wrong", whole.tokens, trace)

    def _prediction_scores(self, question: Program, answers: Sequence[ChoiceAnswer]) -> tuple[float, float] | None:
        """Scores of the two collisions that a predictive question asks about, if they decide or give probabilities."""
        scores = self.scene.predicted_scores
        if not self.data_set_rules or scores is None or question.tokens != PREDICTIVE or len(answers) != 2:
            return None
        if any(a.error for a in answers) or (
            not self._possible_scenes.known and answers[0].answer != answers[1].answer
        ):
            return None
        chosen = [a.trace[a.trace[-1].inputs[0]].value for a in answers]
        if not all(isinstance(e, Event) and e.kind == "collision" for e in chosen):
            return None
        return float(scores[chosen[0].objects]), float(scores[chosen[1].objects])

    def _exactly_one(self, answers: Sequence[ChoiceAnswer], first: float, second: float) -> list[ChoiceAnswer]:
        """Two choices, one of which is correct. If both are judged alike, it is the one with the higher score, or the first."""
        if answers[0].answer == answers[1].answer:
            words = ("correct", "wrong") if first >= second else ("wrong", "correct")
            answers = [replace(a, answer=word) for a, word in zip(answers, words, strict=True)]
        if not self._possible_scenes.known:
            return list(answers)
        share = first_of_two(first, second)
        return [replace(answers[0], probability=share), replace(answers[1], probability=1 - share)]

    def _with_probabilities(self, answers: Sequence[ChoiceAnswer]) -> list[ChoiceAnswer]:
        """The choices with the probability that they are correct; those that failed have none."""
        return [
            a if a.error else replace(a, probability=self._probability(self._parsed(a.program), "yes")) for a in answers
        ]

    def _supposing(self, run: "Callable[[Executor], Found]") -> Found:
        """What a run gives for this scene or, if it fails, for the most probable scene for which it does not fail."""
        try:
            return run(self)
        except ExecutionError:
            found = self._possible_scenes.supposed(run)
            if found is None:
                raise
            return found

    def _probability(self, program: Program, answer: Any) -> float | None:
        """How probable an answer to a program is, in the form that `_said` gives; None if that is not known.

        The probabilities of a scene say nothing about speeds and masses.
        """
        if program.tokens[-1] == "query_image_direction":
            steps = program.steps[:-1]
            directions = self._supposing(lambda e: e.facts.quantities.image_directions(e._values(steps)[-1]))
            return directions.get(answer, 0.0)
        tokens = frozenset(program.tokens)
        if not EXTENSIONS.isdisjoint(tokens):
            return None
        share = self._possible_scenes.share(lambda e: e._said(program.result, e._values(program.steps)[-1]), answer)
        return share if share is None or SIMULATED.isdisjoint(tokens) else simulated(share)

    def _told(self, steps: Sequence[Step], values: Sequence[Any]) -> str:
        """The events that a program gives, each in a line."""
        last, events = steps[-1], values[-1]
        if last.token == "counterfact_events":
            return "\n".join(lines_without(self.scene, values[last.inputs[0]], events)) or "none"
        return "\n".join(event_lines(self.scene, events)) or "none"

    def _said(self, kind: Kind, value: Any) -> Any:
        """An answer in words; for a list of events their kinds and the names of their objects, whatever their frames."""
        if not isinstance(value, tuple):
            return _text(kind, value)
        return [(e.kind, *(self.facts.object(i).name for i in e.objects)) for e in value]

    def _values(self, steps: Sequence[Step], choice_name: str = "", n_choice_steps: int = 0) -> list[Any]:
        """Value of every step; an error in one of the first `n_choice_steps` names the choice."""
        values: list[Any] = []
        for index, step in enumerate(steps):
            if step.module is None:
                values.append(step.token)
                continue
            try:
                values.append(step.module.run(self.facts, *[values[i] for i in step.inputs]))
            except ExecutionError as e:
                where = choice_name if index < n_choice_steps else ""
                raise failure(e, steps, index, values, self.facts, where) from None
        return values

    def _trace(self, steps: Sequence[Step], values: Sequence[Any]) -> tuple[TraceStep, ...]:
        trace: list[TraceStep] = []
        for step, value in zip(steps, values, strict=True):
            token, inputs, kind = step.token, step.inputs, step.kind
            if step.module is None:
                shown = TraceStep(token, inputs, kind, value, value)
            elif kind in OF_OBJECTS:
                objects = as_set(value)
                shown = TraceStep(token, inputs, kind, value, self.facts.object_text(objects), objects)
            elif kind in OF_EVENTS:
                events = value if isinstance(value, tuple) else (value,)
                text = self.facts.event_text(events)
                shown = TraceStep(token, inputs, kind, value, text, (), () if isinstance(value, Boundary) else events)
            else:
                objects = tuple(sorted({o for i in inputs for o in trace[i].objects}))
                events = tuple(dict.fromkeys(e for i in inputs for e in trace[i].events))
                shown = TraceStep(token, inputs, kind, value, _text(kind, value), objects, events)
            trace.append(shown)
        return tuple(trace)


def _text(kind: Kind, value: Any) -> str:
    """A word, number, truth value or frame in words."""
    if kind == Kind.FRAME:
        return "the whole video" if value is None else f"frame {value}"
    if kind == Kind.SPEED:
        return f"{value:.1f} {SPEED_UNIT}"
    return {True: "yes", False: "no"}[value] if kind == Kind.BOOLEAN else str(value)


def _complete(program: Program) -> Program:
    if program.needs_choice:
        raise ProgramError("the program judges a choice; pass it to `answer_choices`")
    return program
