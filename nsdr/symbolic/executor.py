"""Runs programs on a scene (paper, section 4.4)."""

from collections.abc import Sequence
from typing import Any

from nsdr.errors import ExecutionError, ProgramError
from nsdr.symbolic.modules import Kind
from nsdr.symbolic.program import ANSWER_KINDS, Program, Step
from nsdr.symbolic.world import World
from nsdr.types import Answer, ChoiceAnswer, Scene, TraceStep

__all__ = ["Executor", "format_trace"]

ProgramSource = str | Sequence[str] | Program


class Executor:
    """Executes programs on one scene.

    Args:
        scene: what programs ask about.
        semantics: "paper", the meaning in the paper and in CLEVRER's own answers.

    Raises:
        ExecutionError: an unknown semantics.
    """

    def __init__(self, scene: Scene, semantics: str = "paper") -> None:
        if semantics != "paper":
            raise ExecutionError(f"semantics {semantics!r} is not known; expected 'paper'")
        self.scene = scene
        self.world = World(scene)

    def run(self, program: ProgramSource) -> Any:
        """The program's value: a word, number, truth value; objects' ids; or `Event`s.

        Raises:
            ProgramError: the program is not well-formed.
            ExecutionError: it does not fit the scene; names step, module and inputs.
        """
        parsed = _complete(Program.parse(program))
        return self._plain(parsed.result, self._values(parsed)[-1])

    def answer(self, program: ProgramSource, question: str = "") -> Answer:
        """Answer a descriptive question: yes, no, a number or an attribute word, with the trace.

        Raises:
            ProgramError, ExecutionError: as `run`; also when the program gives no answer word.
        """
        parsed = _complete(Program.parse(program))
        if parsed.result not in ANSWER_KINDS:
            raise ProgramError(
                f"the program gives {parsed.result}; a question's program ends in a count, exist or query"
            )
        values = self._values(parsed)
        return Answer(question, parsed.tokens, _word(values[-1]), self._trace(parsed, values))

    def judge(
        self, question_program: ProgramSource, choices: Sequence[tuple[str, ProgramSource]], question: str = ""
    ) -> Answer:
        """Answer a multiple-choice question: every choice is run together with the question; yes means correct.

        Args:
            question_program: ends in `belong_to` with its choice open.
            choices: (text, program) pairs.
            question: its text.

        Raises:
            ProgramError, ExecutionError: as `run`.
        """
        parsed = Program.parse(question_program)
        answers = []
        for text, choice in choices:
            whole = Program.parse(choice).then(parsed)
            values = self._values(whole)
            answers.append(
                ChoiceAnswer(text, "correct" if values[-1] else "wrong", whole.tokens, self._trace(whole, values))
            )
        return Answer(question, parsed.tokens, None, (), tuple(answers))

    def _values(self, program: Program) -> list[Any]:
        """Raw value of every step."""
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
        return tuple(self._trace_step(step, value) for step, value in zip(program.steps, values, strict=True))

    def _trace_step(self, step: Step, value: Any) -> TraceStep:
        return TraceStep(
            step.token, step.inputs, step.kind, self._plain(step.kind, value), self._text(step.kind, value)
        )

    def _plain(self, kind: Kind, value: Any) -> Any:
        if kind == Kind.OBJECTS:
            return tuple(o.id for o in self.scene.objects if value >> o.id & 1)
        if kind == Kind.EVENTS:
            return tuple(e for i, e in enumerate(self.world.events) if value >> i & 1)
        if kind == Kind.OBJECT:
            return self.world.attribute(value).id
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


def _complete(program: Program) -> Program:
    if program.needs_choice:
        raise ProgramError("the program judges a choice; give choices")
    return program


def _word(value: Any) -> str:
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)


def format_trace(trace: Sequence[TraceStep]) -> str:
    """The trace as text, one step a line: number, module with the numbers of its inputs, and the result."""
    lines = []
    for number, step in enumerate(trace, 1):
        inputs = ", ".join(str(i + 1) for i in step.inputs)
        call = f"{step.module}({inputs})" if inputs else step.module
        lines.append(f"{number:>3}  {call:<26} {step.text}")
    return "\n".join(lines)
