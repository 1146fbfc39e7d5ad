"""Runs programs on a scene (paper, section 4.4)."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from operator import attrgetter
from string import ascii_uppercase
from typing import Any

from nsdr.clevrer.files.predictions import PredictionFile
from nsdr.errors import ExecutionError, NsdrError, ProgramError
from nsdr.symbolic.failures import failure
from nsdr.symbolic.joint import exactly_one, with_probabilities
from nsdr.symbolic.modules import EXTENSIONS, Kind
from nsdr.symbolic.official import OfficialExecutor
from nsdr.symbolic.possible_worlds import PossibleWorlds
from nsdr.symbolic.postfix import NotQuick, PhraseTable, PostfixRunner
from nsdr.symbolic.program import ANSWER_KINDS, SAID_KINDS, Program, ProgramSource, program_tokens
from nsdr.symbolic.quantities import Simulate
from nsdr.symbolic.responsibility import check_meaning, judgements
from nsdr.symbolic.world import world_of
from nsdr.types import Answer, ChoiceAnswer, Event, Scene, TraceStep
from nsdr.types.answers import with_lazy
from nsdr.world.vocabulary import SPEED_UNIT

__all__ = ["Executor"]

PREDICTIVE = ("unseen_events", "belong_to")
"""Program of every predictive question."""
PHRASES = PhraseTable(attrgetter("run"))


class Executor:
    """Executes programs on one scene.

    Args:
        scene: the scene; for the official semantics, the content of a prediction file.
        semantics: "paper" follows the paper and CLEVRER's own answers; "official" reproduces the answers of the released
            executor on its prediction files, including its quirks: all methods return what those of
            `nsdr.symbolic.official.OfficialExecutor` do, and never raise an exception on a program.
        collisions: "predicted"; with the official semantics also "velocity", the variant NE.
        responsible: meaning of "responsible" in explanatory questions: "chain" is CLEVRER's, "but_for" what would not have
            happened without (`nsdr.symbolic.responsibility`). Choices carry both (`ChoiceAnswer.meanings`).
        simulate: gives the collisions with an object changed, for questions beyond CLEVRER such as "what if the cube were twice
            as heavy" (`nsdr.symbolic.quantities`); None refuses them.

    Raises:
        ExecutionError: unknown semantics or meaning, or semantics that do not fit the type of the scene, the kind of collisions
            or the meaning.
    """

    def __init__(
        self,
        scene: Scene | PredictionFile,
        semantics: str = "paper",
        collisions: str = "predicted",
        responsible: str = "chain",
        simulate: Simulate | None = None,
    ) -> None:
        check_meaning(responsible)
        if semantics not in ("paper", "official"):
            raise ExecutionError(f"unknown semantics {semantics!r}; expected 'paper' or 'official'")
        self.semantics = semantics
        expected = PredictionFile if semantics == "official" else Scene
        if not isinstance(scene, expected):
            raise ExecutionError(
                f"the {semantics} semantics runs on a {expected.__name__}, got a {type(scene).__name__}"
            )
        self._official: OfficialExecutor | None = None
        self.responsible = responsible
        if not isinstance(scene, Scene):
            if responsible != "chain":
                raise ExecutionError(f"responsible {responsible!r} needs the paper semantics")
            self._official = OfficialExecutor(scene, collisions)
            return
        if collisions != "predicted":
            raise ExecutionError(f"collisions {collisions!r} need the official semantics")
        self.scene = scene
        self.world = world_of(scene, simulate)
        self._runner = PostfixRunner(PHRASES, self.world)
        self._shown: dict[tuple[Kind, Any], tuple[Any, str]] = {}
        self.unseen_scores = scene.unseen_scores
        make = partial(Executor, responsible=responsible)
        self._worlds = None if scene.uncertain is None else PossibleWorlds(scene, make)

    def run(self, program: ProgramSource) -> Any:
        """Run a program.

        Returns:
            Its value: a word, number or truth value, object ids, or `Event`s.

        Raises:
            ProgramError: the program is not well-formed.
            ExecutionError: it does not fit the scene; says what was asked for and what the scene has.
        """
        if self._official is not None:
            return self._official.run(program)
        value, kind, answers = self._value(program)
        return value if answers else self._plain(kind, value)

    def run_batch(self, programs: Iterable[ProgramSource]) -> list[Any]:
        """Run many programs.

        Returns:
            For each program its value as from `run`, or the `ExecutionError` that `run` would raise.

        Raises:
            ProgramError: a program is not well-formed.
        """
        if self._official is not None:
            return self._official.run_batch(programs)
        results: list[Any] = []
        run = self._runner.run
        for program in programs:
            try:
                value, kind, answers = run(program)
                results.append(value if answers else self._plain(kind, value))
            except (NotQuick, ExecutionError):
                try:
                    results.append(self.run(program))
                except ExecutionError as e:
                    results.append(e)
        return results

    def _value(self, source: ProgramSource) -> tuple[Any, Kind, bool]:
        """A program's value, its type, and whether it is a word, number or truth value; errors are those of `run`."""
        try:
            return self._runner.run(source)
        except (NotQuick, ExecutionError):  # step by step, so that the error names the step
            program = _complete(Program.parse(source))
            return self._values(program)[-1], program.result, program.answers

    def answer(self, program: ProgramSource, question: str = "") -> Answer:
        """Answer a descriptive question.

        A question supposes that what it names happened: where that fails in the most probable world, it is answered in the
        most probable one where it does not, unless that is too improbable (`nsdr.symbolic.possible_worlds.MIN_SUPPOSED`).

        Returns:
            The answer (yes, no, a number, an attribute word, a frame, or a list of events) with its trace.

        Raises:
            ProgramError: the program is not well-formed, or does not give an answer.
            ExecutionError: it does not fit the scene; says what was asked for and what the scene has.
        """
        if self._official is not None:
            return self._official.answer(program, question)
        try:
            return self._answered(program, question)
        except ExecutionError:
            worlds = self._worlds
            if worlds is None:
                raise
            found = worlds.supposed(lambda e: (e.answer(program, question), e.run(program)))
            if found is None:
                raise
        answer, value = found
        if not EXTENSIONS.isdisjoint(answer.program):
            return answer
        return with_lazy(answer, probability=partial(worlds.probability, answer.program, value))

    def _answered(self, program: ProgramSource, question: str) -> Answer:
        try:
            value, kind, _ = self._runner.run(program)
            tokens = program_tokens(program)
        except (NotQuick, ExecutionError):
            parsed = _complete(Program.parse(program))
            tokens, kind = parsed.tokens, parsed.result
            value = self._values(parsed, question)[-1] if kind in SAID_KINDS else None
        if kind not in SAID_KINDS:
            raise ProgramError(
                f"the program gives {kind}; the program of a question ends in a count, exist, query or frame"
            )
        answer = with_lazy(Answer(question, tokens, self._answer_text(kind, value)), trace=partial(self._trace, tokens))
        if self._worlds is None or not EXTENSIONS.isdisjoint(tokens):  # uncertain say nothing about speeds and masses
            return answer
        return with_lazy(answer, probability=partial(self._probability, tokens))

    def _probability(self, program: tuple[str, ...]) -> float:
        assert self._worlds is not None
        return self._worlds.probability(program, self.run(program))

    def _answer_text(self, kind: Kind, value: Any) -> str:
        if kind == Kind.EVENTS:
            return "\n".join(self.world.event_sentences(value & self.world.members)) or "none"
        return self._text(kind, value)

    def judge(
        self,
        question_program: ProgramSource,
        choices: Sequence[tuple[str, ProgramSource | NsdrError]],
        question: str = "",
    ) -> Answer:
        """Answer a multiple-choice question: each choice is joined with the question into one program, and "yes" is correct.

        A choice that fails has an `error` in place of an answer, and the others are judged.

        Exactly one of the two choices of a predictive question is correct (a rule of CLEVRER). If both are judged alike and
        the scene has scores of unseen collisions, the choice with the higher score is the correct one. Hardly any
        counterfactual question has no correct choice: if all come out wrong, the scene's uncertain may say which one is correct
        (`nsdr.symbolic.joint`). What the question and each choice suppose is taken as by `answer`. A choice of an explanatory
        question of which it is not known whether the event needed it has an `error` if that is what "responsible" means.

        Args:
            question_program: ends in `belong_to`, which takes the choice (`Program.needs_choice`).
            choices: (text, program) pairs; for a text without a program, the reason.
            question: text of the question.

        Raises:
            ProgramError: a program is not well-formed, or is not that of a question or choice.
            ExecutionError: the question's program does not fit the scene; says what was asked for and what the scene has.
        """
        if self._official is not None:
            return self._official.judge(question_program, choices, question)
        parsed = Program.parse(question_program)
        try:
            answers = self._all_judged(parsed, choices, question)
        except ExecutionError:
            if self._worlds is None:
                raise
            found = self._worlds.supposed(lambda e: e._all_judged(parsed, choices, question))
            if found is None:
                raise
            answers = found
        if "filter_ancestor" in parsed.tokens:
            answers = [self._explained(answer) for answer in answers]
        return Answer(question, parsed.tokens, None, (), tuple(self._judged_together(parsed, answers, choices)))

    def _all_judged(
        self, parsed: Program, choices: Sequence[tuple[str, ProgramSource | NsdrError]], question: str
    ) -> list[ChoiceAnswer]:
        """The choices, one by one."""
        answers = []
        for number, (text, choice) in enumerate(choices):
            if isinstance(choice, NsdrError):
                answers.append(ChoiceAnswer(text, None, (), (), str(choice)))
                continue
            tokens = program_tokens(choice)
            try:
                answers.append(self._judged(parsed, text, tokens))
            except NotQuick:
                name = f"choice {ascii_uppercase[number]}" if 1 < len(choices) <= len(ascii_uppercase) else "the choice"
                answers.append(self._judged_by_steps(parsed, question, text, tokens, name))
        return answers

    def _explained(self, choice: ChoiceAnswer) -> ChoiceAnswer:
        """The choice of an explanatory question with both meanings, judged by the one that is asked for."""
        if choice.error:
            return choice
        if self.responsible == "chain":
            return with_lazy(choice, meanings=lambda: judgements(choice.trace, self.scene))
        trace = choice.trace
        found = judgements(trace, self.scene)
        correct = found.get("but_for")
        if correct is None:
            error = "whether it would have happened without it is not known in this scene"
            return ChoiceAnswer(choice.choice, None, choice.program, (), error, meanings=found)
        return ChoiceAnswer(choice.choice, "correct" if correct else "wrong", choice.program, trace, meanings=found)

    def value_meant(self, program: tuple[str, ...]) -> Any:
        """A program's value as of `run`; of a choice of an explanatory question, by the meaning of "responsible" asked for."""
        if self.responsible == "chain" or "filter_ancestor" not in program:
            return self.run(program)
        return judgements(self._trace(program), self.scene).get("but_for")

    def _judged(self, question: Program, text: str, choice: tuple[str, ...]) -> ChoiceAnswer:
        """The judgement of a choice; raises `NotQuick` where `_judged_by_steps` is needed."""
        tokens = choice + question.tokens
        if not question.needs_choice:
            raise NotQuick
        try:
            correct = self._runner.run(tokens)[0]
        except ExecutionError:
            raise NotQuick from None
        answer = ChoiceAnswer(text, "correct" if correct else "wrong", tokens, ())
        return with_lazy(answer, trace=partial(self._trace, tokens))

    def _judged_by_steps(
        self, question: Program, question_text: str, text: str, choice: tuple[str, ...], choice_name: str
    ) -> ChoiceAnswer:
        whole = Program.parse(choice).then(question)
        try:
            n_choice_steps = len(whole.steps) - len(question.steps)
            value = self._values(whole, question_text, text, choice_name, n_choice_steps)[-1]
        except ExecutionError as e:
            self._check_question(question, question_text)
            found = None if self._worlds is None else self._worlds.supposed(lambda w: (w.run(whole.tokens), w._trace))
            if found is None:
                return ChoiceAnswer(text, None, whole.tokens, (), str(e))
            value, trace = found
        else:
            trace = self._trace
        answer = ChoiceAnswer(text, "correct" if value else "wrong", whole.tokens, ())
        return with_lazy(answer, trace=partial(trace, whole.tokens))

    def _check_question(self, program: Program, question: str) -> None:
        """Raise the error of a multiple-choice question that fails whatever the choice is."""
        takes_choice = next(i for i, step in enumerate(program.steps) if -1 in step.inputs)
        self._values(replace(program, steps=program.steps[:takes_choice]), question)

    def _judged_together(
        self, question: Program, answers: Sequence[ChoiceAnswer], choices: Sequence[tuple[str, Any]]
    ) -> Sequence[ChoiceAnswer]:
        """The choices, judged by what is known of their question, with probabilities where the scene has uncertain."""
        if question.tokens == PREDICTIVE and len(answers) == 2 and not any(a.error for a in answers):
            unsettled = self._worlds is not None or answers[0].answer == answers[1].answer
            scores = self._scores([choice for _, choice in choices]) if unsettled else None
            if scores is not None:
                return exactly_one(answers, scores, self._worlds is not None)
        if self._worlds is None or not EXTENSIONS.isdisjoint(question.tokens):
            return answers
        return with_probabilities(answers, self._worlds.draws, "get_counterfact" in question.tokens)

    def _scores(self, programs: Sequence[Any]) -> tuple[float, float] | None:
        """Scores of two collisions after the video; None where there are none."""
        chosen = [self.run(program) for program in programs]
        if self.unseen_scores is None or not all(isinstance(e, Event) and e.kind == "collision" for e in chosen):
            return None
        first, second = (float(self.unseen_scores[e.objects]) for e in chosen)
        return first, second

    def _values(
        self, program: Program, question: str = "", choice: str = "", choice_name: str = "", n_choice_steps: int = 0
    ) -> list[Any]:
        """Value of every step as the modules pass it on: sets are integers.

        The texts are for the message of an error; the first `n_choice_steps` steps are those of the choice.
        """
        values: list[Any] = []
        world = self.world
        for index, step in enumerate(program.steps):
            if step.module is None:
                values.append(step.token)
                continue
            try:
                values.append(step.module.run(world, *[values[i] for i in step.inputs]))
            except ExecutionError as e:
                text, where = (choice, choice_name) if index < n_choice_steps else (question, "")
                raise failure(e, program, index, values, world, text, where) from None
        return values

    def _trace(self, tokens: tuple[str, ...]) -> tuple[TraceStep, ...]:
        program = Program.parse(tokens)
        trace: list[TraceStep] = []
        for step, value in zip(program.steps, self._values(program), strict=True):
            shown = self._shown.get((step.kind, value))
            if shown is None:
                shown = self._shown[step.kind, value] = self._plain(step.kind, value), self._text(step.kind, value)
            plain, text = shown
            objects: tuple[int, ...] = ()
            events: tuple[Event, ...] = ()
            if step.kind in (Kind.OBJECTS, Kind.OBJECT):
                objects = plain if step.kind == Kind.OBJECTS else (plain,)
            elif step.kind in (Kind.EVENTS, Kind.EVENT):
                events = plain if step.kind == Kind.EVENTS else (plain,)
            else:
                objects = tuple(sorted({o for i in step.inputs for o in trace[i].objects}))
                events = tuple(dict.fromkeys(e for i in step.inputs for e in trace[i].events))
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
        if kind == Kind.SPEED:
            return f"{value:.1f} {SPEED_UNIT}"
        return _word(value)


def _complete(program: Program) -> Program:
    if program.needs_choice:
        raise ProgramError("the program judges a choice; pass it to `judge` with choices")
    return program


def _word(value: Any) -> str:
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)
