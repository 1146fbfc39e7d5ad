"""Runs programs on a scene (paper, section 4.4)."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from nsdr.errors import ExecutionError, ProgramError
from nsdr.symbolic.modules import Kind
from nsdr.symbolic.official import OfficialExecutor
from nsdr.symbolic.program import ANSWER_KINDS, SAID_KINDS, Node, Program, ProgramSource
from nsdr.symbolic.world import World, world_of
from nsdr.types import Answer, ChoiceAnswer, Event, Scene, TraceStep

__all__ = ["Executor"]

PREDICTIVE = ("unseen_events", "belong_to")
"""Program of every predictive question."""
CHOICE_STEP = -1 - len(PREDICTIVE)
"""Index, from the end, of the step that gives the choice of a predictive question."""


class Executor:
    """Executes programs on one scene.

    Args:
        scene: the scene; for the official semantics, the content of a prediction file.
        semantics: "paper" follows the paper and CLEVRER's own answers; "official" reproduces the answers of the released
            executor on its prediction files, including its quirks: all methods return what those of
            `nsdr.symbolic.official.OfficialExecutor` do, and never raise an exception on a program.
        collisions: "predicted"; with the official semantics also "velocity", the variant NE.

    Raises:
        ExecutionError: unknown semantics, or semantics that do not fit the type of the scene or the kind of collisions.
    """

    def __init__(
        self, scene: Scene | Mapping[str, Any], semantics: str = "paper", collisions: str = "predicted"
    ) -> None:
        if semantics not in ("paper", "official"):
            raise ExecutionError(f"unknown semantics {semantics!r}; expected 'paper' or 'official'")
        self.semantics = semantics
        if isinstance(scene, Scene) == (semantics == "official"):
            expected = "the content of a prediction file" if semantics == "official" else "a Scene"
            raise ExecutionError(f"the {semantics} semantics runs on {expected}, got a {type(scene).__name__}")
        self._official: OfficialExecutor | None = None
        if not isinstance(scene, Scene):
            self._official = OfficialExecutor(scene, collisions)
            return
        if collisions != "predicted":
            raise ExecutionError(f"collisions {collisions!r} need the official semantics")
        self.world = world_of(scene)
        self.unseen_scores = scene.unseen_scores

    def run(self, program: ProgramSource) -> Any:
        """Run a program.

        Returns:
            Its value: a word, number or truth value, object ids, or `Event`s.

        Raises:
            ProgramError: the program is not well-formed.
            ExecutionError: it does not fit the scene; names step, module and inputs.
        """
        if self._official is not None:
            return self._official.run(program)
        parsed = _complete(Program.parse(program))
        try:
            value = _evaluate(parsed.root, self.world, {})
        except ExecutionError:
            raise self._error(parsed) from None
        return value if parsed.answers else self._plain(parsed.result, value)

    def run_batch(self, programs: Iterable[ProgramSource]) -> list[Any]:
        """Run many programs; sub-programs that they share are executed once.

        Returns:
            For each program its value as from `run`, or the `ExecutionError` that `run` would raise.

        Raises:
            ProgramError: a program is not well-formed.
        """
        if self._official is not None:
            return self._official.run_batch(programs)
        shared: dict[Node, Any] = {}
        world = self.world
        results: list[Any] = []
        for source in programs:
            program = _complete(source if type(source) is Program else Program.parse(source))
            value = shared.get(program.root)
            if value is None:
                try:
                    value = _evaluate(program.root, world, shared)
                except ExecutionError:
                    results.append(self._error(program))
                    continue
            results.append(value if program.answers else self._plain(program.result, value))
        return results

    def _error(self, program: Program) -> ExecutionError:
        """The error of a failing program, found by running it step by step, so that it names the step."""
        try:
            self._values(program)
        except ExecutionError as e:
            return e
        raise AssertionError(f"{program} fails only when sub-programs are shared")

    def answer(self, program: ProgramSource, question: str = "") -> Answer:
        """Answer a descriptive question.

        Returns:
            The answer with its trace: yes, no, a number, an attribute word, "frame N", or events such as "the red metal
            cube exits (frame 130)", separated by semicolons ("none" if there are none).

        Raises:
            ProgramError: the program is not well-formed, or does not give an answer.
            ExecutionError: it does not fit the scene; names step, module and inputs.
        """
        if self._official is not None:
            return self._official.answer(program, question)
        parsed = _complete(Program.parse(program))
        if parsed.result not in SAID_KINDS:
            raise ProgramError(
                f"the program gives {parsed.result}; the program of a question ends in a count, exist, query or frame"
            )
        values = self._values(parsed)
        return Answer(question, parsed.tokens, self._text(parsed.result, values[-1]), self._trace(parsed, values))

    def judge(
        self, question_program: ProgramSource, choices: Sequence[tuple[str, ProgramSource]], question: str = ""
    ) -> Answer:
        """Answer a multiple-choice question: each choice is joined with the question into one program, and "yes" is correct.

        Exactly one of the two choices of a predictive question is correct (a rule of CLEVRER). If both are judged alike and
        the scene has scores of unseen collisions, the choice with the higher score is the correct one.

        Args:
            question_program: ends in `belong_to`, which takes the choice (`Program.needs_choice`).
            choices: (text, program) pairs.
            question: text of the question.

        Raises:
            ProgramError: a program is not well-formed, or is not that of a question or choice.
            ExecutionError: a program does not fit the scene; names step, module and inputs.
        """
        if self._official is not None:
            return self._official.judge(question_program, choices, question)
        parsed = Program.parse(question_program)
        answers = []
        for text, choice in choices:
            whole = Program.parse(choice).then(parsed)
            values = self._values(whole)
            answers.append(
                ChoiceAnswer(text, "correct" if values[-1] else "wrong", whole.tokens, self._trace(whole, values))
            )
        if parsed.tokens == PREDICTIVE and len(answers) == 2 and answers[0].answer == answers[1].answer:
            answers = self._likelier(answers)
        return Answer(question, parsed.tokens, None, (), tuple(answers))

    def _likelier(self, answers: Sequence[ChoiceAnswer]) -> list[ChoiceAnswer]:
        """The two choices of a predictive question, judged by the scores of their collisions."""
        scores = self.unseen_scores
        if scores is None:
            return list(answers)
        chosen = [a.trace[CHOICE_STEP].value for a in answers]
        if not all(isinstance(e, Event) and e.kind == "collision" for e in chosen):
            return list(answers)
        first, second = (scores[e.objects] for e in chosen)
        words = ("correct", "wrong") if first >= second else ("wrong", "correct")
        return [replace(a, answer=word) for a, word in zip(answers, words, strict=True)]

    def _values(self, program: Program) -> list[Any]:
        """Value of every step as the modules pass it on: sets are integers."""
        values: list[Any] = []
        world = self.world
        for number, step in enumerate(program.steps, 1):
            if step.module is None:
                values.append(step.token)
                continue
            try:
                values.append(step.module.run(world, *[values[i] for i in step.inputs]))
            except ExecutionError as e:
                inputs = ", ".join(self._text(program.steps[i].kind, values[i]) for i in step.inputs)
                raise ExecutionError(f"step {number} {step.token}({inputs}): {e}") from None
        return values

    def _trace(self, program: Program, values: Sequence[Any]) -> tuple[TraceStep, ...]:
        trace: list[TraceStep] = []
        for step, value in zip(program.steps, values, strict=True):
            plain = self._plain(step.kind, value)
            objects: tuple[int, ...] = ()
            events: tuple[Event, ...] = ()
            if step.kind in (Kind.OBJECTS, Kind.OBJECT):
                objects = plain if step.kind == Kind.OBJECTS else (plain,)
            elif step.kind in (Kind.EVENTS, Kind.EVENT):
                events = plain if step.kind == Kind.EVENTS else (plain,)
            else:
                objects = tuple(sorted({o for i in step.inputs for o in trace[i].objects}))
                events = tuple(dict.fromkeys(e for i in step.inputs for e in trace[i].events))
            text = self._text(step.kind, value)
            trace.append(TraceStep(step.token, step.inputs, step.kind, plain, text, objects, events))
        return tuple(trace)

    def _plain(self, kind: Kind, value: Any) -> Any:
        if kind in ANSWER_KINDS:
            return value
        if kind == Kind.OBJECTS:
            return tuple(o.id for o in self.world.objects if value >> o.id & 1)
        if kind == Kind.EVENTS:
            return tuple(e for i, e in enumerate(self.world.events) if value >> i & 1)
        if kind == Kind.OBJECT:
            return self.world.object(value).id
        return self.world.event(value) if kind == Kind.EVENT else value

    def _text(self, kind: Kind, value: Any) -> str:
        if kind in (Kind.OBJECTS, Kind.OBJECT):
            return self.world.object_text(value)
        if kind == Kind.EVENTS and value == self.world.possible:
            return f"{value.bit_count()} possible events"
        if kind in (Kind.EVENTS, Kind.EVENT):
            return self.world.event_text(value & self.world.members)
        if kind == Kind.FRAME:
            return "the whole video" if value is None else f"frame {value}"
        return _word(value)


def _evaluate(node: Node, world: World, known: dict[Node, Any]) -> Any:
    """Value of a sub-program, stored in `known`. None, the value of `null`, counts as unknown and is computed again."""
    left = node.left
    if left is None:
        value = node.run(world)
    else:
        first = known.get(left)
        if first is None:
            first = _evaluate(left, world, known)
        if node.word is not None:
            value = node.run(world, first, node.word)
        elif node.right is None:
            value = node.run(world, first)
        else:
            second = known.get(node.right)
            if second is None:
                second = _evaluate(node.right, world, known)
            value = node.run(world, first, second)
    known[node] = value
    return value


def _complete(program: Program) -> Program:
    if program.needs_choice:
        raise ProgramError("the program judges a choice; pass it to `judge` with choices")
    return program


def _word(value: Any) -> str:
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)
